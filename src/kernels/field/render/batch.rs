//! Samples of a few rays, as rows: the points at which the field is decoded, and the values there.
//!
//! A batch has two lists of rows. The first are the points at which the signed distance is needed: per ray the
//! points of its rule in order (ends of steps, middles, or starts), then those of the stencils of its numerical
//! normals. The second are the middles of the steps, at which colour, materials and normals are decoded. Under
//! the midpoint rule without numerical normals both lists are the same.

use super::intervals::{Intervals, Rays};
use super::scene::{Rule, Scene, Settings};
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
}

/// Rows that give a sample's signed distances: the step's two ends, or one point twice.
pub(super) type Ends = [u32; 2];

/// The value at the end of the step before is known: it is the first value of the segment.
pub(super) const CARRIED: u32 = u32::MAX;

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
        self.segments.push(Segment { ray, samples, first, rows: row..self.rows(), stencils });
    }

    /// Whether both lists are the same.
    pub(super) fn is_shared(settings: &Settings) -> bool {
        settings.rule == Rule::Midpoint && settings.numerical_normals.is_none()
    }

    /// Fetches the features of both lists.
    pub(super) fn fetch(&mut self, scene: &Scene<'_>) {
        let (planes, combine) = (&scene.planes, scene.settings.combine);
        self.sdf_reads.clear();
        self.reads.clear();
        planes.features_of(combine, &self.sdf_points, &mut self.sdf_features, &mut self.sdf_reads);
        if Self::is_shared(&scene.settings) || !scene.heads.has_values() {
            self.features.clear();
        } else {
            planes.features_of(combine, &self.points, &mut self.features, &mut self.reads);
        }
    }
}
