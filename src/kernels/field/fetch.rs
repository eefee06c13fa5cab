//! `field.fetch`: features of points, from planes that are parallel to the axes.
//!
//! p = x/R,   u = ½(p + 1)·(S − 1) limited to 0..S−1,   f = (1−a)(1−b) T₀₀ + (1−a) b T₀₁ + a (1−b) T₁₀ + a b T₁₁
//!
//! u is computed for the two coordinates of a plane; the cell (i, j) and the fractions (a, b) are its integer
//! and fractional part, with i, j ≤ S−2. The first coordinate runs along rows. Of six planes a point reads
//! three, by the sign of the coordinate that the plane lacks (hexa-planes of LIRM, Li et al. 2025); of three
//! planes it reads all (Chan et al. 2022).
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `points` | (N, 3) | inside the box [−R, R]³; outside it the border is read |
//! | T | `planes` | (P, S, S, C) | P = 6: xy−, xy+, xz−, xz+, yz−, yz+; P = 3: xy, xz, yz; S ≥ 2 |
//! | R | setting `half_size` | () | > 0 |
//! | | setting `combine` | | `concat`: f of xy, xz, yz one after the other; `sum`: (xy + xz) + yz |
//! | f | `features` | (N, 3C) or (N, C) | |
//!
//! # Rounding
//! One division for p, then ((p + 1)·½)·(S − 1). The weights are the products above; a feature is
//! ((w₀₀T₀₀ + w₀₁T₀₁) + w₁₀T₁₀) + w₁₁T₁₁.
//!
//! # Kinks and domain
//! At the border of a cell the slope is that of the cell that starts there; where u is limited, and at u = 0
//! and u = S−1, the slope is 0. The plane + is read where the missing coordinate is > 0, so both zeros read the
//! plane −; f jumps there. The derivative of the jump is not part of the gradient.
//!
//! # Adjoint
//! T̄ += w·f̄ for each of the four texels; x̄ = ½(S−1)/R · Σ f̄·∂f/∂u over channels, where
//! ∂f/∂u₀ = (1−b)(T₁₀ − T₀₀) + b(T₁₁ − T₀₁). The gradient of a texel is a left fold over points in index order,
//! which continues the number in the caller's array: calls with consecutive parts of the points have the bits
//! of one call. Sums over channels have 16 lanes ([`crate::num::sum`]); then the planes are added in the order xy, xz, yz.
//! Nothing is saved.
//!
//! # Threads
//! A thread owns bands of [`BAND`](super::scatter::BAND) rows of a plane. For every 4096 points a stable counting
//! sort lists the points of each band.
//!
//! Twin: `reference::field::fetch`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::fetch::{Combine, Planes, forward};
//! // three planes of 2×2 texels; x = ½ is at ¾ of the way from −1 to 1
//! let values = [0.0, 1.0, 2.0, 3.0, 0.0, 0.0, 4.0, 4.0, 5.0, 5.0, 5.0, 5.0];
//! let planes = Planes { values: &values, count: 3, side: 2, channels: 1, half_size: 1.0 };
//! let mut features = [0.0; 3];
//! forward(&planes, Combine::Concat, &[[0.5, 0.0, 0.0]], &mut features);
//! assert_eq!(features, [2.0, 3.0, 5.0]); // ¾·2 + ½·1, ¾·4, 5
//! ```

use super::channels::{load, sums};
use crate::num::lanes::f32x8;
use crate::num::{order, par};
use prefetch_index::prefetch_index;

/// The two coordinates of a pair of axes: xy, xz, yz.
pub const AXES: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];
/// The coordinate that a pair of axes lacks.
const MISSING: [usize; 3] = [2, 1, 0];
/// Points per task of an elementwise loop.
const ROWS: usize = 64;
/// Number of texel values from which on they are not expected in the second-level cache: 512 KiB.
const FAR: usize = 1 << 17;
/// Number of points ahead of the one that is read whose texels are requested from farther caches.
const AHEAD: usize = 2;
/// Numbers per cache line.
pub(super) const LINE: usize = 16;

