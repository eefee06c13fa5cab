//! Nearest hits of rays with a triangle mesh: the operator `geometry.trace`.
//!
//! ```text
//! t = min { t ≥ 0 : o + t·d lies on a triangle },   triangle = the lowest index among those at that t
//! ```
//!
//! Watertight test of Woop, Benthin and Wald (2013) over a tree of eight children a node; see [`super`] for why the tree decides nothing.
//!
//! | symbol | field | shape | |
//! |---|---|---|---|
//! | | `vertices` | (V, 3) | scene units |
//! | | `triangles` | (T, 3) | rows of `vertices` |
//! | o | `origin` | (R, 3) | scene units |
//! | d | `direction` | (R, 3) | any length but 0; t counts in it |
//! | t | `t` | (R) | +∞ = miss |
//! | | `triangle` | (R) | −1 = miss |
//!
//! # Rounding
//! Single precision; t is within 2e-6 × max(t, size of the scene) of the exact one.
//!
//! # Kinks and domain
//! Both sides are hit. Triangles without area are never hit. No ray passes between triangles that share an edge or a vertex; where
//! it meets both, the lower index wins if t is equal. Rays that start more than 2⁴⁰ scene units away (relative to a mesh of ordinary size) hit
//! nothing.
//!
//! # Adjoint
//! None: the hit is a decision. Position and normal at a hit are smooth functions of what the caller holds.

use super::bvh::{Bvh, Hit, MISS, Ray};
use crate::num::par;

/// Rays of one task.
const CHUNK: usize = 4096;

/// Arguments.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (V) positions
    pub vertices: &'a [[f32; 3]],
    /// (T) indices into `vertices`
    pub triangles: &'a [[u32; 3]],
    /// (R) starts
    pub origin: &'a [[f32; 3]],
    /// (R) directions, not 0
    pub direction: &'a [[f32; 3]],
}

/// Results.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// (R), +∞ = miss
    pub t: Vec<f32>,
    /// (R), −1 = miss
    pub triangle: Vec<i32>,
}

/// Nearest hits.
///
/// # Panics
/// As [`Bvh::build`]; also if there are not as many directions as origins.
pub fn forward(x: &In<'_>) -> Out {
    assert_eq!(x.origin.len(), x.direction.len(), "one direction per origin");
    let bvh = Bvh::build(x.vertices, x.triangles);
    let rays: Vec<Ray> = x
        .origin
        .iter()
        .zip(x.direction)
        .map(|(&origin, &direction)| Ray { origin, direction, t_max: f32::INFINITY })
        .collect();
    let mut hits = vec![Hit::NONE; rays.len()];
    par::chunks_mut(&mut hits, CHUNK, |i, hits| {
        bvh.closest_batch(&rays[i * CHUNK..i * CHUNK + hits.len()], hits);
    });
    Out {
        t: hits.iter().map(|h| h.t).collect(),
        triangle: hits.iter().map(|h| if h.triangle == MISS { -1 } else { h.triangle as i32 }).collect(),
    }
}
