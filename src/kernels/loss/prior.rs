//! `loss.prior`: regularisation of Gaussians that no camera observes: neighbours are similar, each is about
//! as deep as it is wide and stays at its anchor.
//!
//! P = Σ_a w_a/(N K) Σ_g Σ_{h ∈ near(g)} ‖a_g − a_h‖²  +  w_r/N Σ_g Σ_k (s_gk − s̄_g)²  +
//! w_f/N Σ_g (s̄_g − ln(κ d_g))²  +  w_t/N Σ_g ‖x_g − t_g‖²/r²  −  w_o/N Σ_g σ(l_g)
//!
//! This loss was designed for this project; it is not from a paper.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | a | `sh` (its constant coefficients), `opacity_logits`, `scales_log` | | one weight each: `color`, `opacity`, `scale` |
//! | x, t | `means`, `anchors` | (N, 3) | centre, and the anchor that attracts it, a constant; scene units |
//! | s, s̄ | `scales_log` | (N, 3) | logarithms of the scales, and their mean |
//! | l, σ(l) | `opacity_logits` | (N) | logit of the opacity, and the opacity |
//! | | `sh` | (N, C, 3) | only the constant coefficients are compared |
//! | near(g) | `near` | (N, K) | indices of the nearest Gaussians; −1 (`u32::MAX`) for missing ones |
//! | ln d | `gap` | (N) | logarithm of the distance to the nearest Gaussian, a constant |
//! | κ | `reach` | () | > 0 in f32: scale of a Gaussian relative to the gap |
//! | r | `radius` | () | > 0, as is r² in f32; scene units: displacement that costs w_t |
//! | w_r, w_f, w_t, w_o | `round`, `fill`, `anchor`, `solid` | () | ≥ 0 |
//! | P | return | () | 0 if there are no Gaussians |
//!
//! # Rounding
//! Differences, s̄, σ, ln κ and the counts N K and N are f32; squares of differences and their sums over
//! Gaussians, from the left, one per term, are f64, each multiplied at the end by its weight over its count.
//! Gradients are f32, added Gaussian by Gaussian, neighbour by neighbour.
//!
//! # Kinks and domain
//! There are no kinks. The neighbours, gaps and anchors are constants. A mean over zero terms is 0: without
//! Gaussians P is 0, and for K = 0 so are the pair terms.
//!
//! # Adjoint
//! Per pair ā_g += 2 w_a P̄/(N K) (a_g − a_h), ā_h −= the same; s̄_gk += 2 w_r P̄/N (s_gk − s̄_g) +
//! 2 w_f P̄/(3N) (s̄_g − ln(κ d_g)) (the deviations from a mean have the mean 0); x̄ += 2 w_t P̄/N (x − t)/r²;
//! l̄ −= w_o P̄/N σ(l)(1 − σ(l)). Nothing is saved.
//!
//! Twin: `reference::loss::prior`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::prior::{In, Weights, forward};
//! let x = In {
//!     means: &[[1.0, 0.0, 0.0]], scales_log: &[[0.0; 3]], opacity_logits: &[0.0], sh: &[0.0; 3], coefficients: 1,
//!     near: &[[u32::MAX]], gap: &[0.0], anchors: &[[0.0; 3]], radius: 0.5,
//! };
//! assert_eq!(forward(&Weights { anchor: 1.0, ..Weights::NONE }, &x), 4.0);
//! ```

use crate::num::elem;

/// Weights of the terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Weight of similar colours.
    pub color: f32,
    /// Weight of similar opacity logits.
    pub opacity: f32,
    /// Weight of similar scales.
    pub scale: f32,
    /// Weight of roundness.
    pub round: f32,
    /// Weight of filling the gaps between neighbours.
    pub fill: f32,
    /// Scale κ of a Gaussian relative to the gap.
    pub reach: f32,
    /// Weight of proximity to the anchor.
    pub anchor: f32,
    /// Weight of opacity.
    pub solid: f32,
}

impl Weights {
    /// All weights 0, so that P is 0.
    pub const NONE: Self = Self {
        color: 0.0,
        opacity: 0.0,
        scale: 0.0,
        round: 0.0,
        fill: 0.0,
        reach: 1.0,
        anchor: 0.0,
        solid: 0.0,
    };
}

/// Inputs, for K neighbours of each Gaussian.
#[derive(Clone, Copy, Debug)]
pub struct In<'a, const K: usize> {
    /// Shape (N, 3).
    pub means: &'a [[f32; 3]],
    /// Shape (N, 3).
    pub scales_log: &'a [[f32; 3]],
    /// Shape (N).
    pub opacity_logits: &'a [f32],
    /// Shape (N, C, 3).
    pub sh: &'a [f32],
    /// Number of SH coefficients, C.
    pub coefficients: usize,
    /// Neighbours, shape (N, K); `u32::MAX` for missing ones.
    pub near: &'a [[u32; K]],
    /// Shape (N).
    pub gap: &'a [f32],
    /// Shape (N, 3).
    pub anchors: &'a [[f32; 3]],
    /// Radius r.
    pub radius: f64,
}

