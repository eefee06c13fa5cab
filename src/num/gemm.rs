//! Matrix products with one association, whatever the tiles, the vector width and the threads.
//!
//! Every output element is one chain: it starts at +0 and adds the rounded products a(i,k)·b(k,j) for k ascending,
//! product and sum rounded separately, up to k = [`CHUNK`]. A longer k is cut into chunks of that length (the last may be
//! shorter), each such a chain, and the partial results are added by the pairwise tree of [`super::sum`]. What is
//! done with the result afterwards ([`Finish`]) comes after the chain.
//!
//! How it is fast changes no bit: both factors are packed into panels ([`ROWS`] rows of a, [`COLUMNS`] columns of
//! b), a tile of [`ROWS`]×[`COLUMNS`] chains stays in registers while k runs over a block of [`BLOCK_K`], and is
//! resumed from memory for the next block. Rows and columns beyond the matrix are zero in the panels and are thrown away;
//! k is never padded, because 0·∞ is not 0 and −0 + 0 is not −0.
//!
//! ```
//! use lastlight::num::gemm::{Finish, View, gemm};
//! let a = [1.0, 2.0, 3.0, 4.0]; // (2, 2)
//! let b = [5.0, 6.0, 7.0, 8.0]; // (2, 2)
//! let mut c = [0.0; 4];
//! gemm(View::new(&a, 2, 2), View::new(&b, 2, 2).t(), Finish::Store, &mut c);
//! assert_eq!(c, [17.0, 23.0, 39.0, 53.0]); // a·bᵀ
//! ```

use super::lanes::f32x8;
use super::par;

/// Longest chain in k; part of the definition.
pub const CHUNK: usize = 4096;

/// Rows of a register tile.
const ROWS: usize = 6;
/// Columns of a register tile: two registers of eight lanes.
const COLUMNS: usize = 16;
/// k per block: a panel of b (16 KiB) stays in the first-level cache.
const BLOCK_K: usize = 256;
/// Rows per task: the packed rows of a and the accumulators stay in the second-level cache.
const BLOCK_ROWS: usize = 8 * ROWS;
/// Columns per task.
const BLOCK_COLUMNS: usize = 32 * COLUMNS;
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

/// What happens to a finished element p of the product, after its chain.
#[derive(Clone, Copy, Debug)]
pub enum Finish<'a> {
    /// c = p
    Store,
    /// c = c + p
    Add,
    /// c = p + bias of the column, bias (n)
    Bias(&'a [f32]),
}

/// A right factor (k, n) packed once, for use with many left factors.
#[derive(Clone, Debug)]
pub struct Packed {
    /// panel p, row k: columns 16p..16p+16 in two registers
    panels: Vec<[f32x8; 2]>,
    k: usize,
    n: usize,
}

impl Packed {
    /// Packs a (k, n) matrix.
    pub fn new(b: View<'_>) -> Self {
        let (k, n) = (b.rows, b.columns);
        let mut panels = vec![[f32x8::ZERO; 2]; n.div_ceil(COLUMNS) * k];
        if k > 0 {
            let pack = |p: usize, panel: &mut [[f32x8; 2]]| pack_panel(b, p * COLUMNS, panel);
            if k * n >= PARALLEL / 4 {
                par::chunks_mut(&mut panels, k, pack);
            } else {
                panels.chunks_mut(k).enumerate().for_each(|(p, panel)| pack(p, panel));
            }
        }
        Self { panels, k, n }
    }
}

