//! Gaussian splatting: from parameters to pictures and back. Level 5.
//!
//! ```text
//! activate    stored scales, opacities ──► linear scales, opacities in 0..1
//! covariance  quats, scales ──► factors F = R·S                (or factors come from a skinned body)
//! project     means, factors, camera ──► means_px, depths_z, shape (s, k1, k2), axis, radii
//! color       means, sh, camera ──► colors
//! plan        everything discrete, computed once: order, tile lists, slots
//! blend       projected splats, plan ──► image, alpha, depth    (tile by tile: `tile`)
//! render      the chain of all of these, one entry on the tape
//! ```
//!
//! Data goes down this list forward and up it in the adjoint. `render` owns the loop over cameras and over blocks of
//! Gaussians; the operators own the formulas: each has a lane-wide body used by `render` and a slice form used by
//! the operator list. Decisions (visibility, clamps, pivots, order, tiles, last index) are made forward, stored in
//! [`plan::Plan`], and never re-derived differently in the adjoint.

pub mod activate;
pub mod blend;
pub mod color;
pub mod covariance;
pub mod discs;
pub mod plan;
pub mod project;
pub mod render;
mod tile;
