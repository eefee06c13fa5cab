//! Blocks of the output: the order of tiles along k, and the storage of unfinished chains between blocks of
//! k.

use super::matrix::{CHUNK, Finish};
use super::packed::Packed;
use super::tile::{COLUMNS, Chains, Columns, Eight, HALF, Job, ROWS, Rows, Sixteen, Tile, widest};
use prefetch_index::prefetch_index;
use std::cell::Cell;
use std::ops::Range;

/// Length of a block of k: a panel of a (12 KiB) and one of b (16 KiB) stay in the first-level cache.
pub(super) const BLOCK_K: usize = 256;

/// Number of panel columns, for one k each, that should stay in the first-level cache (16 KiB).
pub(super) const RESIDENT: usize = 256;

thread_local! {
    /// Memory of a task: packed rows of the left factor, and tiles that are stored between blocks of k.
    static TASK: Cell<(Vec<Rows>, Vec<Tile>)> = const { Cell::new((Vec::new(), Vec::new())) };
}

/// A left factor (m, k); the trait defines how its rows reach the register tiles.
pub(super) trait Left: Copy + Sync {
    /// Prepares the rows for k in `ks`; `panels` is the number of column panels that will use them. `packed`
    /// stays empty if the rows are read in place.
    fn prepare(self, rows: Range<usize>, ks: Range<usize>, panels: usize, packed: &mut Vec<Rows>);
    /// How R rows are read.
    type Tile<'t, const R: usize>: Copy
    where
        Self: 't;
    /// Returns how the rows from `rows.start` on are read over k in `ks`: at most R; rows beyond the last may
    /// hold any values. They are those from `packed.1` on of a panel of the prepared rows.
    fn tile<'t, const R: usize>(
        &'t self,
        rows: Range<usize>,
        ks: Range<usize>,
        packed: (&'t [Rows], usize),
    ) -> Self::Tile<'t, R>;
    /// Resumes chains over these rows and k.
    fn resume<S: Sixteen, const R: usize>(
        &self,
        tile: Self::Tile<'_, R>,
        chains: &mut Chains<S, R>,
        columns: &[Columns],
    );
}

/// One block of the output: its first column, and its part of every row.
pub(super) struct Task<'a> {
    pub(super) top: usize,
    pub(super) left: usize,
    pub(super) rows: Vec<&'a mut [f32]>,
}

impl Task<'_> {
    /// Returns the range of its column panels.
    pub(super) fn panels(&self) -> Range<usize> {
        let width = self.rows.first().map_or(0, |row| row.len());
        self.left / COLUMNS..(self.left + width).div_ceil(COLUMNS)
    }
}

/// Computes one block of the output.
pub(super) fn block(a: impl Left, b: &Packed, task: Task<'_>, how: Finish<'_>) {
    widest(Block { a, b, task, how });
}

pub(super) struct Block<'a, L> {
    pub(super) a: L,
    pub(super) b: &'a Packed,
    pub(super) task: Task<'a>,
    pub(super) how: Finish<'a>,
}

/// One section of the traversal along k.
#[derive(Clone)]
struct Leg {
    ks: Range<usize>,
    /// True if the chains begin here instead of being resumed.
    is_first: bool,
    /// True if the results are written to the output instead of being stored as tiles.
    is_last: bool,
}

impl<L: Left> Job for Block<'_, L> {
    fn by<S: Sixteen>(mut self, simd: S) {
        let (mut packed, mut tiles) = TASK.take();
        let (k, all) = (self.b.k, self.task.rows.len().div_ceil(ROWS) * self.task.panels().len());
        tiles.clear();
        tiles.resize(if k > BLOCK_K { all } else { 0 }, [Columns::ZERO; ROWS]);
        assert!(
            k <= CHUNK || !matches!(self.how, Finish::Resume),
            "a resumed chain has at most {CHUNK} products"
        );
        if k <= CHUNK {
            self.along(simd, 0..k, true, (&mut packed, &mut tiles));
        } else {
            // The pairwise tree over the chunks is built incrementally: two neighbours of one level form one
            // of the next; at the end, the remaining smaller ones are added from the right.
            let mut stack: Vec<(u32, Vec<Tile>)> = Vec::new();
            for start in (0..k).step_by(CHUNK) {
                self.along(simd, start..k.min(start + CHUNK), false, (&mut packed, &mut tiles));
                let (mut level, mut right) = (0, tiles.clone());
                while stack.last().is_some_and(|(l, _)| *l == level) {
                    let (_, mut left) = stack.pop().expect("the stack is not empty");
                    add(&mut left, &right);
                    (level, right) = (level + 1, left);
                }
                stack.push((level, right));
            }
            let (_, mut sums) = stack.pop().expect("there is at least one chunk");
            while let Some((_, mut left)) = stack.pop() {
                add(&mut left, &sums);
                sums = left;
            }
            let end = Leg { ks: k..k, is_first: false, is_last: true };
            self.leg(simd, &end, (&mut packed, &mut sums));
        }
        TASK.set((packed, tiles));
    }
}

fn add(left: &mut [Tile], right: &[Tile]) {
    for (x, y) in left.iter_mut().flatten().zip(right.iter().flatten()) {
        x.0.iter_mut().zip(y.0).for_each(|(x, y)| *x += y);
    }
}

