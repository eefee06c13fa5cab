//! An environment map as a light: radiance of a direction, importance sampling by brightness, and its
//! density.
//!
//! ```text
//! L(d)     bilinear between texel centres; columns wrap; between the first or last row and the pole, linear
//! to the mean of that row
//! Δω_row   = (2π/W)(cos θ_top − cos θ_bottom)
//! p(d)     = w/(Δω Σ w),   w = Δω · luminance of L averaged over the texel in (u, v)
//! ```
//!
//! Inside a texel directions are uniform in solid angle: the azimuth and cos θ are uniform, and cos θ never
//! reaches a pole, because no uniform is 0 or 1. w covers every texel into which L extends, so no bright
//! direction has density 0. A black map has no table: no light is drawn from it and its density is 0, so
//! there is no division by Σ w = 0.
//!
//! # Cells
//! The table has one entry per texel, for a map of up to 2²³ texels. The cells of a larger map's table are texels
//! of a coarser map of at most that size: w of a texel is divided among the cells it overlaps, in proportion.
//! Only the choice of directions is coarser; radiance is that of the map.
//!
//! # Rounding
//! Weights, solid angles and the table are computed in f64; radiance, directions and densities are f32. Near
//! a pole the sampler uses 1 − |cos θ|, and the look-up atan2(√(x²+y²), z), so both keep the accuracy of the
//! angle. The density of a drawn direction is that of the texel it was drawn from; the look-up may return the
//! neighbour if the direction is within rounding (1e-7 of the map's width) of the edge between them. In these
//! strips the two densities differ, which changes a weight of the balance heuristic by at most their ratio
//! there, and a mean by less than 1e-7 of it.

use super::alias::{AliasTable, overlaps};
use super::vector::dot;
use crate::num::elem;
use crate::num::lanes::{Real, f32x8};
use crate::num::order;
use crate::scene::light::Environment;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Weights of linear RGB in luminance (Rec. 709).
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Returns the solid angle of every row's texels, and cos θ of the rows' edges (H + 1).
pub fn solid_angles(width: usize, height: usize) -> (Vec<f64>, Vec<f64>) {
    let edges: Vec<f64> = (0..=height)
        .map(|i| {
            // sin of the distance from the equator is exact at the equator and symmetric about it.
            let from_equator = (height as f64 - 2.0 * i as f64) / (2.0 * height as f64);
            libm::sin(std::f64::consts::PI * from_equator)
        })
        .collect();
    let column = std::f64::consts::TAU / width as f64;
    (edges.windows(2).map(|e| column * (e[0] - e[1])).collect(), edges)
}

/// Returns sin and cos of the inclination of a row's centre.
fn inclination(height: usize, row: usize) -> [f64; 2] {
    let theta = std::f64::consts::PI * (row as f64 + 0.5) / height as f64;
    [libm::sin(theta), libm::cos(theta)]
}

/// Returns sin and cos of the azimuth of a column's centre.
fn azimuth(width: usize, column: usize) -> [f64; 2] {
    let azimuth = std::f64::consts::TAU * ((column as f64 + 0.5) / width as f64 - 0.5);
    [libm::sin(azimuth), libm::cos(azimuth)]
}

/// Returns the unit vector of an inclination and an azimuth, rounded once.
fn sphere([sin_t, cos_t]: [f64; 2], [sin_a, cos_a]: [f64; 2]) -> [f32; 3] {
    [(sin_t * sin_a) as f32, (sin_t * cos_a) as f32, cos_t as f32]
}

/// Returns the direction of the centre of texel (`row`, `column`), rounded once.
pub fn texel_center(width: usize, height: usize, row: usize, column: usize) -> [f32; 3] {
    sphere(inclination(height, row), azimuth(width, column))
}

/// Returns [`texel_center`] of every texel, row-major.
pub fn texel_centers(width: usize, height: usize) -> Vec<[f32; 3]> {
    let columns: Vec<[f64; 2]> = (0..width).map(|j| azimuth(width, j)).collect();
    let rows = (0..height).map(|i| inclination(height, i));
    rows.flat_map(|row| columns.iter().map(move |column| sphere(row, *column))).collect()
}

/// The edges of a row: 1 − |cos θ|, and the hemisphere.
#[derive(Clone, Copy, Debug)]
struct Row {
    /// Values 1 − |cos θ| of the edge nearer to the pole, and of the other.
    versine: [f32; 2],
    /// Sign of the hemisphere: 1 for the upper, −1 for the lower.
    half: f32,
}

