//! `shade.over_black`: a render before black instead of its background.
//!
//! x' = x − (1 − α) b                                                         (x = x' + (1 − α) b is *over* of Porter and Duff 1984)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `image` | (H, W, 3) | sRGB-encoded, composited over b |
//! | α | `alpha` | (H, W) | coverage 0..1 |
//! | b | `background` | (3) | sRGB-encoded; gets no gradient |
//! | x' | `over_black` | (H, W, 3) | |
//!
//! # Rounding
//! f32, in the order of the equation; ᾱ as (r + g) + b.
//!
//! # Kinks and domain
//! None.
//!
//! # Adjoint
//! x̄ += x̄',   ᾱ += Σ_c b_c x̄'_c. Nothing is saved. The cotangent of x is that of x': [`alpha_adjoint`] gives the rest.
//!
//! Twin: `reference::shade::over_black`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! let mut image = [1.0, 0.75, 0.5];
//! lastlight::shade::over_black::forward(&[0.5], [1.0, 0.5, 0.0], &mut image);
//! assert_eq!(image, [0.5, 0.5, 0.5]);
//! ```

/// Takes the background out of an image (H, W, 3).
///
/// # Panics
/// When the image does not have the size of its coverage.
pub fn forward(alpha: &[f32], background: [f32; 3], image: &mut [f32]) {
    assert_eq!(image.len(), 3 * alpha.len(), "three channels per pixel");
    for (rgb, a) in image.chunks_exact_mut(3).zip(alpha) {
        for k in 0..3 {
            rgb[k] -= (1.0 - a) * background[k];
        }
    }
}

/// Adds the gradient by the coverage for the cotangent `bar` (H, W, 3) of the result to `alpha_bar` (H, W).
///
/// # Panics
/// When the cotangent does not have the size of the coverage.
pub fn alpha_adjoint(background: [f32; 3], bar: &[f32], alpha_bar: &mut [f32]) {
    assert_eq!(bar.len(), 3 * alpha_bar.len(), "three channels per pixel");
    for (alpha_bar, g) in alpha_bar.iter_mut().zip(bar.chunks_exact(3)) {
        *alpha_bar += (g[0] * background[0] + g[1] * background[1]) + g[2] * background[2];
    }
}
