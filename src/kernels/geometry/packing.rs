//! Positions of charts in a square of texels.
//!
//! A chart occupies every texel that its triangles touch. Charts are placed one after the other, the highest
//! first, each in the one of four quarter turns and at the place where its lowest row ends first, then at the smallest column; at
//! least `gutter` texels stay free between the texels of two charts. If a chart finds no place, all charts are
//! scaled by [`STEP`] and placed again, so they keep one texel density.

use super::charts::bounds;
use crate::num::{order, par};

/// Fraction of the square that the charts would fill at the first attempt.
const FIRST: f64 = 0.86;

/// Factor of the scale from one attempt to the next.
const STEP: f64 = 0.985;

/// Attempts: a scale of at least 10⁻³ of the first one.
const ATTEMPTS: usize = 460;

/// Free texels at the border of the square.
pub(super) const MARGIN: usize = 2;

/// Distance in texels at which a triangle touches a texel: more than the error of a rounded coordinate.
const TOUCH: f64 = 1.0 / 64.0;

/// Triangles of a chart in its plane.
pub(super) type Flat = Vec<[[f64; 2]; 3]>;

/// Where a chart is: its plane is scaled, moved to its smallest coordinates, turned and moved.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Place {
    scale: f64,
    /// Smallest coordinates, not scaled.
    low: [f64; 2],
    /// Texels before the turn.
    size: [usize; 2],
    /// Quarter turns.
    turn: usize,
    at: [usize; 2],
}

impl Place {
    /// A point of the chart's plane, in texels.
    pub(super) fn map(&self, p: [f64; 2]) -> [f64; 2] {
        let [x, y] = [0, 1].map(|k| (p[k] - self.low[k]) * self.scale + 2.0 * TOUCH);
        let [w, h] = self.size.map(|n| n as f64);
        let turned = [[x, y], [h - y, x], [w - x, h - y], [y, w - x]][self.turn];
        [0, 1].map(|k| turned[k] + self.at[k] as f64)
    }
}

/// Touched texels: columns first..end of each row, the longest first.
#[derive(Clone, Default)]
struct Mask {
    size: [usize; 2],
    runs: Vec<[usize; 3]>,
}

impl Mask {
    fn of(grid: &[bool], size: [usize; 2]) -> Self {
        let mut runs = Vec::new();
        for (y, row) in grid.chunks(order::max(size[0], 1)).enumerate() {
            let mut x = 0;
            while let Some(first) = row[x..].iter().position(|t| *t).map(|n| x + n) {
                x = row[first..].iter().position(|t| !*t).map_or(row.len(), |n| first + n);
                runs.push([y, first, x]);
            }
        }
        runs.sort_by_key(|[_, first, end]| std::cmp::Reverse(end - first));
        Self { size, runs }
    }
}

/// The masks of a chart in four turns, and its place before it is moved.
fn masks(chart: &Flat, scale: f64) -> ([Mask; 4], Place) {
    let [low, high] = bounds(chart.iter().flatten().copied()).unwrap_or_default();
    let size = [0, 1].map(|k| ((high[k] - low[k]) * scale + 4.0 * TOUCH).ceil() as usize);
    let place = Place { scale, low, size, ..Place::default() };
    let mut grid = vec![false; size[0] * size[1]];
    for triangle in chart {
        touch(triangle.map(|p| place.map(p)), size, |x, y| grid[y * size[0] + x] = true);
    }
    let [w, h] = size;
    let turned = |turn: usize| {
        if turn == 0 {
            return Mask::of(&grid, size);
        }
        let to = [[w, h], [h, w], [w, h], [h, w]][turn];
        let mut out = vec![false; w * h];
        for y in 0..h {
            for x in (0..w).filter(|x| grid[y * w + x]) {
                let [i, j] = [[x, y], [h - 1 - y, x], [w - 1 - x, h - 1 - y], [y, w - 1 - x]][turn];
                out[j * to[0] + i] = true;
            }
        }
        Mask::of(&out, to)
    };
    ([0, 1, 2, 3].map(turned), place)
}

