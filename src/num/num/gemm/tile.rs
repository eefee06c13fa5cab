//! Register tiles: chains of products that stay in registers while k runs.
//!
//! A step of k takes sixteen columns of b and one number of each of R rows of a, and adds the 16·R products to
//! as many chains. [`Sixteen`] abstracts how sixteen lanes are placed in registers: [`Pairs`] of eight lanes,
//! which the compiler supports on any machine, or one register each if the processor is found to have AVX-512
//! at run time ([`widest`]). R is six with pairs and twelve with AVX-512, which has twice as many registers:
//! each number of a is then used by one instruction alone, which reads it from memory itself. (A tile of six
//! rows and two panels uses it twice, by a register of its own; that takes 1.5 times as long on Zen 4.) Product
//! and sum are two instructions in both cases, and lanes are never combined, so the bits are the same.

use super::matrix::Finish;
use crate::num::lanes::{Real, f32x8};
#[cfg(target_arch = "x86_64")]
use crate::num::registers::avx512;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;

/// Rows of a tile: one register tile with AVX-512, two with pairs of registers.
pub(super) const ROWS: usize = 12;
/// Half of them: rows of a register tile of pairs, and of the last tile of a matrix if it has no more.
pub(super) const HALF: usize = 6;
/// Columns of a register tile.
pub(super) const COLUMNS: usize = 16;

/// Loads the first eight numbers.
#[inline(always)]
pub(super) fn eight(x: &[f32]) -> f32x8 {
    f32x8::new(x[..8].try_into().expect("eight numbers"))
}

/// Sixteen consecutive columns of b for one k.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct Columns(pub(super) [f32; COLUMNS]);
/// Twelve consecutive rows of a for one k.
pub(super) type Rows = [f32; ROWS];
/// A stored tile of 12×16 unfinished chains.
pub(super) type Tile = [Columns; ROWS];

impl Columns {
    pub(super) const ZERO: Self = Self([0.0; COLUMNS]);
}

/// Sixteen lanes in registers; the operations are those of IEEE 754, each rounded separately.
pub(super) trait Sixteen: Copy + Send + Sync {
    /// Number of rows whose chains fit into the registers together: [`HALF`] or [`ROWS`].
    const HEIGHT: usize;
    /// Whether the registers are those that all code is compiled for, so that a function can be out of line.
    const IS_BASE: bool = true;
    /// A vector of sixteen numbers.
    type V: Copy;
    /// Loads a vector from memory.
    fn load(self, x: &[f32; COLUMNS]) -> Self::V;
    /// Stores a vector to memory.
    fn store(self, x: Self::V) -> [f32; COLUMNS];
    /// Like [`Self::store`], to a place that exists.
    #[inline(always)]
    fn put(self, x: Self::V, into: &mut [f32; COLUMNS]) {
        *into = self.store(x);
    }
    /// Returns the same number in all sixteen lanes.
    fn splat(self, x: f32) -> Self::V;
    /// x + y
    fn sum(self, x: Self::V, y: Self::V) -> Self::V;
    /// x·y
    fn product(self, x: Self::V, y: Self::V) -> Self::V;
    /// x where it is positive, slope·x elsewhere
    fn leaky(self, x: Self::V, slope: f32) -> Self::V;
    /// +0 where gate ≤ 0, x elsewhere
    fn gated(self, x: Self::V, gate: Self::V) -> Self::V;
    /// Runs code compiled for these registers, out of line; everything that it calls has to be inlined
    /// (`inline(always)`, also for the closure if it consists of more than a few instructions).
    fn run(self, work: impl FnOnce());
}

/// Two registers of eight lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pairs;

impl Sixteen for Pairs {
    const HEIGHT: usize = HALF;
    type V = [f32x8; 2];

    #[inline(always)]
    fn load(self, x: &[f32; COLUMNS]) -> Self::V {
        [eight(&x[..8]), eight(&x[8..])]
    }

    #[inline(always)]
    fn store(self, x: Self::V) -> [f32; COLUMNS] {
        let mut all = [0.0; COLUMNS];
        all[..8].copy_from_slice(&x[0].to_array());
        all[8..].copy_from_slice(&x[1].to_array());
        all
    }

