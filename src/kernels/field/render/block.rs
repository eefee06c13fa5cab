//! Forward and adjoint of a block of rays.

use super::batch::{Batch, CARRIED, Segment, UNSHADED};
use super::decode::{Decoded, Nets};
use super::scene::{Plan, Rule, Scene};
use crate::field::{density, interval, normal};
use crate::num::elem;
use crate::num::lanes::{Real, f32x8};
use std::ops::Range;

/// Rays per block: head gradients are left folds within a block, and blocks are added by the pairwise tree.
pub(super) const RAYS: usize = 64;
/// Number of samples from which on a batch is not extended.
pub(super) const ROWS: usize = 768;
/// Samples per ray and batch where rays can stop early.
const WAVE: usize = 8;
/// Rays with a larger opacity are valid: they have a surface point and numerical normals.
pub const VALID: f32 = 0.98;

/// State of a ray between batches.
#[derive(Clone, Debug)]
struct Ray {
    /// Transmittance in front of the next sample.
    through: f32,
    /// Σ w of the samples whose values are not decoded.
    unshaded: f32,
    opacity: f32,
    values: Vec<f32>,
    point: [f32; 3],
    normal: [f32; 3],
    /// Samples that are left.
    left: Range<usize>,
    /// Signed distance at the end of the last step.
    carried: f32,
}

/// Rendered rays of a block: sums along each ray.
#[derive(Debug, Default)]
pub(super) struct Sums {
    /// Σ w, (rays).
    pub(super) opacity: Vec<f32>,
    /// What remains of the background, (rays).
    pub(super) rest: Vec<f32>,
    /// Σ w·v, (rays, channels).
    pub(super) values: Vec<f32>,
    /// Σ w·x, (rays).
    pub(super) points: Vec<[f32; 3]>,
    /// Σ w·n of numerical normals, (rays).
    pub(super) normals: Vec<[f32; 3]>,
    /// Number of samples taken, (rays).
    pub(super) taken: Vec<u32>,
    /// Of every entry of the intervals of these rays: whether its values were decoded; empty if there is no least weight.
    pub(super) shaded: Vec<u8>,
}

/// Buffers of the cotangents of a batch.
#[derive(Debug, Default)]
pub(super) struct Cotangents {
    pub(super) values: Vec<f32>,
    pub(super) sdf: Vec<f32>,
    pub(super) sdf_features: Vec<f32>,
    pub(super) features: Vec<f32>,
    pub(super) weights: Vec<[f32; 2]>,
}

/// Buffers of a thread.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub(super) batch: Batch,
    pub(super) decoded: Decoded,
    pub(super) cotangents: Cotangents,
    /// Per row of the first list.
    pub(super) sdf: Vec<f32>,
    /// Per sample: signed distances at both ends of the step, or at one point twice.
    pub(super) ends: Vec<[f32; 2]>,
    /// Per sample: −σδ.
    depths: Vec<f32>,
    /// Per sample: expm1 and exp of −σδ.
    factors: [Vec<f32>; 2],
    /// Per sample: σ and its derivatives by the signed distances at both ends.
    pub(super) slopes: Vec<[f32; 3]>,
    /// Per sample; empty without numerical normals.
    pub(super) normals: Vec<[f32; 3]>,
}

impl Scratch {
    /// Returns the weight of a sample and the transmittance behind it, from that in front of it.
    pub(super) fn weight(&self, through: f32, sample: usize) -> [f32; 2] {
        [through * -self.factors[0][sample], through * self.factors[1][sample]]
    }
}

/// Renders the rays of a block.
pub(super) fn forward(
    scene: &Scene<'_>,
    nets: &Nets,
    plan: &Plan,
    rays: Range<usize>,
    scratch: &mut Scratch,
) -> Sums {
    let channels = scene.channels().count();
    let start = |ray: usize| Ray {
        through: 1.0,
        unshaded: 0.0,
        opacity: 0.0,
        values: vec![0.0; channels],
        point: [0.0; 3],
        normal: [0.0; 3],
        left: plan.intervals.start[ray]..plan.taken_end(ray),
        carried: 0.0,
    };
    let mut states: Vec<Ray> = rays.clone().map(start).collect();
    let stop = scene.settings.early_stop.filter(|_| plan.last.is_empty());
    let wave = if stop.is_some() { WAVE } else { usize::MAX };
    let is_open = |state: &Ray| !state.left.is_empty();
    let least = scene.least_weight();
    let entries = plan.intervals.start[rays.start]..plan.intervals.start[rays.end];
    let mut shaded = vec![0; if least.is_some() { entries.len() } else { 0 }];
    while states.iter().any(is_open) {
        let mut next = 0;
        while next < states.len() {
            scratch.batch.clear();
            while next < states.len() && scratch.batch.samples() < ROWS {
                let (state, ray) = (&mut states[next], rays.start + next);
                next += 1;
                if is_open(state) {
                    let count = state.left.len().min(wave);
                    let samples = state.left.start..state.left.start + count;
                    state.left.start = samples.end;
                    let is_carried = samples.start > plan.intervals.start[ray];
                    scratch.batch.push(scene, &plan.intervals, (ray, samples), is_carried);
                }
            }
            let carried = |ray: usize| {
                let state = &states[ray - rays.start];
                [state.through, state.carried]
            };
            decode(scene, nets, (plan, stop), scratch, carried);
            if least.is_some() {
                for segment in &scratch.batch.segments {
                    let slots = &scratch.batch.slots[segment.first..][..segment.samples.len()];
                    for (entry, slot) in segment.samples.clone().zip(slots) {
                        shaded[entry - entries.start] = u8::from(*slot != UNSHADED);
                    }
                }
            }
            for s in 0..scratch.batch.segments.len() {
                let segment = scratch.batch.segments[s].clone();
                add_segment(scratch, &segment, &mut states[segment.ray - rays.start], stop);
            }
        }
    }
    let mut sums = Sums { shaded, ..Sums::default() };
    for (state, ray) in states.into_iter().zip(rays) {
        sums.opacity.push(state.opacity);
        sums.rest.push(state.through + state.unshaded);
        sums.values.extend(state.values);
        sums.points.push(state.point);
        sums.normals.push(state.normal);
        sums.taken.push((state.left.start - plan.intervals.start[ray]) as u32);
    }
    sums
}

