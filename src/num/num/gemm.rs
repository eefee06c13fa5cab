//! Matrix products with one fixed association, independent of tile sizes, vector width and number of threads.
//!
//! Every output element is one chain: it starts at +0 and adds the rounded products a(i,k)·b(k,j) for
//! ascending k, with product and sum rounded separately, up to k = [`CHUNK`]. A longer k is split into chunks
//! of that length (the last may be shorter); each chunk is such a chain, and the partial results are added by
//! the pairwise tree of [`super::sum`]. Post-processing of the result ([`Finish`]) is applied after the
//! chain.
//!
//! The optimisations change no bit. Both factors are packed into panels (`ROWS` rows of a, `COLUMNS` columns
//! of b). A tile of `ROWS`×`COLUMNS` chains stays in registers while k runs over a block of `BLOCK_K`, and is
//! resumed from memory for the next block. Rows and columns beyond the matrix are zero in the panels, and
//! their results are discarded; k is never padded, because 0·∞ is not 0 and −0 + 0 is not −0. If the
//! processor has AVX-512, regardless of the build target, registers of sixteen lanes hold twice as many rows
//! ([`product_lanes`]).
//!
//! ```text
//! gemm, gemm_packed, runs::{gemm_runs, add_grids}   the products: matrices, patches of images
//!   pack    panels of both factors
//!   block   a block of the output along k, block by block, chunk by chunk
//!   tile    chains in registers, eight lanes or sixteen
//! ```
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::gemm::{Finish, View, gemm};
//! let a = [1.0, 2.0, 3.0, 4.0]; // (2, 2)
//! let b = [5.0, 6.0, 7.0, 8.0]; // (2, 2)
//! let mut c = [0.0; 4];
//! gemm(View::new(&a, 2, 2), View::new(&b, 2, 2).t(), Finish::Store, &mut c);
//! assert_eq!(c, [17.0, 23.0, 39.0, 53.0]); // a·bᵀ
//! ```

use super::par;
use std::cell::Cell;
use std::ops::Range;

mod block;
mod matrix;
mod pack;
mod packed;
pub mod runs;
#[cfg(test)]
mod tests;
mod tile;

pub use matrix::{CHUNK, Finish, View};
pub use packed::Packed;

use block::{Left, Task, block};
use pack::pack_rows;
use packed::PARALLEL;
use tile::{COLUMNS, Chains, Columns, ROWS, Rows, Sixteen};

/// Rows per task, chosen such that the packed rows of a and the stored tiles stay in the second-level cache.
const BLOCK_ROWS: usize = 4 * ROWS;
/// Columns per task.
const BLOCK_COLUMNS: usize = 64 * COLUMNS;
/// Largest number of column panels per task for which rows of a that are contiguous in k are read in place.
const IN_PLACE: usize = 32;
/// The same for rows that lie next to each other for every k.
const ACROSS: usize = 8;
/// Rows at multiples of this distance (2 KiB) share few sets of the first-level cache, and are packed earlier.
const COLLIDING: usize = 512;

/// Returns the number of lanes of a register in products: 16 if the processor has AVX-512 and the environment
/// variable `LASTLIGHT_LANES` is not 8, otherwise 8 (mapped by the compiler to the registers of the target).
/// The value affects only speed; the bits are the same.
pub fn product_lanes() -> usize {
    #[cfg(target_arch = "x86_64")]
    if super::registers::avx512().is_some() {
        return 16;
    }
    8
}

impl View<'_> {
    /// Whether rows that are contiguous in k are read where they lie.
    fn is_in_place(&self, panels: usize) -> bool {
        let limit = if self.row_stride.is_multiple_of(COLLIDING) { IN_PLACE / 16 } else { IN_PLACE };
        self.column_stride == 1 && panels <= limit
    }

    /// Whether rows that lie next to each other are read where they lie.
    fn is_across(&self, panels: usize) -> bool {
        self.row_stride == 1 && self.column_stride > 1 && panels <= ACROSS
    }
}

impl Left for View<'_> {
    fn prepare(self, rows: Range<usize>, ks: Range<usize>, panels: usize, packed: &mut Vec<Rows>) {
        packed.clear();
        if !self.is_in_place(panels) && !self.is_across(panels) {
            pack_rows(self, rows, ks, packed);
        }
    }

    type Tile<'t, const R: usize>
        = TileRows<'t, R>
    where
        Self: 't;

    #[inline(always)]
    fn tile<'t, const R: usize>(
        &'t self,
        rows: Range<usize>,
        ks: Range<usize>,
        (packed, first): (&'t [Rows], usize),
    ) -> TileRows<'t, R> {
        if !packed.is_empty() || ks.is_empty() {
            return TileRows::Packed(packed, first);
        }
        if self.column_stride != 1 {
            let at = rows.start * self.row_stride + ks.start * self.column_stride;
            return TileRows::Across(&self.values[at..], self.column_stride);
        }
        // Missing rows repeat the last row; the results of their chains are discarded.
        let mut a: [&[f32]; R] = [&[]; R];
        for (i, a) in a.iter_mut().enumerate() {
            let row = (rows.start + i).min(rows.end - 1) * self.row_stride;
            *a = &self.values[row + ks.start..row + ks.end];
        }
        TileRows::InPlace(a)
    }

    #[inline(always)]
    fn resume<S: Sixteen, const R: usize>(
        &self,
        tile: TileRows<'_, R>,
        chains: &mut Chains<S, R>,
        columns: &[Columns],
    ) {
        match tile {
            TileRows::Packed(packed, first) => chains.packed(packed, first, columns),
            TileRows::InPlace(a) => chains.in_place(a, columns),
            TileRows::Across(a, stride) => chains.across(a, stride, columns),
        }
    }
}