impl<L: Left> Block<'_, L> {
    /// Computes new chains over k in `ks`, one block of k at a time; at the end they are written or stored.
    fn along<S: Sixteen>(
        &mut self,
        simd: S,
        ks: Range<usize>,
        is_written: bool,
        (packed, tiles): (&mut Vec<Rows>, &mut [Tile]),
    ) {
        let mut start = ks.start;
        loop {
            let end = ks.end.min(start + BLOCK_K);
            let is_last = is_written && end == ks.end;
            let leg = Leg { ks: start..end, is_first: start == ks.start, is_last };
            self.leg(simd, &leg, (packed, tiles));
            start = end;
            if start == ks.end {
                return;
            }
        }
    }

    /// Computes all tiles along one block of k. The rows of a tile are read by as many panels of columns as
    /// stay in the first-level cache, before the next rows are.
    fn leg<S: Sixteen>(&mut self, simd: S, leg: &Leg, (packed, tiles): (&mut Vec<Rows>, &mut [Tile])) {
        let (panels, height) = (self.task.panels(), self.task.rows.len());
        self.a.prepare(self.task.top..self.task.top + height, leg.ks.clone(), panels.len(), packed);
        let narrow = panels.clone().filter(|p| self.b.n - p * COLUMNS <= COLUMNS / 2).count();
        let (wide, together) = (panels.end - narrow, Ord::max(1, RESIDENT / Ord::max(1, leg.ks.len())));
        for first in (panels.start..wide).step_by(together) {
            let group = first..wide.min(first + together);
            simd.run(
                #[inline(always)]
                || self.group(simd, leg, packed, group, tiles),
            );
        }
        simd.run(
            #[inline(always)]
            || self.group(Eight, leg, packed, wide..panels.end, tiles),
        );
    }

    /// Computes the tiles of some panels for all rows.
    #[inline(always)]
    fn group<S: Sixteen>(
        &mut self,
        simd: S,
        leg: &Leg,
        packed: &[Rows],
        panels: Range<usize>,
        tiles: &mut [Tile],
    ) {
        if panels.is_empty() {
            return;
        }
        let (k, height) = (leg.ks.len(), self.task.rows.len());
        for r in 0..height.div_ceil(ROWS) {
            let mine = if packed.is_empty() { packed } else { &packed[r * k..][..k] };
            let (upper, left) = (r * ROWS, height - r * ROWS);
            if S::HEIGHT == ROWS && left > HALF {
                self.row::<S, ROWS>(simd, leg, (r, 0), mine, panels.clone(), tiles);
                continue;
            }
            for half in (0..left.min(ROWS)).step_by(HALF) {
                debug_assert!(upper + half < height, "a tile has rows");
                self.row::<S, HALF>(simd, leg, (r, half), mine, panels.clone(), tiles);
            }
        }
    }

    /// Computes the register tiles of some panels; their rows begin `half` rows below the upper edge of tile r.
    #[inline(always)]
    fn row<S: Sixteen, const R: usize>(
        &mut self,
        simd: S,
        leg: &Leg,
        (r, half): (usize, usize),
        packed: &[Rows],
        panels: Range<usize>,
        tiles: &mut [Tile],
    ) {
        let all = self.task.panels();
        let Task { top, left, rows } = &mut self.task;
        let first = r * ROWS + half;
        let (from, end, per_panel) = (*top + first, *top + rows.len(), rows.len().div_ceil(ROWS));
        let last = rows.len().min(first + R);
        let rows = &mut rows[first..last];
        let read = self.a.tile::<R>(from..end, leg.ks.clone(), (packed, half));
        for p in panels {
            let at = p * COLUMNS - *left;
            let tile: &mut [Columns] = match tiles.get_mut((p - all.start) * per_panel + r) {
                Some(tile) => &mut tile[half..],
                None => &mut [],
            };
            // Chains of pairs are in memory, where they are loaded, stored and written in place: passed on by value they
            // would be copied. With wider registers it is the other way round.
            let mut chains = Chains::<S, R>::fresh(simd);
            match (leg.is_first, self.how) {
                (true, Finish::Resume) if S::IS_BASE => chains.load_rows(rows, at),
                (true, Finish::Resume) => chains = Chains::of_rows(simd, rows, at),
                (true, _) => {}
                (false, _) if S::IS_BASE => chains.load(tile),
                (false, _) => chains = Chains::resumed(simd, tile),
            }
            if leg.is_last && matches!(self.how, Finish::Add) {
                // The values to be added to were written long ago; fetching them now makes them available
                // when the chains end.
                for row in &*rows {
                    prefetch_index(&**row, at);
                    prefetch_index(&**row, row.len().min(at + COLUMNS) - 1);
                }
            }
            self.a.resume(read, &mut chains, &self.b.panel(p)[leg.ks.clone()]);
            match (leg.is_last, S::IS_BASE) {
                (true, true) => chains.finish_alone(rows, at, [from, *left], self.how),
                (true, false) => chains.finish(rows, at, [from, *left], self.how),
                (false, true) => chains.rest_alone(tile),
                (false, false) => chains.rest(tile),
            }
        }
    }
}
