//! `field.embed`: features of the direction in which a ray is reflected, from panoramas of increasing roughness
//! (neural directional embedding of LIRM, Li et al. 2025; after Wu et al. 2024).
//!
//! r = unit(v − 2(v·n)n),   n = unit(normal);   row t = (atan2(r_x, r_y)/2π + ½)·H − ½,   column
//! c = ½(r_z + 1)·(W−1),   level l = ρ(L−1);   h: linear interpolation along t, c and l
//!
//! Row k is the azimuth cell with the centre (k + ½)/H of the turn that begins at −π; rows wrap. Columns and
//! levels have their texels at the ends of the range. Without a ray r = n.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | | `normal` | (N, 3) | any length; no gradient |
//! | v | `ray_direction` | (N, 3), optional | from the camera into the scene; no gradient |
//! | ρ | `rho` | (N) | 0 to 1 |
//! | E | `panoramas` | (L, H, W, C) | H, W ≥ 2 |
//! | h | `h` | (N, C) | |
//!
//! # Rounding
//! Directions, azimuth and coordinates are in f32; the azimuth is rounded once. The weights of a level are
//! (1−a)(1−b), (1−a)b, a(1−b), ab, its value the left fold of weight times texel; then h = (1−g)·lower + g·upper.
//!
//! # Plan
//! `cell` (N, 2) holds the first row, −1 to H−1 (−1 is row H−1), and the first column, `level` (N) the lower level.
//!
//! # Kinks and domain
//! At the border of a level the slope by ρ is that of the level interval that starts there; at ρ = 1 that of the
//! last. A normal or a reflected direction of length 0 stays 0: r = v, or the azimuth 0 and r_z = 0. With one
//! panorama ρ has no gradient.
//!
//! # Adjoint
//! ρ̄ = (L−1)·Σ h̄ (upper − lower), a sum with 16 lanes ([`crate::num::sum`]); Ē += weight·h̄ for each of the eight texels, in
//! index order of the points, which continues the number in the caller's array. The plan is saved.
//!
//! Twin: `reference::field::embed`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::embed::{Panoramas, forward};
//! // one panorama of 2×3 texels; +z is the last column, between the rows
//! let values = [0.0, 0.0, 3.0, 0.0, 0.0, 5.0];
//! let panoramas = Panoramas { values: &values, levels: 1, height: 2, width: 3, channels: 1 };
//! let (h, _) = forward(&panoramas, &[[0.0, 0.0, 2.0]], None, &[0.5], None);
//! assert_eq!(h, [4.0]);
//! ```

use super::bands::Lists;
use super::channels::{load, sums};
use super::fetch::add_up;
use crate::num::lanes::{Real, f32x8};
use crate::num::{elem, order, par};

/// Points per task of an elementwise loop.
const ROWS: usize = 64;
/// Points per list of a band; changes no bit.
const CHUNK: usize = 4096;
/// Rows of a panorama that one task of [`Panoramas::scatter`] owns; changes no bit.
const BAND: usize = 4;

/// Panoramas of increasing roughness.
#[derive(Clone, Copy, Debug)]
pub struct Panoramas<'a> {
    /// Shape (L, H, W, C).
    pub values: &'a [f32],
    /// Number of levels L.
    pub levels: usize,
    /// Rows H, at least 2.
    pub height: usize,
    /// Columns W, at least 2.
    pub width: usize,
    /// Channels C.
    pub channels: usize,
}

/// The place of a point in the panoramas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// First row, −1 to H−1, and first column.
    pub cell: [i32; 2],
    /// Lower level.
    pub level: i32,
    /// Place between the rows, the columns and the levels.
    pub fractions: [f32; 3],
}

/// Discrete decisions of a point: first row, first column, lower level.
pub type Decision = [i32; 3];

/// Returns v/‖v‖, 0 for 0.
#[inline(always)]
fn unit<L: Real>(v: [L; 3]) -> [L; 3] {
    let length = ((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]).sqrt();
    let is_some = length.gt(L::splat(0.0));
    let safe = L::select(is_some, length, L::splat(1.0));
    v.map(|x| L::select(is_some, x / safe, L::splat(0.0)))
}

/// Returns the unit direction of reflection.
#[inline(always)]
pub fn reflect<L: Real>(normal: [L; 3], ray: Option<[L; 3]>) -> [L; 3] {
    let n = unit(normal);
    let Some(v) = ray else { return n };
    let twice = L::splat(2.0) * ((v[0] * n[0] + v[1] * n[1]) + v[2] * n[2]);
    unit(std::array::from_fn(|k| v[k] - twice * n[k]))
}

