//! How far two surfaces are apart: Chamfer distance and normal consistency.
//!
//! Points X are spread evenly over A, points Y over B ([`super::sample`]); d(x, B) is the distance to the surface of B, not to a sample of
//! it ([`super::distance`]), so equal surfaces have distance 0 however they are cut into triangles.
//!
//! ```text
//! forward  = mean of d(x, B) over X           backward = mean of d(y, A) over Y
//! distance = ½·(forward + backward)
//! squared  = mean of d(x, B)² over X + mean of d(y, A)² over Y
//! normals  = ½·(mean of |n_x·n_B(x)| over X + mean of |n_y·n_A(y)| over Y)
//! ```
//!
//! n are normals of triangles, n_B(x) that of the triangle of B nearest to x. Papers differ: some add where `distance` halves, some halve where `squared`
//! adds; a number is worth its name only.
//!
//! # Rounding
//! Distances are f32; sums run over 16 logical lanes and a tree, in double precision.

use super::bvh::Bvh;
use super::sample::{Sample, cross_product, length, surface};
use crate::num::{par, sum};
use crate::{Error, Result};

/// Points of one task.
const CHUNK: usize = 256;

/// A surface: positions and triangles.
pub type Surface<'a> = (&'a [[f32; 3]], &'a [[u32; 3]]);

/// Measures between surfaces A and B.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chamfer {
    /// Mean distance from A to B, scene units.
    pub forward: f64,
    /// Mean distance from B to A, scene units.
    pub backward: f64,
    /// Half the sum of the two.
    pub distance: f64,
    /// Sum of both mean squared distances.
    pub squared: f64,
    /// Half the sum of both mean |cosines| between normals; 1 for equal surfaces.
    pub normals: f64,
}

/// Means of distance, squared distance and |cosine| of one direction.
fn one_way(samples: &[Sample], bvh: &Bvh, other: Surface<'_>) -> Result<[f64; 3]> {
    let mut rows = vec![[0.0_f64; 3]; samples.len()];
    par::chunks_mut(&mut rows, CHUNK, |chunk, rows| {
        for (row, s) in rows.iter_mut().zip(&samples[chunk * CHUNK..]) {
            let Some(near) = bvh.nearest(s.point) else { continue };
            let d = f64::from(near.distance);
            let n = cross_product(other.1[near.triangle as usize].map(|i| other.0[i as usize]));
            let m = s.normal.map(f64::from);
            let cosine = (n[0] * m[0] + n[1] * m[1] + n[2] * m[2]) / length(n);
            *row = [d, d * d, cosine.abs()];
        }
    });
    if samples.is_empty() {
        return Err(Error::input("Chamfer distance").expected("at least one point").got("0"));
    }
    let mean = |k: usize| sum::sum16_f64_by(rows.len(), |i| rows[i][k]) / rows.len() as f64;
    Ok([mean(0), mean(1), mean(2)])
}

/// Compares two surfaces with `count` points on each.
///
/// # Errors
/// When `count` is 0, or no triangle of a surface has an area.
///
/// # Panics
/// When an index is out of range or a coordinate is not finite.
pub fn compare(a: Surface<'_>, b: Surface<'_>, count: usize, seed: u64) -> Result<Chamfer> {
    let there = surface(a.0, a.1, count, seed).map_err(|e| e.within("first mesh"))?;
    let back = surface(b.0, b.1, count, seed).map_err(|e| e.within("second mesh"))?;
    let (a_tree, b_tree) = (Bvh::build(a.0, a.1), Bvh::build(b.0, b.1));
    let [forward, forward2, forward_n] = one_way(&there, &b_tree, b)?;
    let [backward, backward2, backward_n] = one_way(&back, &a_tree, a)?;
    Ok(Chamfer {
        forward,
        backward,
        distance: 0.5 * (forward + backward),
        squared: forward2 + backward2,
        normals: 0.5 * (forward_n + backward_n),
    })
}
