//! Rays against triangles, and distances. Level 4: no adjoints.
//!
//! ```text
//! vertices, triangles ── bvh::Bvh::build ──► tree      (obvhs proposes it; no result depends on its shape)
//! tree, ray ── closest | occluded ──► hit              (our watertight test, hits ordered by (t, triangle))
//! ```

pub mod bvh;
pub mod chamfer;
#[cfg(test)]
mod contract;
pub mod distance;
mod group;
mod pages;
pub mod sample;
pub mod trace;
mod tree;
mod triangle;
mod turns;
mod walk;