/// Decodes the rows of the batch: features, signed distances, densities, values, numerical normals. `carried` returns the
/// transmittance in front of a ray's first sample of the batch, and the signed distance there.
pub(super) fn decode(
    scene: &Scene<'_>,
    nets: &Nets,
    (plan, stop): (&Plan, Option<f32>),
    scratch: &mut Scratch,
    carried: impl Fn(usize) -> [f32; 2],
) {
    let Scratch { batch, decoded, sdf, ends, depths, factors, slopes, normals, .. } = scratch;
    batch.fetch_first(scene);
    nets.sdf(scene, batch, decoded, sdf);
    ends.clear();
    for segment in &batch.segments {
        let at = |row: u32| if row == CARRIED { carried(segment.ray)[1] } else { sdf[row as usize] };
        ends.extend(
            batch.ends[segment.first..segment.first + segment.samples.len()].iter().map(|e| e.map(at)),
        );
    }
    slopes.clear();
    depths.clear();
    for (ends, lengths) in ends.chunks(8).zip(batch.lengths.chunks(8)) {
        let load = |k: usize| f32x8::from_fn(|l| ends[l.min(ends.len() - 1)][k]);
        let beta = f32x8::splat(scene.beta);
        let of = match scene.settings.rule {
            Rule::Analytic => interval::interval(load(0), load(1), beta),
            Rule::Left | Rule::Midpoint => {
                let [sigma, slope] = density::density(load(0), beta);
                [sigma, slope, f32x8::ZERO]
            }
        };
        let [sigma, by_begin, by_end] = of.map(f32x8::to_array);
        for (l, length) in lengths.iter().enumerate() {
            depths.push(-(sigma[l] * length));
            slopes.push([sigma[l], by_begin[l], by_end[l]]);
        }
    }
    for (factor, of) in factors.iter_mut().zip([elem::expm1_slice, elem::exp_slice]) {
        factor.resize(depths.len(), 0.0);
        of(depths, factor);
    }
    normals.clear();
    if let Some((stencil, epsilon)) = scene.settings.numerical_normals {
        for segment in &batch.segments {
            let rows = &sdf[segment.stencils..segment.rows.end];
            normals.extend(normal::forward(rows, stencil, epsilon).1);
        }
    }
    shade(scene, (plan, stop), scratch, carried);
    let Scratch { batch, decoded, .. } = scratch;
    batch.fetch_second(scene);
    nets.values(scene, batch, decoded);
}

/// Selects the samples whose values are decoded: those of the plan, or those with a weight that counts.
fn shade(
    scene: &Scene<'_>,
    (plan, stop): (&Plan, Option<f32>),
    scratch: &mut Scratch,
    carried: impl Fn(usize) -> [f32; 2],
) {
    let mut batch = std::mem::take(&mut scratch.batch);
    match scene.least_weight() {
        None => batch.shade(|_, _| true),
        Some(_) if !plan.shaded.is_empty() => {
            batch.shade(|segment, i| plan.shaded[segment.samples.start + i - segment.first] != 0);
        }
        Some(least) => {
            let mut through = 1.0;
            batch.shade(|segment, i| {
                if i == segment.first {
                    through = carried(segment.ray)[0];
                }
                let is_behind = i > segment.first && stop.is_some_and(|stop| through <= stop);
                let [w, behind] = scratch.weight(through, i);
                through = behind;
                w >= least && !is_behind
            });
        }
    }
    scratch.batch = batch;
}

/// Adds the samples of a segment to its ray.
fn add_segment(scratch: &Scratch, segment: &Segment, ray: &mut Ray, stop: Option<f32>) {
    let Scratch { batch, decoded, sdf, normals, .. } = scratch;
    let channels = ray.values.len();
    for (k, i) in (segment.first..segment.first + segment.samples.len()).enumerate() {
        let [w, through] = scratch.weight(ray.through, i);
        ray.through = through;
        ray.opacity += w;
        match batch.slots[i] {
            UNSHADED => ray.unshaded += w,
            slot => {
                let values = &decoded.values[slot as usize * channels..][..channels];
                ray.values.iter_mut().zip(values).for_each(|(sum, v)| *sum += w * v);
            }
        }
        ray.point.iter_mut().zip(batch.points[i]).for_each(|(sum, x)| *sum += w * x);
        if let Some(normal) = normals.get(i) {
            ray.normal.iter_mut().zip(normal).for_each(|(sum, n)| *sum += w * n);
        }
        if stop.is_some_and(|stop| through <= stop) {
            ray.left = segment.samples.start + k + 1..segment.samples.start + k + 1;
            return;
        }
    }
    let last = batch.ends[segment.first + segment.samples.len() - 1][1];
    ray.carried = sdf[last as usize];
}
