//! Entries of the gradients that are 0, and the distance of rays from the kinks.

use super::scene::{HEADS, given, layers, with_scene};
use crate::Result;
use crate::field::embed::{self, Panoramas};
use crate::field::render::{Intervals, Rule, Scene};
use crate::num::elem;
use crate::ops::call::RunResult;
use crate::ops::field::reach::{Layers, hidden};
use crate::ops::op::CheckedCall;
use crate::tape::check::Prediction;
use reference::field::{normal_head, sdf_head};

/// What the rays reach of a scene.
pub(super) struct Reached<'a> {
    scene: &'a Scene<'a>,
    /// In the order of [`HEADS`]; `None` for a head that is not there.
    heads: [Option<Layers>; 6],
    /// Per texel: no ray reaches it.
    planes: Vec<bool>,
    panoramas: Vec<bool>,
    /// Smallest distance of a hidden unit with active inputs, a signed distance or a difference of two from 0.
    pub(super) margin: f64,
}

impl<'a> Reached<'a> {
    pub(super) fn new(x: &CheckedCall<'_>, scene: &'a Scene<'a>) -> Self {
        let head = |names: &[&str]| x.has(names[0]).then(|| Layers::of(x, &layers(x, names)));
        Self {
            scene,
            heads: HEADS.map(|(_, names)| head(names)),
            planes: vec![true; scene.planes.values.len()],
            panoramas: vec![true; scene.panoramas.as_ref().map_or(0, |p| p.values.len())],
            margin: f64::INFINITY,
        }
    }

    fn is_apart_by(&mut self, distance: f64) {
        self.margin = if distance < self.margin { distance } else { self.margin };
    }

    fn features(&self, x: [f32; 3]) -> Vec<f64> {
        let Scene { planes, settings, .. } = self.scene;
        let mut features = vec![0.0; settings.combine.width(planes.channels)];
        planes.features(settings.combine, &planes.reads(x), &mut features);
        features.into_iter().map(f64::from).collect()
    }

    /// Sums of the units of a head for a row; `None` if there is no such head.
    fn units(&mut self, head: usize, row: &[f64]) -> Option<Vec<Vec<f64>>> {
        let units = self.heads[head].as_ref()?.units(row);
        // A unit whose inputs are all inactive stays at 0.
        hidden(&units).filter(|z| *z != 0.0).for_each(|z| self.is_apart_by(z.abs()));
        Some(units)
    }

    /// Marks what a row of features with these units reaches: weights of the head, and texels; returns which further
    /// inputs it reaches.
    fn mark(&mut self, head: usize, units: &[Vec<f64>], x: [f32; 3]) -> Vec<bool> {
        let mut inputs = self.heads[head].as_mut().map_or_else(Vec::new, |layers| layers.reach(units));
        let Scene { planes, settings, .. } = self.scene;
        let rest = inputs.split_off(settings.combine.width(planes.channels));
        self.texels(x, &inputs);
        rest
    }

    /// [`Self::units`] and [`Self::mark`] of a head that only reads features; returns its outputs.
    fn head(&mut self, head: usize, row: &[f64], x: [f32; 3]) -> Option<Vec<f64>> {
        let mut units = self.units(head, row)?;
        self.mark(head, &units, x);
        units.pop()
    }

    /// Marks the texels of a point.
    fn texels(&mut self, x: [f32; 3], features: &[bool]) {
        let planes = &self.scene.planes;
        for pair in 0..3 {
            let corners = planes.corners(pair, x);
            // Concatenated features of a plane, or the sum of all planes.
            let own = &features[(pair * planes.channels) % features.len()..][..planes.channels];
            for (offset, w) in [0, 1, planes.side, planes.side + 1].into_iter().zip(corners.weights) {
                let texel = &mut self.planes[(corners.at + offset) * planes.channels..];
                texel.iter_mut().zip(own).for_each(|(zero, is_reached)| *zero &= !(*is_reached && w != 0.0));
            }
        }
    }

    /// Decodes the signed distance of a point.
    fn sdf(&mut self, x: [f32; 3]) -> f64 {
        let row = self.features(x);
        let z = self.head(0, &row, x).map_or(0.0, |z| z[0]);
        sdf_head::distance(z, x.map(f64::from), f64::from(self.scene.planes.half_size))
    }

    /// Decodes colour, materials and normal of a point; those of a trunk are marked by [`Self::sdf`].
    fn values(&mut self, x: [f32; 3], direction: [f32; 3]) {
        let row = self.features(x);
        let normal = self.head(4, &row, x);
        match (&self.scene.panoramas, normal, self.units(5, &row)) {
            (Some(panoramas), Some(z), Some(rho)) => {
                self.embedded(panoramas, (x, direction), &row, (&z, &rho))
            }
            _ => drop(self.head(1, &row, x)),
        }
        self.head(2, &row, x);
        self.head(3, &row, x);
    }

