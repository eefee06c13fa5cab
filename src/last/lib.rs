//! The LAST system. Level 10.
//!
//! ```text
//! figure    the built-in person: points, surfaces, light ──┬─► sets      images and points of known causes, in shards
//! character a person from a file, likewise
//! subject   the interface of any moving person ────────────┴─► video     a capture with poses
//! generate  generates and records the sets; settings: their settings; folder: created, resumed, overwritten
//! points    points and how they are drawn                      image_source  the subject of the images
//! structure structure learners on known factors: exact, local, relaxed
//! model     the image-to-point model and its graph     avatar    a person of Gaussians, fitted with its guidance
//! inspect   checks a capture of a person and draws overlays on its images
//! ```
//!
//! The causal truth comes from `data_gen::figure` in f64; this member renders and writes it. The experiments
//! on this system are in the member `study`, which the library re-exports as `lastlight::last::study`.
#![forbid(unsafe_code)]

#[doc(hidden)]
pub extern crate self as last;

pub mod avatar;
pub mod character;
mod character_settings;
pub mod figure;
mod folder;
pub mod generate;
pub mod image_source;
pub mod inspect;
pub mod model;
pub mod points;
mod progress;
pub mod sets;
mod settings;
pub mod structure;

pub mod subject;

#[doc(hidden)]
pub use lastlight_import::{io, scene};
#[doc(hidden)]
pub use lastlight_kernels::{body, causal, geometry, loss, nn, shade, splat};
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
#[doc(hidden)]
pub use lastlight_train::{check, fit, optim, tape};
