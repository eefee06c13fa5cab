//! Small geometric functions, each next to its adjoint, with one body for `f32` and `f32x8` where vector
//! lanes save time. Level 1.
//!
//! ```text
//! affine    transforms of space, their composition and inverse, with adjoints
//! dense     Cholesky factors, linear systems and inverses of small f64 matrices
//! digraph   directed graphs on a few nodes: order, descendants, d-separation
//! knn       mean squared distance to the three nearest neighbours: initial scales
//! principal the axis of largest variance of a set of points
//! quat      rotation matrix of a quaternion of any length
//! rodrigues rotation matrix of an axis times an angle, and back
//! sh        real spherical harmonics up to degree 3
//! vector    unit vectors
//! ```
//!
//! `splat` (quat, sh) and `fit` (knn) call these functions as loop bodies. The metrics and learners of causal
//! structure use dense, digraph and principal; body poses use affine and rodrigues.

pub mod affine;
pub mod dense;
pub mod digraph;
pub mod knn;
pub mod principal;
pub mod quat;
pub mod rodrigues;
pub mod sh;
pub mod vector;