/// Calls `mark` for every texel within [`TOUCH`] of a triangle.
fn touch(p: [[f64; 2]; 3], size: [usize; 2], mut mark: impl FnMut(usize, usize)) {
    let ends = |k: usize| {
        p.iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], q| [order::min(a, q[k]), order::max(b, q[k])])
    };
    let cells = |[low, high]: [f64; 2], n: usize| {
        let first = order::max((low - TOUCH).floor(), 0.0) as usize;
        first..order::min((high + TOUCH).floor() as usize + 1, n)
    };
    for y in cells(ends(1), size[1]) {
        // The part of the triangle between the lines y and y + 1, a little more.
        let band = [y as f64 - TOUCH, (y + 1) as f64 + TOUCH];
        let mut x = [f64::INFINITY, f64::NEG_INFINITY];
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            let (a, b) = if a[1] <= b[1] { (a, b) } else { (b, a) };
            if b[1] < band[0] || a[1] > band[1] {
                continue;
            }
            let at = |line: f64| a[0] + (b[0] - a[0]) * ((line - a[1]) / (b[1] - a[1]));
            let from = if a[1] < band[0] { at(band[0]) } else { a[0] };
            let to = if b[1] > band[1] { at(band[1]) } else { b[0] };
            x = [order::min(x[0], order::min(from, to)), order::max(x[1], order::max(from, to))];
        }
        if x[0] <= x[1] {
            cells(x, size[0]).for_each(|x| mark(x, y));
        }
    }
}

/// The free columns of every row.
struct Square {
    rows: Vec<Vec<[usize; 2]>>,
}

impl Square {
    fn new(size: usize) -> Self {
        let inner = MARGIN..size - order::min(MARGIN, size);
        Self {
            rows: (0..size)
                .map(|y| if inner.contains(&y) { vec![[inner.start, inner.end]] } else { Vec::new() })
                .collect(),
        }
    }

    /// The smallest column from x on where a run of a row is free.
    fn fit(&self, row: usize, x: usize, length: usize) -> Option<usize> {
        let free = &self.rows[row];
        let first = free.partition_point(|[_, end]| *end <= x);
        free[first..]
            .iter()
            .map(|&[a, b]| [order::max(a, x), b])
            .find(|[a, b]| a + length <= *b)
            .map(|[a, _]| a)
    }

    /// The first row, and its first column, where a mask fits; rows from `end` on are not examined.
    fn find(&self, mask: &Mask, end: usize) -> Option<[usize; 2]> {
        (0..end).find_map(|y| {
            let mut x = 0;
            let mut k = 0;
            // Runs that fit at this column in a row.
            let mut fitting = 0;
            while fitting < mask.runs.len() {
                let [row, first, end] = mask.runs[k];
                let at = self.fit(y + row, x + first, end - first)? - first;
                fitting = if at == x { fitting + 1 } else { 1 };
                (x, k) = (at, (k + 1) % mask.runs.len());
            }
            Some([x, y])
        })
    }

    /// Takes the texels of a mask and a gutter around them.
    fn take(&mut self, mask: &Mask, at: [usize; 2], gutter: usize) {
        for &[row, first, end] in &mask.runs {
            let (a, b) = ((at[0] + first).saturating_sub(gutter), at[0] + end + gutter);
            let rows =
                (at[1] + row).saturating_sub(gutter)..order::min(at[1] + row + gutter + 1, self.rows.len());
            for free in &mut self.rows[rows] {
                let from = free.partition_point(|[_, end]| *end <= a);
                let to = free.partition_point(|[start, _]| *start < b);
                if from < to {
                    let kept = [[free[from][0], a], [b, free[to - 1][1]]];
                    free.splice(from..to, kept.into_iter().filter(|[start, end]| start < end));
                }
            }
        }
    }
}

/// Places all charts at one scale.
fn place(charts: &[Flat], scale: f64, size: usize, gutter: usize) -> Option<Vec<Place>> {
    let made = par::map(charts.len(), |i| masks(&charts[i], scale));
    let longest = |i: usize| order::max(made[i].1.size[0], made[i].1.size[1]);
    let mut by_size: Vec<usize> = (0..charts.len()).collect();
    by_size.sort_by_key(|&i| (std::cmp::Reverse(longest(i)), i));
    let mut square = Square::new(size);
    let mut out = vec![Place::default(); charts.len()];
    for i in by_size {
        let (turns, place) = &made[i];
        let found = par::map(4, |turn| {
            let mask = &turns[turn];
            let end = (size + 1).checked_sub(mask.size[1] + MARGIN)?;
            square.find(mask, end).map(|at| (at[1] + mask.size[1], at, turn))
        });
        let (_, at, turn) = found.into_iter().flatten().min_by_key(|&(end, at, turn)| (end, at[0], turn))?;
        square.take(&turns[turn], at, gutter);
        out[i] = Place { turn, at, ..*place };
    }
    Some(out)
}

/// Places of the charts, and texels per unit of length; none if there are too many charts for the square.
pub(super) fn pack(charts: &[Flat], area: f64, size: usize, gutter: usize) -> Option<(Vec<Place>, f64)> {
    let mut scale = (FIRST / area).sqrt() * size as f64;
    for _ in 0..ATTEMPTS {
        if let Some(places) = place(charts, scale, size, gutter) {
            return Some((places, scale));
        }
        scale *= STEP;
    }
    None
}
