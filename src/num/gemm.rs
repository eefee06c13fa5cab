//! Matrix products with one association, whatever the tiles, the vector width and the threads.
//!
//! Every output element is one chain: it starts at +0 and adds the rounded products a(i,k)·b(k,j) for k ascending,
//! product and sum rounded separately, up to k = [`CHUNK`]. A longer k is cut into chunks of that length (the last may be
//! shorter), each such a chain, and the partial results are added by the pairwise tree of [`super::sum`]. What is
//! done with the result afterwards ([`Finish`]) comes after the chain.
//!
//! How it is fast changes no bit: both factors are packed into panels (`ROWS` rows of a, `COLUMNS` columns of
//! b), a tile of `ROWS`×`COLUMNS` chains stays in registers while k runs over a block of `BLOCK_K`, and is
//! resumed from memory for the next block. Rows and columns beyond the matrix are zero in the panels and are thrown away;
//! k is never padded, because 0·∞ is not 0 and −0 + 0 is not −0. Where the processor has AVX-512, whatever the build was made for, two panels
//! of columns are taken at once in registers of sixteen lanes ([`product_lanes`]).
//!
//! ```text
//! gemm, gemm_packed, runs::{gemm_runs, add_grids}   the products: matrices, patches of pictures
//!   pack    panels of both factors
//!   block   a block of the output along k, block by block, chunk by chunk
//!   tile    chains in registers, eight lanes or sixteen
//! ```
//!
//! ```
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
mod pack;
pub mod runs;
#[cfg(test)]
mod tests;
mod tile;

use block::{Left, Task, block};
use pack::{pack_columns, pack_rows};
use tile::{COLUMNS, Chains, Columns, ROWS, Rows, Sixteen};

/// Longest chain in k; part of the definition.
pub const CHUNK: usize = 4096;

/// Rows per task: the packed rows of a and the resting tiles stay in the second-level cache.
const BLOCK_ROWS: usize = 8 * ROWS;
/// Columns per task.
const BLOCK_COLUMNS: usize = 64 * COLUMNS;
/// Column panels of a task up to which rows of a that are contiguous in k are read where they are.
const IN_PLACE: usize = 32;
/// Multiplications from which on the work is shared between threads.
const PARALLEL: usize = 1 << 18;

/// A matrix seen in a slice: element (i, j) is `values[i·row_stride + j·column_stride]`.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> View<'a> {
    /// A row-major matrix that fills the slice.
    ///
    /// # Panics
    /// When the slice does not have rows·columns elements.
    pub fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        assert_eq!(values.len(), rows * columns, "a row-major ({rows}, {columns}) matrix fills its slice");
        Self { values, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// Any strides: a head of an attention layer, a patch of an image.
    ///
    /// # Panics
    /// When the last element lies outside the slice.
    pub fn strided(
        values: &'a [f32],
        (rows, columns): (usize, usize),
        (row_stride, column_stride): (usize, usize),
    ) -> Self {
        if rows > 0 && columns > 0 {
            let last = (rows - 1) * row_stride + (columns - 1) * column_stride;
            assert!(last < values.len(), "element ({}, {}) lies in the slice", rows - 1, columns - 1);
        }
        Self { values, rows, columns, row_stride, column_stride }
    }

    /// The transpose; nothing moves.
    #[must_use]
    pub fn t(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }
}

/// Lanes of a register in products: 16 where the processor has AVX-512 and `LASTLIGHT_LANES` in the environment is not 8, else 8 (of which the compiler
/// makes what the target has). A matter of speed: the bits are the same.
pub fn product_lanes() -> usize {
    #[cfg(target_arch = "x86_64")]
    if tile::avx512().is_some() {
        return 16;
    }
    8
}

/// What happens to a finished element p of the product, after its chain.
#[derive(Clone, Copy, Debug)]
pub enum Finish<'a> {
    /// c = p
    Store,
    /// c = c + p
    Add,
    /// c = 0 + p: the same where c is known to hold +0, which is then not read
    AddToZero,
    /// c = p + bias of the column, bias (n)
    Bias(&'a [f32]),
    /// c = p + bias where that is positive, this number times it elsewhere
    Leaky(&'a [f32], f32),
}

impl<'a> Finish<'a> {
    fn bias(self) -> Option<&'a [f32]> {
        match self {
            Self::Store | Self::Add | Self::AddToZero => None,
            Self::Bias(bias) | Self::Leaky(bias, _) => Some(bias),
        }
    }
}

/// A right factor (k, n) packed once, for use with many left factors.
#[derive(Clone, Debug, Default)]
pub struct Packed {
    /// (⌈n/16⌉, k): panel p holds columns 16p..16p+16 for every k
    panels: Vec<Columns>,
    k: usize,
    n: usize,
}

impl Packed {
    /// Packs a (k, n) matrix.
    pub fn new(b: View<'_>) -> Self {
        Self::reusing(Vec::new(), b)
    }

