//! Scenes with known truth, authored in f64 and returned as plain records. No files are read or written here.
//!
//! Every number that looks random is drawn by counter (`reference::num::rng`): the same arguments give the same bits. Which
//! purpose stands for what is listed in [`splats::purpose`].
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
