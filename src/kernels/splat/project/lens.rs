//! A camera in the form that the projection reads.

use crate::num::lanes::f32x8;
use crate::scene::camera::{Camera, Model};
use crate::scene::profile::{Profile, TangentClamp};

/// A camera with the precomputed limits of a profile.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// Rotation R.
    pub(super) rotation: [[f32; 3]; 3],
    /// Translation τ, scene units.
    translation: [f32; 3],
    /// Focal lengths f_x, f_y, pixels.
    pub(super) focal: [f32; 2],
    /// Principal point, pixels.
    pub(super) center: [f32; 2],
    /// Smallest and largest t_x/z, then t_y/z, in the Jacobian.
    pub(super) limits: [[f32; 2]; 2],
    /// Width and height, pixels.
    pub(super) size: [f32; 2],
    pub(super) model: Model,
}

impl Lens {
    /// Builds the lens with the tangent limits of `profile`.
    pub fn new(camera: &Camera, profile: &Profile) -> Self {
        let size = [camera.width as f32, camera.height as f32];
        let limits = std::array::from_fn(|i| {
            let (f, c, w) = (camera.focal_px[i], camera.center_px[i], size[i]);
            let tan = w / (2.0 * f);
            match profile.clamp {
                TangentClamp::Gsplat => [-(c / f + 0.3 * tan), (w - c) / f + 0.3 * tan],
                TangentClamp::Inria => [-(1.3 * tan), 1.3 * tan],
            }
        });
        Self {
            rotation: camera.rotation,
            translation: camera.translation,
            focal: camera.focal_px,
            center: camera.center_px,
            limits,
            size,
            model: camera.model,
        }
    }

    /// Returns row `i` of t = R μ + τ.
    #[inline(always)]
    pub(super) fn camera_space(&self, i: usize, mean: [f32x8; 3]) -> f32x8 {
        self.turn(i, mean) + f32x8::splat(self.translation[i])
    }

    /// Returns the dot product of row `i` of R with `v`, a left fold.
    #[inline(always)]
    pub(super) fn turn(&self, i: usize, v: [f32x8; 3]) -> f32x8 {
        let [a, b, c] = self.rotation[i].map(f32x8::splat);
        (a * v[0] + b * v[1]) + c * v[2]
    }
}
