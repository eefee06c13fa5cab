//! Adjoint of a block of rays.

use super::batch::{Segment, UNSHADED};
use super::block::{Cotangents, ROWS, Scratch, VALID, decode};
use super::decode::{HeadsBar, Nets};
use super::scene::{Out, OutBar, Plan, Rule, Scene};
use crate::field::embed::Place;
use crate::field::scatter::Part;
use crate::field::{composite, normal};
use std::ops::Range;

/// Gradients of a block: of the heads, and the cotangents of the features that its rows have fetched.
#[derive(Debug, Default)]
pub(super) struct BlockBar {
    pub(super) heads: HeadsBar,
    pub(super) beta: f64,
    pub(super) background: f64,
    /// What was read, by points: per ray those of the first list, then those of the second.
    pub(super) part: Part,
    /// The cotangents of their features, (points, F).
    pub(super) features: Vec<f32>,
    /// Places where panoramas were read, in the order of rays and samples.
    pub(super) places: Vec<Place>,
    /// Their cotangents, (places, C).
    pub(super) embedded: Vec<f32>,
}

/// Cotangents of the sums of a ray, and its sums.
struct RayBar<'a> {
    values: &'a [f32],
    opacity: f32,
    point: [f32; 3],
    normal: [f32; 3],
}

impl BlockBar {
    /// Removes everything but the memory.
    fn clear(&mut self, nets: &Nets) {
        self.heads = nets.zeros();
        (self.beta, self.background) = (0.0, 0.0);
        self.part.reads().clear();
        self.features.clear();
        self.places.clear();
        self.embedded.clear();
    }
}

/// Computes the gradients of a block from the outputs of its rays and their cotangents.
pub(super) fn block(
    scene: &Scene<'_>,
    nets: &Nets,
    plan: &Plan,
    rays: Range<usize>,
    (out, out_bar): (&Out, &OutBar<'_>),
    (scratch, made): (&mut Scratch, &mut BlockBar),
) {
    made.clear(nets);
    for ray in rays.clone() {
        made.background += background_bar(scene, out, out_bar, ray);
    }
    let mut next = rays.start;
    while next < rays.end {
        scratch.batch.clear();
        while next < rays.end && scratch.batch.samples() < ROWS {
            let samples = plan.intervals.start[next]..plan.taken_end(next);
            if !samples.is_empty() {
                scratch.batch.push(scene, &plan.intervals, (next, samples), false);
            }
            next += 1;
        }
        if scratch.batch.samples() > 0 {
            decode(scene, nets, (plan, None), scratch, |_| [1.0, 0.0]); // complete rays

            adjoint_batch(scene, nets, (out, out_bar), scratch, made);
        }
    }
    made.part.sort(&scene.planes);
}

/// Derivative by the background: the cotangents of all values times what the ray leaves of it.
fn background_bar(scene: &Scene<'_>, out: &Out, out_bar: &OutBar<'_>, ray: usize) -> f64 {
    let rest = out.rest[ray];
    let q = scene.channels().count();
    let mut sum = 0.0;
    for bar in &out_bar.values[ray * q..(ray + 1) * q] {
        sum += f64::from(bar * rest);
    }
    sum
}

fn adjoint_batch(
    scene: &Scene<'_>,
    nets: &Nets,
    (out, out_bar): (&Out, &OutBar<'_>),
    scratch: &mut Scratch,
    made: &mut BlockBar,
) {
    let q = scene.channels().count();
    let mut bars = std::mem::take(&mut scratch.cotangents);
    let (shaded, rows) = (scratch.batch.shaded(), scratch.batch.rows());
    bars.values.clear();
    bars.values.resize(shaded * q, 0.0);
    bars.sdf.clear();
    bars.sdf.resize(rows, 0.0);
    for s in 0..scratch.batch.segments.len() {
        let segment = scratch.batch.segments[s].clone();
        let ray = ray_bar(scene, (out, out_bar), segment.ray);
        adjoint_segment(scene, scratch, &segment, &ray, &mut bars, &mut made.beta);
    }
    let Scratch { batch, decoded, .. } = scratch;
    let f = batch.sdf_features.len() / rows;
    bars.sdf_features.clear();
    bars.sdf_features.resize(rows * f, 0.0);
    let is_shared = scene.is_shared();
    bars.features.clear();
    bars.features.resize(if is_shared { 0 } else { batch.features.len() }, 0.0);
    let into = if is_shared { &mut bars.sdf_features } else { &mut bars.features };
    let (places, embedded) =
        nets.values_adjoint(scene, batch, decoded, &bars.values, (&mut made.heads, into));
    made.places.extend_from_slice(places);
    made.embedded.extend_from_slice(embedded);
    nets.sdf_adjoint(scene, batch, decoded, &bars.sdf, (&mut made.heads, &mut bars.sdf_features));
    let reads = made.part.reads();
    if bars.features.is_empty() {
        reads.extend_from_slice(&batch.sdf_reads);
        made.features.extend_from_slice(&bars.sdf_features);
    } else {
        for segment in &batch.segments {
            let (rows, shaded) = (segment.rows.clone(), segment.shaded.clone());
            reads.extend_from_slice(&batch.sdf_reads[rows.clone()]);
            reads.extend_from_slice(&batch.reads[shaded.clone()]);
            made.features.extend_from_slice(&bars.sdf_features[rows.start * f..rows.end * f]);
            made.features.extend_from_slice(&bars.features[shaded.start * f..shaded.end * f]);
        }
    }
    scratch.cotangents = bars;
}

/// Cotangents of the sums along a ray: those of the outputs, through background, surface point and normal.
fn ray_bar<'a>(scene: &Scene<'_>, (out, out_bar): (&Out, &'a OutBar<'_>), ray: usize) -> RayBar<'a> {
    let q = scene.channels().count();
    let values = &out_bar.values[ray * q..(ray + 1) * q];
    let opacity = out.opacity[ray];
    let mut made = RayBar {
        values,
        opacity: out_bar.opacity.get(ray).copied().unwrap_or(0.0),
        point: [0.0; 3],
        normal: [0.0; 3],
    };
    if let Some(bar) = out_bar.points.get(ray) {
        let is_valid = opacity > VALID;
        let divisor = if is_valid { opacity } else { VALID };
        made.point = bar.map(|b| b / divisor);
        if is_valid {
            let x = out.points[ray];
            made.opacity -= (made.point[0] * x[0] + made.point[1] * x[1]) + made.point[2] * x[2];
        }
    }
    if let Some(bar) = out_bar.normals.get(ray)
        && out.lengths[ray] > 0.0
    {
        let n = out.normals[ray];
        let along = (bar[0] * n[0] + bar[1] * n[1]) + bar[2] * n[2];
        made.normal = std::array::from_fn(|k| (bar[k] - along * n[k]) / out.lengths[ray]);
    }
    made
}

