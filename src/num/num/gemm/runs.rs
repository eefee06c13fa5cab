//! Products whose left factor is stored in memory as runs, such as patches of an image that are read in
//! place.
//!
//! Row r of the factor (m, k) consists of runs of `len` consecutive numbers: run s begins at `starts[r] +
//! offsets[s]`, and k = runs · len. The transpose reads the same memory in the other order. Chains are those
//! of [`super`]: k ascending from +0, with product and sum rounded separately; k beyond
//! [`CHUNK`](super::CHUNK) is split into chunks joined by the pairwise tree.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::gemm::{Finish, Packed, View};
//! use lastlight::num::gemm::runs::{Runs, gemm_runs};
//! let image = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]; // 3×3
//! // the two 2×2 patches in the upper two rows
//! let patches = Runs { values: &image, starts: &[0, 1], offsets: &[0, 3], len: 2 };
//! let ones = Packed::new(View::new(&[1.0; 4], 4, 1));
//! let mut sums = [0.0; 2];
//! gemm_runs(patches, &ones, Finish::Store, sums.chunks_mut(1).collect());
//! assert_eq!(sums, [12.0, 16.0]);
//! ```

use super::block::{Left, RESIDENT, Task, block};
use super::tile::{COLUMNS, Chains, Columns, HALF, Job, ROWS, Rows, Sixteen, widest};
use super::{BLOCK_ROWS, Finish, Packed};
use std::ops::Range;

/// A matrix whose rows consist of runs.
#[derive(Clone, Copy, Debug)]
pub struct Runs<'a> {
    /// Memory that contains the numbers.
    pub values: &'a [f32],
    /// Start of each row in `values`, shape (m).
    pub starts: &'a [usize],
    /// Start of each run, relative to the start of its row.
    pub offsets: &'a [usize],
    /// Numbers per run.
    pub len: usize,
}

impl Runs<'_> {
    /// Number of columns k.
    pub fn k(&self) -> usize {
        self.offsets.len() * self.len
    }
}

impl Left for Runs<'_> {
    fn prepare(self, _: Range<usize>, _: Range<usize>, _: usize, packed: &mut Vec<Rows>) {
        packed.clear();
    }

    type Tile<'t, const R: usize>
        = ([usize; R], Range2)
    where
        Self: 't;

    #[inline(always)]
    fn tile<'t, const R: usize>(
        &'t self,
        rows: Range<usize>,
        ks: Range<usize>,
        _: (&'t [Rows], usize),
    ) -> ([usize; R], Range2) {
        let mut starts = [0; R];
        for (i, start) in starts.iter_mut().enumerate() {
            *start = self.starts[(rows.start + i).min(rows.end - 1)];
        }
        (starts, [ks.start, ks.end])
    }

    #[inline(always)]
    fn resume<S: Sixteen, const R: usize>(
        &self,
        (starts, [first, last]): ([usize; R], Range2),
        chains: &mut Chains<S, R>,
        columns: &[Columns],
    ) {
        let (mut run, mut at) = (first / self.len.max(1), first % self.len.max(1));
        let (mut done, all) = (0, last - first);
        while done < all {
            let n = (all - done).min(self.len - at);
            let from = self.offsets[run] + at;
            let mut a: [&[f32]; R] = [&[]; R];
            for (a, start) in a.iter_mut().zip(starts) {
                *a = &self.values[start + from..][..n];
            }
            chains.in_place(a, &columns[done..done + n]);
            (run, at, done) = (run + 1, 0, done + n);
        }
    }
}

/// First k, and the end.
type Range2 = [usize; 2];

/// The transposed matrix of the patches of one image, `rows` × `columns` of them: column (r, q) of the factor
/// (m, k) begins at `r · down + q · along`, and its runs at `offsets` from there; m = runs · len, k = `rows`
/// · `columns`.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// Memory that contains the numbers, followed by at least `along` more.
    pub values: &'a [f32],
    /// Number of patches in vertical direction.
    pub rows: usize,
    /// Number of patches in horizontal direction.
    pub columns: usize,
    /// Distance from a patch to the one below.
    pub down: usize,
    /// Distance from a patch to the next in its row.
    pub along: usize,
    /// Start of each run, relative to the start of its patch.
    pub offsets: &'a [usize],
    /// Numbers per run.
    pub len: usize,
}

