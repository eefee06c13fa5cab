//! `field.normal`: gradient and normal of a signed distance, from its values at a stencil.
//!
//! gₖ = (s(x + εeₖ) − s(x))/ε (forward),   gₖ = (s(x + εeₖ) − s(x − εeₖ))/2ε (central),   n = g/max(‖g‖, 10⁻⁴)
//! (LIRM, Li et al. 2025)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | s | `sdf` | (N, 4): at x, x + εe₁, x + εe₂, x + εe₃; (N, 6): at x + εe₁, x − εe₁, x + εe₂, … | scene units |
//! | ε | setting `epsilon` | () | scene units, > 0; at least a texel of the planes |
//! | | setting `mode` | | `forward` or `central` |
//! | g | `gradient` | (N, 3) | |
//! | n | `normal` | (N, 3) | unit, or shorter where ‖g‖ < 10⁻⁴ |
//!
//! # Rounding
//! One difference and one division for gₖ; ‖g‖ = √((g₁² + g₂²) + g₃²); one division for n.
//!
//! # Kinks and domain
//! At ‖g‖ = 10⁻⁴ the slope is that of g/‖g‖; below it that of 10⁴ g.
//!
//! # Adjoint
//! ḡ += (n̄ − n(n·n̄))/‖g‖, or 10⁴ n̄; then ±ḡₖ/ε or ±ḡₖ/2ε for the two values, the sum over k in the order
//! (ḡ₁ + ḡ₂) + ḡ₃ for s(x). Nothing is saved.
//!
//! Twin: `reference::field::normal`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::normal::{Stencil, forward};
//! let (g, n) = forward(&[1.0, 2.5, 1.0, 3.0], Stencil::Forward, 0.5);
//! assert_eq!((g[0], n[0]), ([3.0, 0.0, 4.0], [0.6, 0.0, 0.8]));
//! ```

use crate::num::par;

/// Smallest divisor of the normal.
pub const LEAST: f32 = 1e-4;
/// Points per task.
const ROWS: usize = 512;

/// Which values a row has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stencil {
    /// s(x), then s(x + εeₖ).
    Forward,
    /// s(x + εeₖ), s(x − εeₖ) for each axis.
    Central,
}

impl Stencil {
    /// Returns the number of values per point.
    pub fn width(self) -> usize {
        if self == Self::Forward { 4 } else { 6 }
    }

    /// Returns the point at which value `i` of a row is taken.
    pub fn point(self, i: usize, epsilon: f32, mut x: [f32; 3]) -> [f32; 3] {
        for k in 0..3 {
            let [ahead, behind] = self.pair(k);
            if i == ahead {
                x[k] += epsilon;
            } else if i == behind && self == Self::Central {
                x[k] -= epsilon;
            }
        }
        x
    }

    /// Returns the two values whose difference is taken along an axis.
    fn pair(self, k: usize) -> [usize; 2] {
        if self == Self::Forward { [k + 1, 0] } else { [2 * k, 2 * k + 1] }
    }

    /// Returns the distance of the two values.
    fn distance(self, epsilon: f32) -> f32 {
        if self == Self::Forward { epsilon } else { 2.0 * epsilon }
    }
}

fn gradient(row: &[f32], stencil: Stencil, epsilon: f32) -> [f32; 3] {
    let distance = stencil.distance(epsilon);
    std::array::from_fn(|k| {
        let [ahead, behind] = stencil.pair(k);
        (row[ahead] - row[behind]) / distance
    })
}

fn length(g: [f32; 3]) -> f32 {
    ((g[0] * g[0] + g[1] * g[1]) + g[2] * g[2]).sqrt()
}

/// Returns `gradient` and `normal`, both (N, 3).
///
/// # Panics
/// Panics if there is not one complete row per point.
pub fn forward(sdf: &[f32], stencil: Stencil, epsilon: f32) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let width = stencil.width();
    assert!(sdf.len().is_multiple_of(width), "complete rows");
    let n = sdf.len() / width;
    let (mut gradients, mut normals) = (vec![[0.0; 3]; n], vec![[0.0; 3]; n]);
    par::chunks_mut2(&mut gradients, ROWS, &mut normals, ROWS, |c, gradients, normals| {
        let rows = sdf[c * ROWS * width..].chunks_exact(width);
        for ((g, n), row) in gradients.iter_mut().zip(normals).zip(rows) {
            *g = gradient(row, stencil, epsilon);
            let r = length(*g);
            let divisor = if r >= LEAST { r } else { LEAST };
            *n = g.map(|g| g / divisor);
        }
    });
    (gradients, normals)
}

/// Adds the gradient for the cotangents of both results, each (N, 3), to `sdf_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(
    sdf: &[f32],
    stencil: Stencil,
    epsilon: f32,
    gradient_bar: &[[f32; 3]],
    normal_bar: &[[f32; 3]],
    sdf_bar: &mut [f32],
) {
    let width = stencil.width();
    let n = gradient_bar.len();
    assert!(sdf.len() == n * width && sdf_bar.len() == n * width && normal_bar.len() == n, "N rows");
    let distance = stencil.distance(epsilon);
    par::chunks_mut(sdf_bar, ROWS * width, |c, bars| {
        for (r, bar) in bars.chunks_exact_mut(width).enumerate() {
            let at = c * ROWS + r;
            let g = gradient(&sdf[at * width..][..width], stencil, epsilon);
            let (r, of_normal) = (length(g), normal_bar[at]);
            let through = if r >= LEAST {
                let n = g.map(|g| g / r);
                let along = (n[0] * of_normal[0] + n[1] * of_normal[1]) + n[2] * of_normal[2];
                std::array::from_fn(|k| (of_normal[k] - n[k] * along) / r)
            } else {
                of_normal.map(|g| g / LEAST)
            };
            let total: [f32; 3] = std::array::from_fn(|k| (gradient_bar[at][k] + through[k]) / distance);
            for (k, g) in total.iter().enumerate() {
                let [ahead, behind] = stencil.pair(k);
                bar[ahead] += g;
                if stencil == Stencil::Central {
                    bar[behind] -= g;
                }
            }
            if stencil == Stencil::Forward {
                bar[0] -= (total[0] + total[1]) + total[2];
            }
        }
    });
}
