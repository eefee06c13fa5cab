//! Up to eight surface points that are shaded together, one per lane.

use super::lobes::Lobes;
use super::passes::FirstHit;
use super::scene::Scene;
use super::tracer::Tracer;
use super::work::{Path, Work};
use crate::num::lanes::{Real, f32x8};
use crate::shade::surface::{self, Surface};

/// Points where paths hit a surface. Lanes from `count` on repeat the last point.
pub(super) struct Points {
    pub(super) count: usize,
    pub(super) paths: [Path; 8],
    /// Direction back along the paths.
    pub(super) view: [f32x8; 3],
    pub(super) surface: Surface,
}

impl Points {
    /// Builds the points of the paths at these indices of `work.front`.
    #[inline(always)]
    pub(super) fn new(scene: &Scene<'_>, work: &Work, eight: &[u32]) -> Self {
        let at: [usize; 8] = std::array::from_fn(|l| eight[Ord::min(l, eight.len() - 1)] as usize);
        let rays = &work.front.rays;
        let view: [f32x8; 3] = std::array::from_fn(|c| f32x8::from_fn(|l| -rays[at[l]].direction[c]));
        Self {
            count: eight.len(),
            paths: at.map(|k| work.front.paths[k]),
            view,
            surface: surface::eight(scene.object, &at.map(|k| work.hits[k]), view),
        }
    }

    /// Returns the throughputs of the paths.
    #[inline(always)]
    pub(super) fn throughput(&self) -> [f32x8; 3] {
        std::array::from_fn(|c| f32x8::from_fn(|l| self.paths[l].throughput[c]))
    }

    /// Stores the points as the first surfaces of their samples.
    pub(super) fn write_first(&self, into: &mut [FirstHit]) {
        let s = &self.surface;
        let (normal, albedo) = (s.mapped.map(f32x8::to_array), s.material.albedo.map(f32x8::to_array));
        let (roughness, metallic) = (s.material.roughness.to_array(), s.material.metallic.to_array());
        for l in 0..self.count {
            into[self.paths[l].slot as usize] = FirstHit {
                hit: true,
                normal: pick(&normal, l),
                albedo: pick(&albedo, l),
                roughness: roughness[l],
                metallic: metallic[l],
            };
        }
    }
}

/// A vertex of up to eight paths: the points and their BRDFs.
pub(super) struct Vertex<'a, const LAMBERT: bool> {
    /// Number of surfaces before this one.
    pub(super) number: u32,
    pub(super) points: &'a Points,
    pub(super) lobes: Lobes<LAMBERT>,
    /// Throughput of the paths up to this vertex.
    pub(super) throughput: [f32x8; 3],
}

impl<const LAMBERT: bool> Vertex<'_, LAMBERT> {
    /// Draws one block of random words per lane.
    #[inline(always)]
    pub(super) fn draw(&self, tracer: &Tracer<'_>, purpose: u16) -> [[u32; 4]; 8] {
        let paths = &self.points.paths;
        let number = self.number as u16;
        std::array::from_fn(|l| tracer.rng.block(paths[l].pixel, paths[l].sample, purpose, number))
    }
}

/// Returns lane `l` of three components.
#[inline(always)]
pub(super) fn pick(x: &[[f32; 8]; 3], l: usize) -> [f32; 3] {
    [x[0][l], x[1][l], x[2][l]]
}