impl Grid<'_> {
    /// Number of rows m.
    pub fn m(&self) -> usize {
        self.offsets.len() * self.len
    }

    /// Number of columns k.
    pub fn k(&self) -> usize {
        self.rows * self.columns
    }

    /// Returns where patches contain the rows from `rows.start` on, at most R; missing rows repeat the last
    /// one.
    #[inline(always)]
    fn places<const R: usize>(&self, rows: Range<usize>) -> Places<R> {
        let mut at = [0; R];
        for (i, at) in at.iter_mut().enumerate() {
            let row = (rows.start + i).min(rows.end - 1);
            *at = self.offsets[row / self.len] + row % self.len;
        }
        Places { at, are_neighbours: rows.start % self.len + R <= self.len && R <= self.along }
    }

    /// Resumes the chains of these rows over the patches `ks`.
    #[inline(always)]
    fn resume_at<S: Sixteen, const R: usize>(
        &self,
        chains: &mut Chains<S, R>,
        places: &Places<R>,
        ks: Range<usize>,
        columns: &[Columns],
    ) {
        if ks.is_empty() {
            return;
        }
        let (mut row, mut column) = (ks.start / self.columns, ks.start % self.columns);
        let (mut done, all) = (0, ks.len());
        while done < all {
            let n = (all - done).min(self.columns - column);
            let now = &columns[done..done + n];
            let start = row * self.down + column * self.along;
            if places.are_neighbours {
                let line = &self.values[start + places.at[0]..][..n * self.along];
                for (patch, b) in line.chunks_exact(self.along).zip(now) {
                    let a: &[f32; R] = patch[..R].try_into().expect("R numbers");
                    chains.step(|r| a[r], b);
                }
            } else {
                for (i, b) in now.iter().enumerate() {
                    chains.step(|r| self.values[start + i * self.along + places.at[r]], b);
                }
            }
            (row, column, done) = (row + 1, 0, done + n);
        }
    }
}

/// Positions of R rows of a factor within a patch.
#[derive(Clone, Copy)]
pub(super) struct Places<const R: usize> {
    /// Start of each row.
    at: [usize; R],
    /// True if the rows are consecutive and do not reach beyond the next patch, so that they are read without
    /// separate look-ups.
    are_neighbours: bool,
}

impl Left for Grid<'_> {
    fn prepare(self, _: Range<usize>, _: Range<usize>, _: usize, packed: &mut Vec<Rows>) {
        packed.clear();
    }

    type Tile<'t, const R: usize>
        = (Places<R>, Range2)
    where
        Self: 't;

    #[inline(always)]
    fn tile<'t, const R: usize>(
        &'t self,
        rows: Range<usize>,
        ks: Range<usize>,
        _: (&'t [Rows], usize),
    ) -> (Places<R>, Range2) {
        (self.places(rows), [ks.start, ks.end])
    }

    #[inline(always)]
    fn resume<S: Sixteen, const R: usize>(
        &self,
        (places, [first, last]): (Places<R>, Range2),
        chains: &mut Chains<S, R>,
        columns: &[Columns],
    ) {
        self.resume_at(chains, &places, first..last, columns);
    }
}

/// Computes the rows of a·b on this thread; `rows` are the rows of the product at any location in memory.
///
/// # Panics
/// Panics if the shapes do not match, or if a run is outside the memory.
pub fn gemm_runs(a: Runs<'_>, b: &Packed, how: Finish<'_>, mut rows: Vec<&mut [f32]>) {
    assert_eq!(a.starts.len(), rows.len(), "the product has as many rows as the left factor");
    assert_eq!(a.k(), b.k, "both factors have the same k");
    assert!(
        rows.iter().all(|row| row.len() == b.n),
        "each row of the product has as many entries as the right factor has columns"
    );
    if let Some(bias) = how.bias() {
        assert_eq!(bias.len(), b.n, "one bias per column");
    }
    let mut top = 0;
    while !rows.is_empty() && b.n > 0 {
        let rest = rows.split_off(rows.len().min(BLOCK_ROWS));
        block(a, b, Task { top, left: 0, rows }, how);
        (top, rows) = (top + BLOCK_ROWS, rest);
    }
}

