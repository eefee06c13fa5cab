//! Gaussian splatting: from parameters to images, and the adjoint. Level 5.
//!
//! ```text
//! activate    stored scales, opacities ──► linear scales, opacities in 0..1
//! covariance  quats, scales ──► factors F = R·S                (or factors come from a skinned body)
//! project     means, factors, camera ──► means_px, depths_z, shape (s, k1, k2), axis, radii
//! color       means, sh, camera ──► colors
//! plan        all discrete decisions, made once: order, tile lists, slots
//! blend       projected splats, plan ──► image, alpha, depth    (tile by tile: `tile`)
//! render      all of these stages, recorded as one entry on the tape
//! ```
//!
//! Data flows down this list in the forward pass and up in the adjoint. `render` owns the loop over cameras
//! and over blocks of Gaussians; the operators own the formulas: each has a lane-wide body used by `render`
//! and a slice form used by the operator list. Decisions (visibility, clamps, pivots, order, tiles, last
//! index) are made in the forward pass and stored in [`plan::Plan`]; the adjoint reuses them and never
//! decides again.

pub mod activate;
pub mod blend;
pub mod color;
pub mod covariance;
pub mod discs;
pub mod plan;
pub mod project;
pub mod render;
mod tile;
