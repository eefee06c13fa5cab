//! Levels 9 and 11 of lastlight: the operator list, and its commands on user-supplied arrays.
//!
//! ```text
//! ops      the operator list: signatures, runs, generated cases    level 9
//! oracle   run, compare, mint, gradient checks of the list         level 11
//! ```
#![forbid(unsafe_code)]

pub mod ops;
pub mod oracle;

#[doc(hidden)]
pub use lastlight_files as io;
#[doc(hidden)]
pub use lastlight_kernels::{body, causal, field, geometry, loss, nn, shade, splat};
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
#[doc(hidden)]
pub use lastlight_scene as scene;
#[doc(hidden)]
pub use lastlight_train::{check, fit, optim, tape};