/// How the rows of a tile are read.
#[derive(Clone, Copy)]
enum TileRows<'a, const R: usize> {
    /// From a packed panel, from the given row on.
    Packed(&'a [Rows], usize),
    /// Each where it lies, contiguous in k.
    InPlace([&'a [f32]; R]),
    /// Next to each other for every k, the given distance apart.
    Across(&'a [f32], usize),
}

thread_local! {
    /// Memory of the last packed right factor, reused so that repeated products need no fresh pages.
    static PANELS: Cell<Vec<Columns>> = const { Cell::new(Vec::new()) };
}

/// Largest number of vectors kept for the next product: 64 MiB.
const KEEP: usize = 1 << 20;

/// Computes c (m, n, row-major) from the product of a (m, k) and b (k, n).
///
/// # Panics
/// Panics if the shapes do not fit.
pub fn gemm(a: View<'_>, b: View<'_>, how: Finish<'_>, c: &mut [f32]) {
    let packed = Packed::reusing(PANELS.take(), b);
    gemm_packed(a, &packed, how, c);
    if packed.panels.len() <= KEEP {
        PANELS.set(packed.panels);
    }
}

/// Like [`gemm`], with a right factor that is already packed.
///
/// # Panics
/// Panics if the shapes do not fit.
pub fn gemm_packed(a: View<'_>, b: &Packed, how: Finish<'_>, c: &mut [f32]) {
    product(a, b, how, c, true);
}

/// Like [`gemm`], on this thread alone: for tasks of a loop that already runs on all threads.
///
/// # Panics
/// Panics if the shapes do not fit.
pub fn gemm_here(a: View<'_>, b: View<'_>, how: Finish<'_>, c: &mut [f32]) {
    let packed = Packed::here(PANELS.take(), b);
    product(a, &packed, how, c, false);
    if packed.panels.len() <= KEEP {
        PANELS.set(packed.panels);
    }
}

/// Like [`gemm_packed`], on this thread alone.
///
/// # Panics
/// Panics if the shapes do not fit.
pub fn gemm_packed_here(a: View<'_>, b: &Packed, how: Finish<'_>, c: &mut [f32]) {
    product(a, b, how, c, false);
}

fn product(a: View<'_>, b: &Packed, how: Finish<'_>, c: &mut [f32], shared: bool) {
    let (m, n) = (a.rows, b.n);
    assert_eq!(a.columns, b.k, "both factors have the same k");
    assert_eq!(c.len(), m * n, "the product is a ({m}, {n}) matrix");
    if let Some(bias) = how.bias() {
        assert_eq!(bias.len(), n, "one bias per column");
    }
    if let Finish::Gated(gates, width) = how {
        assert!(width == n && gates.len() == m * n, "one gate per entry");
    }
    if m == 0 || n == 0 {
        return;
    }
    // There is one task per block of the output; it owns its part of every row.
    let height = if n >= BLOCK_COLUMNS / 4 { BLOCK_ROWS } else { 4 * BLOCK_ROWS };
    let mut tasks: Vec<Task<'_>> = Vec::new();
    for (i, rows) in c.chunks_mut(height * n).enumerate() {
        let top = i * height;
        if n <= BLOCK_COLUMNS {
            tasks.push(Task { top, left: 0, rows: rows.chunks_exact_mut(n).collect() });
            continue;
        }
        let first = tasks.len();
        let lefts = (0..n).step_by(BLOCK_COLUMNS);
        tasks.extend(lefts.map(|left| Task { top, left, rows: Vec::with_capacity(height) }));
        for row in rows.chunks_mut(n) {
            for (part, task) in row.chunks_mut(BLOCK_COLUMNS).zip(&mut tasks[first..]) {
                task.rows.push(part);
            }
        }
    }
    if shared && m * n * b.k >= PARALLEL && tasks.len() > 1 {
        par::each(tasks, |_, task| block(a, b, task, how));
    } else {
        tasks.into_iter().for_each(|task| block(a, b, task, how));
    }
}
