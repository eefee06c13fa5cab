//! Scenes with known truth, authored in f64 and returned as plain records. No files are read or written here.
//!
//! ```text
//! splats  Gaussian scenes      objects       closed painted meshes        cameras  training, test, ring and head views
//! figure  a causal figure      environments  skies, studios, rooms        poison   numbers that break programs
//! draws   numbers by counter   surface, light   the records of meshes and maps
//! ```
//!
//! Every number that looks random is drawn by counter (`reference::num::rng`): the same arguments give the same bits. Which
//! purpose stands for what is listed in the modules named `purpose`, [`splats::purpose`], [`objects::purpose`],
//! [`environments::purpose`] and [`cameras::purpose`] among them.
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
