//! Small geometry, one body for `f32` and `f32x8` where lanes pay, each function beside its adjoint. Level 1.
//!
//! ```text
//! knn    mean squared distance to the three nearest neighbours: initial scales
//! quat   rotation matrix of a quaternion of any length
//! sh     real spherical harmonics up to degree 3
//! ```
//!
//! Called by `splat` (quat, sh) and `fit` (knn); the caller owns the loops, these are the bodies.

pub mod knn;
pub mod quat;
pub mod sh;
