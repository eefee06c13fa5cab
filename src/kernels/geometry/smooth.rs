//! Smoothing by the mean of neighbours, and vertex normals.
//!
//! One pass with factor λ moves every vertex towards the mean of its neighbours (the umbrella operator):
//!
//! p ← p + λ (1/|N| Σ_{q ∈ N} q − p)
//!
//! | symbol | argument | meaning |
//! |---|---|---|
//! | p, q | `positions` | (V, 3) |
//! | N | of `triangles` | vertices that share an edge with p; without any, p does not move |
//! | λ | `factor` | 0..=1 |
//! | μ | `inverse` | 0 or below −λ: factor of a second pass after each one |
//!
//! All vertices move at once. With μ = 0 the surface shrinks: of a sphere of radius r with mean edge length h by
//! about λ h²/(2r) in each pass. With μ < −λ the two passes together keep low frequencies (Taubin 1995): a mode with eigenvalue k of
//! 1 − mean is multiplied by (1 − λk)(1 − μk), which is 1 at k = 0 and at 1/λ + 1/μ.
//!
//! # Rounding
//! f64 in all passes; the mean is the left fold over neighbours of ascending index, then one quotient. Positions
//! are rounded to f32 once, at the end.

use super::components::cross;
use crate::math::vector::unit;
use crate::num::par;
use crate::scene::mesh::Mesh;
use crate::{Error, Result};

/// Vertices per task.
const BATCH: usize = 1024;

/// Factors and number of passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// λ, 0..=1.
    pub factor: f64,
    /// μ, 0 or below −λ.
    pub inverse: f64,
    /// Passes with λ.
    pub iterations: usize,
}

impl Default for Smoothing {
    /// λ = 1, ten passes, no second factor: what LIRM uses before it makes texture coordinates.
    fn default() -> Self {
        Self { factor: 1.0, inverse: 0.0, iterations: 10 }
    }
}

/// Lists of indices, one behind the other.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Lists {
    /// (N + 1) start of each list.
    pub(super) starts: Vec<u32>,
    /// The lists.
    pub(super) members: Vec<u32>,
}

impl Lists {
    /// Lists of the second entries by the first, in the order of the pairs.
    pub(super) fn of(n: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut starts = vec![0_u32; n + 1];
        pairs.clone().for_each(|(i, _)| starts[i as usize + 1] += 1);
        for i in 0..n {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut members = vec![0; starts[n] as usize];
        for (i, j) in pairs {
            members[next[i as usize] as usize] = j;
            next[i as usize] += 1;
        }
        Self { starts, members }
    }

    /// One list.
    pub(super) fn list(&self, i: usize) -> &[u32] {
        &self.members[self.starts[i] as usize..self.starts[i + 1] as usize]
    }
}

/// The vertices that share an edge with each vertex, ascending.
fn neighbours(triangles: &[[u32; 3]], vertices: usize) -> Vec<Vec<u32>> {
    let around = Lists::of(
        vertices,
        triangles.iter().flat_map(|&[a, b, c]| [(a, b), (a, c), (b, c), (b, a), (c, a), (c, b)]),
    );
    par::map_batched(vertices, BATCH, |i| {
        let mut list: Vec<u32> = around.list(i).iter().copied().filter(|&j| j as usize != i).collect();
        list.sort_unstable();
        list.dedup();
        list
    })
}

/// Returns smoothed positions.
///
/// # Errors
/// Returns an error if a factor is out of range.
///
/// # Example
/// One pass with factor ½ halves the height of the tip of a pyramid whose base is at 0.
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::smooth::{Smoothing, smooth};
/// let tip = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];
/// let sides = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
/// let once = Smoothing { factor: 0.5, inverse: 0.0, iterations: 1 };
/// assert_eq!(smooth(&tip, &sides, &once)?[4], [0.0, 0.0, 0.5]);
/// # Ok::<(), lastlight::Error>(())
/// ```
pub fn smooth(positions: &[[f32; 3]], triangles: &[[u32; 3]], how: &Smoothing) -> Result<Vec<[f32; 3]>> {
    let Smoothing { factor, inverse, iterations } = *how;
    if !((0.0..=1.0).contains(&factor) && (inverse == 0.0 || (-2.0..-factor).contains(&inverse))) {
        let e = Error::input("smoothing")
            .expected("a factor of 0 to 1; an inverse factor of 0, or from −2 to below −factor");
        return Err(e.got(format!("{factor}, {inverse}")));
    }
    let around = neighbours(triangles, positions.len());
    let mut p: Vec<[f64; 3]> = positions.iter().map(|p| p.map(f64::from)).collect();
    for _ in 0..iterations {
        p = pass(&p, &around, factor);
        if inverse != 0.0 {
            p = pass(&p, &around, inverse);
        }
    }
    Ok(p.into_iter().map(|p| p.map(|x| x as f32)).collect())
}

fn pass(p: &[[f64; 3]], around: &[Vec<u32>], factor: f64) -> Vec<[f64; 3]> {
    par::map_batched(p.len(), BATCH, |i| {
        if around[i].is_empty() {
            return p[i];
        }
        let sum = around[i]
            .iter()
            .fold([0.0; 3], |sum: [f64; 3], &j| std::array::from_fn(|k| sum[k] + p[j as usize][k]));
        let n = around[i].len() as f64;
        std::array::from_fn(|k| p[i][k] + factor * (sum[k] / n - p[i][k]))
    })
}

/// Returns unit vertex normals: means of the face normals, weighted by the angle of the face at the vertex
/// (Thürmer and Wüthrich 1998), so that they do not depend on how a flat face is divided into triangles.
///
/// Faces without area have no weight. Where the mean is zero, the normal is that of the first face with
/// area; where there is none, (0, 0, 1).
///
/// # Rounding
/// f64: the angle is atan2(‖u × v‖, u·v), the sum a left fold over triangles of ascending index; rounded once.
pub fn normals(mesh: &Mesh) -> Vec<[f32; 3]> {
    let pairs = (0..mesh.triangles.len()).flat_map(|t| mesh.triangles[t].map(|i| (i, t as u32)));
    let faces = Lists::of(mesh.positions.len(), pairs);
    par::map_batched(mesh.positions.len(), BATCH, |i| {
        let (mut sum, mut first) = ([0.0; 3], None);
        for &t in faces.list(i) {
            let [a, b, c] = mesh.corners(t as usize);
            let face = unit(cross(a, b, c));
            if face == [0.0; 3] {
                continue;
            }
            first = first.or(Some(face));
            let at = mesh.triangles[t as usize].iter().position(|&j| j as usize == i).unwrap_or(0);
            let angle = angle([a, b, c], at);
            sum = std::array::from_fn(|k| sum[k] + angle * face[k]);
        }
        let mean = unit(sum);
        let normal = if mean == [0.0; 3] { first.unwrap_or([0.0, 0.0, 1.0]) } else { mean };
        normal.map(|x| x as f32)
    })
}

/// Angle of a triangle at one of its corners, radians.
fn angle(p: [[f32; 3]; 3], at: usize) -> f64 {
    let n = cross(p[at], p[(at + 1) % 3], p[(at + 2) % 3]);
    let edge = |j: usize| std::array::from_fn::<f64, 3, _>(|k| f64::from(p[j][k]) - f64::from(p[at][k]));
    let (u, v) = (edge((at + 1) % 3), edge((at + 2) % 3));
    let length = ((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2]).sqrt();
    libm::atan2(length, (u[0] * v[0] + u[1] * v[1]) + u[2] * v[2])
}
