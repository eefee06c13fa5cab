//! Automatic exposure of an image.

use super::environment::luminance;
use crate::num::order;

/// Percentile of the foreground's luminance that is scaled to [`TARGET`].
pub const PERCENTILE: f64 = 0.9;
/// Linear luminance of that percentile after scaling.
pub const TARGET: f32 = 0.8;
/// Limits of the scale.
pub const LIMITS: [f32; 2] = [0.25, 4.0];

/// Returns 0.8 divided by the 90th percentile of the luminance of foreground pixels (alpha ≥ ½), limited to
/// 0.25..=4, or 1 without a foreground.
///
/// The percentile is the entry at index ⌈0.9·n⌉ − 1 of the n luminances in ascending order. A black
/// foreground gives 4.
///
/// # Panics
/// Panics if the lengths differ.
pub fn auto(color: &[[f32; 3]], alpha: &[f32]) -> f32 {
    assert_eq!(color.len(), alpha.len(), "there is one alpha per pixel");
    let mut bright: Vec<f32> =
        color.iter().zip(alpha).filter(|(_, a)| **a >= 0.5).map(|(c, _)| luminance(*c)).collect();
    if bright.is_empty() {
        return 1.0;
    }
    bright.sort_unstable_by_key(|x| order::key_f32(*x));
    let rank = (PERCENTILE * bright.len() as f64).ceil() as usize;
    let level = bright[Ord::max(rank, 1) - 1];
    if !(level > 0.0) {
        return LIMITS[1];
    }
    order::clamp(TARGET / level, LIMITS[0], LIMITS[1])
}
