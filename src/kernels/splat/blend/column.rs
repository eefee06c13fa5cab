//! The inner loops of blending: one splat in one vector column of a tile, forward and adjoint.
//!
//! A vector column is eight pixels wide and as high as the tile. A tile has H of them; vector v = row·H + h
//! contains the eight pixels of column h in one row. The forward pass computes C ← C + T α c, T ← T (1 − α)
//! in every pixel. The adjoint reverses these steps, last splat first, and sums the splat's record over the
//! rows.

use super::alpha::{AlphaLimits, Column, Decided, raw_alpha};
use super::record::{RECORD, RecordLanes};
use super::state::{AdjointState, Entry, ForwardState, TileIn, VECTORS};
use crate::num::lanes::{Real, f32x8};

/// Rows to process in one vector column.
#[derive(Clone, Copy)]
pub(super) struct ColumnRows {
    /// Index of the vector column.
    pub(super) h: usize,
    /// Rows, one bit each; at least one bit is set.
    pub(super) rows: u32,
}

// The rules that end a traversal. They are constants so that the loop is compiled once for each.

/// [`Stop::After`](crate::scene::profile::Stop::After)
pub(super) const AFTER: u8 = 0;
/// [`Stop::Before`](crate::scene::profile::Stop::Before)
pub(super) const BEFORE: u8 = 1;
/// [`Stop::BeforeStrict`](crate::scene::profile::Stop::BeforeStrict)
pub(super) const BEFORE_STRICT: u8 = 2;
/// [`Stop::Never`](crate::scene::profile::Stop::Never)
pub(super) const NEVER: u8 = 3;
/// The traversal ends at the stored last index of each pixel.
pub(super) const FROZEN: u8 = 4;

/// A [`column_forward`] for one pivot axis and one rule.
pub(super) type ColumnForward<const V: usize> =
    fn(&TileIn<'_>, &Entry<'_>, ColumnRows, Option<&[f32x8; V]>, &mut ForwardState<V>);

/// Blends one entry in one vector column; `frozen_last` is the last index of every pixel for rule [`FROZEN`].
pub(super) fn column_forward<const X: bool, const RULE: u8, const H: usize, const V: usize>(
    x: &TileIn<'_>,
    entry: &Entry<'_>,
    ColumnRows { h, mut rows }: ColumnRows,
    frozen_last: Option<&[f32x8; V]>,
    state: &mut ForwardState<V>,
) {
    let Entry { k, splat: s, masks } = *entry;
    let one = f32x8::splat(1.0);
    let t_stop = f32x8::splat(x.profile.t_stop);
    let limits = AlphaLimits::new(x.profile);
    let index = f32x8::splat(k as i32 as f32);
    let count = f32x8::splat((k + 1) as i32 as f32);
    let color = [s.color[0], s.color[1], s.color[2], s.z].map(f32x8::splat);
    let column = Column::new(s, x.tile.centers[h & 3]);
    while rows != 0 {
        let r = rows.trailing_zeros() as usize;
        rows &= rows - 1;
        let v = (r * H + h) & (V - 1); // V is a power of two; the mask removes the bounds check
        let w = column.whitened::<X>(x.tile.center_y(r));
        let Decided { alpha, mut keep, .. } = limits.decide(raw_alpha(column.opacity, w), masks, v);
        let t = state.t[v];
        match RULE {
            AFTER => keep = keep & Real::gt(t, t_stop),
            FROZEN => keep = keep & Real::le(index, frozen_last.expect("required by FROZEN")[v]),
            NEVER => keep = keep & state.live[v],
            _ => {
                let next = t * (one - alpha);
                let ends = if RULE == BEFORE { Real::le(next, t_stop) } else { Real::lt(next, t_stop) };
                let live = state.live[v] & !(ends & keep);
                state.live[v] = live;
                keep = keep & live;
            }
        }
        // α is 0 where the splat is skipped, so the products below change nothing and no lane needs a
        // selection.
        let alpha = keep & alpha;
        let weight = t * alpha;
        for (sum, c) in state.sums.iter_mut().zip(color) {
            sum[v] = sum[v] + weight * c;
        }
        let t = t * (one - alpha);
        state.t[v] = t;
        // The update is exact for integers; a selection would become a masked store, which costs several
        // times as much as this step.
        state.last[v] = state.last[v] + (keep & (count - state.last[v]));
    }
}

