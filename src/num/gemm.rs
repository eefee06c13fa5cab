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

use super::lanes::{Real, f32x8};
use super::par;
use std::cell::Cell;
use std::ops::Range;

mod pack;
pub mod runs;

use pack::{eight, halves, pack_columns, pack_rows};

/// Longest chain in k; part of the definition.
pub const CHUNK: usize = 4096;

/// Rows of a register tile.
const ROWS: usize = 6;
/// Columns of a register tile: two registers of eight lanes.
const COLUMNS: usize = 16;
/// k per block: a panel of a (8 KiB) and one of b (16 KiB) stay in the first-level cache.
const BLOCK_K: usize = 256;
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

/// What happens to a finished element p of the product, after its chain.
#[derive(Clone, Copy, Debug)]
pub enum Finish<'a> {
    /// c = p
    Store,
    /// c = c + p
    Add,
    /// c = p + bias of the column, bias (n)
    Bias(&'a [f32]),
    /// c = p + bias where that is positive, this number times it elsewhere
    Leaky(&'a [f32], f32),
}

impl<'a> Finish<'a> {
    fn bias(self) -> Option<&'a [f32]> {
        match self {
            Self::Store | Self::Add => None,
            Self::Bias(bias) | Self::Leaky(bias, _) => Some(bias),
        }
    }
}

/// Sixteen neighbouring columns of b, row by row.
type Columns = [f32x8; 2];
/// Six neighbouring rows of a, column by column; the last two are not used.
type Rows = [f32; 8];
/// One register tile: 6×16 chains.
type Tile = [[f32x8; 2]; ROWS];

const ZERO: Tile = [[f32x8::ZERO; 2]; ROWS];

