//! Bodies that move: rotations of joints, linear blend skinning.
//!
//! ```text
//! pose, correction, joints, parents ── pose ──► joint transforms (J, 3, 4)
//!
//! rest points, rest factors ─┐
//! weights, joint transforms ─┴─ skin ──► posed points, posed factors
//! ```
//!
//! `skin` is called by `data-gen` too, which poses its figure with it.

pub mod pose;
pub mod rest;
pub mod skin;