impl<'a> Panoramas<'a> {
    fn hold_to_shape(&self) {
        assert!(self.levels > 0 && self.height >= 2 && self.width >= 2 && self.channels > 0, "no empty axis");
        let texels = self.levels * self.height * self.width;
        assert_eq!(self.values.len(), texels * self.channels, "(L, H, W, C)");
    }

    /// Returns the place of a direction and a roughness ρ; `given` replaces the decisions.
    #[inline]
    pub fn place(&self, direction: [f32; 3], rho: f32, given: Option<Decision>) -> Place {
        let turn = elem::atan2(direction[0], direction[1]) / std::f32::consts::TAU;
        let row = (turn + 0.5) * self.height as f32 - 0.5;
        let last = (self.width - 1) as f32;
        let column = order::clamp((0.5 * (direction[2] + 1.0)) * last, 0.0, last);
        let level = rho * (self.levels - 1) as f32;
        let [first_row, first_column, lower] = given.unwrap_or_else(|| {
            [
                if row < 0.0 { -1 } else { Ord::min(row as i32, self.height as i32 - 1) },
                Ord::min(column as i32, self.width as i32 - 2),
                Ord::max(Ord::min(level as i32, self.levels as i32 - 2), 0),
            ]
        });
        Place {
            cell: [first_row, first_column],
            level: lower,
            fractions: [row - first_row as f32, column - first_column as f32, level - lower as f32],
        }
    }

    /// Returns the rows of a place, wrapped.
    fn rows(&self, place: &Place) -> [usize; 2] {
        let first = (place.cell[0] + self.height as i32) as usize % self.height;
        [first, (first + 1) % self.height]
    }

    /// Returns the number of levels that a place reads, 1 if there is one panorama.
    fn levels_read(&self) -> usize {
        Ord::min(self.levels, 2)
    }

    /// Returns the weights of the levels.
    fn level_weights(&self, place: &Place) -> [f32; 2] {
        if self.levels > 1 { [1.0 - place.fractions[2], place.fractions[2]] } else { [1.0, 0.0] }
    }

