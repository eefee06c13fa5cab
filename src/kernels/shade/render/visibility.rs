//! Rays through transparent surfaces: camera and BRDF rays pass or stop at random, shadow rays are
//! attenuated.

use super::tracer::{OPACITY, Tracer, uniform};
use super::work::{Path, Work};
use crate::geometry::bvh::{Hit, MISS, Ray};
use crate::shade::surface;

/// Largest number of transparent surfaces that one ray passes; surfaces and lights behind them are ignored.
const LAYERS: u16 = 256;

impl Tracer<'_> {
    /// Moves a ray on through surfaces that transmit it.
    pub(super) fn pass_through(&self, ray: &mut Ray, hit: &mut Hit, path: &mut Path, vertex: u32) {
        for layer in 0..LAYERS {
            if hit.triangle == MISS {
                return;
            }
            let open = surface::transmittance(self.scene.object, hit);
            if open <= 0.0 {
                return;
            }
            if open < 1.0 {
                let draw = vertex as u16 * LAYERS + layer; // at most 255·256 + 255
                let word = self.rng.block(path.pixel, path.sample, OPACITY, draw);
                if uniform(word[0]) >= open {
                    return;
                }
            }
            path.passed += hit.t;
            ray.origin = surface::beyond(self.scene.object, hit, ray.direction);
            *hit = self.scene.bvh.closest(ray);
        }
    }

    /// Moves a ray on to the first surface with an opacity of at least one half.
    pub(super) fn pass_to_opaque(&self, ray: &mut Ray, hit: &mut Hit) {
        for _ in 0..LAYERS {
            let there = self.scene.transparent && hit.triangle != MISS;
            if !there || surface::transmittance(self.scene.object, hit) <= 0.5 {
                break;
            }
            ray.origin = surface::beyond(self.scene.object, hit, ray.direction);
            *hit = self.scene.bvh.closest(ray);
        }
    }

    /// Adds the light of shadow rays that are not blocked.
    pub(super) fn add_unshadowed(&self, work: &mut Work) {
        let shadow = &mut work.shadow;
        if self.scene.transparent {
            shadow.hits.clear();
            shadow.hits.resize(shadow.rays.len(), Hit::NONE);
            self.scene.bvh.closest_batch(&shadow.rays, &mut shadow.hits);
            let rays = shadow.rays.iter().zip(&shadow.hits);
            for ((ray, hit), (slot, light)) in rays.zip(&shadow.light) {
                let open = self.transmittance(*ray, *hit);
                for c in 0..3 {
                    work.radiance[*slot as usize][c] += open * light[c];
                }
            }
            return;
        }
        shadow.occluded.clear();
        shadow.occluded.resize(shadow.rays.len(), false);
        self.scene.bvh.occluded_batch(&shadow.rays, &mut shadow.occluded);
        for ((slot, light), occluded) in shadow.light.iter().zip(&shadow.occluded) {
            if !occluded {
                for c in 0..3 {
                    work.radiance[*slot as usize][c] += light[c];
                }
            }
        }
    }

    /// Returns the fraction of light that passes transparent surfaces: the product of their transmittances.
    /// `hit` is the first of them.
    fn transmittance(&self, mut ray: Ray, mut hit: Hit) -> f32 {
        let mut open = 1.0;
        for _ in 0..LAYERS {
            if hit.triangle == MISS {
                return open;
            }
            open *= surface::transmittance(self.scene.object, &hit);
            if open <= 0.0 {
                return 0.0;
            }
            ray.origin = surface::beyond(self.scene.object, &hit, ray.direction);
            ray.t_max -= hit.t;
            hit = self.scene.bvh.closest(&ray);
        }
        if hit.triangle == MISS { open } else { 0.0 }
    }
}
