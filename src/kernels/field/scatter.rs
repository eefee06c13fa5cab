//! Gradients of feature planes: cotangents of features, added to the texels that the points read.
//!
//! A texel's gradient is one left fold over the points, in index order, that continues the number in the
//! caller's array. A thread owns bands of [`BAND`] rows of a plane, and a stable counting sort lists the points
//! of each band, part by part; so neither threads nor the lengths of parts change a bit.

use super::bands::Lists;
use super::fetch::{Combine, LINE, Planes, Reads};
use crate::num::lanes::f32x8;
use crate::num::par;
use prefetch_index::prefetch_index;

/// Rows of a plane that one task of [`Planes::scatter`] owns; changes no bit.
pub const BAND: usize = 4;
/// Entries ahead of the one that is added whose cotangents are requested from farther caches.
const AHEAD: usize = 8;
/// Points per part; changes no bit.
const CHUNK: usize = 4096;

/// What consecutive points read, listed by bands.
#[derive(Debug, Default)]
pub struct Part {
    reads: Vec<Reads>,
    lists: Lists,
}

impl Part {
    /// Returns what the points read.
    pub fn reads(&mut self) -> &mut Vec<Reads> {
        &mut self.reads
    }

    /// Lists the entries that touch each band: point·3 + pair of axes.
    pub fn sort(&mut self, planes: &Planes<'_>) {
        let (side, per_plane) = (planes.side as u32, planes.side.div_ceil(BAND) as u32);
        let entries = self.reads.iter().flatten().map(|read| {
            let row = read.at / side;
            let (plane, row) = (row / side, row % side);
            let band = plane * per_plane + row / BAND as u32;
            (band, (row + 1).is_multiple_of(BAND as u32))
        });
        self.lists.fill((planes.count as u32 * per_plane) as usize, entries);
    }
}

impl Planes<'_> {
    /// Adds the gradient of the planes for the cotangents of the features of consecutive points. Calls with
    /// consecutive parts of the points add in the same order as one call.
    ///
    /// # Panics
    /// Panics if a buffer does not have the size of its shape.
    pub fn scatter(
        &self,
        combine: Combine,
        points: &[[f32; 3]],
        features_bar: &[f32],
        planes_bar: &mut [f32],
    ) {
        self.hold_to_shape();
        let width = combine.width(self.channels);
        assert_eq!(features_bar.len(), points.len() * width, "one row of features per point");
        let parts = par::map(points.len().div_ceil(CHUNK), |c| {
            let points = &points[c * CHUNK..Ord::min((c + 1) * CHUNK, points.len())];
            let mut part = Part::default();
            part.reads().extend(points.iter().map(|point| self.reads(*point)));
            part.sort(self);
            part
        });
        let parts: Vec<_> = parts.iter().zip(features_bar.chunks(CHUNK * width)).collect();
        self.scatter_parts(combine, &parts, planes_bar);
    }

    /// Like [`Self::scatter`], for parts that are sorted, with the cotangents of their features.
    ///
    /// # Panics
    /// Panics under the conditions of [`Self::scatter`].
    pub fn scatter_parts(&self, combine: Combine, parts: &[(&Part, &[f32])], planes_bar: &mut [f32]) {
        assert_eq!(planes_bar.len(), self.values.len(), "the gradient has the shape of the planes");
        let (width, channels) = (combine.width(self.channels), self.channels);
        for (part, bar) in parts {
            assert_eq!(bar.len(), part.reads.len() * width, "one row of features per point");
        }
        let row = self.side * channels;
        let bands: Vec<&mut [f32]> =
            planes_bar.chunks_mut(self.side * row).flat_map(|plane| plane.chunks_mut(BAND * row)).collect();
        let per_plane = self.side.div_ceil(BAND);
        par::each(bands, |t, band| {
            // Texels of this band are those from `first` on.
            let first = (t / per_plane * self.side + t % per_plane * BAND) * self.side;
            for (part, features_bar) in parts {
                let entries = part.lists.of(t);
                for (i, &entry) in entries.iter().enumerate() {
                    let (at, pair) = (entry as usize / 3, entry as usize % 3);
                    let from = combine.part(pair, channels).start;
                    if let Some(later) = entries.get(i + AHEAD) {
                        // All entries of a band are of one pair of axes.
                        let later = *later as usize / 3 * width + from;
                        for line in 0..channels.div_ceil(LINE) {
                            prefetch_index(features_bar, later + line * LINE);
                        }
                    }
                    let read = &part.reads[at][pair];
                    let g = &features_bar[at * width + from..][..channels];
                    for half in 0..2 {
                        let texel = (read.at as usize + half * self.side).wrapping_sub(first);
                        if let Some(to) = band.get_mut(texel.wrapping_mul(channels)..)
                            && !to.is_empty()
                        {
                            let weights = [read.weights[2 * half], read.weights[2 * half + 1]];
                            add_scaled(weights, g, &mut to[..2 * channels]);
                        }
                    }
                }
            }
        });
    }
}

/// Adds w₀·x to the first half of `to`, and w₁·x to the second.
#[inline(always)]
fn add_scaled(w: [f32; 2], x: &[f32], to: &mut [f32]) {
    let (left, right) = to.split_at_mut(x.len());
    let (x8, x1) = x.as_chunks::<8>();
    let ((left8, left1), (right8, right1)) = (left.as_chunks_mut::<8>(), right.as_chunks_mut::<8>());
    let wide = w.map(f32x8::splat);
    for ((x, left), right) in x8.iter().zip(left8).zip(right8) {
        let x = f32x8::new(*x);
        *left = (f32x8::new(*left) + wide[0] * x).to_array();
        *right = (f32x8::new(*right) + wide[1] * x).to_array();
    }
    for ((x, left), right) in x1.iter().zip(left1).zip(right1) {
        *left += w[0] * *x;
        *right += w[1] * *x;
    }
}
