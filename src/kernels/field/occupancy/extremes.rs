//! Values of planes in a box: at the points between which they are linear, or their smallest and largest.
//!
//! Between two lines of texels a plane is bilinear, so a linear combination of its channels is smallest and
//! largest at the corners of the box and where lines of texels cross it: a grid of at most [`MOST`]² points. A
//! larger box takes the smallest and largest value of each channel from a pyramid: a texel of level l is over
//! up to 2×2 texels of level l − 1, and a range of texels is covered by those of the first level on which it
//! has at most [`FEW`] per axis.

use super::super::fetch::{AXES, Planes, add_up};
use super::bounded::Box3;
use crate::num::lanes::{Real, f32x8};
use crate::num::order;
use std::ops::RangeInclusive;

/// Largest number of points per axis at which a plane is interpolated.
const MOST: usize = 6;
/// Largest number of texels per axis that a range reads.
const FEW: usize = 4;

/// One level of all planes.
#[derive(Clone, Debug)]
struct Level {
    side: usize,
    /// Smallest values, (P, side, side, C).
    low: Vec<f32>,
    /// Largest values; empty on level 0, where they are the smallest ones.
    high: Vec<f32>,
}

/// Planes with their levels.
#[derive(Clone, Debug)]
pub(super) struct Extremes {
    levels: Vec<Level>,
    channels: usize,
}

/// Rows of channels that bound a pair of axes in a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Part {
    /// Index of the first row.
    pub(super) first: usize,
    /// Number of rows.
    pub(super) rows: usize,
    /// Whether each linear combination has its extremes at the rows; otherwise the rows are the smallest and the
    /// largest value of each channel.
    pub(super) is_exact: bool,
}

impl Level {
    fn high(&self) -> &[f32] {
        if self.high.is_empty() { &self.low } else { &self.high }
    }

    /// Returns the level above.
    fn halved(&self, planes: usize, c: usize) -> Self {
        let side = self.side.div_ceil(2);
        let mut low = vec![f32::INFINITY; planes * side * side * c];
        let mut high = vec![f32::NEG_INFINITY; low.len()];
        for plane in 0..planes {
            for i in 0..self.side {
                for j in 0..self.side {
                    let from = ((plane * self.side + i) * self.side + j) * c;
                    let to = ((plane * side + i / 2) * side + j / 2) * c;
                    for k in 0..c {
                        low[to + k] = order::min(low[to + k], self.low[from + k]);
                        high[to + k] = order::max(high[to + k], self.high()[from + k]);
                    }
                }
            }
        }
        Self { side, low, high }
    }
}

/// Writes the smallest and the largest value of each channel in the texels of `low` and of `high` that begin at
/// the offsets.
#[inline(always)]
pub(super) fn widest(values: [&[f32]; 2], offsets: impl Iterator<Item = usize> + Clone, to: [&mut [f32]; 2]) {
    let [low, high] = values;
    let [to_low, to_high] = to;
    let ((low8, low1), (high8, high1)) = (to_low.as_chunks_mut::<8>(), to_high.as_chunks_mut::<8>());
    let eights = low8.len();
    for (k, (to_low, to_high)) in low8.iter_mut().zip(high8).enumerate() {
        let (mut least, mut most) = (f32x8::splat(f32::INFINITY), f32x8::splat(f32::NEG_INFINITY));
        for at in offsets.clone() {
            let load =
                |x: &[f32]| f32x8::new(*x[at + 8 * k..].first_chunk().expect("a texel has its channels"));
            least = Real::min(least, load(low));
            most = Real::max(most, load(high));
        }
        *to_low = least.to_array();
        *to_high = most.to_array();
    }
    for (k, (to_low, to_high)) in low1.iter_mut().zip(high1).enumerate() {
        let at = |offset: usize| offset + 8 * eights + k;
        *to_low = offsets.clone().fold(f32::INFINITY, |x, offset| order::min(x, low[at(offset)]));
        *to_high = offsets.clone().fold(f32::NEG_INFINITY, |x, offset| order::max(x, high[at(offset)]));
    }
}

/// Where a box lies in the planes: cells and fractions of its lower and upper end along each axis, and which
/// sides its points are on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Places {
    ends: [[(usize, f32); 2]; 3],
    is_minus: [bool; 3],
    is_plus: [bool; 3],
}

impl Places {
    pub(super) fn new(planes: &Planes<'_>, [low, high]: Box3) -> Self {
        let end = |x: f32| {
            let (cell, fraction, _) = planes.place(x);
            (cell, fraction)
        };
        // Zeros are of the lower side; a lower end of 0 is no point if the upper one is larger.
        let is_plus = high.map(|x| planes.is_plus(x));
        Self {
            ends: [0, 1, 2].map(|k| [end(low[k]), end(high[k])]),
            is_minus: [0, 1, 2].map(|k| low[k] < 0.0 || !is_plus[k]),
            is_plus,
        }
    }
}

