//! Tiles: the camera rays of their pixels, and the means over the samples of a pixel.

use super::passes::{Pixel, Window};
use super::tracer::{CAMERA, Tracer, uniform};
use super::work::{Path, Work};
use crate::geometry::bvh::{Hit, MISS, Ray};
use crate::scene::camera::Camera;
use crate::shade::surface;
use crate::shade::vector::dot;

/// Number of paths traced together; it changes no bit.
const BATCH: usize = 4096;

/// A camera that may move while the shutter is open.
pub(super) struct Shutter<'a> {
    /// The camera when the shutter opens.
    pub(super) camera: &'a Camera,
    /// The camera when the shutter closes; `None` if it does not move.
    pub(super) end: Option<&'a Camera>,
    /// The camera at half time; the camera itself if it does not move.
    pub(super) middle: &'a Camera,
}

/// Data that is the same for all tiles.
pub(super) struct Job<'a> {
    pub(super) tracer: Tracer<'a>,
    pub(super) shutter: Shutter<'a>,
}

impl Job<'_> {
    /// Renders the pixels of one tile.
    pub(super) fn tile(&self, tile: Window) -> Vec<Pixel> {
        let n = tile.size[0] * tile.size[1];
        let mut pixels = vec![Pixel::default(); n];
        let mut work = Work::default();
        let all = self.tracer.settings.samples;
        let per_batch = Ord::max(1, BATCH / n) as u32;
        let mut from = 0;
        while from < all {
            let to = Ord::min(from + per_batch, all);
            let each = (to - from) as usize;
            self.aim(&mut work, tile, from..to, self.shutter.end);
            self.tracer.trace(&mut work);
            for (k, p) in pixels.iter_mut().enumerate() {
                for slot in k * each..(k + 1) * each {
                    p.add_light(&work.radiance[slot], &work.first[slot]);
                }
            }
            if self.shutter.end.is_some() {
                self.aim(&mut work, tile, from..to, None);
                self.tracer.find_first(&mut work);
            }
            for (k, p) in pixels.iter_mut().enumerate() {
                for first in &work.first[k * each..(k + 1) * each] {
                    p.add_surface(first);
                }
            }
            from = to;
        }
        for p in &mut pixels {
            p.finish(all);
        }
        self.depths(tile, &mut pixels);
        pixels
    }

    /// Computes the depth at which the rays through the centres of a tile's pixels hit a surface.
    fn depths(&self, tile: Window, pixels: &mut [Pixel]) {
        let (scene, camera) = (self.tracer.scene, self.shutter.middle);
        let (mut rays, mut of) = (Vec::new(), Vec::new());
        for k in 0..pixels.len() {
            let at = [tile.origin[0] + k % tile.size[0], tile.origin[1] + k / tile.size[0]];
            if let Some((origin, direction)) = camera.ray(at.map(|x| x as f32 + 0.5)) {
                rays.push(Ray { origin, direction, t_max: f32::INFINITY });
                of.push(k);
            }
        }
        let mut hits = vec![Hit::NONE; rays.len()];
        scene.bvh.closest_batch(&rays, &mut hits);
        for ((ray, hit), k) in rays.iter_mut().zip(&mut hits).zip(of) {
            self.tracer.pass_to_opaque(ray, hit);
            if hit.triangle != MISS {
                let p = surface::position(scene.object, hit);
                pixels[k].depth_z = dot(camera.rotation[2], p) + camera.translation[2];
            }
        }
    }

    /// Starts the paths of some samples of a tile: pixel by pixel, samples ascending. Without `end` the
    /// camera stays at half time.
    fn aim(&self, work: &mut Work, tile: Window, samples: std::ops::Range<u32>, end: Option<&Camera>) {
        let Window { origin, size } = tile;
        work.begin(size[0] * size[1] * samples.len());
        let mut slot = 0;
        for y in origin[1]..origin[1] + size[1] {
            for x in origin[0]..origin[0] + size[0] {
                let pixel = (y as u64) << 32 | x as u64;
                for sample in samples.clone() {
                    let word = self.tracer.rng.block(pixel, sample, CAMERA, 0);
                    let px = [x as f32 + uniform(word[0]), y as f32 + uniform(word[1])];
                    let ray = match end {
                        None => self.shutter.middle.ray(px),
                        Some(end) => {
                            let all = self.tracer.settings.samples as f32;
                            let time = (sample as f32 + uniform(word[2])) / all;
                            self.shutter.camera.between(end, time).ray(px)
                        }
                    };
                    if let Some((origin, direction)) = ray {
                        work.front.push(
                            Ray { origin, direction, t_max: f32::INFINITY },
                            Path { slot, pixel, sample, throughput: [1.0; 3], density: 0.0, passed: 0.0 },
                        );
                    }
                    slot += 1;
                }
            }
        }
    }
}
