//! Small geometry, one body for `f32` and `f32x8` where lanes pay, each function beside its adjoint. Level 1.
//!
//! ```text
//! affine    transforms of space, their composition and inverse, with adjoints
//! dense     triangles, solutions and inverses of small f64 matrices
//! digraph   directed graphs on a few nodes: order, descendants, d-separation
//! knn       mean squared distance to the three nearest neighbours: initial scales
//! principal the axis along which points vary most
//! quat      rotation matrix of a quaternion of any length
//! rodrigues rotation matrix of an axis times an angle, and back
//! sh        real spherical harmonics up to degree 3
//! vector    unit vectors
//! ```
//!
//! Called by `splat` (quat, sh) and `fit` (knn), where the caller owns the loops and these are the bodies; by scores and learners of causal
//! structure (dense, digraph, principal); by poses of bodies (affine, rodrigues).

pub mod affine;
pub mod dense;
pub mod digraph;
pub mod knn;
pub mod principal;
pub mod quat;
pub mod rodrigues;
pub mod sh;
pub mod vector;
