//! Next-event estimation: one light and one point of an emissive triangle are drawn per point, and shadow rays
//! are traced towards them.

use super::emitters::Emitters;
use super::points::{Points, Vertex, pick};
use super::tracer::{EMITTER, LIGHT, Tracer, uniform};
use super::work::{ShadowRays, Work};
use crate::geometry::bvh::Ray;
use crate::num::lanes::{Real, f32x8};
use crate::num::order;
use crate::scene::light::{Lamp, MAX_RADIANCE};
use crate::shade::environment::Sky;
use crate::shade::vector::{mul, select, sub, unit};

/// One light sample per lane, relative to the points.
struct LightSample {
    /// Unit direction towards the light.
    towards: [f32x8; 3],
    /// Irradiance of a lamp divided by the probability of drawing it, or radiance of an emitter; 0 if the map
    /// was drawn.
    light: [f32x8; 3],
    /// Density of the direction times the probability of drawing this light; 1 for lamps, 0 if there is no
    /// sample.
    density: f32x8,
    /// 1 where BRDF sampling can produce the same direction, which is where the map or an emitter was drawn;
    /// otherwise 0.
    rival: f32x8,
    /// Distance to the light.
    reach: [f32; 8],
}

impl Tracer<'_> {
    /// Traces shadow rays to one light per point, drawn uniformly; the map counts as one light. The scene has
    /// at least one light.
    #[inline(always)]
    pub(super) fn sample_light<const LAMBERT: bool>(
        &self,
        vertex: &Vertex<'_, LAMBERT>,
        shadow: &mut ShadowRays,
    ) {
        let sample = self.draw_light(vertex.points, &vertex.draw(self, LIGHT));
        vertex.look_at(&sample, self.scene.sky.as_ref(), shadow);
    }

    /// Traces shadow rays to one point of an emissive triangle per surface point.
    #[inline(always)]
    pub(super) fn sample_emitter<const LAMBERT: bool>(
        &self,
        vertex: &Vertex<'_, LAMBERT>,
        emitters: &Emitters,
        shadow: &mut ShadowRays,
    ) {
        let words = vertex.draw(self, EMITTER);
        let start = vertex.points.surface.start().map(f32x8::to_array);
        let (mut towards, mut radiance) = ([[0.0; 8]; 3], [[0.0; 8]; 3]);
        let (mut density, mut reach) = ([0.0; 8], [0.0; 8]);
        for l in 0..vertex.points.count {
            let [x0, x1, x2, x3] = words[l];
            let word = u64::from(x1) << 32 | u64::from(x0);
            let u = [uniform(x2), uniform(x3)];
            let Some(drawn) = emitters.draw(self.scene.object, pick(&start, l), word, u) else { continue };
            for c in 0..3 {
                towards[c][l] = drawn.towards[c];
                radiance[c][l] = drawn.radiance[c];
            }
            (density[l], reach[l]) = (drawn.density, drawn.reach);
        }
        let sample = LightSample {
            towards: towards.map(f32x8::new),
            light: radiance.map(f32x8::new),
            density: f32x8::new(density),
            rival: f32x8::splat(1.0),
            reach,
        };
        vertex.look_at(&sample, None, shadow);
    }

    /// Returns the weight of the emission that path `k` of `work.front` meets: that of the balance heuristic
    /// where an emitter sample could have found it, otherwise 1.
    #[inline]
    pub(super) fn weight_of_emission(&self, work: &Work, k: usize) -> f32 {
        let path = &work.front.paths[k];
        match &self.scene.emitters {
            Some(emitters) if path.density > 0.0 => {
                let (hit, direction) = (&work.hits[k], work.front.rays[k].direction);
                let distance = path.passed + hit.t;
                let rival = emitters.density(self.scene.object, hit.triangle, direction, distance);
                path.density / (path.density + rival)
            }
            _ => 1.0,
        }
    }

    /// Draws a light for every lane.
    #[inline(always)]
    fn draw_light(&self, points: &Points, words: &[[u32; 4]; 8]) -> LightSample {
        let scene = self.scene;
        let lights = scene.lights();
        // The upper part of word·lights selects the light; the lower part is again uniform and selects the
        // texel.
        let (mut chosen, mut rest) = ([0_usize; 8], [0_u64; 8]);
        for l in 0..8 {
            let word = u64::from(words[l][1]) << 32 | u64::from(words[l][0]);
            let wide = u128::from(word) * lights as u128;
            (chosen[l], rest[l]) = ((wide >> 64) as usize, wide as u64);
        }
        let zero = f32x8::splat(0.0);
        let mut sample = LightSample {
            towards: [zero; 3],
            light: [zero; 3],
            density: zero,
            rival: zero,
            reach: [f32::INFINITY; 8],
        };
        if scene.lit_by_sky()
            && let Some(sky) = &scene.sky
        {
            let u2: [f32; 8] = std::array::from_fn(|l| uniform(words[l][2]));
            let u3: [f32; 8] = std::array::from_fn(|l| uniform(words[l][3]));
            if let Some((d, density)) = sky.draw8(&rest, [&u2, &u3]) {
                sample.towards = d;
                sample.density = density * f32x8::splat(scene.choice());
                sample.rival = f32x8::splat(1.0);
            }
        }
        let lamps = chosen.map(|i| scene.lamps.get(i));
        if lamps[..points.count].iter().any(Option::is_some) {
            sample.put_lamps(points, &lamps, lights as f32);
        }
        sample
    }
}

