//! Validated, typed scenes. Level 3: the last place that returns data errors.
//!
//! ```text
//! io (plain records) ──► scene ──► splat, fit, …
//! camera     one pinhole, orthographic or fisheye view      profile    the constants of a splatting semantics
//! gaussians  stored, unconstrained parameters of a scene    views      photos with cameras, undistorted
//! columns    their five arrays, one after the other
//! convert    scenes of Gaussians from file to file          mesh       triangles, and objects made of them
//! material   metallic-roughness, textures                   light      environment maps, lamps
//! passes     renderer's passes of a photo                   bound      the projected box of what a camera sees
//! rays       Plücker coordinates of the rays of a view
//! field      feature planes, panoramas and heads of an object
//! from_data_gen  generated surfaces, maps and views as objects, environments and cameras
//! ```
#![forbid(unsafe_code)]

pub mod bound;
pub mod camera;
pub mod columns;
pub mod convert;
pub mod environment_file;
pub mod field;
pub mod from_data_gen;
pub mod gaussians;
pub mod lens;
pub mod light;
pub mod material;
pub mod mesh;

pub mod passes;
pub mod person;
pub mod placement;
pub mod profile;
pub mod rays;
pub mod views;

#[doc(hidden)]
pub extern crate self as scene;
#[doc(hidden)]
pub use lastlight_files as io;
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
