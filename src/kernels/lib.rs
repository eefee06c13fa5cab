//! Levels 4 to 6 of lastlight: layers, geometry, renderers, light, causal operators, bodies and losses, each
//! with its adjoint.
//!
//! ```text
//! nn, geometry                 layers; rays, triangles and distances          level 4
//! splat, shade, causal, body   renderers, light, factors, skinned bodies      level 5
//! loss                         losses of images, points and groups; metrics   level 6
//! ```
#![forbid(unsafe_code)]

pub mod body;
pub mod causal;
pub mod geometry;
pub mod loss;
pub mod nn;
pub mod shade;
pub mod splat;

#[doc(hidden)]
pub use lastlight_files as io;
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
#[doc(hidden)]
pub use lastlight_scene as scene;