/// Gradients; the adjoint adds to them.
#[derive(Debug)]
pub struct InBar<'a> {
    /// Shape (N, 3).
    pub means: &'a mut [[f32; 3]],
    /// Shape (N, 3).
    pub scales_log: &'a mut [[f32; 3]],
    /// Shape (N).
    pub opacity_logits: &'a mut [f32],
    /// Shape (N, C, 3).
    pub sh: &'a mut [f32],
}

impl<const K: usize> In<'_, K> {
    /// Iterates over the pairs of neighbours in order.
    fn pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        let all = self.near.iter().enumerate().flat_map(|(i, near)| near.iter().map(move |&j| (i, j)));
        all.filter(|(_, j)| *j != u32::MAX).map(|(i, j)| [i, j as usize])
    }

    /// Returns N K and N.
    fn counts(&self) -> [f32; 2] {
        [(self.means.len() * K) as f32, self.means.len() as f32]
    }

    /// Returns the mean of the logarithms of the scales, and its difference from ln(κ d).
    fn size(&self, i: usize, ln_reach: f32) -> [f32; 2] {
        let s = self.scales_log[i];
        let mean = ((s[0] + s[1]) + s[2]) / 3.0;
        [mean, mean - (self.gap[i] + ln_reach)]
    }
}

/// Returns P.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward<const K: usize>(w: &Weights, x: &In<'_, K>) -> f64 {
    let width = 3 * x.coefficients;
    let square = |d: f32| f64::from(d) * f64::from(d);
    let mut sums = [0.0f64; 7];
    for [i, j] in x.pairs() {
        for c in 0..3 {
            sums[0] += square(x.sh[i * width + c] - x.sh[j * width + c]);
            sums[2] += square(x.scales_log[i][c] - x.scales_log[j][c]);
        }
        sums[1] += square(x.opacity_logits[i] - x.opacity_logits[j]);
    }
    let ln_reach = elem::ln(w.reach);
    for i in 0..x.means.len() {
        let [mean, lack] = x.size(i, ln_reach);
        sums[4] += square(lack);
        for c in 0..3 {
            sums[3] += square(x.scales_log[i][c] - mean);
            sums[5] += square(x.means[i][c] - x.anchors[i][c]) / (x.radius * x.radius);
        }
        sums[6] -= f64::from(elem::sigmoid(x.opacity_logits[i]));
    }
    let [pairs, each] = x.counts();
    let weights = [w.color, w.opacity, w.scale, w.round, w.fill, w.anchor, w.solid];
    let counts = [pairs, pairs, pairs, each, each, each, each];
    let kept = (0..7).filter(|&k| counts[k] > 0.0);
    kept.fold(0.0, |p, k| p + f64::from(weights[k]) * sums[k] / f64::from(counts[k]))
}

/// Adds the gradients for the cotangent `value_bar` to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint<const K: usize>(w: &Weights, x: &In<'_, K>, value_bar: f32, x_bar: &mut InBar<'_>) {
    let (width, [pairs, each]) = (3 * x.coefficients, x.counts());
    let [color, opacity, scale] = [w.color, w.opacity, w.scale].map(|w| 2.0 * (w * value_bar) / pairs);
    for [i, j] in x.pairs() {
        for c in 0..3 {
            let d = x.sh[i * width + c] - x.sh[j * width + c];
            x_bar.sh[i * width + c] += color * d;
            x_bar.sh[j * width + c] -= color * d;
            let d = x.scales_log[i][c] - x.scales_log[j][c];
            x_bar.scales_log[i][c] += scale * d;
            x_bar.scales_log[j][c] -= scale * d;
        }
        let d = x.opacity_logits[i] - x.opacity_logits[j];
        x_bar.opacity_logits[i] += opacity * d;
        x_bar.opacity_logits[j] -= opacity * d;
    }
    let [round, fill, anchor, solid] = [w.round, w.fill, w.anchor, w.solid].map(|w| w * value_bar);
    let square = (x.radius * x.radius) as f32;
    let ln_reach = elem::ln(w.reach);
    for i in 0..x.means.len() {
        let [mean, lack] = x.size(i, ln_reach);
        for c in 0..3 {
            let d = x.scales_log[i][c] - mean;
            x_bar.scales_log[i][c] += 2.0 * round / each * d + 2.0 * fill / (3.0 * each) * lack;
            let d = x.means[i][c] - x.anchors[i][c];
            x_bar.means[i][c] += 2.0 * anchor / each * d / square;
        }
        let o = elem::sigmoid(x.opacity_logits[i]);
        x_bar.opacity_logits[i] -= solid / each * (o * (1.0 - o));
    }
}