    /// Returns the four texels of a level, and their weights.
    fn texels(&self, place: &Place, above: usize) -> [(&'a [f32], f32); 4] {
        let [a, b, _] = place.fractions;
        let weights = [(1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b];
        let rows = self.rows(place);
        std::array::from_fn(|k| {
            let row = (place.level as usize + above) * self.height + rows[k / 2];
            let at = row * self.width + place.cell[1] as usize + k % 2;
            (&self.values[at * self.channels..][..self.channels], weights[k])
        })
    }

    /// Writes h of one point.
    pub fn features(&self, place: &Place, h: &mut [f32]) {
        let by_level = self.level_weights(place);
        let levels: [_; 2] = std::array::from_fn(|k| {
            let texels = self.texels(place, k % self.levels_read());
            (texels.map(|(t, _)| t), texels.map(|(_, w)| w))
        });
        let (mut lower, mut upper) = ([0.0; 8], [0.0; 8]);
        for (k, h) in h.chunks_mut(8).enumerate() {
            let (n, first) = (h.len(), 8 * k);
            for (values, (texels, weights)) in
                [&mut lower, &mut upper].into_iter().zip(levels).take(self.levels_read())
            {
                add_up([(texels.map(|t| &t[first..first + n]), weights)], &mut values[..n]);
            }
            for ((h, lower), upper) in h.iter_mut().zip(&lower).zip(&upper) {
                *h = by_level[0] * lower;
                if self.levels > 1 {
                    *h += by_level[1] * upper;
                }
            }
        }
    }

    /// Returns the gradient of ρ for the cotangent of h of one point.
    pub fn rho_bar(&self, place: &Place, h_bar: &[f32]) -> f32 {
        if self.levels == 1 {
            return 0.0;
        }
        let (lower, upper) = (self.texels(place, 0), self.texels(place, 1));
        let wide = lower.map(|(_, w)| f32x8::splat(w));
        let [sum] = sums(
            h_bar.len(),
            #[inline(always)]
            |c| {
                let by = |k: usize| wide[k] * (load(upper[k].0, c) - load(lower[k].0, c));
                [load(h_bar, c) * (((by(0) + by(1)) + by(2)) + by(3))]
            },
            |c| {
                let by = |k: usize| lower[k].1 * (upper[k].0[c] - lower[k].0[c]);
                [h_bar[c] * (((by(0) + by(1)) + by(2)) + by(3))]
            },
        );
        (self.levels - 1) as f32 * sum
    }

    /// Adds the gradient of the panoramas for the cotangents of h of consecutive points. Calls with consecutive
    /// parts of the points add in the same order as one call.
    ///
    /// # Panics
    /// Panics if a buffer does not have the size of its shape.
    pub fn scatter(&self, places: &[Place], h_bar: &[f32], panoramas_bar: &mut [f32]) {
        self.hold_to_shape();
        assert_eq!(h_bar.len(), places.len() * self.channels, "one row per point");
        assert_eq!(panoramas_bar.len(), self.values.len(), "the gradient has the shape of the panoramas");
        let per_level = self.height.div_ceil(BAND);
        let lists = par::map(places.len().div_ceil(CHUNK), |c| {
            let places = &places[c * CHUNK..Ord::min((c + 1) * CHUNK, places.len())];
            Lists::sort(places.len(), self.levels * per_level, |i| {
                let (rows, lower) = (self.rows(&places[i]), places[i].level as usize);
                let band = |above: usize, k: usize| (lower + above) * per_level + rows[k] / BAND;
                let top = self.levels_read() - 1;
                [band(0, 0), band(0, 1), band(top, 0), band(top, 1)]
            })
        });
        let row = self.width * self.channels;
        let levels = panoramas_bar.chunks_mut(self.height * row);
        let bands: Vec<&mut [f32]> = levels.flat_map(|level| level.chunks_mut(BAND * row)).collect();
        par::each(bands, |t, band| {
            for (c, list) in lists.iter().enumerate() {
                for &entry in list.of(t) {
                    let at = c * CHUNK + entry as usize;
                    let g = &h_bar[at * self.channels..][..self.channels];
                    self.add(&places[at], g, [t / per_level, t % per_level * BAND], band);
                }
            }
        });
    }

    /// Adds the gradient of one point to the rows of a band, which begins at `first_row` of `level`.
    fn add(&self, place: &Place, h_bar: &[f32], [level, first_row]: [usize; 2], band: &mut [f32]) {
        let (rows, by_level) = (self.rows(place), self.level_weights(place));
        let above = level - place.level as usize;
        let weights = self.texels(place, above).map(|(_, w)| by_level[above] * w);
        for (k, row) in rows.into_iter().enumerate() {
            let Some(row) = row.checked_sub(first_row).filter(|row| *row < BAND) else { continue };
            let at = (row * self.width + place.cell[1] as usize) * self.channels;
            let (left, right) = band[at..at + 2 * self.channels].split_at_mut(self.channels);
            left.iter_mut().zip(h_bar).for_each(|(to, g)| *to += weights[2 * k] * g);
            right.iter_mut().zip(h_bar).for_each(|(to, g)| *to += weights[2 * k + 1] * g);
        }
    }
}

/// Returns `h` (N, C) and the place of every point; `given` replaces the decisions.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(
    panoramas: &Panoramas<'_>,
    normal: &[[f32; 3]],
    ray_direction: Option<&[[f32; 3]]>,
    rho: &[f32],
    given: Option<&[Decision]>,
) -> (Vec<f32>, Vec<Place>) {
    panoramas.hold_to_shape();
    let n = rho.len();
    assert!(normal.len() == n && ray_direction.is_none_or(|v| v.len() == n), "one row per point");
    let places = par::map_batched(n, ROWS, |i| {
        let direction = reflect(normal[i], ray_direction.map(|v| v[i]));
        panoramas.place(direction, rho[i], given.map(|d| d[i]))
    });
    let mut h = vec![0.0; n * panoramas.channels];
    par::chunks_mut(&mut h, ROWS * panoramas.channels, |c, h| {
        for (h, place) in h.chunks_exact_mut(panoramas.channels).zip(&places[c * ROWS..]) {
            panoramas.features(place, h);
        }
    });
    (h, places)
}

/// Adds the gradients for the cotangent `h_bar` (N, C) to `rho_bar` (N) and `panoramas_bar`; one that is empty is
/// not requested.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(
    panoramas: &Panoramas<'_>,
    places: &[Place],
    h_bar: &[f32],
    rho_bar: &mut [f32],
    panoramas_bar: &mut [f32],
) {
    par::chunks_mut(rho_bar, ROWS, |c, bars| {
        let rows = places[c * ROWS..]
            .iter()
            .zip(h_bar[c * ROWS * panoramas.channels..].chunks_exact(panoramas.channels));
        for (bar, (place, g)) in bars.iter_mut().zip(rows) {
            *bar += panoramas.rho_bar(place, g);
        }
    });
    if !panoramas_bar.is_empty() {
        panoramas.scatter(places, h_bar, panoramas_bar);
    }
}
