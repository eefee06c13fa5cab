//! Products with a left factor that lies in memory as runs: patches of a picture, read where they are.
//!
//! Row r of the factor (m, k) consists of runs of `len` neighbouring numbers: run s begins at `starts[r] + offsets[s]`, k = runs · len. The same memory read
//! the other way round is the transpose. Chains are those of [`super`]: k ascending from +0, product and sum rounded separately, beyond
//! [`CHUNK`](super::CHUNK) in chunks joined by the tree.
//!
//! ```
//! use lastlight::num::gemm::{Finish, Packed, View};
//! use lastlight::num::gemm::runs::{Runs, gemm_runs};
//! let picture = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]; // 3×3
//! // both patches of 2×2 in the upper two rows
//! let patches = Runs { values: &picture, starts: &[0, 1], offsets: &[0, 3], len: 2 };
//! let ones = Packed::new(View::new(&[1.0; 4], 4, 1));
//! let mut sums = [0.0; 2];
//! gemm_runs(patches, &ones, Finish::Store, sums.chunks_mut(1).collect());
//! assert_eq!(sums, [12.0, 16.0]);
//! ```

use super::{BLOCK_ROWS, Columns, Finish, Left, Packed, ROWS, Rows, Task, Tile, block, step};
use std::ops::Range;

/// A matrix whose rows consist of runs.
#[derive(Clone, Copy, Debug)]
pub struct Runs<'a> {
    /// where the numbers are
    pub values: &'a [f32],
    /// (m) where each row begins
    pub starts: &'a [usize],
    /// where each run begins, from the beginning of its row
    pub offsets: &'a [usize],
    /// numbers of a run
    pub len: usize,
}

impl Runs<'_> {
    /// Columns k.
    pub fn k(&self) -> usize {
        self.offsets.len() * self.len
    }
}

impl Left for Runs<'_> {
    fn prepare(self, _: Range<usize>, _: Range<usize>, _: usize, packed: &mut Vec<Rows>) {
        packed.clear();
    }

    #[inline(never)]
    fn resume(self, rows: Range<usize>, ks: Range<usize>, _: &[Rows], columns: &[Columns], tile: &mut Tile) {
        let starts: [usize; ROWS] = std::array::from_fn(|i| self.starts[(rows.start + i).min(rows.end - 1)]);
        let mut acc = *tile;
        let (mut run, mut at, mut left) = (ks.start / self.len.max(1), ks.start % self.len.max(1), columns);
        while !left.is_empty() {
            let n = left.len().min(self.len - at);
            let (now, rest) = left.split_at(n);
            let from = self.offsets[run] + at;
            let slice = |r: usize| &self.values[starts[r] + from..][..n];
            let a: [&[f32]; ROWS] = std::array::from_fn(slice);
            let (b4, b1) = now.as_chunks::<4>();
            let quads = |r: usize| &a[r].as_chunks::<4>().0[..b4.len()];
            let (a0, a1, a2, a3, a4, a5) = (quads(0), quads(1), quads(2), quads(3), quads(4), quads(5));
            for (k, b) in b4.iter().enumerate() {
                let a = [&a0[k], &a1[k], &a2[k], &a3[k], &a4[k], &a5[k]];
                for i in 0..4 {
                    step(&mut acc, |r| a[r][i], &b[i]);
                }
            }
            for (k, b) in b1.iter().enumerate() {
                step(&mut acc, |r| a[r][4 * b4.len() + k], b);
            }
            (run, at, left) = (run + 1, 0, rest);
        }
        *tile = acc;
    }
}

/// Patches of one picture, `rows` × `columns` of them, taken the other way round: column (r, q) of the factor (m, k) begins at
/// `r · down + q · along`, its runs at `offsets` from there, m = runs · len, k = `rows` · `columns`.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// where the numbers are, and at least `along` more
    pub values: &'a [f32],
    /// patches below each other
    pub rows: usize,
    /// patches beside each other
    pub columns: usize,
    /// from a patch to the one below
    pub down: usize,
    /// from a patch to the next
    pub along: usize,
    /// where each run begins, from the beginning of its patch
    pub offsets: &'a [usize],
    /// numbers of a run
    pub len: usize,
}

