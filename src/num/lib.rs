//! Levels 0 and 1 of lastlight: the error type, the operations that determine bits, and small geometric
//! functions.
//!
//! ```text
//! error   the error type: what, where, expected, got, and a suggestion                    level 0
//! num     lanes, elementary functions, sums, matrix products, threads, random numbers     level 0
//! math    small geometric functions, each next to its adjoint                             level 1
//! ```
//!
//! The root of every member re-exports the modules that its code may use, both its own and those of lower
//! levels. A path such as `crate::num::par` is therefore the same in every member and in the library itself.
#![forbid(unsafe_code)]

pub mod error;
pub mod math;
pub mod num;

pub use error::{Error, Result};
