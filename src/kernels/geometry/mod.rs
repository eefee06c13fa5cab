//! Rays against triangles, distances, samples. Level 4: no adjoints.
//!
//! ```text
//! vertices, triangles ── bvh::Bvh::build ──► tree      (obvhs proposes it; no result depends on its shape)
//! tree, ray ── closest | occluded ──► hit              (our watertight test, hits ordered by (t, triangle))
//! points, triangles ── nearest ──► distances ── compare ──► how far two surfaces are apart
//! ```
//!
//! # The contract
//! The hit of a ray is the smallest (t, triangle) over all triangles that `triangle` accepts. A tree may only leave out what cannot win. That is so by
//! construction and not by an estimate of errors: the reported t is at least the start of the triangle's own box, and a box around that one starts
//! no later and ends no earlier, because every operation in between is monotonic in floating point.
//!
//! # How the tree is walked
//! ```text
//! tree     eight children a node, eight triangles a leaf, lane by lane; one array in huge pages (pages)
//! walk     one ray: nearest child first, what waits is fetched early
//! group    up to sixteen rays side by side: one hull for all at nodes, each ray by itself at leaves
//! turns    any rays, twelve of which take turns: while one waits for memory, others are at work
//! ```
//!
//! A ray that bounces off a mesh of a million triangles visits 10 nodes and 3 leaves, in 300 ns. Groups do not pay for such rays, not even sorted by
//! direction and start: the frustum of sixteen of them meets every leaf between their starts. `benches/record` has the figures.

pub mod bvh;
pub mod compare;
#[cfg(test)]
mod contract;
mod group;
pub mod nearest;
mod pages;
pub mod ray;
pub mod trace;
mod tree;
mod triangle;
mod turns;
mod walk;
