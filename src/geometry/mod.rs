//! Rays against triangles, and distances. Level 4: no adjoints.
//!
//! ```text
//! vertices, triangles ── bvh::Bvh::build ──► tree      (obvhs proposes it; no result depends on its shape)
//! tree, ray ── closest | occluded ──► hit              (our watertight test, hits ordered by (t, triangle))
//! ```

pub mod bvh;
mod pages;
mod tree;
mod triangle;
mod turns;
mod walk;