impl<const LAMBERT: bool> Vertex<'_, LAMBERT> {
    /// Adds the shadow rays of a light sample; a lane that drew the map takes its radiance from `sky`.
    #[inline(always)]
    fn look_at(&self, sample: &LightSample, sky: Option<&Sky<'_>>, shadow: &mut ShadowRays) {
        let Points { count, paths, surface: s, .. } = self.points;
        let LightSample { towards, density: own, rival, reach, .. } = sample;
        let zero = f32x8::splat(0.0);
        let (f_cos, density) = self.lobes.eval(*towards);
        let total = *own + *rival * density;
        let on = f32x8::and(f32x8::and(Real::gt(total, zero), Real::gt(density, zero)), s.before(*towards));
        let mut light = sample.light;
        if let Some(sky) = sky {
            // The map is evaluated only where the surface faces its direction.
            let of_sky = Real::gt(*rival, zero);
            let radiance = sky.look8(*towards, f32x8::bits(f32x8::and(on, of_sky))).0;
            light = select(of_sky, radiance, light);
        }
        let safe = Real::select(on, total, f32x8::splat(1.0));
        let light = mul(mul(self.throughput, f_cos), light).map(|x| (x / safe).to_array());
        let start = s.start().map(f32x8::to_array);
        let ways = towards.map(f32x8::to_array);
        let goes = f32x8::bits(on);
        for l in (0..*count).filter(|l| goes >> l & 1 == 1) {
            let light = pick(&light, l);
            if light != [0.0; 3] {
                let ray = Ray { origin: pick(&start, l), direction: pick(&ways, l), t_max: reach[l] };
                shadow.push(ray, paths[l].slot, light);
            }
        }
    }
}

impl LightSample {
    /// Replaces the sample of every lane that drew a lamp.
    #[inline(always)]
    fn put_lamps(&mut self, points: &Points, lamps: &[Option<&Lamp>; 8], lights: f32) {
        let mut towards = self.towards.map(f32x8::to_array);
        let mut light = self.light.map(f32x8::to_array);
        let (mut density, mut rival) = (self.density.to_array(), self.rival.to_array());
        let p = points.surface.position.map(f32x8::to_array);
        for l in 0..points.count {
            let Some(lamp) = lamps[l] else { continue };
            let (way, irradiance, distance) = shine(lamp, pick(&p, l));
            for c in 0..3 {
                towards[c][l] = way[c];
                light[c][l] = irradiance[c] * lights;
            }
            (density[l], rival[l], self.reach[l]) = (1.0, 0.0, distance);
        }
        (self.towards, self.light) = (towards.map(f32x8::new), light.map(f32x8::new));
        (self.density, self.rival) = (f32x8::new(density), f32x8::new(rival));
    }
}

/// Returns the direction to a lamp, the irradiance on a surface that faces it, and the distance.
fn shine(lamp: &Lamp, from: [f32; 3]) -> ([f32; 3], [f32; 3], f32) {
    match lamp {
        Lamp::Distant { towards, irradiance } => (*towards, *irradiance, f32::INFINITY),
        Lamp::Point { position, intensity } => {
            let (way, distance) = unit(sub(*position, from));
            let square = distance * distance;
            // At distances too small for f32 the irradiance would be infinite.
            let each = |x: f32| order::min(x / square, MAX_RADIANCE);
            let irradiance = if square > 0.0 { intensity.map(each) } else { [0.0; 3] };
            (way, irradiance, distance)
        }
    }
}
