//! `shade.over_black`: replaces the background of a render by black.
//!
//! x' = x − (1 − α) b   (x = x' + (1 − α) b is *over* of Porter and Duff 1984)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `image` | (H, W, 3) | sRGB-encoded, composited over b |
//! | α | `alpha` | (H, W) | coverage 0..1 |
//! | b | `background` | (3) | sRGB-encoded; no gradient |
//! | x' | `over_black` | (H, W, 3) | |
//!
//! # Rounding
//! All values are f32, in the order of the equation; ᾱ is (r + g) + b.
//!
//! # Kinks and domain
//! There are no kinks.
//!
//! # Adjoint
//! x̄ += x̄',   ᾱ += Σ_c b_c x̄'_c. Nothing is saved. The cotangent of x equals that of x'; [`alpha_adjoint`]
//! computes ᾱ.
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

/// Removes the background from an image (H, W, 3).
///
/// # Panics
/// Panics if the image does not have the size of its alpha channel.
pub fn forward(alpha: &[f32], background: [f32; 3], image: &mut [f32]) {
    assert_eq!(image.len(), 3 * alpha.len(), "the image has three channels per pixel");
    for (rgb, a) in image.chunks_exact_mut(3).zip(alpha) {
        for k in 0..3 {
            rgb[k] -= (1.0 - a) * background[k];
        }
    }
}

/// Adds the gradient of α, for the cotangent `bar` (H, W, 3) of the result, to `alpha_bar` (H, W).
///
/// # Panics
/// Panics if the cotangent does not have the size of the alpha channel.
pub fn alpha_adjoint(background: [f32; 3], bar: &[f32], alpha_bar: &mut [f32]) {
    assert_eq!(bar.len(), 3 * alpha_bar.len(), "the cotangent has three channels per pixel");
    for (alpha_bar, g) in alpha_bar.iter_mut().zip(bar.chunks_exact(3)) {
        *alpha_bar += (g[0] * background[0] + g[1] * background[1]) + g[2] * background[2];
    }
}
