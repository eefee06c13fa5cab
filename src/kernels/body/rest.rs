//! `body.rest`: maps points and covariance factors from a body's canonical pose to its rest pose.
//!
//! y = M_C⁻¹ (x − t_C) + o,   H = M_C⁻¹ F,   T_C = [M_C | t_C] = Σ_b w_b C_b   (GauHuman)
//!
//! This is the inverse of linear blend skinning; [`mod@super::skin`] then moves the result from rest to the
//! pose.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `points` | (P, 3) | canonical position, scene units |
//! | F | `factors` | (P, 3, 3) | Σ = F·Fᵀ in the canonical pose, scene units |
//! | w | `weights` | (P, K) | skinning weights |
//! | C | `canonical` | (K, 3, 4), optional | canonical pose from rest; absent if the rest pose is canonical, then T_C is the identity |
//! | o | `offsets` | (P, 3), optional | pose-dependent displacement of a point at rest, a constant |
//! | y, H | `rest_points`, `rest_factors` | (P, 3), (P, 3, 3) | at rest |
//!
//! # Rounding
//! All values are f32. T_C is a left fold over the joints from +0; M_C⁻¹ is the cofactors over the
//! determinant; rows of three are (a + b) + c.
//!
//! # Kinks and domain
//! There are no kinks. With `canonical` there is at least one joint, and the absolute value of the
//! determinant of every M_C is between 10⁻¹² and 10¹²; common canonical poses are far from both limits.
//! [`In::check`] refuses other values, including those from a row of zero weights; [`forward`] divides by the
//! determinant without a check.
//!
//! # Adjoint
//! x̄ += M_C⁻ᵀ ȳ, F̄ += M_C⁻ᵀ H̄; w̄_b += ⟨T̄_C, C_b⟩, T̄_C = −M_C⁻ᵀ (ȳ y₀ᵀ + H̄ Hᵀ, ȳ) with y₀ = y − o. y₀,
//! H and M_C⁻¹ of every point are saved.
//!
//! Twin: `reference::body::rest`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::body::rest::{In, forward};
//! // one joint, whose canonical pose is a quarter turn about z and a translation along x
//! let canonical = [[[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]];
//! let x = In { points: &[[1.0, 2.0, 0.5]], factors: &[[0.0; 9]], weights: &[1.0], canonical: Some(&canonical), offsets: None };
//! assert_eq!(forward(&x).0.points, [[2.0, 0.0, 0.5]]);
//! ```

use super::pose::Affine;
use crate::math::affine::{inverse_linear, is_invertible};
use crate::num::par;
use crate::{Error, Result};

/// Points per task.
const BLOCK: usize = 256;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (P, 3).
    pub points: &'a [[f32; 3]],
    /// Shape (P, 3, 3).
    pub factors: &'a [[f32; 9]],
    /// Shape (P, K).
    pub weights: &'a [f32],
    /// Shape (K).
    pub canonical: Option<&'a [Affine]>,
    /// Shape (P, 3).
    pub offsets: Option<&'a [[f32; 3]]>,
}

/// Outputs or their cotangents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Shape (P, 3).
    pub points: Vec<[f32; 3]>,
    /// Shape (P, 3, 3).
    pub factors: Vec<[f32; 9]>,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (P, 3).
    pub points: Vec<[f32; 3]>,
    /// Shape (P, 3, 3).
    pub factors: Vec<[f32; 9]>,
    /// Shape (P, K); empty if not requested.
    pub weights: Vec<f32>,
}

/// A point at rest, and the transform that maps it there.
#[derive(Clone, Copy, Debug)]
struct Rest {
    /// Position at rest without the offset, y − o.
    place: [f32; 3],
    /// Factor H at rest.
    h: [f32; 9],
    /// Inverse M_C⁻¹; absent if the rest pose is canonical.
    inverse: Option<[f32; 9]>,
}

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug)]
pub struct Saved(Vec<Rest>);

/// Returns Σ_b w_b C_b.
fn blend(weights: &[f32], bones: &[Affine]) -> Affine {
    let mut t = [[0.0; 4]; 3];
    for (&w, bone) in weights.iter().zip(bones) {
        for i in 0..3 {
            for j in 0..4 {
                t[i][j] += w * bone[i][j];
            }
        }
    }
    t
}

/// Returns the inverse of the linear part, row-major, and its determinant.
fn inverse(t: &Affine) -> ([f32; 9], f32) {
    let (m, det) = inverse_linear(&t.map(|row| [row[0], row[1], row[2]]));
    (std::array::from_fn(|e| m[e / 3][e % 3]), det)
}

/// Returns M x.
fn apply(m: &[f32; 9], x: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| (m[3 * i] * x[0] + m[3 * i + 1] * x[1]) + m[3 * i + 2] * x[2])
}

/// Returns Mᵀ x.
fn apply_t(m: &[f32; 9], x: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| (m[i] * x[0] + m[3 + i] * x[1]) + m[6 + i] * x[2])
}

/// Returns A B.
fn product(a: &[f32; 9], b: &[f32; 9]) -> [f32; 9] {
    std::array::from_fn(|e| {
        let (i, j) = (e / 3, e % 3);
        (a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j]) + a[3 * i + 2] * b[6 + j]
    })
}

