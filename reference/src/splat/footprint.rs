//! Extent of an ellipse: its covariance, Inria's square, the half-axes of its bounding box.

use crate::scene::camera::Camera;
use crate::scene::profile::{Footprint, Profile};

/// xx, xy, yy of Σ' from s, k1, k2 and the axis p.
pub fn covariance_of_shape(shape: [f64; 3], axis: usize) -> [f64; 3] {
    let [s, k1, k2] = shape;
    let larger = 1.0 / (k1 * k1);
    let other = 1.0 / (k2 * k2) + s * s * larger;
    if axis == 0 { [larger, s * larger, other] } else { [other, s * larger, larger] }
}

/// Half-width of Inria's square, ceil(3 √λ_max) with λ_max = m + √max(0.1, m² − det).
pub fn inria_radius(shape: [f64; 3], axis: usize) -> f64 {
    let [a, _, c] = covariance_of_shape(shape, axis);
    let (m, det) = (0.5 * (a + c), 1.0 / (shape[1] * shape[1]) / (shape[2] * shape[2]));
    let square = m * m - det;
    libm::ceil(3.0 * (m + if square > 0.1 { square } else { 0.1 }.sqrt()).sqrt())
}

/// Extent of a Gaussian without an opacity, in standard deviations: √(2 ln 255), rounded up.
const EXTENT: f64 = 3.33;

/// Half-axes in whole pixels of the box around the visible part: ceil(e·√Σ'ii), e = min(3.33, √(2
/// ln(o/α_min))), or Inria's square; without an opacity or without a cut-off, e = 3.33. Both are 0 where o <
/// α_min, or where the box of e = 3.33 (Inria's square) lies outside the image.
pub fn radii_px(
    mean_px: [f64; 2],
    shape: [f64; 3],
    axis: usize,
    opacity: Option<f64>,
    camera: &Camera,
    profile: &Profile,
) -> [f64; 2] {
    let [a, _, c] = covariance_of_shape(shape, axis);
    let inria = profile.footprint == Footprint::Inria;
    let radii = |extent: f64| match inria {
        true => [inria_radius(shape, axis); 2],
        false => [a, c].map(|variance| libm::ceil(extent * variance.sqrt())),
    };
    let extent = match opacity {
        Some(o) if !inria && o < profile.alpha_min => return [0.0; 2],
        Some(o) if profile.alpha_min > 0.0 => (2.0 * libm::log(o / profile.alpha_min)).sqrt(),
        _ => EXTENT,
    };
    let widest = radii(EXTENT);
    let touches =
        (0..2).all(|k| mean_px[k] + widest[k] > 0.0 && mean_px[k] - widest[k] < camera.size_px[k] as f64);
    match touches {
        true => radii(if extent < EXTENT { extent } else { EXTENT }),
        false => [0.0; 2],
    }
}