    #[inline(always)]
    fn put(self, x: Self::V, into: &mut [f32; COLUMNS]) {
        into[..8].copy_from_slice(&x[0].to_array());
        into[8..].copy_from_slice(&x[1].to_array());
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Self::V {
        [f32x8::splat(x); 2]
    }

    #[inline(always)]
    fn sum(self, x: Self::V, y: Self::V) -> Self::V {
        [x[0] + y[0], x[1] + y[1]]
    }

    #[inline(always)]
    fn product(self, x: Self::V, y: Self::V) -> Self::V {
        [x[0] * y[0], x[1] * y[1]]
    }

    #[inline(always)]
    fn leaky(self, x: Self::V, slope: f32) -> Self::V {
        let one = |x: f32x8| f32x8::select(x.gt(f32x8::ZERO), x, f32x8::splat(slope) * x);
        [one(x[0]), one(x[1])]
    }

    #[inline(always)]
    fn gated(self, x: Self::V, gate: Self::V) -> Self::V {
        let one = |x: f32x8, gate: f32x8| f32x8::select(gate.le(f32x8::ZERO), f32x8::ZERO, x);
        [one(x[0], gate[0]), one(x[1], gate[1])]
    }

    #[inline(never)]
    fn run(self, work: impl FnOnce()) {
        work();
    }
}

/// One register of eight lanes, for panels of which at most eight columns are used; the others are not
/// computed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eight;

impl Sixteen for Eight {
    const HEIGHT: usize = ROWS;
    type V = f32x8;

    #[inline(always)]
    fn load(self, x: &[f32; COLUMNS]) -> Self::V {
        eight(&x[..8])
    }

    #[inline(always)]
    fn store(self, x: Self::V) -> [f32; COLUMNS] {
        let mut all = [0.0; COLUMNS];
        all[..8].copy_from_slice(&x.to_array());
        all
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Self::V {
        f32x8::splat(x)
    }

    #[inline(always)]
    fn sum(self, x: Self::V, y: Self::V) -> Self::V {
        x + y
    }

    #[inline(always)]
    fn product(self, x: Self::V, y: Self::V) -> Self::V {
        x * y
    }

    #[inline(always)]
    fn leaky(self, x: Self::V, slope: f32) -> Self::V {
        f32x8::select(x.gt(f32x8::ZERO), x, f32x8::splat(slope) * x)
    }

    #[inline(always)]
    fn gated(self, x: Self::V, gate: Self::V) -> Self::V {
        f32x8::select(gate.le(f32x8::ZERO), f32x8::ZERO, x)
    }

    #[inline(never)]
    fn run(self, work: impl FnOnce()) {
        work();
    }
}

#[cfg(target_arch = "x86_64")]
impl Sixteen for V4 {
    const HEIGHT: usize = ROWS;
    const IS_BASE: bool = false;
    type V = std::arch::x86_64::__m512;

    #[inline(always)]
    fn load(self, x: &[f32; COLUMNS]) -> Self::V {
        pulp::cast(*x)
    }

