//! Traversal of paths from the camera to their ends.

use super::points::Points;
use super::settings::Brdf;
use super::tracer::Tracer;
use super::work::{Front, Work};
use crate::geometry::bvh::{Hit, MISS};
use crate::num::lanes::{Real, f32x8};
use crate::shade::surface;

impl Tracer<'_> {
    /// Finds the first surfaces of the paths of a batch, without light.
    pub(super) fn find_first(&self, work: &mut Work) {
        self.meet(work, 0);
        for eight in work.met.chunks(8) {
            Points::new(self.scene, work, eight).write_first(&mut work.first);
        }
    }

    /// Traces the paths of a batch to their ends.
    pub(super) fn trace(&self, work: &mut Work) {
        let scene = self.scene;
        for vertex in 0..=self.settings.bounces {
            if work.front.rays.is_empty() {
                return;
            }
            self.meet(work, vertex);
            work.shadow.clear();
            work.next.clear();
            let met = std::mem::take(&mut work.met);
            for eight in met.chunks(8) {
                match self.settings.brdf {
                    Brdf::MetallicRoughness => self.shade::<false>(work, eight, vertex),
                    Brdf::Lambert => self.shade::<true>(work, eight, vertex),
                }
            }
            work.met = met;
            self.add_unshadowed(work);
            std::mem::swap(&mut work.front, &mut work.next);
        }
        // The last directions collect emission and the map.
        if scene.emissive && !work.front.rays.is_empty() {
            let vertex = self.settings.bounces + 1;
            self.meet(work, vertex);
            for &k in &work.met {
                let weight = self.weight_of_emission(work, k as usize);
                let path = &work.front.paths[k as usize];
                let emission = surface::emission(scene.object, &work.hits[k as usize]);
                let out = &mut work.radiance[path.slot as usize];
                for c in 0..3 {
                    out[c] += path.throughput[c] * (weight * emission[c]);
                }
            }
        }
    }

    /// Finds the nearest hits of the paths; paths that leave the scene add the map. The indices of the others
    /// are appended to `met`.
    fn meet(&self, work: &mut Work, vertex: u32) {
        let scene = self.scene;
        work.hits.clear();
        work.hits.resize(work.front.rays.len(), Hit::NONE);
        scene.bvh.closest_batch(&work.front.rays, &mut work.hits);
        if scene.transparent {
            for k in 0..work.front.rays.len() {
                let Front { rays, paths } = &mut work.front;
                self.pass_through(&mut rays[k], &mut work.hits[k], &mut paths[k], vertex);
            }
        }
        work.met.clear();
        let mut missed = [0_u32; 8];
        let mut waiting = 0;
        for (k, hit) in work.hits.iter().enumerate() {
            if hit.triangle != MISS {
                work.met.push(k as u32);
            } else if scene.sky.is_some() && (vertex > 0 || self.settings.environment_visible) {
                missed[waiting] = k as u32;
                waiting += 1;
                if waiting == 8 {
                    self.escape(&missed, &work.front, &mut work.radiance);
                    waiting = 0;
                }
            }
        }
        if waiting > 0 {
            self.escape(&missed[..waiting], &work.front, &mut work.radiance);
        }
    }

    /// Adds the map to paths that leave the scene.
    fn escape(&self, which: &[u32], front: &Front, radiance: &mut [[f32; 3]]) {
        let Some(sky) = &self.scene.sky else { return };
        let Front { rays, paths } = front;
        let at = |l: usize| which[Ord::min(l, which.len() - 1)] as usize;
        let towards = std::array::from_fn(|c| f32x8::from_fn(|l| rays[at(l)].direction[c]));
        let (color, density) = sky.look8(towards, (1 << which.len()) - 1);
        let share = f32x8::splat(self.scene.choice());
        let own = f32x8::from_fn(|l| paths[at(l)].density);
        let zero = f32x8::splat(0.0);
        let found = Real::gt(own, zero);
        let rival = own + share * density;
        let weight =
            Real::select(found, own / Real::select(found, rival, f32x8::splat(1.0)), f32x8::splat(1.0));
        let (color, weight) = (color.map(f32x8::to_array), weight.to_array());
        for (l, &k) in which.iter().enumerate() {
            let path = &paths[k as usize];
            let out = &mut radiance[path.slot as usize];
            for c in 0..3 {
                out[c] += path.throughput[c] * (weight[l] * color[c][l]);
            }
        }
    }
}
