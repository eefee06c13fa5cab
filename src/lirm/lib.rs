//! The LIRM system. Level 10.
//!
//! ```text
//! gen       data sets of rendered objects: training, test and egocentric pictures with their passes
//! settings  what decides a set                shots     cameras, names and split of its pictures
//! folder    how a set is begun, continued, started over
//! subject   the object of a set, and its light
//! exposure  photographs of an object brought to one brightness, for training
//! truth     both as files
//! ```
#![forbid(unsafe_code)]

#[doc(hidden)]
pub extern crate self as lirm;

pub mod exposure;
mod folder;
pub mod r#gen;
mod settings;
mod shots;
pub mod subject;
pub mod truth;

#[doc(hidden)]
pub use lastlight_import::{io, scene};
#[doc(hidden)]
pub use lastlight_kernels::{body, causal, geometry, loss, nn, shade, splat};
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
#[doc(hidden)]
pub use lastlight_train::{check, fit, optim, tape};