/// Calls `visit` with the cells and fractions at which a linear piece between two places begins or ends.
fn pieces(from: (usize, f32), to: (usize, f32), mut visit: impl FnMut((usize, f32))) {
    visit(from);
    (from.0 + 1..=to.0).for_each(|line| visit((line, 0.0)));
    visit(to);
}

impl Extremes {
    /// Builds the levels of `values`, (P, side, side, C).
    pub(super) fn new(values: Vec<f32>, side: usize, channels: usize) -> Self {
        let planes = values.len() / (side * side * channels);
        let mut levels = vec![Level { side, low: values, high: Vec::new() }];
        while levels[levels.len() - 1].side > FEW {
            levels.push(levels[levels.len() - 1].halved(planes, channels));
        }
        Self { levels, channels }
    }

    /// Returns the largest |value| of each channel in some planes.
    pub(super) fn largest(&self, planes: std::ops::Range<usize>) -> Vec<f32> {
        let (level, c) = (&self.levels[0], self.channels);
        let texels = level.side * level.side;
        let mut ends = [vec![0.0; c], vec![0.0; c]];
        let [low, high] = &mut ends;
        let offsets = (planes.start * texels..planes.end * texels).map(|texel| texel * c);
        widest([&level.low, &level.low], offsets, [low, high]);
        low.iter().zip(high).map(|(low, high)| if *high > -*low { *high } else { -*low }).collect()
    }

    /// Appends the rows of a pair of axes of three or six planes in a box.
    pub(super) fn part(&self, count: usize, pair: usize, at: &Places, rows: &mut Vec<f32>) -> Part {
        let missing = 2 - pair;
        let planes = if count == 3 {
            pair..=pair
        } else {
            2 * pair + usize::from(!at.is_minus[missing])..=2 * pair + usize::from(at.is_plus[missing])
        };
        let first = rows.len() / self.channels;
        let places = AXES[pair].map(|axis| at.ends[axis]);
        let is_exact = places.iter().all(|[a, b]| b.0 - a.0 + 2 <= MOST);
        if is_exact {
            let [[a0, b0], [a1, b1]] = places;
            for plane in planes {
                pieces(a0, b0, |u| pieces(a1, b1, |v| self.interpolate(plane, u, v, rows)));
            }
        } else {
            // The texels of a cell are its own and the next.
            let [first, last] = [places.map(|[a, _]| a.0), places.map(|[_, b]| b.0 + 1)];
            self.cover(planes, first, last, rows);
        }
        Part { first, rows: rows.len() / self.channels - first, is_exact }
    }

    /// Appends the values at a place of a plane.
    #[inline(always)]
    fn interpolate(&self, plane: usize, (i, a): (usize, f32), (j, b): (usize, f32), rows: &mut Vec<f32>) {
        let (level, c) = (&self.levels[0], self.channels);
        let at = ((plane * level.side + i) * level.side + j) * c;
        let texel = |offset: usize| &level.low[at + offset * c..][..c];
        let start = rows.len();
        rows.resize(start + c, 0.0);
        let t = [texel(0), texel(1), texel(level.side), texel(level.side + 1)];
        let w = [(1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b];
        add_up([(t, w)], &mut rows[start..]);
    }

    /// Appends the smallest and the largest values in a range of texels of planes.
    fn cover(&self, planes: RangeInclusive<usize>, first: [usize; 2], last: [usize; 2], rows: &mut Vec<f32>) {
        let c = self.channels;
        let fits = |l: usize| (0..2).all(|k| (last[k] >> l) - (first[k] >> l) < FEW);
        let l = (0..self.levels.len()).find(|l| fits(*l)).unwrap_or(self.levels.len() - 1);
        let level = &self.levels[l];
        let start = rows.len();
        rows.resize(start + 2 * c, 0.0);
        let (low, high) = rows[start..].split_at_mut(c);
        let [across, down] = [0, 1].map(|k| first[k] >> l..=last[k] >> l);
        let offsets = planes.flat_map(|plane| {
            let down = down.clone();
            let texel = move |i: usize, j: usize| ((plane * level.side + i) * level.side + j) * c;
            across.clone().flat_map(move |i| down.clone().map(move |j| texel(i, j)))
        });
        let offsets: Vec<usize> = offsets.collect();
        widest([&level.low, level.high()], offsets.iter().copied(), [low, high]);
    }
}
