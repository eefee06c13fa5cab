//! Samples of a few rays, as rows: the points at which the field is decoded, and the values there.
//!
//! A batch has two lists of rows. The first are the points at which the signed distance is needed: per ray the
//! points of its rule in order (ends of steps, middles, or starts), then those of the stencils of its numerical
//! normals. The second are the middles of the steps, at which colour, materials and normals are decoded: of all
//! steps, or of those with a weight that counts. Under the midpoint rule, without numerical normals and least
//! weight, both lists are the same.

use super::intervals::{Intervals, Rays};
use super::scene::{Rule, Scene};
use crate::field::fetch::Reads;
use std::ops::Range;

/// Consecutive samples of one ray.
#[derive(Clone, Debug)]
pub(super) struct Segment {
    /// Index in the crop.
    pub(super) ray: usize,
    /// Samples, as entries of [`Intervals::index`].
    pub(super) samples: Range<usize>,
    /// Place of its first sample in the batch.
    pub(super) first: usize,
    /// Its rows in the first list.
    pub(super) rows: Range<usize>,
    /// Row of the first stencil in the first list.
    pub(super) stencils: usize,
    /// Its rows in the second list.
    pub(super) shaded: Range<usize>,
}

/// Rows that give a sample's signed distances: the step's two ends, or one point twice.
pub(super) type Ends = [u32; 2];

/// The value at the end of the step before is known: it is the first value of the segment.
pub(super) const CARRIED: u32 = u32::MAX;

/// The sample has no row in the second list.
pub(super) const UNSHADED: u32 = u32::MAX;

/// The rows of a batch.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub(super) segments: Vec<Segment>,
    /// Points of the first list.
    pub(super) sdf_points: Vec<[f32; 3]>,
    /// Per sample.
    pub(super) ends: Vec<Ends>,
    /// Per sample: the middle of its step.
    pub(super) points: Vec<[f32; 3]>,
    /// Per sample: the length of its step.
    pub(super) lengths: Vec<f32>,
    /// Per sample: its row in the second list.
    pub(super) slots: Vec<u32>,
    /// Points of the second list, and the rays they are on.
    pub(super) shaded_points: Vec<[f32; 3]>,
    pub(super) shaded_rays: Vec<usize>,
    /// Features of the first list.
    pub(super) sdf_features: Vec<f32>,
    /// Features of the second list; empty if it is the first.
    pub(super) features: Vec<f32>,
    /// What the points of both lists read.
    pub(super) sdf_reads: Vec<Reads>,
    pub(super) reads: Vec<Reads>,
}

impl Batch {
    /// Removes all rows.
    pub(super) fn clear(&mut self) {
        self.segments.clear();
        self.sdf_points.clear();
        self.ends.clear();
        self.points.clear();
        self.lengths.clear();
        self.slots.clear();
        self.shaded_points.clear();
        self.shaded_rays.clear();
    }

    /// Number of samples.
    pub(super) fn samples(&self) -> usize {
        self.points.len()
    }

    /// Number of rows of the first list.
    pub(super) fn rows(&self) -> usize {
        self.sdf_points.len()
    }

    /// Adds consecutive samples of a ray. If `is_carried`, the signed distance at the start of the first of
    /// them is known from the batch before.
    pub(super) fn push(
        &mut self,
        scene: &Scene<'_>,
        intervals: &Intervals,
        (ray, samples): (usize, Range<usize>),
        is_carried: bool,
    ) {
        let (rays, rule): (Rays<'_>, Rule) = (scene.rays, scene.settings.rule);
        let (first, row) = (self.samples(), self.rows());
        for s in samples.clone() {
            let [begin, end] = intervals.ends(ray, s);
            let middle = rays.at(ray, begin + 0.5 * (end - begin));
            let next = self.rows() as u32;
            match rule {
                Rule::Left => self.sdf_points.push(rays.at(ray, begin)),
                Rule::Midpoint => self.sdf_points.push(middle),
                Rule::Analytic => {
                    let before = if intervals.continues(ray, s) && (s > samples.start || is_carried) {
                        self.ends.get(first..).and_then(<[Ends]>::last).map_or(CARRIED, |ends| ends[1])
                    } else {
                        self.sdf_points.push(rays.at(ray, begin));
                        next
                    };
                    self.ends.push([before, self.rows() as u32]);
                    self.sdf_points.push(rays.at(ray, end));
                }
            }
            if rule != Rule::Analytic {
                self.ends.push([next; 2]);
            }
            self.points.push(middle);
            self.lengths.push(end - begin);
        }
        let stencils = self.rows();
        if let Some((stencil, epsilon)) = scene.settings.numerical_normals {
            for at in &self.points[first..] {
                self.sdf_points.extend((0..stencil.width()).map(|i| stencil.point(i, epsilon, *at)));
            }
        }
        self.segments.push(Segment { ray, samples, first, rows: row..self.rows(), stencils, shaded: 0..0 });
    }

    /// Fetches the features of the first list.
    pub(super) fn fetch_first(&mut self, scene: &Scene<'_>) {
        self.sdf_reads.clear();
        let (planes, combine) = (&scene.planes, scene.settings.combine);
        planes.features_of(combine, &self.sdf_points, &mut self.sdf_features, &mut self.sdf_reads);
    }

    /// Puts the samples for which `is_shaded(segment, sample of the batch)` into the second list.
    pub(super) fn shade(&mut self, mut is_shaded: impl FnMut(&Segment, usize) -> bool) {
        for segment in &mut self.segments {
            let first = self.shaded_points.len();
            for i in segment.first..segment.first + segment.samples.len() {
                let is_shaded = is_shaded(segment, i);
                self.slots.push(if is_shaded { self.shaded_points.len() as u32 } else { UNSHADED });
                if is_shaded {
                    self.shaded_points.push(self.points[i]);
                    self.shaded_rays.push(segment.ray);
                }
            }
            segment.shaded = first..self.shaded_points.len();
        }
    }

    /// Number of rows of the second list.
    pub(super) fn shaded(&self) -> usize {
        self.shaded_points.len()
    }

    /// Fetches the features of the second list, unless it is the first.
    pub(super) fn fetch_second(&mut self, scene: &Scene<'_>) {
        self.reads.clear();
        self.features.clear();
        if !scene.is_shared() && scene.heads.has_values() {
            let (planes, combine) = (&scene.planes, scene.settings.combine);
            planes.features_of(combine, &self.shaded_points, &mut self.features, &mut self.reads);
        }
    }

    /// Features of the second list.
    pub(super) fn second_features(&self, is_shared: bool) -> &[f32] {
        if is_shared { &self.sdf_features } else { &self.features }
    }
}