/// Tables for sampling over H × W cells; absent for a black map.
#[derive(Clone, Debug)]
struct Table {
    /// Numbers of cells, horizontally and vertically.
    size: [usize; 2],
    /// Cells per texel, horizontally and vertically; 1 unless the map is large.
    per_texel: [f32; 2],
    /// Alias table, shape (H·W).
    alias: AliasTable,
    /// Density of each cell per steradian, shape (H·W).
    density: Vec<f32>,
    /// Rows of cells, shape (H).
    rows: Vec<Row>,
}

impl Table {
    /// Returns the cell at a position in texels.
    #[inline(always)]
    fn cell(&self, x: f32, y: f32) -> usize {
        let j = order::min((x * self.per_texel[0]) as usize, self.size[0] - 1);
        let i = order::min((y * self.per_texel[1]) as usize, self.size[1] - 1);
        i * self.size[0] + j
    }
}

/// Largest number of cells of a table.
const CELLS: usize = 1 << 23;

/// An environment map prepared for look-ups and sampling.
#[derive(Clone, Debug)]
pub struct Sky<'a> {
    width: usize,
    height: usize,
    /// Radiance of the texels, shape (H·W).
    radiance: &'a [[f32; 3]],
    /// Radiance of the poles, top and bottom.
    poles: [[f32; 3]; 2],
    /// Radiance of a constant map.
    constant: Option<[f32; 3]>,
    table: Option<Table>,
}

/// A direction drawn from a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapSample {
    /// Unit vector towards the light.
    pub towards: [f32; 3],
    /// Density per steradian.
    pub density: f32,
    /// Index of the cell, which is a texel unless the map is large.
    pub cell: usize,
}

impl<'a> Sky<'a> {
    /// Computes the tables; the map must have passed its own validation.
    pub fn new(map: &'a Environment) -> Self {
        Self::with_cells(map, CELLS)
    }

    /// Like [`Self::new`], with a table of at most `most` cells, which must be at least 1.
    pub fn with_cells(map: &'a Environment, most: usize) -> Self {
        let (w, h) = (map.width, map.height);
        let mean = |row: usize| -> [f32; 3] {
            std::array::from_fn(|c| {
                let sum = (0..w).fold(0.0, |s: f64, j| s + f64::from(map.radiance[row * w + j][c]));
                (sum / w as f64) as f32
            })
        };
        let constant = map.radiance.iter().all(|t| *t == map.radiance[0]).then_some(map.radiance[0]);
        let poles = constant.map_or_else(|| [mean(0), mean(h - 1)], |c| [c, c]);
        let mut sky = Self { width: w, height: h, radiance: &map.radiance, poles, constant, table: None };
        let texels = [w, h];
        let of = |step: usize| texels.map(|n| n.div_ceil(step));
        let mut step = 1;
        while step < Ord::max(w, h) && of(step)[0] * of(step)[1] > most {
            step += 1;
        }
        sky.table = if step == 1 {
            sky.table(texels, sky.weights())
        } else {
            sky.table(of(step), sky.weights_of_cells(of(step)))
        };
        sky
    }

    /// Returns w of every texel.
    fn weights(&self) -> Vec<f64> {
        let mut weights = Vec::with_capacity(self.width * self.height);
        self.rows_of_weights(|_, row| weights.extend_from_slice(row));
        weights
    }

    /// Returns Σ w of every cell of a coarser map; a texel gives each cell the part that lies in it.
    fn weights_of_cells(&self, [w, h]: [usize; 2]) -> Vec<f64> {
        let (columns, rows) = (overlaps(self.width, w), overlaps(self.height, h));
        let mut weights = vec![0.0; w * h];
        self.rows_of_weights(|i, row| {
            for (cell, part) in rows[i] {
                let out = &mut weights[cell * w..][..w];
                for (x, parts) in row.iter().zip(&columns) {
                    for (column, across) in parts {
                        out[*column] += x * (part * across);
                    }
                }
            }
        });
        weights
    }

    /// Calls `take` with the index and the weights of every row of texels.
    fn rows_of_weights(&self, mut take: impl FnMut(usize, &[f64])) {
        let (w, h) = (self.width, self.height);
        let omega = solid_angles(w, h).0;
        // Means over texels: ⅛, ¾, ⅛ horizontally; the same vertically, or ¼ pole where there is no further
        // row.
        let across = |i: usize| -> Vec<f64> {
            let lum: Vec<f64> = self.radiance[i * w..][..w].iter().map(|t| luminance_f64(*t)).collect();
            (0..w).map(|j| 0.125 * (lum[(j + w - 1) % w] + lum[(j + 1) % w]) + 0.75 * lum[j]).collect()
        };
        let poles = self.poles.map(luminance_f64);
        let (mut above, mut here, mut row) = (Vec::new(), across(0), vec![0.0; w]);
        for i in 0..h {
            let below = if i + 1 < h { across(i + 1) } else { Vec::new() };
            for j in 0..w {
                let beside = |row: &[f64], pole: f64| match row.get(j) {
                    Some(x) => 0.125 * x + 0.375 * here[j],
                    None => 0.25 * pole + 0.25 * here[j],
                };
                row[j] = (beside(&above, poles[0]) + beside(&below, poles[1])) * omega[i];
            }
            take(i, &row);
            (above, here) = (here, below);
        }
    }