/// Columns `first..first + 16` of b (k, n), row by row; columns beyond n stay zero.
fn pack_panel(b: View<'_>, first: usize, panel: &mut [[f32x8; 2]]) {
    let width = COLUMNS.min(b.columns - first);
    if b.column_stride == 1 {
        for (k, row) in panel.iter_mut().enumerate() {
            let start = k * b.row_stride + first;
            let mut x = [0.0; COLUMNS];
            x[..width].copy_from_slice(&b.values[start..start + width]);
            *row = halves(&x);
        }
    } else if b.row_stride == 1 && width == COLUMNS {
        // Sixteen contiguous columns: transposed eight by eight.
        let column = |j: usize| &b.values[(first + j) * b.column_stride..][..panel.len()];
        let columns: [&[f32]; COLUMNS] = std::array::from_fn(column);
        let whole = panel.len() - panel.len() % 8;
        for k in (0..whole).step_by(8) {
            for half in 0..2 {
                let load =
                    |j: usize| f32x8::new(columns[8 * half + j][k..k + 8].try_into().expect("eight numbers"));
                for (i, row) in f32x8::transpose(std::array::from_fn(load)).into_iter().enumerate() {
                    panel[k + i][half] = row;
                }
            }
        }
        for k in whole..panel.len() {
            panel[k] = halves(&std::array::from_fn(|j| columns[j][k]));
        }
    } else {
        for (k, row) in panel.iter_mut().enumerate() {
            let at = |j: usize| b.values[k * b.row_stride + (first + j) * b.column_stride];
            *row = halves(&std::array::from_fn(|j| if j < width { at(j) } else { 0.0 }));
        }
    }
}

#[inline(always)]
fn halves(x: &[f32; COLUMNS]) -> [f32x8; 2] {
    let half = |i: usize| f32x8::new(std::array::from_fn(|j| x[i + j]));
    [half(0), half(8)]
}

/// Rows `rows` and k `ks` of a, in panels of six rows, k by k; rows beyond the end stay zero.
fn pack_rows(
    a: View<'_>,
    rows: std::ops::Range<usize>,
    ks: std::ops::Range<usize>,
    panels: &mut Vec<[f32; ROWS]>,
) {
    panels.clear();
    for first in rows.clone().step_by(ROWS) {
        let height = ROWS.min(rows.end - first);
        if a.column_stride == 1 && height == ROWS {
            let row = |r: usize| &a.values[(first + r) * a.row_stride..][ks.clone()];
            let r: [&[f32]; ROWS] = std::array::from_fn(row);
            panels.extend((0..ks.len()).map(|k| [r[0][k], r[1][k], r[2][k], r[3][k], r[4][k], r[5][k]]));
        } else {
            let at = |r: usize, k: usize| a.values[(first + r) * a.row_stride + k * a.column_stride];
            panels
                .extend(ks.clone().map(|k| std::array::from_fn(|r| if r < height { at(r, k) } else { 0.0 })));
        }
    }
}

/// One register tile: 6×16 chains.
type Tile = [[f32x8; 2]; ROWS];

/// Resumes the chains of a tile over one block of k.
#[inline(never)]
fn resume(a: &[[f32; ROWS]], b: &[[f32x8; 2]], tile: &mut Tile) {
    let mut acc = *tile;
    for (a, b) in a.iter().zip(b) {
        for (r, acc) in acc.iter_mut().enumerate() {
            let x = f32x8::splat(a[r]);
            acc[0] = acc[0] + x * b[0];
            acc[1] = acc[1] + x * b[1];
        }
    }
    *tile = acc;
}

/// The partial results of one block of the output: tiles in order of column panel, then row panel.
type Partial = Vec<Tile>;

/// Chains over k `chunk` (at most [`CHUNK`]) for the given rows and column panels.
fn chains(
    a: View<'_>,
    b: &Packed,
    rows: std::ops::Range<usize>,
    panels: std::ops::Range<usize>,
    chunk: std::ops::Range<usize>,
    packed: &mut Vec<[f32; ROWS]>,
) -> Partial {
    let row_panels = rows.len().div_ceil(ROWS);
    let mut tiles = vec![[[f32x8::ZERO; 2]; ROWS]; row_panels * panels.len()];
    let mut start = chunk.start;
    while start < chunk.end {
        let end = chunk.end.min(start + BLOCK_K);
        pack_rows(a, rows.clone(), start..end, packed);
        let mut tile = tiles.iter_mut();
        for p in panels.clone() {
            let b = &b.panels[p * b.k..][start..end];
            for (a, tile) in packed.chunks_exact(end - start).zip(&mut tile) {
                resume(a, b, tile);
            }
        }
        start = end;
    }
    tiles
}