impl Grid<'_> {
    /// Rows m.
    pub fn m(&self) -> usize {
        self.offsets.len() * self.len
    }

    /// Columns k.
    pub fn k(&self) -> usize {
        self.rows * self.columns
    }

    /// Where a patch holds row `row`.
    fn place(&self, row: usize) -> usize {
        self.offsets[row / self.len] + row % self.len
    }
}

impl Left for Grid<'_> {
    fn prepare(self, _: Range<usize>, _: Range<usize>, _: usize, packed: &mut Vec<Rows>) {
        packed.clear();
    }

    #[inline(never)]
    fn resume(self, rows: Range<usize>, ks: Range<usize>, _: &[Rows], columns: &[Columns], tile: &mut Tile) {
        let mut acc = *tile;
        let from = self.place(rows.start);
        // Six rows of one run, none of which is beyond the next patch, are read without looking up each.
        let is_together = rows.start % self.len + ROWS <= self.len && ROWS <= self.along;
        let places: [usize; ROWS] = std::array::from_fn(|i| self.place((rows.start + i).min(rows.end - 1)));
        let (mut row, mut column, mut left) = (ks.start / self.columns, ks.start % self.columns, columns);
        while !left.is_empty() {
            let (now, rest) = left.split_at(left.len().min(self.columns - column));
            let start = row * self.down + column * self.along;
            if is_together {
                let line = &self.values[start + from..][..now.len() * self.along];
                for (patch, b) in line.chunks_exact(self.along).zip(now) {
                    let a: &[f32; ROWS] = patch[..ROWS].try_into().expect("six numbers");
                    step(&mut acc, |r| a[r], b);
                }
            } else {
                for (i, b) in now.iter().enumerate() {
                    step(&mut acc, |r| self.values[start + i * self.along + places[r]], b);
                }
            }
            (row, column, left) = (row + 1, 0, rest);
        }
        *tile = acc;
    }
}

/// Rows of a product from row `top` on, at most `at_once` in a block, by this thread; they may lie apart.
fn product(
    a: impl Left,
    b: &Packed,
    how: Finish<'_>,
    (mut top, at_once): (usize, usize),
    mut rows: Vec<&mut [f32]>,
) {
    assert!(rows.iter().all(|row| row.len() == b.n), "a row of the product per row of the left factor");
    if let Some(bias) = how.bias() {
        assert_eq!(bias.len(), b.n, "one bias per column");
    }
    if b.n == 0 {
        return;
    }
    while rows.len() > at_once {
        let rest = rows.split_off(at_once);
        block(a, b, Task { top, left: 0, rows }, how);
        (top, rows) = (top + at_once, rest);
    }
    if !rows.is_empty() {
        block(a, b, Task { top, left: 0, rows }, how);
    }
}

/// The rows of a·b, on this thread; `rows` are those of the product, wherever they lie.
///
/// # Panics
/// When the shapes do not fit, or a run lies outside the memory.
pub fn gemm_runs(a: Runs<'_>, b: &Packed, how: Finish<'_>, rows: Vec<&mut [f32]>) {
    assert_eq!(a.starts.len(), rows.len(), "a row of the product per row of the left factor");
    assert_eq!(a.k(), b.k, "both factors have the same k");
    product(a, b, how, (0, BLOCK_ROWS), rows);
}

/// Rows of a·b from row `top` on for a picture's patches taken the other way round, on this thread; `rows` are those of the product,
/// wherever they lie.
///
/// # Panics
/// When the shapes do not fit, or a run lies outside the memory.
pub fn gemm_grid(a: Grid<'_>, top: usize, b: &Packed, how: Finish<'_>, rows: Vec<&mut [f32]>) {
    assert!(top + rows.len() <= a.m(), "a row of the product per row of the left factor");
    assert_eq!(a.k(), b.k, "both factors have the same k");
    product(a, b, how, (top, rows.len()), rows);
}
