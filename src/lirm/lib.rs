//! The LIRM system. Level 10.
//!
//! ```text
//! gen       data sets of rendered objects: training, test and egocentric images with their passes
//! settings  settings of a set                 shots     cameras, names and split of its images
//! folder    how a set is created, resumed, overwritten
//! subject   the object of a set, and its light
//! truth     object and light as files
//! views     the images of one object in memory: rendered by index, or read from a capture
//! model     the transformer that turns images into a field      train     its stages
//! reading   images of a capture as the model reads them, set by set
//! reconstruct  sets of images after a state, or after none: a state, its field, scores
//! protocol  how a model is scored: objects, inputs, controls, constants
//! evaluate  scores of a model on unseen objects                  baselines what it has to beat
//! ```
#![forbid(unsafe_code)]

#[doc(hidden)]
pub extern crate self as lirm;

pub mod baselines;
pub mod evaluate;
mod folder;
pub mod r#gen;
pub mod model;
mod protocol;
pub mod reading;
pub mod reconstruct;
mod settings;
mod shots;
pub mod subject;
pub mod train;
pub mod truth;
pub mod views;

#[doc(hidden)]
pub use lastlight_import::{io, scene};
#[doc(hidden)]
pub use lastlight_kernels::{body, causal, field, geometry, loss, nn, shade, splat};
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
#[doc(hidden)]
pub use lastlight_train::{check, fit, optim, tape};