/// Adds the products of the transposed patches of several images to rows of c, which are those of the product
/// from row `top` on: c = (c + a₀·b₀) + a₁·b₁ …, each with its own right factor, on this thread.
///
/// # Panics
/// Panics if the shapes do not match, if the patches are not placed alike in all images, or if a run is
/// outside the memory.
pub fn add_grids(items: &[(Grid<'_>, &Packed)], top: usize, mut rows: Vec<&mut [f32]>) {
    for (a, b) in items {
        let lies = |a: &Grid<'_>| (a.rows, a.columns, a.down, a.along, a.len);
        assert!(
            lies(a) == lies(&items[0].0) && a.offsets == items[0].0.offsets,
            "the patches are placed alike in all images"
        );
        assert!(top + rows.len() <= a.m(), "the rows from `top` on exist in the left factor");
        assert_eq!(a.k(), b.k, "both factors have the same k");
        assert!(
            rows.iter().all(|row| row.len() == b.n),
            "each row of the product has as many entries as the right factor has columns"
        );
    }
    if items.iter().all(|(a, _)| a.k() <= SHORT) {
        return widest(AddGrids { items, task: Task { top, left: 0, rows } });
    }
    for (a, b) in items {
        block(
            *a,
            b,
            Task { top, left: 0, rows: rows.iter_mut().map(|row| &mut **row).collect() },
            Finish::Add,
        );
    }
}

/// Largest k for which [`add_grids`] keeps sums in registers (where these have sixteen lanes) while it
/// processes a few items.
const SHORT: usize = 256;

pub(super) struct AddGrids<'a, 'b> {
    pub(super) items: &'a [(Grid<'b>, &'b Packed)],
    pub(super) task: Task<'a>,
}

impl Job for AddGrids<'_, '_> {
    fn by<S: Sixteen>(mut self, simd: S) {
        for p in self.task.panels() {
            simd.run(
                #[inline(always)]
                || self.panel(simd, p),
            );
        }
    }
}

impl AddGrids<'_, '_> {
    /// Computes the tiles of one panel for all rows.
    #[inline(always)]
    fn panel<S: Sixteen>(&mut self, simd: S, panel: usize) {
        // As many items are processed together as keep their columns in the first-level cache.
        let k = self.items.first().map_or(1, |(_, b)| b.k);
        for items in self.items.chunks((RESIDENT / k.max(1)).max(1)) {
            let (mut first, all) = (0, self.task.rows.len());
            while first < all {
                if S::HEIGHT == ROWS && all - first > HALF {
                    self.tile::<S, ROWS>(simd, items, panel, first);
                    first += ROWS;
                } else {
                    self.tile::<S, HALF>(simd, items, panel, first);
                    first += HALF;
                }
            }
        }
    }

    /// Computes one register tile from row `first` on.
    #[inline(always)]
    fn tile<S: Sixteen, const R: usize>(
        &mut self,
        simd: S,
        items: &[(Grid<'_>, &Packed)],
        panel: usize,
        first: usize,
    ) {
        let Task { top, rows, .. } = &mut self.task;
        let (at, end, last) = (panel * COLUMNS, *top + rows.len(), rows.len().min(first + R));
        let from = *top + first;
        let rows = &mut rows[first..last];
        let mut sums = Chains::<S, R>::of_rows(simd, rows, at);
        // The patches of all items are placed alike.
        let places = items[0].0.places(from..end);
        for (a, b) in items {
            let mut chains = Chains::fresh(simd);
            a.resume_at(&mut chains, &places, 0..b.k, b.panel(panel));
            sums.add(&chains);
        }
        sums.finish(rows, at, [from, 0], Finish::Store);
    }
}
