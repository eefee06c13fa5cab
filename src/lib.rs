//! lastlight: a bit-reproducible CPU reference of two differentiable-rendering systems.
#![forbid(unsafe_code)]

pub mod error;
pub mod num;

pub use error::{Error, Result};
pub use tape::check;
pub mod fit;
pub mod io;
pub mod loss;
pub mod math;
pub mod nn;
pub mod ops;
pub mod optim;
pub mod oracle;
pub mod scene;
pub mod splat;
pub mod tape;
#[doc(hidden)]
pub mod cli;