/// All chunks of k for one block of the output, added by the pairwise tree as they come: two neighbours of one level
/// make one of the next, and at the end the last, smaller ones are added from the right.
fn block(a: View<'_>, b: &Packed, rows: std::ops::Range<usize>, panels: std::ops::Range<usize>) -> Partial {
    let mut packed = Vec::new();
    let mut stack: Vec<(u32, Partial)> = Vec::new();
    let add = |left: &mut Partial, right: &Partial| {
        for (x, y) in left.iter_mut().flatten().flatten().zip(right.iter().flatten().flatten()) {
            *x = *x + *y;
        }
    };
    for start in (0..b.k.max(1)).step_by(CHUNK) {
        let mut level = 0;
        let mut right =
            chains(a, b, rows.clone(), panels.clone(), start..b.k.min(start + CHUNK), &mut packed);
        while stack.last().is_some_and(|(l, _)| *l == level) {
            let (_, mut left) = stack.pop().expect("the last entry was just seen");
            add(&mut left, &right);
            (level, right) = (level + 1, left);
        }
        stack.push((level, right));
    }
    let (_, mut result) = stack.pop().expect("there is at least one chunk, if an empty one");
    while let Some((_, mut left)) = stack.pop() {
        add(&mut left, &result);
        result = left;
    }
    result
}

/// Writes a block of tiles to its rows of c, each given from the block's first column on.
fn finish(tiles: &Partial, rows: &mut [&mut [f32]], first: usize, how: Finish<'_>) {
    let row_panels = rows.len().div_ceil(ROWS);
    for (i, row) in rows.iter_mut().enumerate() {
        for (p, c) in row.chunks_mut(COLUMNS).enumerate() {
            let [lo, hi] = tiles[p * row_panels + i / ROWS][i % ROWS];
            let mut x = [0.0; COLUMNS];
            x[..8].copy_from_slice(&lo.to_array());
            x[8..].copy_from_slice(&hi.to_array());
            match how {
                Finish::Store => c.copy_from_slice(&x[..c.len()]),
                Finish::Add => c.iter_mut().zip(&x).for_each(|(c, x)| *c += *x),
                Finish::Bias(bias) => {
                    let bias = &bias[first + p * COLUMNS..];
                    c.iter_mut().zip(&x).zip(bias).for_each(|((c, x), bias)| *c = *x + *bias);
                }
            }
        }
    }
}

/// c (m, n, row-major) from the product of a (m, k) and b (k, n).
///
/// # Panics
/// When the shapes do not fit.
pub fn gemm(a: View<'_>, b: View<'_>, how: Finish<'_>, c: &mut [f32]) {
    gemm_packed(a, &Packed::new(b), how, c);
}

/// [`gemm`] with a right factor packed before.
///
/// # Panics
/// When the shapes do not fit.
pub fn gemm_packed(a: View<'_>, b: &Packed, how: Finish<'_>, c: &mut [f32]) {
    let (m, n) = (a.rows, b.n);
    assert_eq!(a.columns, b.k, "both factors have the same k");
    assert_eq!(c.len(), m * n, "the product is a ({m}, {n}) matrix");
    if let Finish::Bias(bias) = how {
        assert_eq!(bias.len(), n, "one bias per column");
    }
    if m == 0 || n == 0 {
        return;
    }
    // One task per block of the output, each owning its part of every row.
    let mut tasks: Vec<(usize, usize, Vec<&mut [f32]>)> = Vec::new();
    for (i, rows) in c.chunks_mut(BLOCK_ROWS * n).enumerate() {
        let at = tasks.len();
        tasks.extend((0..n.div_ceil(BLOCK_COLUMNS)).map(|j| (i, j, Vec::with_capacity(BLOCK_ROWS))));
        for row in rows.chunks_mut(n) {
            for (j, part) in row.chunks_mut(BLOCK_COLUMNS).enumerate() {
                tasks[at + j].2.push(part);
            }
        }
    }
    let run = |_: usize, (i, j, mut rows): (usize, usize, Vec<&mut [f32]>)| {
        let (top, left) = (i * BLOCK_ROWS, j * BLOCK_COLUMNS);
        let panels = left / COLUMNS..(left + rows[0].len()).div_ceil(COLUMNS);
        let tiles = block(a, b, top..top + rows.len(), panels);
        finish(&tiles, &mut rows, left, how);
    };
    if m * n * b.k.max(1) >= PARALLEL && tasks.len() > 1 {
        par::each(tasks, run);
    } else {
        tasks.into_iter().enumerate().for_each(|(i, t)| run(i, t));
    }
}
