//! Ray–triangle intersection, distances, surface samples; signed distance volumes to textured meshes. Level 4,
//! without adjoints.
//!
//! ```text
//! vertices, triangles ── bvh::Bvh::build ──► tree      (obvhs proposes it; its shape affects no result)
//! tree, ray ── closest | occluded ──► hit              (watertight test, hits ordered by (t, triangle))
//! points, triangles ── nearest ──► distances ── compare ──► distance between two surfaces
//! samples, vertices of a scan ── scan ──► the shape error of Stanford-ORB
//! vertices, triangles, tree ── signed ──► signed distances of points
//! bit_grid ── bricks ──► occupied bricks along a ray   (obvhs proposes the tree)
//!
//! volume ── components::fill_cavities ──► volume ── marching ──► mesh ── components::keep ──► mesh
//!        ── smooth ──► mesh, normals ── atlas ──► mesh with texture coordinates ── texels ──► surface points
//! ```
//!
//! # From a volume to a textured mesh
//! ```text
//! marching     the surface where a volume of samples changes its sign: closed, each edge in two triangles
//! cells        the triangles of one cell, derived from the crossings of its faces when the program starts
//! components   connected parts of a mesh, the largest of them; cavities of a volume
//! smooth       mean of neighbours with a factor, optionally keeping the volume; vertex normals
//! atlas        charts with limited stretch, placed in a square: no overlap, gutters, one texel density
//! charts       regions of the surface that one projection maps without overlap
//! packing      positions of the charts in the square
//! texels       the surface point of every texel, and the nearest one for texels of gutters
//! facts        edges, parts, area, volume; use and density of texture coordinates, of any mesh
//! ```
//!
//! All of these are functions of their input bits: decisions are taken on f64 values that are computed in one
//! written order, ties go to the smaller index, and threads own slabs, charts or rows.
//!
//! # The contract of rays
//! The hit of a ray is the smallest (t, triangle) over all triangles that `triangle` accepts. A tree may only
//! skip triangles that cannot have the smallest (t, triangle). This holds by construction and not by an error
//! estimate: the reported t is at least the start of the triangle's own box, and an enclosing box starts no
//! later and ends no earlier, because every operation in between is monotonic in floating point.
//!
//! # Traversal
//! ```text
//! tree     eight children per node, up to eight triangles per leaf, one per lane (in huge pages: pages)
//! walk     one ray: nearest child first, with prefetching of pending nodes
//! group    up to sixteen neighbouring rays: one hull for all at nodes, individual rays at leaves
//! turns    independent rays, twelve interleaved: while one waits for memory, others proceed
//! ```
//!
//! A ray that is reflected from a mesh of a million triangles visits 10 nodes and 3 leaves, in 300 ns. Groups
//! are slower for such rays, even if sorted by direction and origin: the frustum of sixteen of them
//! intersects every leaf between their origins. `benches/record` contains the measurements.

pub mod atlas;
pub mod bit_grid;
pub mod bricks;
pub mod bvh;
mod cells;
mod charts;
pub mod compare;
pub mod components;
#[cfg(test)]
mod contract;
pub mod facts;
mod group;
pub mod marching;
pub mod nearest;
mod packing;
mod pages;
mod primitives;
pub mod ray;
pub mod scan;
pub mod signed;
pub mod smooth;
pub mod texels;
pub mod trace;
mod tree;
mod triangle;
mod turns;
mod walk;