/// Returns Aᵀ B.
fn product_t(a: &[f32; 9], b: &[f32; 9]) -> [f32; 9] {
    std::array::from_fn(|e| {
        let (i, j) = (e / 3, e % 3);
        (a[i] * b[j] + a[3 + i] * b[3 + j]) + a[6 + i] * b[6 + j]
    })
}

/// Returns ⟨T̄, C⟩ of two affine transforms.
fn inner(m_bar: &[f32; 9], t_bar: [f32; 3], bone: &Affine) -> f32 {
    let mut s = 0.0;
    for i in 0..3 {
        for j in 0..3 {
            s += m_bar[3 * i + j] * bone[i][j];
        }
        s += t_bar[i] * bone[i][3];
    }
    s
}

impl In<'_> {
    /// Checks that T_C of every point has an inverse.
    ///
    /// # Errors
    /// With `canonical`, returns an error if there is no joint, if the weights are not (P, K), or if a
    /// determinant is too small or too large; the error names the first such point.
    pub fn check(&self) -> Result<()> {
        let Some(bones) = self.canonical else { return Ok(()) };
        let wrong = |place: String| Error::input("body.rest").at(place);
        if bones.is_empty() {
            return Err(wrong("array 'canonical'".to_owned()).expected("at least one joint").got("none"));
        }
        if self.weights.len() != self.points.len() * bones.len() {
            return Err(wrong("array 'weights'".to_owned())
                .expected(format!("{} points times {} joints", self.points.len(), bones.len()))
                .got(self.weights.len().to_string()));
        }
        for (p, weights) in self.weights.chunks_exact(bones.len()).enumerate() {
            let (_, det) = inverse(&blend(weights, bones));
            if !is_invertible(f64::from(det)) {
                return Err(wrong(format!("point {p}"))
                    .expected("a blend of canonical transforms that has an inverse")
                    .got(format!("determinant {det:e}")));
            }
        }
        Ok(())
    }

    fn at_rest(&self, p: usize) -> Rest {
        let (x, f) = (self.points[p], self.factors[p]);
        let Some(bones) = self.canonical else { return Rest { place: x, h: f, inverse: None } };
        let t = blend(&self.weights[p * bones.len()..][..bones.len()], bones);
        let (m, _) = inverse(&t);
        let place = apply(&m, [x[0] - t[0][3], x[1] - t[1][3], x[2] - t[2][3]]);
        Rest { place, h: product(&m, &f), inverse: Some(m) }
    }
}

/// Returns points and factors at rest, and the intermediate values that the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> (Out, Saved) {
    let rest = par::map_batched(x.points.len(), BLOCK, |p| x.at_rest(p));
    let moved = |(p, r): (usize, &Rest)| {
        let o = x.offsets.map_or([0.0; 3], |o| o[p]);
        [r.place[0] + o[0], r.place[1] + o[1], r.place[2] + o[2]]
    };
    let points = rest.iter().enumerate().map(moved).collect();
    (Out { points, factors: rest.iter().map(|r| r.h).collect() }, Saved(rest))
}

fn add<const K: usize>(to: &mut [f32; K], what: [f32; K]) {
    to.iter_mut().zip(what).for_each(|(to, x)| *to += x);
}

/// Adds the gradients for the cotangents `out_bar` to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, or if there is no joint.
pub fn adjoint(x: &In<'_>, saved: &Saved, out_bar: &Out, x_bar: &mut InBar) {
    let k = x.canonical.map_or(1, <[Affine]>::len);
    assert!(k > 0, "there is at least one joint");
    let mut weights = x_bar.weights.chunks_mut(BLOCK * k);
    let tasks = (x_bar.points.chunks_mut(BLOCK))
        .zip(x_bar.factors.chunks_mut(BLOCK))
        .map(|(m, f)| (m, f, weights.next().unwrap_or_default()))
        .collect();
    par::each(tasks, |block, (points, factors, weights)| {
        for (i, (point, factor)) in points.iter_mut().zip(factors).enumerate() {
            let at = block * BLOCK + i;
            let (y_bar, h_bar) = (out_bar.points[at], out_bar.factors[at]);
            let r = &saved.0[at];
            let (Some(m), Some(bones)) = (&r.inverse, x.canonical) else {
                add(point, y_bar);
                add(factor, h_bar);
                continue;
            };
            let through = apply_t(m, y_bar);
            add(point, through);
            add(factor, product_t(m, &h_bar));
            if weights.is_empty() {
                continue;
            }
            let inside: [f32; 9] = std::array::from_fn(|e| {
                let (i, j) = (e / 3, e % 3);
                let along = (h_bar[3 * i] * r.h[3 * j] + h_bar[3 * i + 1] * r.h[3 * j + 1])
                    + h_bar[3 * i + 2] * r.h[3 * j + 2];
                y_bar[i] * r.place[j] + along
            });
            let (m_bar, t_bar) = (product_t(m, &inside).map(|v| -v), through.map(|v| -v));
            for (w, bone) in weights[i * k..][..k].iter_mut().zip(bones) {
                *w += inner(&m_bar, t_bar, bone);
            }
        }
    });
}