    /// Builds the table of cells with weights.
    fn table(&self, size: [usize; 2], weights: Vec<f64>) -> Option<Table> {
        let [w, h] = size;
        let (omega, edges) = solid_angles(w, h);
        let total = crate::num::sum::sum16_f64(&weights);
        if !(total > 0.0) {
            return None;
        }
        let density = match self.constant {
            Some(_) => vec![0.25 * FRAC_1_PI; h * w],
            None => weights.iter().enumerate().map(|(i, x)| (x / total / omega[i / w]) as f32).collect(),
        };
        let rows = edges
            .windows(2)
            .map(|e| {
                let upper = e[0] + e[1] >= 0.0;
                // A row that contains the equator counts from the upper pole.
                let versine = if upper { [1.0 - e[0], 1.0 - e[1]] } else { [1.0 + e[1], 1.0 + e[0]] };
                Row { versine: versine.map(|x| x as f32), half: if upper { 1.0 } else { -1.0 } }
            })
            .collect();
        let per_texel = [w as f32 / self.width as f32, h as f32 / self.height as f32];
        Some(Table { size, per_texel, alias: AliasTable::new(&weights, total), density, rows })
    }

    /// Whether the map is black, so that no direction can be drawn.
    pub fn is_black(&self) -> bool {
        self.table.is_none()
    }

    /// Returns the numbers of texels, horizontally and vertically.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Returns the numbers of cells of the table, horizontally and vertically: those of texels, unless the map is
    /// large or black.
    pub fn cells(&self) -> [usize; 2] {
        self.table.as_ref().map_or(self.size(), |t| t.size)
    }

    /// Returns the probability with which [`Self::draw`] chooses each cell, computed from its alias table;
    /// empty for a black map.
    pub fn probabilities(&self) -> Vec<f64> {
        self.table.as_ref().map_or_else(Vec::new, |table| table.alias.probabilities())
    }

    /// Returns the position of directions in the map: columns and rows from 0 to W and H.
    #[inline(always)]
    fn place<L: Real>(&self, d: [L; 3]) -> [L; 2] {
        let s = L::splat;
        let azimuth = elem::atan2(d[0], d[1]);
        let polar = elem::atan2((d[0] * d[0] + d[1] * d[1]).sqrt(), d[2]);
        [
            (azimuth * s(0.5 * FRAC_1_PI) + s(0.5)) * s(self.width as f32),
            polar * s(FRAC_1_PI) * s(self.height as f32),
        ]
    }

    /// Returns the bilinear radiance at a position.
    #[inline(always)]
    fn at(&self, x: f32, y: f32) -> [f32; 3] {
        let (w, h) = (self.width as i64, self.height as i64);
        let (x, y) = (x - 0.5, y - 0.5);
        let low = x.floor();
        let fx = x - low;
        let j = low as i64;
        let [j0, j1] = [j, j + 1].map(|j| if j < 0 { j + w } else if j >= w { j - w } else { j } as usize);
        let row = |i: i64| -> [f32; 3] {
            if i < 0 {
                return self.poles[0];
            }
            if i >= h {
                return self.poles[1];
            }
            let line = &self.radiance[i as usize * self.width..][..self.width];
            let (a, b) = (line[j0], line[j1]);
            std::array::from_fn(|c| a[c] + fx * (b[c] - a[c]))
        };
        let i = y.floor() as i64;
        let mut fy = y - y.floor();
        // The distance from a row to its pole is half a texel.
        if i < 0 {
            fy = order::max(2.0 * fy - 1.0, 0.0);
        } else if i >= h - 1 {
            fy = order::min(2.0 * fy, 1.0);
        }
        let (a, b) = (row(i), row(i + 1));
        std::array::from_fn(|c| a[c] + fy * (b[c] - a[c]))
    }

    /// Returns the radiance from the unit direction `towards`.
    pub fn radiance(&self, towards: [f32; 3]) -> [f32; 3] {
        match self.constant {
            Some(c) => c,
            None => {
                let [x, y] = self.place(towards);
                self.at(x, y)
            }
        }
    }