/// A right factor (k, n) packed once, for use with many left factors.
#[derive(Clone, Debug)]
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

    /// Packs another matrix into the memory of this one.
    #[must_use]
    pub fn renewed(self, b: View<'_>) -> Self {
        Self::reusing(self.panels, b)
    }

    /// Packs into memory that may already be there.
    fn reusing(mut panels: Vec<Columns>, b: View<'_>) -> Self {
        let (k, n) = (b.rows, b.columns);
        panels.resize(n.div_ceil(COLUMNS) * k, [f32x8::ZERO; 2]);
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

/// A left factor (m, k): how its rows reach the register tiles.
trait Left: Copy + Sync {
    /// Makes the rows ready for k in `ks`; `panels` is the number of column panels they will meet. Empty where they are read in place.
    fn prepare(self, rows: Range<usize>, ks: Range<usize>, panels: usize, packed: &mut Vec<Rows>);
    /// Resumes the chains of a tile of the rows from `rows.start` on (at most six, beyond the last anything) over k in `ks`; `packed` is the tile's part of
    /// what was prepared.
    fn resume(
        self,
        rows: Range<usize>,
        ks: Range<usize>,
        packed: &[Rows],
        columns: &[Columns],
        tile: &mut Tile,
    );
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
    fn resume(
        self,
        rows: Range<usize>,
        ks: Range<usize>,
        packed: &[Rows],
        columns: &[Columns],
        tile: &mut Tile,
    ) {
        if !packed.is_empty() {
            return resume(packed, columns, tile);
        }
        if columns.is_empty() {
            return;
        }
        // Beyond the last row it is read again; those chains are thrown away.
        let row = |i: usize| (rows.start + i).min(rows.end - 1) * self.row_stride;
        let slice = |i| &self.values[row(i) + ks.start..row(i) + ks.end];
        resume_in_place(std::array::from_fn(slice), columns, tile);
    }
}

thread_local! {
    /// Memory of the last packed right factor, so that repeated products touch no fresh pages.
    static PANELS: Cell<Vec<Columns>> = const { Cell::new(Vec::new()) };
    /// Memory of a task: packed rows of the left factor, and tiles resting between blocks of k.
    static TASK: Cell<(Vec<Rows>, Vec<Tile>)> = const { Cell::new((Vec::new(), Vec::new())) };
}

/// Vectors kept for the next product at most: 64 MiB.
const KEEP: usize = 1 << 20;

/// Resumes the chains of a tile over one block of k with packed rows.
#[inline(never)]
fn resume(a: &[Rows], b: &[Columns], tile: &mut Tile) {
    let mut acc = *tile;
    // Four k at a time: the loop's own instructions would otherwise take issue slots from the arithmetic.
    let ((a4, a1), (b4, b1)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    for (a, b) in a4.iter().zip(b4) {
        for i in 0..4 {
            step(&mut acc, |r| a[i][r], &b[i]);
        }
    }
    for (a, b) in a1.iter().zip(b1) {
        step(&mut acc, |r| a[r], b);
    }
    *tile = acc;
}

/// The same with the rows where they are, each contiguous in k: for few columns, where packing does not pay.
#[inline(never)]
fn resume_in_place(a: [&[f32]; ROWS], b: &[Columns], tile: &mut Tile) {
    let mut acc = *tile;
    let (b4, b1) = b.as_chunks::<4>();
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
    *tile = acc;
}

/// One k: adds a product to each of the 96 chains.
#[inline(always)]
fn step(acc: &mut Tile, a: impl Fn(usize) -> f32, b: &Columns) {
    for (r, acc) in acc.iter_mut().enumerate() {
        let x = f32x8::splat(a(r));
        acc[0] += x * b[0];
        acc[1] += x * b[1];
    }
}

/// Chains over k in `chunk` (at most [`CHUNK`]) for the given rows and column panels; `finished(panel, row panel,
/// tile)` takes each tile, column panel by column panel, numbered within the block.
fn chains(
    a: impl Left,
    b: &Packed,
    (rows, panels, chunk): (Range<usize>, Range<usize>, Range<usize>),
    (packed, resting): (&mut Vec<Rows>, &mut Vec<Tile>),
    mut finished: impl FnMut(usize, usize, &Tile),
) {
    let row_panels = rows.len().div_ceil(ROWS);
    // Tiles rest in memory between blocks of k.
    resting.clear();
    resting.resize(if chunk.len() > BLOCK_K { row_panels * panels.len() } else { 0 }, ZERO);
    let mut start = chunk.start;
    loop {
        let end = chunk.end.min(start + BLOCK_K);
        a.prepare(rows.clone(), start..end, panels.len(), packed);
        for (p, panel) in panels.clone().enumerate() {
            let columns = &b.panel(panel)[start..end];
            for r in 0..row_panels {
                let mut fresh = ZERO;
                let tile = resting.get_mut(p * row_panels + r).unwrap_or(&mut fresh);
                let mine =
                    if packed.is_empty() { &[][..] } else { &packed[r * columns.len()..][..columns.len()] };
                a.resume(rows.start + r * ROWS..rows.end, start..end, mine, columns, tile);
                if end == chunk.end {
                    finished(p, r, tile);
                }
            }
        }
        if end == chunk.end {
            return;
        }
        start = end;
    }
}

/// One block of the output: where it begins, and its part of every row.
struct Task<'a> {
    top: usize,
    left: usize,
    rows: Vec<&'a mut [f32]>,
}

#[inline(always)]
fn leaky(x: f32x8, slope: f32) -> f32x8 {
    f32x8::select(x.gt(f32x8::ZERO), x, f32x8::splat(slope) * x)
}

/// Computes one block of the output.
fn block(a: impl Left, b: &Packed, task: Task<'_>, how: Finish<'_>) {
    let Task { top, left, mut rows } = task;
    let (mut packed, mut resting) = TASK.take();
    let row_panels = rows.len().div_ceil(ROWS);
    let panels = left / COLUMNS..(left + rows[0].len()).div_ceil(COLUMNS);
    let part = |chunk: Range<usize>| (top..top + rows.len(), panels.clone(), chunk);
    if b.k <= CHUNK {
        let part = part(0..b.k);
        chains(a, b, part, (&mut packed, &mut resting), |p, r, tile| {
            finish(tile, &mut rows[r * ROWS..], (p * COLUMNS, left), how)
        });
        TASK.set((packed, resting));
        return;
    }
    // The pairwise tree over the chunks as they come: two neighbours of one level make one of the next, and at the end
    // the last, smaller ones are added from the right.
    let add = |left: &mut [Tile], right: &[Tile]| {
        for (x, y) in left.iter_mut().flatten().flatten().zip(right.iter().flatten().flatten()) {
            *x += *y;
        }
    };
    let mut stack: Vec<(u32, Vec<Tile>)> = Vec::new();
    for start in (0..b.k).step_by(CHUNK) {
        let (mut level, mut right) = (0, Vec::with_capacity(row_panels * panels.len()));
        let part = part(start..b.k.min(start + CHUNK));
        chains(a, b, part, (&mut packed, &mut resting), |_, _, tile| right.push(*tile));
        while stack.last().is_some_and(|(l, _)| *l == level) {
            let (_, mut left) = stack.pop().expect("the last entry was just seen");
            add(&mut left, &right);
            (level, right) = (level + 1, left);
        }
        stack.push((level, right));
    }
    TASK.set((packed, resting));
    let (_, mut tiles) = stack.pop().expect("there is at least one chunk");
    while let Some((_, mut left)) = stack.pop() {
        add(&mut left, &tiles);
        tiles = left;
    }
    for (i, tile) in tiles.iter().enumerate() {
        let (p, r) = (i / row_panels, i % row_panels);
        finish(tile, &mut rows[r * ROWS..], (p * COLUMNS, left), how);
    }
}

/// Writes a tile to (at most six) rows of c from column `at` of the block on, which begins at column `left`.
#[inline(always)]
fn finish(tile: &Tile, rows: &mut [&mut [f32]], (at, left): (usize, usize), how: Finish<'_>) {
    for (tile, row) in tile.iter().zip(rows) {
        let end = row.len().min(at + COLUMNS);
        let c = &mut row[at..end];
        if let Ok(c) = <&mut [f32; COLUMNS]>::try_from(&mut *c) {
            let old = || halves(c);
            let x = match how {
                Finish::Store => *tile,
                Finish::Add => {
                    let c = old();
                    [c[0] + tile[0], c[1] + tile[1]]
                }
                Finish::Bias(_) | Finish::Leaky(..) => {
                    let bias = &how.bias().unwrap_or_default()[left + at..];
                    [tile[0] + eight(bias), tile[1] + eight(&bias[8..])]
                }
            };
            let x = match how {
                Finish::Leaky(_, slope) => x.map(|x| leaky(x, slope)),
                _ => x,
            };
            c[..8].copy_from_slice(&x[0].to_array());
            c[8..].copy_from_slice(&x[1].to_array());
            continue;
        }
        for (j, c) in c.iter_mut().enumerate() {
            let p = tile[j / 8].to_array()[j % 8];
            *c = match how {
                Finish::Store => p,
                Finish::Add => *c + p,
                Finish::Bias(bias) => p + bias[left + at + j],
                Finish::Leaky(bias, slope) => {
                    let x = p + bias[left + at + j];
                    if x > 0.0 { x } else { slope * x }
                }
            };
        }
    }
}

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
