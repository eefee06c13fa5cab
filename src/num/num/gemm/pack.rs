//! Packing of both factors into the panels that the register tiles read.

use super::matrix::View;
use super::tile::{COLUMNS, Columns, ROWS, Rows, eight};
use crate::num::lanes::f32x8;
use std::ops::Range;

/// Packs columns `first..first + 16` of b (k, n); columns beyond n are zero.
pub(super) fn pack_columns(b: View<'_>, first: usize, panel: &mut [Columns]) {
    let width = COLUMNS.min(b.columns - first);
    let at = |k: usize, j: usize| b.values[k * b.row_stride + (first + j) * b.column_stride];
    let slow = |k: usize| Columns(std::array::from_fn(|j| if j < width { at(k, j) } else { 0.0 }));
    if width == COLUMNS && b.column_stride == 1 {
        for (k, row) in panel.iter_mut().enumerate() {
            let sixteen = &b.values[k * b.row_stride + first..][..COLUMNS];
            *row = Columns(sixteen.try_into().expect("sixteen numbers"));
        }
        return;
    }
    if width < COLUMNS || b.row_stride != 1 {
        for (k, row) in panel.iter_mut().enumerate() {
            *row = slow(k);
        }
        return;
    }
    // Sixteen contiguous columns are transposed in blocks of eight by eight. All of a column's cache line is
    // used before the next column is read, because columns whose distance is a power of two share few cache
    // sets.
    let whole = b.rows - b.rows % COLUMNS;
    for k in (0..whole).step_by(COLUMNS) {
        for half in 0..2 {
            for k in [k, k + 8] {
                let load = |j: usize| eight(&b.values[(first + 8 * half + j) * b.column_stride + k..]);
                for (i, row) in f32x8::transpose(std::array::from_fn(load)).into_iter().enumerate() {
                    panel[k + i].0[8 * half..8 * half + 8].copy_from_slice(&row.to_array());
                }
            }
        }
    }
    for (k, row) in panel.iter_mut().enumerate().skip(whole) {
        *row = slow(k);
    }
}

/// Packs rows `rows` and k `ks` of a into panels of twelve rows; rows beyond the end are zero.
pub(super) fn pack_rows(a: View<'_>, rows: Range<usize>, ks: Range<usize>, panels: &mut Vec<Rows>) {
    panels.reserve(rows.len().div_ceil(ROWS) * ks.len());
    for first in rows.clone().step_by(ROWS) {
        let height = ROWS.min(rows.end - first);
        let mut k = ks.start;
        if a.column_stride == 1 {
            while k + 8 <= ks.end {
                let load = |r: usize| {
                    if r < height { eight(&a.values[(first + r) * a.row_stride + k..]) } else { f32x8::ZERO }
                };
                let upper = f32x8::transpose(std::array::from_fn(load)).map(f32x8::to_array);
                let lower =
                    f32x8::transpose(std::array::from_fn(|r| if r < 4 { load(8 + r) } else { f32x8::ZERO }))
                        .map(f32x8::to_array);
                panels.extend((0..8).map(|i| {
                    let mut rows = [0.0; ROWS];
                    rows[..8].copy_from_slice(&upper[i]);
                    rows[8..].copy_from_slice(&lower[i][..4]);
                    rows
                }));
                k += 8;
            }
        } else if a.row_stride == 1 && height == ROWS {
            panels.extend((k..ks.end).map(|k| -> Rows {
                a.values[k * a.column_stride + first..][..ROWS].try_into().expect("twelve numbers")
            }));
            k = ks.end;
        }
        let at = |r: usize, k: usize| a.values[(first + r) * a.row_stride + k * a.column_stride];
        panels.extend((k..ks.end).map(|k| std::array::from_fn(|r| if r < height { at(r, k) } else { 0.0 })));
    }
}