/// How the features of the three planes are combined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Combine {
    /// One after the other.
    Concat,
    /// (xy + xz) + yz.
    Sum,
}

/// Feature planes.
#[derive(Clone, Copy, Debug)]
pub struct Planes<'a> {
    /// Shape (P, S, S, C).
    pub values: &'a [f32],
    /// Number of planes P: 6, two per pair of axes, or 3.
    pub count: usize,
    /// Texels per side S, at least 2.
    pub side: usize,
    /// Channels C.
    pub channels: usize,
    /// Half size R of the box.
    pub half_size: f32,
}

/// The cell of a plane that a point reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners {
    /// Index of the first texel among all texels; the others are 1, S and S + 1 behind it.
    pub at: usize,
    /// Weights of the texels 0, 1, S and S + 1.
    pub weights: [f32; 4],
    /// Place inside the cell, from 0 to 1.
    pub fractions: [f32; 2],
    /// Whether the point is strictly inside the plane in each coordinate.
    pub is_inside: [bool; 2],
}

/// The cell that a point reads in one plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Read {
    /// Index of the first texel among all texels.
    pub at: u32,
    /// Weights of the texels 0, 1, S and S + 1 from there.
    pub weights: [f32; 4],
}

/// The cells that a point reads: xy, xz, yz.
pub type Reads = [Read; 3];

impl Combine {
    /// Returns the number of features of a point for planes with that many channels.
    pub fn width(self, channels: usize) -> usize {
        if self == Self::Concat { 3 * channels } else { channels }
    }

    /// Returns the part of the features of a point that a pair of axes contributes to.
    pub(super) fn part(self, pair: usize, channels: usize) -> std::ops::Range<usize> {
        let start = if self == Self::Concat { pair * channels } else { 0 };
        start..start + channels
    }
}

impl<'a> Planes<'a> {
    pub(super) fn hold_to_shape(&self) {
        assert!(
            self.values.len() / Ord::max(self.channels, 1) <= u32::MAX as usize,
            "texels have 32-bit indices"
        );
        assert!(self.count == 3 || self.count == 6, "three or six planes");
        assert!(self.side >= 2 && self.channels > 0, "planes have cells and channels");
        assert_eq!(self.values.len(), self.count * self.side * self.side * self.channels, "(P, S, S, C)");
    }

    /// Returns the cell that a coordinate lies in, the place inside it, and whether it is strictly inside the plane.
    #[inline(always)]
    pub(super) fn place(&self, x: f32) -> (usize, f32, bool) {
        let last = self.side - 1;
        let u = ((x / self.half_size + 1.0) * 0.5) * last as f32;
        let is_inside = u > 0.0 && u < last as f32;
        let u = order::clamp(u, 0.0, last as f32);
        // u is not negative: the conversion is the floor.
        let cell = Ord::min(u as usize, last - 1);
        (cell, u - cell as f32, is_inside)
    }

    /// Whether a point reads the plane + of a pair of axes, from the coordinate that the pair lacks.
    #[inline(always)]
    pub(super) fn is_plus(&self, x: f32) -> bool {
        x / self.half_size > 0.0
    }

    /// Returns the cell that `point` reads in the plane of a pair of axes (0: xy, 1: xz, 2: yz).
    #[inline]
    pub fn corners(&self, pair: usize, point: [f32; 3]) -> Corners {
        let places = AXES[pair].map(|k| self.place(point[k]));
        self.corners_at(pair, places, self.count == 6 && self.is_plus(point[MISSING[pair]]))
    }

    /// Returns the cells that a point reads in the planes of the three pairs of axes; each coordinate is placed once.
    #[inline(always)]
    fn all_corners(&self, point: [f32; 3]) -> [Corners; 3] {
        let places = point.map(|x| self.place(x));
        let is_plus = point.map(|x| self.count == 6 && self.is_plus(x));
        std::array::from_fn(|pair| {
            self.corners_at(pair, AXES[pair].map(|k| places[k]), is_plus[MISSING[pair]])
        })
    }