/// A [`column_adjoint`] for one pivot axis and one set of sums.
pub(super) type ColumnAdjoint = fn(&TileIn<'_>, &Entry<'_>, ColumnRows, &mut AdjointState, &mut RecordLanes);

/// Reverses one entry in one vector column. The sums of its record over the rows, left folds, are written to
/// `out`.
///
/// `DEPTH` includes the cotangents of depth and alpha, `ABS` the sums of |ū|.
pub(super) fn column_adjoint<const X: bool, const DEPTH: bool, const ABS: bool>(
    x: &TileIn<'_>,
    entry: &Entry<'_>,
    ColumnRows { h, mut rows }: ColumnRows,
    state: &mut AdjointState,
    out: &mut RecordLanes,
) {
    let Entry { k, splat: s, masks } = *entry;
    let one = f32x8::splat(1.0);
    let limits = AlphaLimits::new(x.profile);
    let color = s.color.map(f32x8::splat);
    let z = f32x8::splat(s.z);
    let index = f32x8::splat(k as i32 as f32);
    let column = Column::new(s, x.tile.centers[h & 3]);
    let through_cap = f32x8::splat(f32::from_bits(if x.profile.inria_bwd { u32::MAX } else { 0 }));
    let mut sums = [f32x8::splat(0.0); RECORD];
    while rows != 0 {
        let r = rows.trailing_zeros() as usize;
        rows &= rows - 1;
        let v = (2 * r + h) & (VECTORS - 1);
        let (w1, w2) = column.whitened::<X>(x.tile.center_y(r));
        let raw = raw_alpha(column.opacity, (w1, w2));
        let Decided { alpha, keep, capped } = limits.decide(raw, masks, v);
        let keep = keep & Real::le(index, state.last[v]);
        // α is 0 where the splat was skipped, so T and the state behind it stay the same, and every product
        // is 0.
        let alpha = keep & alpha;
        // Reverses T' = T (1 − α).
        let rest = one - alpha;
        let t = state.t[v] / rest;
        state.t[v] = t;
        // Combines the splat's colour, depth and coverage with the pixel's cotangents.
        let mut e = (color[0] * state.bar[0][v] + color[1] * state.bar[1][v]) + color[2] * state.bar[2][v];
        if DEPTH {
            e = (e + z * state.bar[3][v]) + state.alpha_bar[v];
        }
        let behind = state.behind[v];
        let alpha_bar = t * (e - behind);
        state.behind[v] = alpha * e + rest * behind;
        let weight = t * alpha;
        sums[6] = sums[6] + weight * state.bar[0][v];
        sums[7] = sums[7] + weight * state.bar[1][v];
        sums[8] = sums[8] + weight * state.bar[2][v];
        if DEPTH {
            sums[9] = sums[9] + weight * state.bar[3][v];
        }
        // The derivative is that of the uncapped product, which is the same number where the cap is not
        // reached.
        let p = keep & (through_cap | !capped) & (alpha_bar * raw);
        let p2 = p * w2;
        sums[0] = sums[0] + p;
        sums[2] = sums[2] + p2;
        sums[5] = sums[5] + p2 * w2;
        if !X {
            let p1 = p * w1;
            sums[1] = sums[1] + p1;
            sums[3] = sums[3] + p1 * w1;
            sums[4] = sums[4] + p1 * w2;
        }
        if ABS {
            let along_q = p2 * column.k2;
            let along_p = (p * w1) * column.k1 - column.s * along_q;
            let (ux, uy) = if X { (along_p, along_q) } else { (along_q, along_p) };
            sums[10] = sums[10] + Real::abs(ux);
            sums[11] = sums[11] + Real::abs(uy);
        }
    }
    if X {
        // Along the rows w1 is a constant of the column, so it is a factor of the sums.
        let w1 = column.dx * column.k1;
        sums[1] = w1 * sums[0];
        sums[3] = w1 * sums[1];
        sums[4] = w1 * sums[2];
    }
    *out = sums;
}
