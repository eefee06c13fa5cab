//! Active paths, and the buffers of a batch of them.

use super::passes::FirstHit;
use crate::geometry::bvh::{Hit, Ray};

/// An active path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    /// Index in the batch.
    pub(super) slot: u32,
    /// Pixel y·2³² + x, which together with the sample is the key of the draws.
    pub(super) pixel: u64,
    pub(super) sample: u32,
    /// Product of f·cos/p so far.
    pub(super) throughput: [f32; 3],
    /// Density of the current direction; 0 for camera rays, which no light sample competes with.
    pub(super) density: f32,
    /// Distance from the last vertex to the start of the ray, which is behind the transparent surfaces passed.
    pub(super) passed: f32,
}

/// Paths and their current rays.
#[derive(Debug, Default)]
pub(super) struct Front {
    pub(super) rays: Vec<Ray>,
    pub(super) paths: Vec<Path>,
}

impl Front {
    pub(super) fn clear(&mut self) {
        self.rays.clear();
        self.paths.clear();
    }

    #[inline(always)]
    pub(super) fn push(&mut self, ray: Ray, path: Path) {
        self.rays.push(ray);
        self.paths.push(path);
    }
}

/// Rays towards light.
#[derive(Debug, Default)]
pub(super) struct ShadowRays {
    pub(super) rays: Vec<Ray>,
    /// Slot of each ray, and the radiance to add there if the ray is not blocked.
    pub(super) light: Vec<(u32, [f32; 3])>,
    pub(super) occluded: Vec<bool>,
    /// First hits of the rays, if some material transmits light.
    pub(super) hits: Vec<Hit>,
}

impl ShadowRays {
    pub(super) fn clear(&mut self) {
        self.rays.clear();
        self.light.clear();
    }

    #[inline(always)]
    pub(super) fn push(&mut self, ray: Ray, slot: u32, light: [f32; 3]) {
        self.rays.push(ray);
        self.light.push((slot, light));
    }
}

/// All buffers of a batch, kept so that the next batch reuses their memory.
#[derive(Debug, Default)]
pub(super) struct Work {
    /// Paths on the way to the next vertex.
    pub(super) front: Front,
    /// Hits of these paths.
    pub(super) hits: Vec<Hit>,
    /// Indices in `front` of the paths that hit a surface.
    pub(super) met: Vec<u32>,
    /// Paths that leave the vertex.
    pub(super) next: Front,
    pub(super) shadow: ShadowRays,
    /// Radiance of each sample, shape (slots).
    pub(super) radiance: Vec<[f32; 3]>,
    /// First surface of each sample, shape (slots).
    pub(super) first: Vec<FirstHit>,
}

impl Work {
    /// Starts a batch of `slots` samples.
    pub(super) fn begin(&mut self, slots: usize) {
        self.front.clear();
        self.radiance.clear();
        self.radiance.resize(slots, [0.0; 3]);
        self.first.clear();
        self.first.resize(slots, FirstHit::default());
    }
}