    /// Returns the density per steradian with which [`Self::draw`] returns the unit direction `towards`; 0
    /// for a black map.
    pub fn density(&self, towards: [f32; 3]) -> f32 {
        let Some(table) = &self.table else { return 0.0 };
        let [x, y] = self.place(towards);
        table.density[table.cell(x, y)]
    }

    /// Returns the cell that contains a unit direction; 0 for a black map.
    pub fn cell_of(&self, towards: [f32; 3]) -> usize {
        let [x, y] = self.place(towards);
        self.table.as_ref().map_or(0, |t| t.cell(x, y))
    }

    /// Returns radiance and density of eight directions with the bits of [`Self::radiance`] and
    /// [`Self::density`]. Lanes whose bit in `wanted` is 0 may be zero.
    #[inline]
    pub fn look8(&self, towards: [f32x8; 3], wanted: u32) -> ([f32x8; 3], f32x8) {
        if let Some(c) = self.constant {
            let density = self.table.as_ref().map_or(0.0, |t| t.density[0]); // the same for all cells
            return (c.map(f32x8::splat), f32x8::splat(density));
        }
        let mut radiance = [[0.0; 8]; 3];
        let mut density = [0.0; 8];
        if wanted != 0 {
            let [x, y] = self.place(towards).map(f32x8::to_array);
            for l in (0..8).filter(|l| wanted >> l & 1 == 1) {
                let r = self.at(x[l], y[l]);
                for c in 0..3 {
                    radiance[c][l] = r[c];
                }
                if let Some(table) = &self.table {
                    density[l] = table.density[table.cell(x[l], y[l])];
                }
            }
        }
        (radiance.map(f32x8::new), f32x8::new(density))
    }

    /// Draws a direction from a word and two uniforms; returns `None` for a black map.
    pub fn draw(&self, word: u64, u: [f32; 2]) -> Option<MapSample> {
        let table = self.table.as_ref()?;
        let cell = table.alias.choose(word);
        let (turn, versine, half) = self.inside(table, cell, u);
        Some(MapSample { towards: direction(turn, versine, half), density: table.density[cell], cell })
    }

    /// Draws eight directions with densities, with the bits of [`Self::draw`]; returns `None` for a black
    /// map.
    #[inline]
    pub fn draw8(&self, words: &[u64; 8], u: [&[f32; 8]; 2]) -> Option<([f32x8; 3], f32x8)> {
        let table = self.table.as_ref()?;
        let (mut turn, mut versine, mut half, mut density) = ([0.0; 8], [0.0; 8], [0.0; 8], [0.0; 8]);
        for l in 0..8 {
            let cell = table.alias.choose(words[l]);
            (turn[l], versine[l], half[l]) = self.inside(table, cell, [u[0][l], u[1][l]]);
            density[l] = table.density[cell];
        }
        let [turn, versine, half, density] = [turn, versine, half, density].map(f32x8::new);
        Some((direction(turn, versine, half), density))
    }

    /// Returns the azimuth in turns from −½, 1 − |cos θ|, and the hemisphere of a point of a cell.
    #[inline(always)]
    fn inside(&self, table: &Table, cell: usize, u: [f32; 2]) -> (f32, f32, f32) {
        let (i, j) = (cell / table.size[0], cell % table.size[0]);
        let row = table.rows[i];
        let turn = (j as f32 + u[0]) / table.size[0] as f32 - 0.5;
        (turn, row.versine[0] + u[1] * (row.versine[1] - row.versine[0]), row.half)
    }
}

/// Returns the unit vector of an azimuth in turns and 1 − |cos θ|. Beyond the equator 1 − |cos θ| exceeds 1,
/// where cos θ changes its sign.
#[inline(always)]
fn direction<L: Real>(turn: L, versine: L, half: L) -> [L; 3] {
    let s = L::splat;
    let sin = (versine * (s(2.0) - versine)).max(s(0.0)).sqrt();
    let azimuth = turn * s(TAU);
    [sin * elem::sin(azimuth), sin * elem::cos(azimuth), half * (s(1.0) - versine)]
}

/// Returns the luminance of linear RGB in f64, for tables.
pub(super) fn luminance_f64(c: [f32; 3]) -> f64 {
    let c = c.map(f64::from);
    let k = LUMINANCE.map(f64::from);
    (k[0] * c[0] + k[1] * c[1]) + k[2] * c[2]
}

/// Returns the luminance of linear RGB.
#[inline(always)]
pub fn luminance<L: Real>(c: [L; 3]) -> L {
    dot(c, LUMINANCE.map(L::splat))
}
