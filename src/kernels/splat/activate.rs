//! `splat.activate`: converts stored parameters to the inputs of the renderer.
//!
//! scales = exp(scales_log),  opacities = 1 / (1 + exp(−opacity_logits))                 (3DGS 2023, §5.1)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | | `scales_log` | (N, 3) | ln of scene units |
//! | | `opacity_logits` | (N) | any |
//! | | `scales` | (N, 3) | scene units, > 0 |
//! | | `opacities` | (N) | 0..1 |
//!
//! # Rounding
//! The functions are [`elem::exp`] and [`elem::sigmoid`], each accurate to within one ulp.
//!
//! # Adjoint
//! scales_loḡ = scales̄ · scales;  logit̄ = ō · (o (1 − o)). The adjoint uses the outputs; nothing else is
//! saved.
//!
//! Twin: `reference::splat::activate`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::splat::activate::forward;
//! let (mut scales, mut opacities) = ([[0.0; 3]], [0.0]);
//! forward(&[[0.0, 0.0, std::f32::consts::LN_2]], &[0.0], &mut scales, &mut opacities);
//! assert_eq!((scales[0][0], opacities[0]), (1.0, 0.5)); // e⁰ and 1/(1 + e⁰)
//! assert!((scales[0][2] - 2.0).abs() < 1e-6);
//! ```

use crate::num::{elem, par};

const CHUNK: usize = 4096;

/// Fills `scales` (N, 3) and `opacities` (N).
pub fn forward(
    scales_log: &[[f32; 3]],
    opacity_logits: &[f32],
    scales: &mut [[f32; 3]],
    opacities: &mut [f32],
) {
    let n = scales_log.len();
    assert!(opacity_logits.len() == n && scales.len() == n && opacities.len() == n, "all arrays have N rows");
    par::chunks_mut2(scales, CHUNK, opacities, CHUNK, |c, s, o| {
        for (i, (s, o)) in s.iter_mut().zip(o.iter_mut()).enumerate() {
            *s = scales_log[c * CHUNK + i].map(elem::exp);
            *o = elem::sigmoid(opacity_logits[c * CHUNK + i]);
        }
    });
}

/// Adds the gradients to `scales_log_bar` (N, 3) and `opacity_logits_bar` (N); `scales` and `opacities` are
/// the outputs.
pub fn adjoint(
    scales: &[[f32; 3]],
    opacities: &[f32],
    scales_bar: &[[f32; 3]],
    opacities_bar: &[f32],
    scales_log_bar: &mut [[f32; 3]],
    opacity_logits_bar: &mut [f32],
) {
    let n = scales.len();
    assert!(
        opacities.len() == n && scales_bar.len() == n && opacities_bar.len() == n,
        "all arrays have N rows"
    );
    assert!(scales_log_bar.len() == n && opacity_logits_bar.len() == n, "gradients have N rows");
    par::chunks_mut2(scales_log_bar, CHUNK, opacity_logits_bar, CHUNK, |c, s_bar, o_bar| {
        for (i, (s_bar, o_bar)) in s_bar.iter_mut().zip(o_bar.iter_mut()).enumerate() {
            let at = c * CHUNK + i;
            for k in 0..3 {
                s_bar[k] += scales_bar[at][k] * scales[at][k];
            }
            *o_bar += opacities_bar[at] * (opacities[at] * (1.0 - opacities[at]));
        }
    });
}
