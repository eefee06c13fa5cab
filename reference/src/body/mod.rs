//! Articulated bodies: rotations of joints, linear blend skinning.
//!
//! ```text
//! pose, correction, joints, parents ── pose ──► joint transforms (J, 3, 4)
//!
//! rest points, rest factors ─┐
//! weights, joint transforms ─┴─ skin ──► posed points, posed factors
//! ```
//!
//! `data-gen` also calls `skin`, to pose its figure.

pub mod pose;
pub mod rest;
pub mod skin;
