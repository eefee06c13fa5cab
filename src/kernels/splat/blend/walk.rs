//! Traverses the list of one tile: front to back in the forward pass, back to front in the adjoint.
//!
//! The forward pass finds the rows of each vector column that an entry can reach, passes them to `column` and
//! stores them; the adjoint uses the stored rows.

use super::column::{
    AFTER, BEFORE, BEFORE_STRICT, ColumnAdjoint, ColumnForward, ColumnRows, FROZEN, NEVER, column_adjoint,
    column_forward,
};
use super::record::{RECORD, Record, fold};
use super::state::{AdjointState, ForwardState, TileIn};
use crate::num::lanes::{Real, f32x8};
use crate::scene::profile::Stop;
use crate::splat::tile::{Tile, spans};

/// Number of splats whose row spans are computed together.
const BATCH: usize = 16;

/// Returns the rows of each vector column that are inside the image, one bit each.
fn rows_inside<const H: usize>(tile: &Tile) -> [u32; H] {
    let mut inside = [u32::MAX >> (32 - tile.rows); H];
    for (h, rows) in inside.iter_mut().enumerate() {
        if 8 * h >= tile.cols {
            *rows = 0;
        }
    }
    inside
}

/// Returns the inner loops for pivots x and y with a rule.
fn columns_forward<const H: usize, const V: usize>(rule: u8) -> [ColumnForward<V>; 2] {
    match rule {
        FROZEN => [column_forward::<true, FROZEN, H, V>, column_forward::<false, FROZEN, H, V>],
        AFTER => [column_forward::<true, AFTER, H, V>, column_forward::<false, AFTER, H, V>],
        BEFORE => [column_forward::<true, BEFORE, H, V>, column_forward::<false, BEFORE, H, V>],
        BEFORE_STRICT => {
            [column_forward::<true, BEFORE_STRICT, H, V>, column_forward::<false, BEFORE_STRICT, H, V>]
        }
        _ => [column_forward::<true, NEVER, H, V>, column_forward::<false, NEVER, H, V>],
    }
}

/// Blends one tile with H vectors per row and V vectors in total.
///
/// `frozen_last` is the stored last index of every pixel; it is given if and only if `x` has masks, and
/// requires H = 2. The processed rows are written to `rows`, one element per entry; `rows` is empty if they
/// are not saved.
pub(super) fn tile_forward<const H: usize, const V: usize>(
    x: &TileIn<'_>,
    frozen_last: Option<&[f32x8; V]>,
    rows: &mut [[u16; 2]],
) -> ForwardState<V> {
    let mut state = ForwardState::new::<H>(&x.tile);
    let mut alive = rows_inside::<H>(&x.tile);
    let rule = match (frozen_last, x.profile.stop) {
        (Some(_), _) => FROZEN,
        (None, Stop::After) => AFTER,
        (None, Stop::Before) => BEFORE,
        (None, Stop::BeforeStrict) => BEFORE_STRICT,
        (None, Stop::Never) => NEVER,
    };
    let columns = columns_forward::<H, V>(rule);
    // Spans are computed one batch ahead: their latencies overlap, and the splats are in the cache when they
    // are blended.
    let mut ahead = [[0_u32; H]; BATCH];
    for (batch, part) in x.list.chunks(BATCH).enumerate() {
        if alive == [0; H] {
            if let Some(rest) = rows.get_mut(batch * BATCH..) {
                rest.fill([0; 2]); // splats behind an opaque tile are not processed
            }
            break;
        }
        for (spanned, &g) in ahead.iter_mut().zip(part) {
            *spanned = spans::<H>(&x.splats[g as usize], &x.tile, x.cull);
            for h in 0..H {
                spanned[h] &= alive[h];
            }
        }
        for (i, spanned) in ahead.iter().enumerate().take(part.len()) {
            let k = batch * BATCH + i;
            let entry = x.entry(k);
            let column = columns[entry.axis()];
            for h in 0..H {
                if spanned[h] != 0 {
                    column(x, &entry, ColumnRows { h, rows: spanned[h] }, frozen_last, &mut state);
                }
            }
            if let Some(walked) = rows.get_mut(k) {
                *walked = [spanned[0] as u16, spanned[H - 1] as u16];
            }
        }
        if frozen_last.is_none() {
            for v in 0..V {
                let live = if rule == AFTER {
                    Real::gt(state.t[v], f32x8::splat(x.profile.t_stop))
                } else {
                    state.live[v]
                };
                alive[v % H] &= !(u32::from(<f32x8 as Real>::bits(live) == 0) << (v / H));
            }
        }
    }
    state
}

/// Optional sums of a record, in addition to those that every record has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RecordSums {
    /// The sum for z, and the cotangents of depth and alpha in all other sums.
    pub(super) depth: bool,
    /// The sums of |ū|.
    pub(super) abs: bool,
}

/// Returns the inner loops for pivots x and y that compute these sums.
fn columns_adjoint(sums: RecordSums) -> [ColumnAdjoint; 2] {
    match (sums.depth, sums.abs) {
        (false, false) => [column_adjoint::<true, false, false>, column_adjoint::<false, false, false>],
        (true, false) => [column_adjoint::<true, true, false>, column_adjoint::<false, true, false>],
        (false, true) => [column_adjoint::<true, false, true>, column_adjoint::<false, false, true>],
        (true, true) => [column_adjoint::<true, true, true>, column_adjoint::<false, true, true>],
    }
}

/// Traverses one 16×16 tile back to front and writes one record per entry; `rows` are those of the forward
/// pass.
pub(super) fn tile_adjoint(
    x: &TileIn<'_>,
    rows: &[[u16; 2]],
    mut state: AdjointState,
    sums: RecordSums,
    records: &mut [Record],
) {
    let columns = columns_adjoint(sums);
    for (k, record) in records.iter_mut().enumerate().rev() {
        let [left, right] = rows[k].map(u32::from);
        if left == 0 && right == 0 {
            continue; // this record is never read, see `gather_records`
        }
        let entry = x.entry(k);
        let column = columns[entry.axis()];
        let mut total = [f32x8::splat(0.0); RECORD];
        if left != 0 {
            column(x, &entry, ColumnRows { h: 0, rows: left }, &mut state, &mut total);
        }
        if right != 0 {
            // Fold 16 → 8: the right half of the tile is added to the left one.
            let mut half = [f32x8::splat(0.0); RECORD];
            column(x, &entry, ColumnRows { h: 1, rows: right }, &mut state, &mut half);
            for (l, r) in total.iter_mut().zip(half) {
                *l = *l + r;
            }
        }
        *record = fold(&total);
    }
}
