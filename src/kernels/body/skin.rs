//! `body.skin`: linear blend skinning of points and of factors of covariances.
//!
//! T_p = Σ_b w_pb G_b,   x'_p = M_p x_p + t_p,   F'_p = M_p F_p,
//! M_p = linear part of T_p, t_p its last column
//!
//! | symbol | argument | shape | unit, range |
//! |--------|----------|-------|-------------|
//! | x | `points` | (P, 3) | rest position, scene units |
//! | w | `weights` | (P, K) | usually ≥ 0 with rows that sum to 1; not normalised here |
//! | G | `transforms` | (K, 4, 4) | posed from rest, affine: the last row is 0 0 0 1 and is not read |
//! | F | `factors` | (P, 3, 3), optional | Σ = F·Fᵀ at rest, scene units |
//! | x' | `skinned` | (P, 3) | posed position, scene units |
//! | F' | `skinned_factors` | (P, 3, 3) | Σ' = F'·F'ᵀ = M Σ Mᵀ: a blend of rotations is not a rotation, so Σ' has no quaternion form |
//!
//! # Rounding
//! All values are f32. T_p is a left fold over the bones in their order from +0, with product and sum rounded
//! separately; bones of weight 0 are skipped, which changes no bit. A row of M·x + t is ((M₀x₀ + M₁x₁) +
//! M₂x₂) + t; an entry of M·F is the same without t.
//!
//! # Kinks and domain
//! The outputs are polynomial in every input, so there are no kinks. Weights need not sum to 1; a row of
//! zeros gives the origin.
//!
//! # Adjoint
//! x̄ += Mᵀ x̄',   F̄ += Mᵀ F̄',   T̄ = (x̄' xᵀ + F̄' Fᵀ, x̄'),   w̄_pb += ⟨T̄_p, G_b⟩,
//! Ḡ_b += Σ_p w_pb T̄_p
//!
//! T_p is recomputed. Products of three are left folds; an entry of T̄ begins with x̄'·x; ⟨ , ⟩ is a left
//! fold over its twelve entries, row by row. Ḡ is summed in f64: a left fold over the points of each block of
//! 256, blocks by the pairwise tree, rounded once. The last rows get no gradient.
//!
//! Twin: `reference::body::skin`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::body::skin::{In, forward};
//! let rest = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
//! // a quarter turn about z through (1, 0, 0)
//! let quarter = [0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
//! let x = In { points: &[[2.0, 0.0, 0.5]], weights: &[0.5, 0.5], transforms: &[rest, quarter], factors: &[] };
//! assert_eq!(forward(x).skinned, [[1.5, 0.5, 0.5]]);
//! ```

use crate::num::{order, par, sum};

/// Points per task; the value is part of the rounding of Ḡ.
const BLOCK: usize = 256;

/// Upper three rows of an affine transform.
type Affine = [[f32; 4]; 3];

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (P, 3).
    pub points: &'a [[f32; 3]],
    /// Shape (P, K).
    pub weights: &'a [f32],
    /// Shape (K, 4, 4).
    pub transforms: &'a [[f32; 16]],
    /// Shape (P, 3, 3); empty if there are none.
    pub factors: &'a [[f32; 9]],
}

/// Outputs or their cotangents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Shape (P, 3).
    pub skinned: Vec<[f32; 3]>,
    /// Shape (P, 3, 3); empty if there are no factors.
    pub skinned_factors: Vec<[f32; 9]>,
}

/// Gradients; the adjoint adds to them. Those that are not requested are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (P, 3).
    pub points: Vec<[f32; 3]>,
    /// Shape (P, K).
    pub weights: Vec<f32>,
    /// Shape (K, 4, 4).
    pub transforms: Vec<[f32; 16]>,
    /// Shape (P, 3, 3).
    pub factors: Vec<[f32; 9]>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self {
            points: vec![[0.0; 3]; x.points.len()],
            weights: vec![0.0; x.weights.len()],
            transforms: vec![[0.0; 16]; x.transforms.len()],
            factors: vec![[0.0; 9]; x.factors.len()],
        }
    }
}

impl In<'_> {
    fn check(&self) {
        let (points, bones) = (self.points.len(), self.transforms.len());
        assert!(bones > 0, "there is at least one bone");
        assert_eq!(self.weights.len(), points * bones, "weights are (P, K)");
        assert!(
            self.factors.is_empty() || self.factors.len() == points,
            "there is one factor per point, or none"
        );
    }

    /// Returns the weights of a point.
    fn weights_of(&self, p: usize) -> &[f32] {
        &self.weights[p * self.transforms.len()..][..self.transforms.len()]
    }

    /// Returns T_p.
    fn blend(&self, p: usize) -> Affine {
        let mut t = [[0.0; 4]; 3];
        for (w, g) in self.weights_of(p).iter().zip(self.transforms).filter(|(w, _)| **w != 0.0) {
            for (row, g) in t.iter_mut().zip(g.as_chunks::<4>().0) {
                for (t, g) in row.iter_mut().zip(g) {
                    *t += w * g;
                }
            }
        }
        t
    }
}

