//! Paths on their way and the buffers of a batch of them.

use super::passes::FirstHit;
use crate::geometry::bvh::{Hit, Ray};

/// A path under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    /// place in the batch
    pub(super) slot: u32,
    /// (y·2³² + x, sample): the key of its draws
    pub(super) pixel: u64,
    pub(super) sample: u32,
    /// product of f·cos/p so far
    pub(super) throughput: [f32; 3],
    /// density of the direction it travels in; 0 for the camera's, which no light sample rivals
    pub(super) density: f32,
}

/// Paths and the rays that they travel along.
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
    /// slot that a ray belongs to, and what arrives there if the ray is free
    pub(super) light: Vec<(u32, [f32; 3])>,
    pub(super) occluded: Vec<bool>,
    /// what they meet first, where materials let light through
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

/// Everything about a batch, kept so that the next one reuses its memory.
#[derive(Debug, Default)]
pub(super) struct Work {
    /// paths on the way to the vertex that comes next
    pub(super) front: Front,
    /// what they hit
    pub(super) hits: Vec<Hit>,
    /// places in `front` that hit something
    pub(super) met: Vec<u32>,
    /// paths that leave the vertex
    pub(super) next: Front,
    pub(super) shadow: ShadowRays,
    /// (slots)
    pub(super) radiance: Vec<[f32; 3]>,
    /// (slots)
    pub(super) first: Vec<FirstHit>,
}

impl Work {
    /// Begins a batch of `slots` samples.
    pub(super) fn begin(&mut self, slots: usize) {
        self.front.clear();
        self.radiance.clear();
        self.radiance.resize(slots, [0.0; 3]);
        self.first.clear();
        self.first.resize(slots, FirstHit::default());
    }
}
