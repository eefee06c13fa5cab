//! `splat.covariance`: the factor of a Gaussian's covariance from rotation and scales.
//!
//! Σ = R S Sᵀ Rᵀ = F Fᵀ,   F = R·S: column j of F is column j of R times s_j          (3DGS 2023, eq. 6)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | q | `quats` | (N, 4) | w, x, y, z; any length but zero |
//! | s | `scales` | (N, 3) | standard deviations, scene units, ≥ 0 |
//! | F | `factors` | (N, 3, 3) | scene units |
//!
//! All later stages use F and never Σ, because the product F Fᵀ loses the small axes of a needle.
//!
//! # Rounding
//! R rounds as in [`crate::math::quat`]; there is one product per entry.
//!
//! # Kinks and domain
//! Scenes with ‖q‖ = 0 are refused on input. A zero scale is valid: F loses rank, and the blur keeps the
//! splat visible.
//!
//! # Adjoint
//! R̄ᵢⱼ = F̄ᵢⱼ sⱼ, s̄ⱼ = Σᵢ F̄ᵢⱼ Rᵢⱼ, then [`crate::math::quat::rotation_adjoint`]. R is recomputed; nothing
//! is saved.
//!
//! Twin: `reference::splat::covariance`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::splat::covariance::forward;
//! // half a turn about z, R = diag(−1, −1, 1); the length of the quaternion has no influence
//! let mut factors = [[0.0; 9]];
//! forward(&[[0.0, 0.0, 0.0, 2.0]], &[[1.0, 2.0, 3.0]], &mut factors);
//! assert_eq!(factors, [[-1.0, 0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, 3.0]]);
//! ```

use crate::math::quat;
use crate::num::lanes::{Real, f32x8};
use crate::num::par;

/// Returns F of one quaternion and three scales, row-major.
#[inline(always)]
pub fn factor<L: Real>(q: [L; 4], s: [L; 3]) -> [L; 9] {
    let r = quat::rotation(q);
    std::array::from_fn(|e| r[e] * s[e % 3])
}

/// Returns (q̄, s̄) for the cotangent F̄.
#[inline(always)]
pub fn factor_adjoint<L: Real>(q: [L; 4], s: [L; 3], f_bar: [L; 9]) -> ([L; 4], [L; 3]) {
    let r = quat::rotation(q);
    let r_bar = std::array::from_fn(|e| f_bar[e] * s[e % 3]);
    let s_bar =
        std::array::from_fn(|j| (f_bar[j] * r[j] + f_bar[3 + j] * r[3 + j]) + f_bar[6 + j] * r[6 + j]);
    (quat::rotation_adjoint(q, r_bar), s_bar)
}

/// Returns `M` numbers of consecutive rows, one row per lane, transposed; rows past the end repeat the last
/// one.
#[inline(always)]
pub(crate) fn gather<const M: usize>(rows: &[[f32; M]], at: usize) -> [f32x8; M] {
    let last = rows.len() - 1;
    let pick: [&[f32; M]; 8] = std::array::from_fn(|l| &rows[crate::num::order::min(at + l, last)]);
    std::array::from_fn(|m| f32x8::from_fn(|l| pick[l][m]))
}

/// Adds lanes to consecutive rows; lanes past the end are dropped.
#[inline(always)]
pub(crate) fn scatter_add<const M: usize>(rows: &mut [[f32; M]], at: usize, values: [f32x8; M]) {
    let lanes = values.map(f32x8::to_array);
    for (l, row) in rows[at..].iter_mut().take(8).enumerate() {
        for m in 0..M {
            row[m] += lanes[m][l];
        }
    }
}

/// Writes lanes to consecutive rows; lanes past the end are dropped.
#[inline(always)]
pub(crate) fn scatter<const M: usize>(rows: &mut [[f32; M]], at: usize, values: [f32x8; M]) {
    let lanes = values.map(f32x8::to_array);
    for (l, row) in rows[at..].iter_mut().take(8).enumerate() {
        *row = std::array::from_fn(|m| lanes[m][l]);
    }
}

/// Rows per task, a multiple of the lane count. It changes no bit, because rows are independent.
const CHUNK: usize = 1024;

/// Computes `factors` (N, 3, 3) from `quats` (N, 4) and `scales` (N, 3).
pub fn forward(quats: &[[f32; 4]], scales: &[[f32; 3]], factors: &mut [[f32; 9]]) {
    assert!(
        quats.len() == scales.len() && scales.len() == factors.len(),
        "quats, scales and factors have N rows"
    );
    par::chunks_mut(factors, CHUNK, |c, out| {
        let base = c * CHUNK;
        let n = out.len();
        forward_rows(&quats[base..base + n], &scales[base..base + n], out);
    });
}

/// One thread's share of [`forward`].
pub(crate) fn forward_rows(quats: &[[f32; 4]], scales: &[[f32; 3]], factors: &mut [[f32; 9]]) {
    for at in (0..factors.len()).step_by(8) {
        scatter(factors, at, factor(gather(quats, at), gather(scales, at)));
    }
}

/// Adds the gradients to `quats_bar` (N, 4) and `scales_bar` (N, 3).
pub fn adjoint(
    quats: &[[f32; 4]],
    scales: &[[f32; 3]],
    factors_bar: &[[f32; 9]],
    quats_bar: &mut [[f32; 4]],
    scales_bar: &mut [[f32; 3]],
) {
    assert!(
        quats.len() == factors_bar.len() && scales.len() == quats.len(),
        "quats, scales and factors_bar have N rows"
    );
    assert!(quats_bar.len() == quats.len() && scales_bar.len() == quats.len(), "gradients have N rows");
    par::chunks_mut2(quats_bar, CHUNK, scales_bar, CHUNK, |c, q_bar, s_bar| {
        let rows = c * CHUNK..c * CHUNK + q_bar.len();
        adjoint_rows(&quats[rows.clone()], &scales[rows.clone()], &factors_bar[rows], q_bar, s_bar);
    });
}

/// One thread's share of [`adjoint`].
pub(crate) fn adjoint_rows(
    quats: &[[f32; 4]],
    scales: &[[f32; 3]],
    factors_bar: &[[f32; 9]],
    quats_bar: &mut [[f32; 4]],
    scales_bar: &mut [[f32; 3]],
) {
    for at in (0..quats.len()).step_by(8) {
        let (q_bar, s_bar) = factor_adjoint(gather(quats, at), gather(scales, at), gather(factors_bar, at));
        scatter_add(quats_bar, at, q_bar);
        scatter_add(scales_bar, at, s_bar);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identity_rotation_gives_the_scales_on_the_diagonal() {
        let mut f = vec![[0.0_f32; 9]];
        forward(&[[2.0, 0.0, 0.0, 0.0]], &[[1.0, 2.0, 3.0]], &mut f);
        assert_eq!(f[0], [1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0], "R = I whatever the length of q");
    }

    #[test]
    fn gradient_of_a_quaternion_is_orthogonal_to_it() {
        let q = [0.3_f32, -1.2, 0.7, 2.0];
        let (bar, _) = factor_adjoint(q, [0.5, 1.5, 0.1], [1.0, 2.0, -3.0, 0.5, 0.25, 4.0, -1.0, 0.75, 2.5]);
        let radial: f32 = (0..4).fold(0.0, |a, i| a + q[i] * bar[i]);
        assert!(radial.abs() <= 4e-6, "radial component {radial}");
    }
}