/// Adds the cotangents of the values and signed distances of a ray.
fn adjoint_segment(
    scene: &Scene<'_>,
    scratch: &Scratch,
    segment: &Segment,
    ray: &RayBar<'_>,
    bars: &mut Cotangents,
    beta_bar: &mut f64,
) {
    let Scratch { batch, decoded, sdf, ends, slopes, normals, .. } = scratch;
    let (q, samples) = (ray.values.len(), segment.first..segment.first + segment.samples.len());
    let slot = |i: usize| Some(batch.slots[i]).filter(|slot| *slot != UNSHADED).map(|slot| slot as usize);
    let mut through = 1.0;
    bars.weights.clear();
    for i in samples.clone() {
        let [w, behind] = scratch.weight(through, i);
        through = behind;
        bars.weights.push([w, behind]);
        if let Some(into) = slot(i).and_then(|slot| bars.values.get_mut(slot * q..(slot + 1) * q)) {
            into.iter_mut().zip(ray.values).for_each(|(v_bar, bar)| *v_bar = w * bar);
        }
    }
    let background = &vec![scene.settings.background; q][..];
    if let Some((stencil, epsilon)) = scene.settings.numerical_normals {
        let rows = segment.stencils..segment.rows.end;
        let n_bar: Vec<[f32; 3]> = bars.weights.iter().map(|[w, _]| ray.normal.map(|bar| w * bar)).collect();
        let none = vec![[0.0; 3]; n_bar.len()];
        normal::adjoint(&sdf[rows.clone()], stencil, epsilon, &none, &n_bar, &mut bars.sdf[rows]);
    }
    let mut behind = 0.0; // Σ w̄·w of the samples behind
    for (k, i) in samples.clone().enumerate().rev() {
        let [w, through] = bars.weights[k];
        let mut w_bar = match slot(i) {
            Some(slot) => {
                let values = &decoded.values[slot * q..(slot + 1) * q];
                composite::weight_bar(values, background, ray.values, ray.opacity)
            }
            // Its values are those of the background.
            None => ray.opacity,
        };
        let x = batch.points[i];
        w_bar += (ray.point[0] * x[0] + ray.point[1] * x[1]) + ray.point[2] * x[2];
        if let Some(n) = normals.get(i) {
            w_bar += (ray.normal[0] * n[0] + ray.normal[1] * n[1]) + ray.normal[2] * n[2];
        }
        let depth_bar = w_bar * through - behind;
        behind += w_bar * w;
        let sigma_bar = depth_bar * batch.lengths[i];
        let [begin, end] = batch.ends[i];
        let ([s0, s1], [sigma, by_begin, by_end]) = (ends[i], slopes[i]);
        if scene.settings.rule == Rule::Analytic {
            bars.sdf[end as usize] += sigma_bar * by_end;
            bars.sdf[begin as usize] += sigma_bar * by_begin;
            *beta_bar -= f64::from(sigma_bar * ((sigma + (s0 * by_begin + s1 * by_end)) / scene.beta));
        } else {
            bars.sdf[begin as usize] += sigma_bar * by_begin;
            *beta_bar -= f64::from(sigma_bar * ((sigma + s0 * by_begin) / scene.beta));
        }
    }
}
