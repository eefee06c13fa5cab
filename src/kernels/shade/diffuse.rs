//! `shade.diffuse`: view-independent colours of Gaussians, shaded by a first-order light in their normals.
//!
//! c' = s · max(½ + Y₀ c, 0),   s = max(¼, 1 + n·d)   (bands 0 and 1 of Ramamoorthi and Hanrahan 2001)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | c | `sh` | (N, 3) | constant spherical-harmonic coefficients |
//! | n | `normals` | (N, 3) | unit vectors, or 0 for a surface without a normal; constants |
//! | d | `toward` | (3) | direction to the light, times its strength relative to the mean light |
//! | s | `shades` | (N) | ≥ ¼ |
//! | c' | `colors` | (N, 3) | sRGB-encoded, ≥ 0 |
//! | Y₀ | | | 0.28209479 |
//!
//! # Rounding
//! All values are f32; n·d is (x + y) + z. d̄ is a left fold over the Gaussians in f64, rounded once.
//!
//! # Kinks and domain
//! A shade at or below ¼ has no gradient; neither has a colour with ½ + Y₀ c below 0. At ½ + Y₀ c = 0 the
//! gradient is that of ½ + Y₀ c.
//!
//! # Adjoint
//! c̄ += Y₀ s c̄' where ½ + Y₀ c ≥ 0,   s̄ = Σ_c max(½ + Y₀ c, 0) c̄',   d̄ += Σ over s > ¼ of s̄ n. The
//! shades are saved.
//!
//! Twin: `reference::shade::diffuse`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::shade::diffuse::{In, forward};
//! let normals = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
//! let (colors, shades) = forward(&In { sh: &[0.0; 6], normals: &normals, toward: [0.0, 0.0, 0.5] });
//! assert_eq!((colors, shades), (vec![[0.75; 3], [0.25; 3]], vec![1.5, 0.5]));
//! ```

use crate::num::order;

/// Constant spherical harmonic Y₀.
const Y0: f32 = 0.282_094_79;
/// Smallest shade.
const LEAST: f32 = 0.25;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, 3).
    pub sh: &'a [f32],
    /// Shape (N, 3).
    pub normals: &'a [[f32; 3]],
    /// Direction and strength of the light, d.
    pub toward: [f32; 3],
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (N, 3).
    pub sh: Vec<f32>,
    /// Gradient of d.
    pub toward: [f32; 3],
}

/// Returns ½ + Y₀ c.
fn raw(c: f32) -> f32 {
    0.5 + Y0 * c
}

/// Whether a colour with the coefficient c has a gradient: ½ + Y₀ c ≥ 0.
pub fn is_lit(c: f32) -> bool {
    raw(c) >= 0.0
}

/// Returns the shade of a normal.
fn shade(normal: [f32; 3], toward: [f32; 3]) -> f32 {
    let s = 1.0 + ((normal[0] * toward[0] + normal[1] * toward[1]) + normal[2] * toward[2]);
    if s <= LEAST { LEAST } else { s }
}

/// Returns colours (N, 3) and shades (N).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> (Vec<[f32; 3]>, Vec<f32>) {
    assert_eq!(x.sh.len(), 3 * x.normals.len(), "there is one normal per colour");
    let shades: Vec<f32> = x.normals.iter().map(|&n| shade(n, x.toward)).collect();
    let colors = x.sh.as_chunks::<3>().0.iter().zip(&shades);
    let colors = colors.map(|(c, s)| c.map(|c| order::max(raw(c), 0.0) * s)).collect();
    (colors, shades)
}

/// Adds the gradients for the cotangent `colors_bar` (N, 3) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, shades: &[f32], colors_bar: &[[f32; 3]], x_bar: &mut InBar) {
    assert!(
        colors_bar.len() == shades.len() && x_bar.sh.len() == x.sh.len(),
        "there is one gradient per colour"
    );
    let mut sum = [0.0f64; 3];
    for (i, (normal, &s)) in x.normals.iter().zip(shades).enumerate() {
        let mut shade_bar = 0.0f32;
        for c in 0..3 {
            let base = raw(x.sh[3 * i + c]);
            if base >= 0.0 {
                x_bar.sh[3 * i + c] += Y0 * s * colors_bar[i][c];
                shade_bar += base * colors_bar[i][c];
            }
        }
        if s <= LEAST {
            continue;
        }
        for c in 0..3 {
            sum[c] += f64::from(normal[c]) * f64::from(shade_bar);
        }
    }
    x_bar.toward.iter_mut().zip(sum).for_each(|(bar, s)| *bar += s as f32);
}