    /// Decodes a colour that reads panoramas, from the outputs of the normal head and the units of ρ.
    fn embedded(
        &mut self,
        panoramas: &Panoramas<'_>,
        (x, direction): ([f32; 3], [f32; 3]),
        row: &[f64],
        (z, rho): (&[f64], &[Vec<f64>]),
    ) {
        let radial = normal_head::unit(x.map(f64::from));
        let n = normal_head::unit(std::array::from_fn(|k| z[k] + radial[k])).map(|n| n as f32);
        let level = elem::sigmoid(rho[rho.len() - 1][0] as f32);
        let r = embed::reflect(n, Some(direction));
        let place = panoramas.place(r, level, None);
        let mut h = vec![0.0; panoramas.channels];
        panoramas.features(&place, &mut h);
        let cosine = (n[0] * r[0] + n[1] * r[1]) + n[2] * r[2];
        let inputs = h.into_iter().chain([cosine]).map(f64::from);
        let own = row.iter().copied().chain(inputs).take(self.heads[1].as_ref().map_or(0, Layers::inputs));
        let own: Vec<f64> = own.collect();
        let Some(units) = self.units(1, &own) else { return };
        let is_reached = self.mark(1, &units, x);
        let ones: Vec<f32> =
            is_reached[..panoramas.channels].iter().map(|is| f32::from(u8::from(*is))).collect();
        let mut weights = vec![0.0; panoramas.values.len()];
        panoramas.scatter(&[place], &ones, &mut weights);
        self.panoramas.iter_mut().zip(weights).for_each(|(zero, w)| *zero &= w == 0.0);
        if panoramas.levels > 1 && is_reached[..panoramas.channels].contains(&true) {
            self.mark(5, rho, x);
        }
    }

    /// Decodes the samples that a ray takes; `has_normal` if it has a numerical normal. `shaded` is that of the plan.
    pub(super) fn ray(
        &mut self,
        (intervals, shaded): (&Intervals, &[u8]),
        (ray, taken): (usize, usize),
        has_normal: bool,
    ) {
        let Scene { rays, settings, .. } = self.scene;
        let from = intervals.start[ray];
        for s in from..from + taken {
            let [begin, end] = intervals.ends(ray, s);
            let middle = rays.at(ray, begin + 0.5 * (end - begin));
            match settings.rule {
                Rule::Left | Rule::Midpoint => {
                    let x = if settings.rule == Rule::Left { rays.at(ray, begin) } else { middle };
                    let distance = self.sdf(x);
                    self.is_apart_by(distance.abs());
                }
                Rule::Analytic => {
                    let [s0, s1] = [begin, end].map(|t| self.sdf(rays.at(ray, t)));
                    [s0, s1, s1 - s0].into_iter().for_each(|distance| self.is_apart_by(distance.abs()));
                }
            }
            if shaded.get(s) != Some(&0) {
                self.values(middle, rays.directions[ray]);
            }
            if let Some((stencil, epsilon)) = settings.numerical_normals.filter(|_| has_normal) {
                for i in 0..stencil.width() {
                    self.sdf(stencil.point(i, epsilon, middle));
                }
            }
        }
    }
}

/// Units that are never active, texels that no ray reads; the background without values, ρ with one panorama.
pub(super) fn predict(x: &CheckedCall<'_>, ran: &RunResult) -> Result<Prediction> {
    with_scene(x, |scene| {
        let plan = given(&ran.plan, scene)?;
        let valid = ran.plan.need("valid")?.to_f64();
        let mut reached = Reached::new(x, scene);
        for (ray, taken) in plan.last.iter().enumerate() {
            reached.ray((&plan.intervals, &plan.shaded), (ray, *taken as usize), valid[ray] != 0.0);
        }
        let mut known = Prediction::default();
        known.zeros.insert("planes".to_owned(), reached.planes);
        known.zeros.insert("panoramas".to_owned(), reached.panoramas);
        for ((_, names), head) in HEADS.iter().zip(reached.heads) {
            let names = layers(x, names).into_iter().map(str::to_owned);
            known.zeros.extend(names.zip(head.into_iter().flat_map(|head| head.zeros)));
        }
        if scene.panoramas.as_ref().is_some_and(|p| p.levels == 1) {
            known.unread.extend(layers(x, HEADS[5].1).into_iter().map(str::to_owned));
        }
        if !scene.heads.has_values() {
            known.unread.push("background".to_owned());
        }
        Ok(known)
    })
}