/// Returns the sum of three products, added from the left.
#[inline(always)]
fn three(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn column(f: &[f32; 9], j: usize) -> [f32; 3] {
    [f[j], f[3 + j], f[6 + j]]
}

#[inline(always)]
fn linear(t: &Affine) -> [[f32; 3]; 3] {
    t.map(|[a, b, c, _]| [a, b, c])
}

/// Returns posed points and factors.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, or if there are no bones.
pub fn forward(x: In<'_>) -> Out {
    x.check();
    let blocks = par::map(x.points.len().div_ceil(BLOCK), |block| {
        let mut out = Out::default();
        for p in block * BLOCK..order::min(x.points.len(), (block + 1) * BLOCK) {
            let t = x.blend(p);
            let m = linear(&t);
            out.skinned.push([0, 1, 2].map(|i| three(m[i], x.points[p]) + t[i][3]));
            if let Some(f) = x.factors.get(p) {
                out.skinned_factors.push(std::array::from_fn(|e| three(m[e / 3], column(f, e % 3))));
            }
        }
        out
    });
    let mut all = Out::default();
    for block in blocks {
        all.skinned.extend(block.skinned);
        all.skinned_factors.extend(block.skinned_factors);
    }
    all
}

/// Gradients of the points of one task.
struct Task<'a> {
    points: &'a mut [[f32; 3]],
    weights: &'a mut [f32],
    factors: &'a mut [[f32; 9]],
}

/// Adds the gradients for the cotangents `out_bar` to `x_bar`; the cotangents of the factors may be empty.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, or if there are no bones.
pub fn adjoint(x: In<'_>, out_bar: &Out, x_bar: &mut InBar) {
    x.check();
    let (points, bones) = (x.points.len(), x.transforms.len());
    assert_eq!(out_bar.skinned.len(), points, "there is one cotangent per point");
    assert!(
        out_bar.skinned_factors.is_empty() || out_bar.skinned_factors.len() == x.factors.len(),
        "there is one cotangent per factor, or none"
    );
    let fits = |have: usize, want: usize| have == 0 || have == want;
    assert!(
        fits(x_bar.points.len(), points) && fits(x_bar.factors.len(), x.factors.len()),
        "gradients of points and factors have P rows"
    );
    assert!(
        fits(x_bar.weights.len(), x.weights.len()) && fits(x_bar.transforms.len(), bones),
        "gradients of weights and transforms have the shapes of the inputs"
    );
    let mut parts = (
        x_bar.points.chunks_mut(BLOCK),
        x_bar.weights.chunks_mut(BLOCK * bones),
        x_bar.factors.chunks_mut(BLOCK),
    );
    let tasks = (0..points.div_ceil(BLOCK))
        .map(|_| Task {
            points: parts.0.next().unwrap_or_default(),
            weights: parts.1.next().unwrap_or_default(),
            factors: parts.2.next().unwrap_or_default(),
        })
        .collect();
    let with_transforms = !x_bar.transforms.is_empty();
    let sums = par::map_each(tasks, |block, task| block_adjoint(&x, out_bar, block, task, with_transforms));
    if with_transforms {
        let sums = sum::tree_arrays(sums);
        for (bar, sums) in x_bar.transforms.iter_mut().zip(sums.chunks_exact(12)) {
            for (bar, sum) in bar.iter_mut().zip(sums) {
                *bar += *sum as f32;
            }
        }
    }
}

/// Processes one block of points and returns its part of Ḡ (K, 3, 4), which is empty if not requested.
fn block_adjoint(x: &In<'_>, out_bar: &Out, block: usize, task: Task<'_>, with_transforms: bool) -> Vec<f64> {
    let bones = x.transforms.len();
    let first = block * BLOCK;
    let mut sums = vec![0.0_f64; if with_transforms { 12 * bones } else { 0 }];
    for p in first..order::min(x.points.len(), first + BLOCK) {
        let m = linear(&x.blend(p));
        let (at, point, point_bar) = (p - first, &x.points[p], &out_bar.skinned[p]);
        let back = |j: usize, bar: [f32; 3]| three([m[0][j], m[1][j], m[2][j]], bar);
        if let Some(bar) = task.points.get_mut(at) {
            (0..3).for_each(|j| bar[j] += back(j, *point_bar));
        }
        let factor_bar = out_bar.skinned_factors.get(p);
        if let (Some(bar), Some(f_bar)) = (task.factors.get_mut(at), factor_bar) {
            (0..9).for_each(|e| bar[e] += back(e / 3, column(f_bar, e % 3)));
        }
        if task.weights.is_empty() && sums.is_empty() {
            continue;
        }
        let mut t_bar: Affine = std::array::from_fn(|i| {
            let [a, b, c] = point.map(|x| point_bar[i] * x);
            [a, b, c, point_bar[i]]
        });
        if let (Some(f), Some(f_bar)) = (x.factors.get(p), factor_bar) {
            for (i, row) in t_bar.iter_mut().enumerate() {
                for (j, t) in row.iter_mut().take(3).enumerate() {
                    for c in 0..3 {
                        *t += f_bar[3 * i + c] * f[3 * j + c];
                    }
                }
            }
        }
        let t_bar = t_bar.as_flattened();
        if let Some(bars) = task.weights.chunks_exact_mut(bones).nth(at) {
            for (bar, g) in bars.iter_mut().zip(x.transforms) {
                *bar += t_bar.iter().zip(g).fold(0.0_f32, |sum, (t, g)| sum + t * g);
            }
        }
        if sums.is_empty() {
            continue;
        }
        for (b, w) in x.weights_of(p).iter().enumerate().filter(|(_, w)| **w != 0.0) {
            for (sum, t) in sums[12 * b..][..12].iter_mut().zip(t_bar) {
                *sum += f64::from(*w) * f64::from(*t);
            }
        }
    }
    sums
}
