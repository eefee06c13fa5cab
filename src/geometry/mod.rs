//! Rays against triangles, distances, samples. Level 4: no adjoints.
//!
//! ```text
//! vertices, triangles ── bvh::Bvh::build ──► tree      (obvhs proposes it; no result depends on its shape)
//! tree, ray ── closest | occluded ──► hit              (our watertight test, hits ordered by (t, triangle))
//! points, triangles ── nearest ──► distances ── compare ──► how far two surfaces are apart
//! ```

pub mod bvh;
pub mod compare;
#[cfg(test)]
mod contract;
mod group;
pub mod nearest;
mod pages;
pub mod trace;
mod tree;
mod triangle;
mod turns;
mod walk;
