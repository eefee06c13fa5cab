//! `geometry.trace`: nearest hits of rays with a triangle mesh.
//!
//! ```text
//! t = min { t ≥ 0 : o + t·d is on a triangle },   triangle = the lowest index among those at that t
//! ```
//!
//! The operator uses the watertight test of Woop et al. (2013) and a tree with eight children per node;
//! [`super`] explains why the tree affects no result.
//!
//! | symbol | field | shape | |
//! |---|---|---|---|
//! | | `vertices` | (V, 3) | scene units |
//! | | `triangles` | (T, 3) | rows of `vertices` |
//! | o | `origin` | (R, 3) | scene units |
//! | d | `direction` | (R, 3) | any length but 0; t is in units of it |
//! | t | `t` | (R) | +∞ = miss |
//! | | `triangle` | (R) | −1 = miss |
//!
//! # Rounding
//! All values are f32; t is within 2e-6 × max(t, size of the scene) of the exact value.
//!
//! # Kinks and domain
//! Both sides of a triangle are hit. Triangles without area are never hit. No ray passes between triangles
//! that share an edge or a vertex; if it hits both at equal t, the lower index wins. Rays that start more
//! than 2⁴⁰ scene units away (relative to a mesh of ordinary size) hit nothing.
//!
//! # Adjoint
//! There is no adjoint: the hit is a discrete decision. Position and normal at a hit are smooth functions of
//! the caller's data.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::geometry::trace::{In, forward};
//! let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
//! let origin = [[0.25, 0.25, 1.0], [2.0, 2.0, 1.0]]; // above the triangle, and beside it
//! let direction = [[0.0, 0.0, -1.0]; 2];
//! let x = In { vertices: &vertices, triangles: &[[0, 1, 2]], origin: &origin, direction: &direction };
//! let out = forward(&x);
//! assert_eq!(out.t, [1.0, f32::INFINITY]);
//! assert_eq!(out.triangle, [0, -1]);
//! ```

use super::bvh::{Bvh, Hit, MISS, Ray};
use crate::num::par;

/// Rays per task.
const CHUNK: usize = 4096;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Vertex positions, shape (V).
    pub vertices: &'a [[f32; 3]],
    /// Indices into `vertices`, shape (T).
    pub triangles: &'a [[u32; 3]],
    /// Origins of the rays, shape (R).
    pub origin: &'a [[f32; 3]],
    /// Directions of the rays, shape (R), not 0.
    pub direction: &'a [[f32; 3]],
}

/// Outputs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Ray parameters, shape (R); +∞ for a miss.
    pub t: Vec<f32>,
    /// Triangle indices, shape (R); −1 for a miss.
    pub triangle: Vec<i32>,
}

/// Returns the nearest hits.
///
/// # Panics
/// Panics under the conditions of [`Bvh::build`], and if the numbers of directions and origins differ.
pub fn forward(x: &In<'_>) -> Out {
    assert_eq!(x.origin.len(), x.direction.len(), "there is one direction per origin");
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
