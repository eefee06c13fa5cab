//! Numerical normals at the surface points of rays, compared with a pass. Shared by the fits of one object and by LIRM.
//!
//! LIRM composites the normals of all samples of a ray; here there is one stencil per ray, at its surface point x̂ ([`super::surface`]).

use super::crops::Crop;
use super::losses::cropped;
use super::targets::Target;
use crate::Result;
use crate::field::render;
use crate::loss::{self, mse};

/// Rays that end at a surface of the object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtSurface {
    /// Indices of the rays.
    pub rays: Vec<usize>,
    /// Their surface points.
    pub points: Vec<[f32; 3]>,
}

impl AtSurface {
    /// The rays of crops that are opaque, where the image is covered by the object and counts.
    pub fn of(targets: &[Target], crops: &[Crop], out: &render::Out) -> Self {
        let mut covered = Vec::with_capacity(out.opacity.len());
        for crop in crops {
            let target = &targets[crop.view];
            let of = |all: &[f32]| cropped(all, target.camera.width, crop, 1);
            let kept = target.kept.as_ref().map(|kept| of(kept));
            let is_kept = |i: usize| kept.as_ref().is_none_or(|k| k[i] != 0.0);
            covered.extend(of(&target.foreground).iter().enumerate().map(|(i, m)| *m > 0.5 && is_kept(i)));
        }
        let is_there = |i: &usize| out.opacity[*i] > render::VALID && covered[*i];
        let rays: Vec<usize> = (0..out.opacity.len()).filter(is_there).collect();
        Self { points: rays.iter().map(|i| out.points[*i]).collect(), rays }
    }

    /// The mean over all pixels of ‖n − n*‖² where a normal is compared, times a weight; its cotangents are added to `bar`, one per
    /// ray at the surface. 0 where an image has no pass.
    ///
    /// # Errors
    /// When there is a normal that is not finite.
    pub fn compare(
        &self,
        targets: &[Target],
        crops: &[Crop],
        normals: &[[f32; 3]],
        weight: f32,
        bar: &mut [[f32; 3]],
    ) -> Result<f32> {
        let (mut truth, mut solid) = (Vec::new(), Vec::new());
        for crop in crops {
            let target = &targets[crop.view];
            let Some(normal) = &target.normal else { return Ok(0.0) };
            truth.extend(cropped(normal, target.camera.width, crop, 3));
            solid.extend(cropped(&target.solid, target.camera.width, crop, 1));
        }
        let all = solid.len();
        let y: Vec<f32> = self.rays.iter().flat_map(|r| truth[3 * r..3 * r + 3].to_vec()).collect();
        let mask: Vec<f32> = self.rays.iter().map(|r| solid[*r]).collect();
        let x = normals.as_flattened();
        let pair = loss::In { x, y: &y, mask: Some(&mask), height: mask.len(), width: 1 };
        let (value, saved) = mse::forward_over(&pair, mse::Over::All)?;
        // Over all pixels, as the other terms.
        let weight = weight * mask.len() as f32 / all as f32;
        mse::adjoint(&pair, &saved, weight, bar.as_flattened_mut(), None);
        Ok(weight * value)
    }
}
