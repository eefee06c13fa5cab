//! Levels 0 and 1 of lastlight: the error type, where bits are decided, small geometry.
//!
//! ```text
//! error   the one error type: what, where, expected, got, what to do                      level 0
//! num     lanes, elementary functions, sums, matrix products, threads, random numbers     level 0
//! math    small geometry, each function beside its adjoint                                level 1
//! ```
//!
//! Every member's root names the modules it may use, its own and those below, so that a path such as `crate::num::par` reads the same in
//! every member and in the library itself.
#![forbid(unsafe_code)]

pub mod error;
pub mod math;
pub mod num;

pub use error::{Error, Result};
