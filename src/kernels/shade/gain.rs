//! `shade.gain`: per-channel gain on a render without its background, which models brightness changes between
//! frames.
//!
//! x' = e^γ (x − (1 − α) b) + (1 − α) b   (x = C + (1 − α) b is *over* of Porter and Duff 1984; the gain acts
//! on C)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `image` | (H, W, 3) | sRGB-encoded |
//! | α | `alpha` | (H, W) | coverage 0..1 |
//! | γ | `gain` | (3) | logarithm of the gain of a channel, ≤ 88 |
//! | b | `background` | (3) | sRGB-encoded; not scaled, no gradient |
//! | x' | `lit` | (H, W, 3) | sRGB-encoded |
//!
//! # Rounding
//! All values are f32 per pixel, in the order of the equation with (1 − α) b computed once. γ̄ is accumulated
//! per row in f64 from the left, rows by the pairwise tree, rounded once.
//!
//! # Kinks and domain
//! There are no kinks. Above γ = 88.72, e^γ is ∞ in f32, and x' is ∞ or NaN. There is at least one pixel.
//!
//! # Adjoint
//! x̄ += e^γ x̄',   ᾱ −= Σ_c (1 − e^γ_c) b_c x̄'_c,   γ̄_c += Σ over pixels of (x' − (1 − α) b)_c x̄'_c. The
//! result x' is saved. The adjoint works in place, as the forward pass does: the cotangent of x' becomes that
//! of x.
//!
//! Twin: `reference::shade::gain`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::shade::gain::{In, forward};
//! let mut image = [0.5, 0.5, 0.5];
//! forward(&In { alpha: &[0.5], background: [1.0, 0.0, 0.5], gain: [0.0; 3] }, &mut image);
//! assert_eq!(image, [0.5; 3]); // e⁰ = 1 changes nothing
//! ```

use crate::num::{elem, sum};

/// Inputs without the image, which is changed in place.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (H, W).
    pub alpha: &'a [f32],
    /// Background b.
    pub background: [f32; 3],
    /// Logarithmic gains γ.
    pub gain: [f32; 3],
}

/// Replaces the image x (H, W, 3) by x'.
///
/// # Panics
/// Panics if the image does not have the size of its alpha channel.
pub fn forward(x: &In<'_>, image: &mut [f32]) {
    assert_eq!(image.len(), 3 * x.alpha.len(), "the image has three channels per pixel");
    let g = x.gain.map(elem::exp);
    for (rgb, a) in image.chunks_exact_mut(3).zip(x.alpha) {
        for c in 0..3 {
            let behind = (1.0 - a) * x.background[c];
            rgb[c] = g[c] * (rgb[c] - behind) + behind;
        }
    }
}

/// Converts the cotangent `image_bar` of the result `lit` (H, W, 3) to that of the image, adds to `alpha_bar`
/// (H, W), and returns γ̄.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, or if the image does not consist of rows of
/// `width` pixels.
pub fn adjoint(
    x: &In<'_>,
    lit: &[f32],
    width: usize,
    image_bar: &mut [f32],
    alpha_bar: &mut [f32],
) -> [f32; 3] {
    assert!(
        lit.len() == 3 * x.alpha.len() && image_bar.len() == lit.len(),
        "result and cotangent have three channels per pixel"
    );
    assert!(alpha_bar.len() == x.alpha.len(), "there is one gradient per alpha value");
    assert!(width > 0 && x.alpha.len().is_multiple_of(width), "the image consists of complete rows");
    let g = x.gain.map(elem::exp);
    let rows = image_bar.chunks_exact_mut(3 * width).zip(alpha_bar.chunks_exact_mut(width)).enumerate();
    let sums: Vec<[f64; 3]> = rows
        .map(|(r, (image_bar, alpha_bar))| {
            let mut row = [0.0f64; 3];
            for (i, (bar, alpha_bar)) in image_bar.chunks_exact_mut(3).zip(alpha_bar).enumerate() {
                let at = r * width + i;
                let uncovered = 1.0 - x.alpha[at];
                for c in 0..3 {
                    let above = lit[3 * at + c] - uncovered * x.background[c];
                    row[c] += f64::from(above) * f64::from(bar[c]);
                    *alpha_bar -= (1.0 - g[c]) * x.background[c] * bar[c];
                    bar[c] *= g[c];
                }
            }
            row
        })
        .collect();
    std::array::from_fn(|c| sum::tree_f64(&sums.iter().map(|s| s[c]).collect::<Vec<f64>>()) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_differentiate() {
        let image: Vec<f32> = (0..12).map(|i| 0.2 + 0.05 * i as f32).collect();
        let alpha = [1.0, 0.5, 0.25, 0.9];
        let (background, gain) = ([0.2, 0.4, 0.6], [0.1, -0.3, 0.2]);
        let seeds: Vec<f32> = (0..12).map(|i| ((i * 5) % 7) as f32 - 3.0).collect();
        let value = |image: &[f32], alpha: &[f32], gain| {
            let mut lit = image.to_vec();
            forward(&In { alpha, background, gain }, &mut lit);
            lit.iter().zip(&seeds).fold(0.0, |s, (x, w)| s + f64::from(*x) * f64::from(*w))
        };
        let x = In { alpha: &alpha, background, gain };
        let mut lit = image.clone();
        forward(&x, &mut lit);
        let (mut image_bar, mut alpha_bar) = (seeds.clone(), vec![0.0; 4]);
        let bar = adjoint(&x, &lit, 2, &mut image_bar, &mut alpha_bar);
        let h = 1e-2f32;
        let close = |got: f32, up: f64, down: f64| {
            let slope = (up - down) / (2.0 * f64::from(h));
            assert!((f64::from(got) - slope).abs() < 2e-3 * (1.0 + slope.abs()), "{got} against {slope}");
        };
        for c in 0..3 {
            let gain = |d: f32| std::array::from_fn(|k| gain[k] + if k == c { d } else { 0.0 });
            close(bar[c], value(&image, &alpha, gain(h)), value(&image, &alpha, gain(-h)));
        }
        for i in 0..4 {
            let moved = |d: f32| {
                let mut alpha = alpha;
                alpha[i] += d;
                value(&image, &alpha, gain)
            };
            close(alpha_bar[i], moved(h), moved(-h));
        }
        for i in 0..12 {
            let moved = |d: f32| {
                let mut image = image.clone();
                image[i] += d;
                value(&image, &alpha, gain)
            };
            close(image_bar[i], moved(h), moved(-h));
        }
    }
}