    /// Returns the cell at two places of the plane − or + of a pair of axes.
    #[inline(always)]
    fn corners_at(&self, pair: usize, places: [(usize, f32, bool); 2], is_plus: bool) -> Corners {
        let [(row, a, is_inside_a), (column, b, is_inside_b)] = places;
        let plane = if self.count == 6 { 2 * pair + usize::from(is_plus) } else { pair };
        Corners {
            at: (plane * self.side + row) * self.side + column,
            weights: [(1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b],
            fractions: [a, b],
            is_inside: [is_inside_a, is_inside_b],
        }
    }

    /// Returns what a point reads in the planes of the three pairs of axes.
    #[inline]
    pub fn reads(&self, point: [f32; 3]) -> Reads {
        self.all_corners(point).map(|Corners { at, weights, .. }| Read { at: at as u32, weights })
    }

    /// Returns the values of the four texels of a cell.
    #[inline(always)]
    fn texels(&self, at: usize) -> [&'a [f32]; 4] {
        let row =
            |texel: usize| self.values[texel * self.channels..][..2 * self.channels].split_at(self.channels);
        let ((t0, t1), (t2, t3)) = (row(at), row(at + self.side));
        [t0, t1, t2, t3]
    }

    /// Writes the features of one point.
    #[inline(always)]
    pub fn features(&self, combine: Combine, reads: &Reads, features: &mut [f32]) {
        match combine {
            Combine::Sum => add_up(reads.map(|read| (self.texels(read.at as usize), read.weights)), features),
            Combine::Concat => {
                for (read, out) in reads.iter().zip(features.chunks_exact_mut(self.channels)) {
                    add_up([(self.texels(read.at as usize), read.weights)], out);
                }
            }
        }
    }

    /// Writes the features of points, one row each, and appends what they read, on this thread.
    pub fn features_of(
        &self,
        combine: Combine,
        points: &[[f32; 3]],
        features: &mut Vec<f32>,
        reads: &mut Vec<Reads>,
    ) {
        let (width, first) = (combine.width(self.channels), reads.len());
        reads.extend(points.iter().map(|point| self.reads(*point)));
        features.resize(points.len() * width, 0.0);
        self.rows(combine, &reads[first..], features);
    }

    /// Writes the features of points, one row each.
    fn rows(&self, combine: Combine, reads: &[Reads], features: &mut [f32]) {
        let is_far = self.values.len() > FAR;
        for (i, row) in features.chunks_exact_mut(combine.width(self.channels)).enumerate() {
            if let Some(later) = reads.get(i + AHEAD).filter(|_| is_far) {
                self.request(later);
            }
            self.features(combine, &reads[i], row);
        }
    }

    /// Requests the texels that a point reads from farther caches.
    #[inline(always)]
    fn request(&self, reads: &Reads) {
        for read in reads {
            for row in [read.at as usize, read.at as usize + self.side] {
                for line in 0..(2 * self.channels).div_ceil(LINE) {
                    prefetch_index(self.values, row * self.channels + line * LINE);
                }
            }
        }
    }

    /// Returns the gradient of one point for the cotangent of its features.
    pub fn point_bar(&self, combine: Combine, point: [f32; 3], features_bar: &[f32]) -> [f32; 3] {
        let mut bar = [0.0; 3];
        for (pair, corners) in self.all_corners(point).into_iter().enumerate() {
            let (t, [a, b]) = (self.texels(corners.at), corners.fractions);
            let g = &features_bar[combine.part(pair, self.channels)];
            let t = t.map(|t| &t[..g.len()]);
            let [a8, b8, one] = [a, b, 1.0].map(f32x8::splat);
            let along = sums(
                g.len(),
                #[inline(always)]
                |c| {
                    let (g, [t0, t1, t2, t3]) = (load(g, c), t.map(|t| load(t, c)));
                    [
                        g * ((one - b8) * (t2 - t0) + b8 * (t3 - t1)),
                        g * ((one - a8) * (t1 - t0) + a8 * (t3 - t2)),
                    ]
                },
                |c| {
                    [
                        g[c] * ((1.0 - b) * (t[2][c] - t[0][c]) + b * (t[3][c] - t[1][c])),
                        g[c] * ((1.0 - a) * (t[1][c] - t[0][c]) + a * (t[3][c] - t[2][c])),
                    ]
                },
            );
            for k in 0..2 {
                if corners.is_inside[k] {
                    bar[AXES[pair][k]] += along[k];
                }
            }
        }
        bar.map(|g| g * (0.5 * (self.side - 1) as f32) / self.half_size)
    }
}

/// Writes the weighted sums of the four texels of N planes, added from the first plane to the last.
#[inline(always)]
pub(super) fn add_up<const N: usize>(planes: [([&[f32]; 4], [f32; 4]); N], out: &mut [f32]) {
    let (out8, out1) = out.as_chunks_mut::<8>();
    let eights = planes.map(|(t, w)| (t.map(|t| &t.as_chunks::<8>().0[..out8.len()]), w.map(f32x8::splat)));
    for (c, out) in out8.iter_mut().enumerate() {
        let mut sum = f32x8::ZERO;
        for (n, (t, w)) in eights.iter().enumerate() {
            let [t0, t1, t2, t3] = t.map(|t| f32x8::new(t[c]));
            let value = ((w[0] * t0 + w[1] * t1) + w[2] * t2) + w[3] * t3;
            sum = if n == 0 { value } else { sum + value };
        }
        *out = sum.to_array();
    }
    let done = 8 * out8.len();
    for (c, out) in out1.iter_mut().enumerate() {
        for (n, (t, w)) in planes.iter().enumerate() {
            let [t0, t1, t2, t3] = t.map(|t| t[done + c]);
            let value = ((w[0] * t0 + w[1] * t1) + w[2] * t2) + w[3] * t3;
            *out = if n == 0 { value } else { *out + value };
        }
    }
}

/// Writes `features`, (N, 3C) or (N, C).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(planes: &Planes<'_>, combine: Combine, points: &[[f32; 3]], features: &mut [f32]) {
    planes.hold_to_shape();
    let width = combine.width(planes.channels);
    assert_eq!(features.len(), points.len() * width, "one row of features per point");
    par::chunks_mut(features, ROWS * width, |c, rows| {
        let points = &points[c * ROWS..][..rows.len() / width];
        let mut reads = [[Read::default(); 3]; ROWS];
        reads.iter_mut().zip(points).for_each(|(reads, point)| *reads = planes.reads(*point));
        planes.rows(combine, &reads[..points.len()], rows);
    });
}

/// Adds the gradients for the cotangent `features_bar` to `points_bar` (N, 3) and `planes_bar` (P, S, S, C); one
/// that is empty is not requested.
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(
    planes: &Planes<'_>,
    combine: Combine,
    points: &[[f32; 3]],
    features_bar: &[f32],
    points_bar: &mut [[f32; 3]],
    planes_bar: &mut [f32],
) {
    planes.hold_to_shape();
    let width = combine.width(planes.channels);
    assert_eq!(features_bar.len(), points.len() * width, "one row of features per point");
    if !points_bar.is_empty() {
        assert_eq!(points_bar.len(), points.len(), "one gradient per point");
        par::chunks_mut(points_bar, ROWS, |c, bars| {
            let from = c * ROWS;
            let rows = points[from..].iter().zip(features_bar[from * width..].chunks_exact(width));
            for (bar, (point, g)) in bars.iter_mut().zip(rows) {
                let own = planes.point_bar(combine, *point, g);
                (0..3).for_each(|k| bar[k] += own[k]);
            }
        });
    }
    if !planes_bar.is_empty() {
        planes.scatter(combine, points, features_bar, planes_bar);
    }
}
