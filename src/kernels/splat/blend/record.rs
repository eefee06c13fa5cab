//! Gradient records: the sums over one (splat, tile), and the cotangents of a splat that follow from them.
//!
//! ō = ΣP/o,  k̄1 = −ΣPw1²/k1,  k̄2 = −ΣPw2²/k2,  s̄ = (k2/k1) ΣPw1w2,  ū_p = k1 ΣPw1 − s k2 ΣPw2,  ū_q = k2
//! ΣPw2
//!
//! # Rounding
//! The 16 columns of a tile are folded 16→8→4→2→1; the first of these steps is in `walk`. Records of a splat
//! are summed in slot order in f64 and rounded once.

use crate::num::lanes::f32x8;
use crate::splat::plan::{Plan, Splat};

/// Number of values in one gradient record: P, Pw1, Pw2, Pw1², Pw1w2, Pw2², r, g, b, z, |ū_x|, |ū_y|.
pub const RECORD: usize = 12;

/// Sums over one (splat, tile), in the order of [`RECORD`].
pub type Record = [f32; RECORD];

/// A record before its lanes are folded, with the sums of eight columns.
pub(super) type RecordLanes = [f32x8; RECORD];

/// Folds twelve sums over their 8 lanes: l += l+4, then +2, +1.
#[inline(always)]
pub(super) fn fold(eight: &RecordLanes) -> Record {
    let zero = f32x8::splat(0.0);
    let tree = |rows: [f32x8; 8]| {
        let r = f32x8::transpose(rows);
        (((r[0] + r[4]) + (r[2] + r[6])) + ((r[1] + r[5]) + (r[3] + r[7]))).to_array()
    };
    let a = tree(std::array::from_fn(|i| eight[i]));
    let b = tree(std::array::from_fn(|i| if i < RECORD - 8 { eight[8 + i] } else { zero }));
    std::array::from_fn(|i| if i < 8 { a[i] } else { b[i - 8] })
}

/// Returns the sum of the records of one Gaussian in slot order; `None` if no tile lists it.
///
/// `rows` is [`Saved::rows`](super::Saved::rows); pairs without processed rows have no record.
pub fn gather_records(
    plan: &Plan,
    rows: &[[u16; 2]],
    records: &[Record],
    camera_row: usize,
) -> Option<[f64; RECORD]> {
    let slots = plan.slot_start[camera_row] as usize..plan.slot_start[camera_row + 1] as usize;
    if slots.is_empty() {
        return None;
    }
    let mut sum = [0.0_f64; RECORD];
    for &entry in &plan.entry_of_slot[slots] {
        if rows[entry as usize] == [0, 0] {
            continue;
        }
        for (total, x) in sum.iter_mut().zip(&records[entry as usize]) {
            *total += f64::from(*x);
        }
    }
    Some(sum)
}

/// Cotangents of one projected splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatBar {
    /// Cotangent ∂L/∂u, pixels⁻¹.
    pub mean_px: [f32; 2],
    /// Cotangents ∂L/∂(s, k1, k2).
    pub shape: [f32; 3],
    /// Cotangent ∂L/∂o of the opacity in [`Splat`].
    pub opacity: f32,
    /// Cotangent ∂L/∂c.
    pub color: [f32; 3],
    /// Cotangent ∂L/∂z.
    pub z: f32,
    /// Σ over pixels of |∂L/∂u|, if the adjoint computes it.
    pub mean_px_abs: [f32; 2],
}

impl SplatBar {
    /// Computes the cotangents from the sum of a splat's records.
    pub fn new(s: &Splat, sums: [f64; RECORD]) -> Self {
        let [p, p1, p2, p11, p12, p22, r, g, b, z, ax, ay] = sums.map(|x| x as f32);
        let [sh, k1, k2] = s.shape;
        let (along_p, along_q) = (k1 * p1 - (sh * k2) * p2, k2 * p2);
        Self {
            mean_px: if s.axis == 0 { [along_p, along_q] } else { [along_q, along_p] },
            shape: [(k2 / k1) * p12, -p11 / k1, -p22 / k2],
            opacity: p / s.opacity,
            color: [r, g, b],
            z,
            mean_px_abs: [ax, ay],
        }
    }
}
