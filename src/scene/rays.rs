//! Rays of a view as Plücker coordinates, which a network reads pixel by pixel.
//!
//! A ray from o in the unit direction d has the coordinates (d, m), m = o × d. The moment m is the same for every point of
//! the line: (o + s·d) × d = o × d. So the six numbers describe the line, not the camera's place on it; d·m = 0, and ‖m‖ is
//! the distance of the line from the origin of the world.
//!
//! # Rounding
//! o and d are those of [`Camera::ray`]. The products of m and their difference are computed in f64, and m is rounded once.

use super::camera::Camera;
use crate::num::par;

/// Numbers per pixel: d, then m.
pub const PLUCKER: usize = 6;

/// Returns (d, o × d) of the ray through the centre of every pixel, shape (H, W, 6), for any camera model. A pixel without a
/// ray (outside the circle of a fisheye) has six zeros, which no ray has.
///
/// ```
/// # use lastlight_scene as lastlight;
/// use lastlight::scene::camera::{Camera, Model};
/// use lastlight::scene::rays::plucker;
/// let camera = Camera {
///     rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
///     translation: [-2.0, 0.0, 0.0], // the camera is at (2, 0, 0)
///     focal_px: [1.0, 1.0],
///     center_px: [0.5, 0.5],
///     width: 1,
///     height: 1,
///     model: Model::Pinhole,
/// };
/// // d = (0, 0, 1), (2, 0, 0) × (0, 0, 1) = (0, −2, 0)
/// assert_eq!(plucker(&camera), [0.0, 0.0, 1.0, 0.0, -2.0, 0.0]);
/// ```
pub fn plucker(camera: &Camera) -> Vec<f32> {
    let mut rays = vec![0.0; camera.height * camera.width * PLUCKER];
    par::chunks_mut(&mut rays, camera.width * PLUCKER, |row, line| {
        for (column, ray) in line.chunks_exact_mut(PLUCKER).enumerate() {
            if let Some((origin, direction)) = camera.ray([column, row].map(|at| at as f32 + 0.5)) {
                ray[..3].copy_from_slice(&direction);
                ray[3..].copy_from_slice(&moment(origin, direction));
            }
        }
    });
    rays
}

/// Returns o × d.
pub fn moment(o: [f32; 3], d: [f32; 3]) -> [f32; 3] {
    let (o, d) = (o.map(f64::from), d.map(f64::from));
    let along = |i: usize, j: usize| (o[i] * d[j] - o[j] * d[i]) as f32;
    [along(1, 2), along(2, 0), along(0, 1)]
}