    #[inline(always)]
    fn store(self, x: Self::V) -> [f32; COLUMNS] {
        pulp::cast(x)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Self::V {
        self.avx512f._mm512_set1_ps(x)
    }

    #[inline(always)]
    fn sum(self, x: Self::V, y: Self::V) -> Self::V {
        self.avx512f._mm512_add_ps(x, y)
    }

    #[inline(always)]
    fn product(self, x: Self::V, y: Self::V) -> Self::V {
        self.avx512f._mm512_mul_ps(x, y)
    }

    #[inline(always)]
    fn leaky(self, x: Self::V, slope: f32) -> Self::V {
        let is_positive =
            self.avx512f._mm512_cmp_ps_mask::<{ std::arch::x86_64::_CMP_GT_OQ }>(x, self.splat(0.0));
        self.avx512f._mm512_mask_blend_ps(is_positive, self.product(self.splat(slope), x), x)
    }

    #[inline(always)]
    fn gated(self, x: Self::V, gate: Self::V) -> Self::V {
        let stays =
            self.avx512f._mm512_cmp_ps_mask::<{ std::arch::x86_64::_CMP_NLE_UQ }>(gate, self.splat(0.0));
        self.avx512f._mm512_maskz_mov_ps(stays, x)
    }

    #[inline(always)]
    fn run(self, work: impl FnOnce()) {
        self.vectorize(work);
    }
}

/// Work that can run with any kind of registers.
pub(super) trait Job {
    fn by<S: Sixteen>(self, simd: S);
}

/// Runs the job with the widest registers of this machine.
pub(super) fn widest(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = avx512() {
        return job.by(simd);
    }
    job.by(Pairs);
}

/// Applies `f` to each slice. (The closure of `array::map` is not always inlined, and then all registers are
/// spilled around it.)
#[inline(always)]
pub(super) fn each<'a, T, U, const N: usize>(
    slices: [&'a [T]; N],
    f: impl Fn(&'a [T]) -> &'a [U],
) -> [&'a [U]; N] {
    let mut results: [&[U]; N] = [&[]; N];
    for i in 0..N {
        results[i] = f(slices[i]);
    }
    results
}

/// Chains of one tile in registers.
pub(super) struct Chains<S: Sixteen, const R: usize> {
    simd: S,
    acc: [S::V; R],
}

impl<S: Sixteen, const R: usize> Chains<S, R> {
    /// Starts new chains at +0.
    #[inline(always)]
    pub(super) fn fresh(simd: S) -> Self {
        Self { simd, acc: [simd.splat(0.0); R] }
    }

    /// Loads the chains from rows of a stored tile.
    #[inline(always)]
    pub(super) fn resumed(simd: S, tile: &[Columns]) -> Self {
        let mut chains = Self::fresh(simd);
        chains.load(tile);
        chains
    }

    /// Like [`Self::resumed`], in place.
    #[inline(always)]
    pub(super) fn load(&mut self, tile: &[Columns]) {
        for (acc, row) in self.acc.iter_mut().zip(&tile[..R]) {
            *acc = self.simd.load(&row.0);
        }
    }

    /// Stores the chains in rows of a tile.
    #[inline(always)]
    pub(super) fn rest(self, tile: &mut [Columns]) {
        for (row, acc) in tile[..R].iter_mut().zip(self.acc) {
            self.simd.put(acc, &mut row.0);
        }
    }

    /// Performs one step of k, which adds a product to each chain.
    #[inline(always)]
    pub(super) fn step(&mut self, a: impl Fn(usize) -> f32, b: &Columns) {
        let columns = self.simd.load(&b.0);
        for (r, acc) in self.acc.iter_mut().enumerate() {
            *acc = self.simd.sum(*acc, self.simd.product(self.simd.splat(a(r)), columns));
        }
    }

    /// Adds products over packed rows, from row `first` of them on.
    #[inline(always)]
    pub(super) fn packed(&mut self, a: &[Rows], first: usize, columns: &[Columns]) {
        if S::IS_BASE {
            return self.packed_alone(a, first, columns);
        }
        // The loop handles four k at a time; the loop's own instructions would otherwise take issue slots
        // from the arithmetic.
        let (a4, a1) = a.as_chunks::<4>();
        let (b4, b1) = columns[..a.len()].as_chunks::<4>();
        for (a, b) in a4.iter().zip(b4) {
            for (a, b) in a.iter().zip(b) {
                self.step(|r| a[first + r], b);
            }
        }
        for (a, b) in a1.iter().zip(b1) {
            self.step(|r| a[first + r], b);
        }
    }

    /// Adds products over rows read in place, each contiguous in k and as long as the columns.
    #[inline(always)]
    pub(super) fn in_place(&mut self, a: [&[f32]; R], columns: &[Columns]) {
        if S::IS_BASE {
            return self.in_place_alone(&a, columns);
        }
        let (b4, b1) = columns.as_chunks::<4>();
        let a4 = each(a, |a| &a.as_chunks::<4>().0[..b4.len()]);
        for (k, b) in b4.iter().enumerate() {
            for (i, b) in b.iter().enumerate() {
                self.step(|r| a4[r][k][i], b);
            }
        }
        let a1 = each(a, |a| &a[4 * b4.len()..][..b1.len()]);
        for (k, b) in b1.iter().enumerate() {
            self.step(|r| a1[r][k], b);
        }
    }

    // Tiles of pairs use all sixteen registers. Their loops are out of line and take two k at a time: in a larger
    // function, or a longer body, the compiler keeps chains in memory, which takes up to twice as long.

    #[inline(never)]
    fn packed_alone(&mut self, a: &[Rows], first: usize, columns: &[Columns]) {
        let mut chains = Self { simd: self.simd, acc: self.acc };
        let (a2, a1) = a.as_chunks::<2>();
        let (b2, b1) = columns[..a.len()].as_chunks::<2>();
        for (a, b) in a2.iter().zip(b2) {
            chains.step(|r| a[0][first + r], &b[0]);
            chains.step(|r| a[1][first + r], &b[1]);
        }
        for (a, b) in a1.iter().zip(b1) {
            chains.step(|r| a[first + r], b);
        }
        *self = chains;
    }

    #[inline(never)]
    fn in_place_alone(&mut self, a: &[&[f32]; R], columns: &[Columns]) {
        let mut chains = Self { simd: self.simd, acc: self.acc };
        let (b2, b1) = columns.as_chunks::<2>();
        let a2 = each(*a, |a| &a.as_chunks::<2>().0[..b2.len()]);
        for (k, b) in b2.iter().enumerate() {
            chains.step(|r| a2[r][k][0], &b[0]);
            chains.step(|r| a2[r][k][1], &b[1]);
        }
        if let [b] = b1 {
            chains.step(|r| a[r][2 * b2.len()], b);
        }
        *self = chains;
    }

    /// Like [`Self::rest`], out of line.
    #[inline(never)]
    pub(super) fn rest_alone(&self, tile: &mut [Columns]) {
        Self { simd: self.simd, acc: self.acc }.rest(tile);
    }

    /// Like [`Self::finish`], out of line.
    #[inline(never)]
    pub(super) fn finish_alone(
        &self,
        rows: &mut [&mut [f32]],
        at: usize,
        place: [usize; 2],
        how: Finish<'_>,
    ) {
        Self { simd: self.simd, acc: self.acc }.finish(rows, at, place, how);
    }

    /// Like [`Self::across`], for complete rows with a stride of at least R; returns the number of k.
    #[inline(never)]
    fn across_alone(&mut self, a: &[f32], stride: usize, columns: &[Columns]) -> usize {
        assert!(stride >= R, "the rows of one k lie next to each other");
        let mut chains = Self { simd: self.simd, acc: self.acc };
        let (b2, _) = columns.as_chunks::<2>();
        let mut rest = a;
        for b in b2 {
            let Some((a, after)) = rest.split_at_checked(2 * stride) else { break };
            let (a0, a1) = a.split_at(stride);
            chains.step(|r| a0[r], &b[0]);
            chains.step(|r| a1[r], &b[1]);
            rest = after;
        }
        *self = chains;
        (a.len() - rest.len()) / stride
    }

    /// Adds products over rows that lie next to each other for every k, `stride` apart; numbers beyond the end
    /// of `a` are those of rows that do not exist.
    #[inline(always)]
    pub(super) fn across(&mut self, a: &[f32], stride: usize, columns: &[Columns]) {
        if !S::IS_BASE {
            return self.across_some(a, stride, columns);
        }
        let done = if stride >= R { self.across_alone(a, stride, columns) } else { 0 };
        if done < columns.len() {
            self.across_rest(&a[done * stride..], stride, &columns[done..]);
        }
    }

    #[inline(never)]
    fn across_rest(&mut self, a: &[f32], stride: usize, columns: &[Columns]) {
        let mut chains = Self { simd: self.simd, acc: self.acc };
        chains.across_some(a, stride, columns);
        *self = chains;
    }

    #[inline(always)]
    fn across_some(&mut self, a: &[f32], stride: usize, columns: &[Columns]) {
        for (k, b) in columns.iter().enumerate() {
            let a = &a[k * stride..];
            match a.first_chunk::<R>() {
                Some(a) => self.step(|r| a[r], b),
                None => {
                    let a = padded(&a[..Ord::min(a.len(), R)]);
                    self.step(|r| a[r], b);
                }
            }
        }
    }

    /// Adds the values of other chains.
    #[inline(always)]
    pub(super) fn add(&mut self, others: &Self) {
        for (acc, other) in self.acc.iter_mut().zip(&others.acc) {
            *acc = self.simd.sum(*acc, *other);
        }
    }

    /// Loads the values of at most R rows of c from column `at` on; beyond their end the values are zero.
    #[inline(always)]
    pub(super) fn of_rows(simd: S, rows: &[&mut [f32]], at: usize) -> Self {
        let mut chains = Self::fresh(simd);
        chains.load_rows(rows, at);
        chains
    }

    /// Like [`Self::of_rows`], in place.
    #[inline(always)]
    pub(super) fn load_rows(&mut self, rows: &[&mut [f32]], at: usize) {
        let simd = self.simd;
        if let Some(rows) = rows.first_chunk::<R>()
            && rows[0].len() >= at + COLUMNS
        {
            for i in 0..R {
                self.acc[i] = simd.load(rows[i][at..].first_chunk().expect("sixteen columns"));
            }
            return;
        }
        for (acc, row) in self.acc.iter_mut().zip(rows) {
            *acc = simd.load(&padded(&row[at..row.len().min(at + COLUMNS)]));
        }
    }

    /// Writes to at most R rows of c from column `at` on; in the product, they begin at row and column `place`.
    #[inline(always)]
    pub(super) fn finish(self, rows: &mut [&mut [f32]], at: usize, place: [usize; 2], how: Finish<'_>) {
        let (simd, left) = (self.simd, place[1] + at);
        match how {
            Finish::Store | Finish::Resume => self.write(rows, at, |_, x, _| x),
            Finish::Relu => self.write(rows, at, |_, x, _| simd.gated(x, x)),
            Finish::Gated(gates, n) => self.write(rows, at, |i, x, c| {
                simd.gated(x, simd.load(&padded(&gates[(place[0] + i) * n + left..][..c.len()])))
            }),
            Finish::Add => self.write(rows, at, |_, x, c| simd.sum(simd.load(&padded(c)), x)),
            Finish::AddToZero => self.write(rows, at, |_, x, _| simd.sum(simd.splat(0.0), x)),
            Finish::Bias(bias) => {
                self.write(rows, at, |_, x, c| simd.sum(x, simd.load(&padded(&bias[left..][..c.len()]))));
            }
            Finish::Leaky(bias, slope) => self.write(rows, at, |_, x, c| {
                simd.leaky(simd.sum(x, simd.load(&padded(&bias[left..][..c.len()]))), slope)
            }),
        }
    }

    /// Writes `value(row, chains, sixteen numbers of c or those that are left of it)`.
    #[inline(always)]
    fn write(self, rows: &mut [&mut [f32]], at: usize, value: impl Fn(usize, S::V, &[f32]) -> S::V) {
        // Complete tiles have a loop of known length, so that the chains stay in registers.
        if let Some(rows) = rows.first_chunk_mut::<R>()
            && rows[0].len() >= at + COLUMNS
        {
            for i in 0..R {
                let c = rows[i][at..].first_chunk_mut::<COLUMNS>().expect("sixteen columns");
                self.simd.put(value(i, self.acc[i], c), c);
            }
            return;
        }
        for ((i, x), row) in self.acc.into_iter().enumerate().zip(rows) {
            let c = &mut row[at..];
            match c.first_chunk_mut::<COLUMNS>() {
                Some(c) => *c = self.simd.store(value(i, x, c)),
                None => write_some(c, &self.simd.store(value(i, x, c))),
            }
        }
    }
}

/// Loads up to sixteen numbers, followed by zeros.
#[inline(always)]
fn padded(x: &[f32]) -> [f32; COLUMNS] {
    match x.try_into() {
        Ok(all) => all,
        Err(_) => read_some(x),
    }
}

// This function is out of line, so that the general copy does not also handle complete tiles.

#[cold]
#[inline(never)]
fn read_some(x: &[f32]) -> [f32; COLUMNS] {
    let mut all = [0.0; COLUMNS];
    all[..x.len()].copy_from_slice(x);
    all
}

/// Copies the first numbers, four at a time (a copy of any length would be a call).
#[inline(always)]
fn write_some(c: &mut [f32], x: &[f32; COLUMNS]) {
    let ((c4, c1), (x4, _)) = (c.as_chunks_mut::<4>(), x.as_chunks::<4>());
    let done = c4.len();
    c4.iter_mut().zip(x4).for_each(|(c, x)| *c = *x);
    if let Some(x) = x4.get(done) {
        match c1 {
            [a, b, c] => [*a, *b, *c] = [x[0], x[1], x[2]],
            [a, b] => [*a, *b] = [x[0], x[1]],
            [a] => *a = x[0],
            _ => {}
        }
    }
}
