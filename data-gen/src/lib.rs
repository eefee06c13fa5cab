//! Synthetic scenes with known truth, generated in f64 and returned as plain data. No files are read or
//! written here.
//!
//! ```text
//! splats  Gaussian scenes      objects       closed textured meshes       cameras  training, test, ring and
//! head views
//! figure  a causal figure      environments  skies, studios, rooms        poison   numerically critical
//! values
//! draws   counter-based draws  surface, light   data types of meshes and maps
//! ```
//!
//! All random numbers are counter-based (`reference::num::rng`): the same arguments give the same bits. The
//! modules named `purpose` list the purpose numbers, among them [`splats::purpose`], [`objects::purpose`],
//! [`environments::purpose`] and [`cameras::purpose`].
#![forbid(unsafe_code)]

pub mod cameras;
pub mod draws;
pub mod environments;
pub mod figure;
pub mod light;
mod noise;
pub mod objects;
pub mod poison;
mod space;
pub mod splats;
pub mod surface;