    /// Packs a row-major (k, n) matrix of which `read(first, into)` gives the numbers from `first` on, on this thread, into the memory of this one.
    #[must_use]
    pub fn renewed(self, (k, n): (usize, usize), read: impl Fn(usize, &mut [f32])) -> Self {
        let mut panels = self.panels;
        panels.resize(n.div_ceil(COLUMNS) * k, Columns::ZERO);
        for (p, panel) in panels.chunks_exact_mut(k.max(1)).enumerate() {
            let (first, width) = (p * COLUMNS, COLUMNS.min(n - p * COLUMNS));
            for (row, columns) in panel.iter_mut().enumerate() {
                let at = row * n + first;
                if width == COLUMNS {
                    read(at, &mut columns.0); // of a known size: a few instructions
                } else {
                    columns.0[width..].fill(0.0);
                    read(at, &mut columns.0[..width]);
                }
            }
        }
        Self { panels, k, n }
    }

    /// Sums of the columns, each a left fold from +0.
    pub fn column_sums(&self) -> impl Iterator<Item = f32> {
        let panels = (0..self.n.div_ceil(COLUMNS)).map(|p| {
            self.panel(p).iter().fold([0.0; COLUMNS], |mut sums, columns| {
                sums.iter_mut().zip(columns.0).for_each(|(sum, x)| *sum += x);
                sums
            })
        });
        panels.flatten().take(self.n)
    }

    /// Packs into memory that may already be there.
    fn reusing(mut panels: Vec<Columns>, b: View<'_>) -> Self {
        let (k, n) = (b.rows, b.columns);
        panels.resize(n.div_ceil(COLUMNS) * k, Columns::ZERO);
        let pack = |p: usize, panel: &mut [Columns]| pack_columns(b, p * COLUMNS, panel);
        if k * n < PARALLEL / 4 {
            panels.chunks_mut(k.max(1)).enumerate().for_each(|(p, panel)| pack(p, panel));
        } else {
            par::chunks_mut(&mut panels, k, pack);
        }
        Self { panels, k, n }
    }

    /// Columns 16p..16p+16, k by k.
    fn panel(&self, p: usize) -> &[Columns] {
        &self.panels[p * self.k..(p + 1) * self.k]
    }
}

impl View<'_> {
    fn is_in_place(&self, panels: usize) -> bool {
        self.column_stride == 1 && panels <= IN_PLACE
    }
}

impl Left for View<'_> {
    fn prepare(self, rows: Range<usize>, ks: Range<usize>, panels: usize, packed: &mut Vec<Rows>) {
        packed.clear();
        if !self.is_in_place(panels) {
            pack_rows(self, rows, ks, packed);
        }
    }

    #[inline(always)]
    fn resume<S: Sixteen, const P: usize>(
        self,
        chains: &mut Chains<S, P>,
        rows: Range<usize>,
        ks: Range<usize>,
        packed: &[Rows],
        columns: [&[Columns]; P],
    ) {
        if ks.is_empty() {
            return;
        }
        if !packed.is_empty() {
            return chains.packed(packed, columns);
        }
        // Beyond the last row it is read again; those chains are thrown away.
        let mut a: [&[f32]; ROWS] = [&[]; ROWS];
        for (i, a) in a.iter_mut().enumerate() {
            let row = (rows.start + i).min(rows.end - 1) * self.row_stride;
            *a = &self.values[row + ks.start..row + ks.end];
        }
        chains.in_place(a, columns);
    }
}

thread_local! {
    /// Memory of the last packed right factor, so that repeated products touch no fresh pages.
    static PANELS: Cell<Vec<Columns>> = const { Cell::new(Vec::new()) };
}

/// Vectors kept for the next product at most: 64 MiB.
const KEEP: usize = 1 << 20;

/// c (m, n, row-major) from the product of a (m, k) and b (k, n).
///
/// # Panics
/// When the shapes do not fit.
pub fn gemm(a: View<'_>, b: View<'_>, how: Finish<'_>, c: &mut [f32]) {
    let packed = Packed::reusing(PANELS.take(), b);
    gemm_packed(a, &packed, how, c);
    if packed.panels.len() <= KEEP {
        PANELS.set(packed.panels);
    }
}

/// [`gemm`] with a right factor packed before.
///
/// # Panics
/// When the shapes do not fit.
pub fn gemm_packed(a: View<'_>, b: &Packed, how: Finish<'_>, c: &mut [f32]) {
    let (m, n) = (a.rows, b.n);
    assert_eq!(a.columns, b.k, "both factors have the same k");
    assert_eq!(c.len(), m * n, "the product is a ({m}, {n}) matrix");
    if let Some(bias) = how.bias() {
        assert_eq!(bias.len(), n, "one bias per column");
    }
    if m == 0 || n == 0 {
        return;
    }
    // One task per block of the output, each owning its part of every row.
    let height = if n >= BLOCK_COLUMNS / 4 { BLOCK_ROWS } else { 4 * BLOCK_ROWS };
    let mut tasks: Vec<Task<'_>> = Vec::new();
    for (i, rows) in c.chunks_mut(height * n).enumerate() {
        let first = tasks.len();
        let lefts = (0..n).step_by(BLOCK_COLUMNS);
        tasks.extend(lefts.map(|left| Task { top: i * height, left, rows: Vec::with_capacity(height) }));
        for row in rows.chunks_mut(n) {
            for (part, task) in row.chunks_mut(BLOCK_COLUMNS).zip(&mut tasks[first..]) {
                task.rows.push(part);
            }
        }
    }
    if m * n * b.k >= PARALLEL && tasks.len() > 1 {
        par::each(tasks, |_, task| block(a, b, task, how));
    } else {
        tasks.into_iter().for_each(|task| block(a, b, task, how));
    }
}
