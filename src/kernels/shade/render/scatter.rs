//! One vertex of up to eight paths: emission, light samples, a BRDF sample.

use super::lobes::Lobes;
use super::points::{Points, Vertex, pick};
use super::tracer::{SCATTER, Tracer, uniform};
use super::work::{Front, Path, ShadowRays, Work};
use crate::geometry::bvh::Ray;
use crate::num::lanes::{Real, f32x8};
use crate::shade::vector::mul;

/// Directions drawn for the BRDF, one per lane.
struct BrdfSample {
    /// Unit direction.
    towards: [f32x8; 3],
    f_cos: [f32x8; 3],
    density: f32x8,
    /// Bits of the lanes whose direction is valid.
    goes: u32,
}

impl Tracer<'_> {
    /// Shades up to eight hits at these indices of `work.front`.
    #[inline(never)]
    pub(super) fn shade<const LAMBERT: bool>(&self, work: &mut Work, eight: &[u32], number: u32) {
        let scene = self.scene;
        let points = Points::new(scene, work, eight);
        if number == 0 {
            points.write_first(&mut work.first);
        }
        let throughput = points.throughput();
        if scene.emissive {
            let glow = mul(throughput, points.surface.emission).map(f32x8::to_array);
            for l in 0..points.count {
                let weight = self.weight_of_emission(work, eight[l] as usize);
                let out = &mut work.radiance[points.paths[l].slot as usize];
                for c in 0..3 {
                    out[c] += weight * glow[c][l];
                }
            }
        }
        let lobes = Lobes::<LAMBERT>::new(&points.surface, points.view);
        let vertex = Vertex { number, points: &points, lobes, throughput };
        if scene.lights() > 0 {
            self.sample_light(&vertex, &mut work.shadow);
        }
        if let Some(emitters) = &scene.emitters {
            self.sample_emitter(&vertex, emitters, &mut work.shadow);
        }
        let last = number == self.settings.bounces;
        if last && !scene.lit_by_sky() && !scene.emissive {
            return;
        }
        let sample = self.sample_brdf(&vertex);
        if last && !scene.emissive {
            self.look_at_sky(&vertex, &sample, &mut work.shadow);
        } else {
            vertex.go_on(&sample, &mut work.next);
        }
    }

    /// Draws a direction for every lane.
    #[inline(always)]
    fn sample_brdf<const LAMBERT: bool>(&self, vertex: &Vertex<'_, LAMBERT>) -> BrdfSample {
        let words = vertex.draw(self, SCATTER);
        let u: [f32x8; 3] = std::array::from_fn(|k| f32x8::from_fn(|l| uniform(words[l][k])));
        let towards = vertex.lobes.direction(u);
        let (f_cos, density) = vertex.lobes.eval(towards);
        let reflects = Real::gt(density, f32x8::splat(0.0));
        let goes = f32x8::bits(f32x8::and(reflects, vertex.points.surface.before(towards)));
        BrdfSample { towards, f_cos, density, goes }
    }

    /// Traces shadow rays to the map for paths that end with the directions of `sample`.
    #[inline(always)]
    fn look_at_sky<const LAMBERT: bool>(
        &self,
        vertex: &Vertex<'_, LAMBERT>,
        sample: &BrdfSample,
        shadow: &mut ShadowRays,
    ) {
        let Some(sky) = &self.scene.sky else { return };
        let (color, rival) = sky.look8(sample.towards, sample.goes);
        let total = sample.density + f32x8::splat(self.scene.choice()) * rival;
        let safe = Real::select(Real::gt(total, f32x8::splat(0.0)), total, f32x8::splat(1.0));
        let light = mul(mul(vertex.throughput, sample.f_cos), color).map(|x| (x / safe).to_array());
        let start = vertex.points.surface.start().map(f32x8::to_array);
        let ways = sample.towards.map(f32x8::to_array);
        for l in (0..vertex.points.count).filter(|l| sample.goes >> l & 1 == 1) {
            let ray = Ray { origin: pick(&start, l), direction: pick(&ways, l), t_max: f32::INFINITY };
            shadow.push(ray, vertex.points.paths[l].slot, pick(&light, l));
        }
    }
}

impl<const LAMBERT: bool> Vertex<'_, LAMBERT> {
    /// Continues the paths in the directions of `sample`.
    #[inline(always)]
    fn go_on(&self, sample: &BrdfSample, next: &mut Front) {
        let density = sample.density;
        let safe = Real::select(Real::gt(density, f32x8::splat(0.0)), density, f32x8::splat(1.0));
        let through = mul(self.throughput, sample.f_cos).map(|x| (x / safe).to_array());
        let start = self.points.surface.start().map(f32x8::to_array);
        let ways = sample.towards.map(f32x8::to_array);
        let density = density.to_array();
        for l in (0..self.points.count).filter(|l| sample.goes >> l & 1 == 1) {
            let throughput = pick(&through, l);
            if throughput == [0.0; 3] {
                continue;
            }
            next.push(
                Ray { origin: pick(&start, l), direction: pick(&ways, l), t_max: f32::INFINITY },
                Path { throughput, density: density[l], passed: 0.0, ..self.points.paths[l] },
            );
        }
    }
}
