//! Computes α of one splat at eight pixels, and makes the decisions about the cap α_max and the cut-off
//! α_min.
//!
//! α = min(α_max, o exp(−½ (w1² + w2²))),  w1 = d_p k1,  w2 = (d_q − s d_p) k2,  d = pixel centre − u
//!
//! The forward pass, the adjoint and the masks of the operator list share these functions, so all of them use
//! the same bits.

use crate::num::elem::exp_lanes;
use crate::num::lanes::{Real, f32x8};
use crate::scene::profile::Profile;
use crate::splat::plan::Splat;
use std::ops::Range;

/// Returns (w1, w2) of a pixel at (d_p, d_q) from the centre.
#[inline(always)]
pub fn whiten<L: Real>(dp: L, dq: L, [s, k1, k2]: [L; 3]) -> (L, L) {
    (dp * k1, (dq - s * dp) * k2)
}

/// Returns o·exp(−½(w1² + w2²)), which is not yet capped. No other function computes α.
#[inline(always)]
pub fn raw_alpha<L: Real>(opacity: L, (w1, w2): (L, L)) -> L {
    opacity * exp_lanes((w1 * w1 + w2 * w2) * L::splat(-0.5))
}

/// Values of one splat in lanes, for one vector column of a tile.
pub(super) struct Column {
    /// Difference of the pixel centres from u_x along x.
    pub(super) dx: f32x8,
    /// Centre u_y.
    mean_y: f32,
    /// Shape parameter s.
    pub(super) s: f32x8,
    /// Shape parameter k1.
    pub(super) k1: f32x8,
    /// Shape parameter k2.
    pub(super) k2: f32x8,
    /// Opacity o.
    pub(super) opacity: f32x8,
}

impl Column {
    /// Prepares a splat; `centers` are the x of the column's pixel centres.
    #[inline(always)]
    pub(super) fn new(splat: &Splat, centers: f32x8) -> Self {
        let c = f32x8::splat;
        let [s, k1, k2] = splat.shape;
        Self {
            dx: centers - c(splat.mean_px[0]),
            mean_y: splat.mean_px[1],
            s: c(s),
            k1: c(k1),
            k2: c(k2),
            opacity: c(splat.opacity),
        }
    }

    /// Returns (w1, w2) of a row, for pivot axis x (`X`) or y.
    #[inline(always)]
    pub(super) fn whitened<const X: bool>(&self, center_y: f32) -> (f32x8, f32x8) {
        let dy = f32x8::splat(center_y - self.mean_y);
        let (dp, dq) = if X { (self.dx, dy) } else { (dy, self.dx) };
        whiten(dp, dq, [self.s, self.k1, self.k2])
    }
}

/// Stored decisions that replace new ones, one bit per pair and pixel: (E, 32) bytes, bit 16·row + column of
/// a 16×16 tile.
#[derive(Clone, Copy, Debug)]
pub struct FrozenMasks<'a> {
    /// Index of the last included splat in the tile's list, shape (C, H, W), −1 = none.
    pub last_index: &'a [f32],
    /// Mask of contributions, shape (E, 32): 1 = the pair contributes to the pixel.
    pub alpha: &'a [[u8; 32]],
    /// Mask of the cap, shape (E, 32): 1 = α is capped at the pixel.
    pub cap: &'a [[u8; 32]],
}

impl<'a> FrozenMasks<'a> {
    /// Returns the masks of one tile's entries.
    pub(super) fn tile(&self, entries: Range<usize>) -> TileMasks<'a> {
        TileMasks { alpha: &self.alpha[entries.clone()], cap: &self.cap[entries] }
    }
}

/// The [`FrozenMasks`] of the entries of one tile.
#[derive(Clone, Copy)]
pub(super) struct TileMasks<'a> {
    alpha: &'a [[u8; 32]],
    cap: &'a [[u8; 32]],
}

impl<'a> TileMasks<'a> {
    /// Returns the masks of entry `k` of the tile.
    #[inline(always)]
    pub(super) fn entry(self, k: usize) -> EntryMasks<'a> {
        EntryMasks { alpha: &self.alpha[k], cap: &self.cap[k] }
    }
}

/// The [`FrozenMasks`] of one entry: byte v contains the eight pixels of vector v.
#[derive(Clone, Copy)]
pub(super) struct EntryMasks<'a> {
    alpha: &'a [u8; 32],
    cap: &'a [u8; 32],
}

/// Expands one byte of a stored mask to lanes.
#[inline(always)]
fn byte_lanes(byte: u8) -> f32x8 {
    Real::gt(f32x8::from_fn(|l| f32::from(byte >> l & 1)), f32x8::splat(0.5))
}

/// α of eight pixels after the decisions about it.
pub(super) struct Decided {
    /// Capped α.
    pub(super) alpha: f32x8,
    /// Mask of the lanes with α ≥ α_min, where the splat contributes.
    pub(super) keep: f32x8,
    /// Mask of the lanes where the cap applies.
    pub(super) capped: f32x8,
}

/// Limits α_max and α_min in lanes.
#[derive(Clone, Copy)]
pub(super) struct AlphaLimits {
    max: f32x8,
    min: f32x8,
}

impl AlphaLimits {
    /// Returns the limits of a profile.
    #[inline(always)]
    pub(super) fn new(profile: &Profile) -> Self {
        Self { max: f32x8::splat(profile.alpha_max), min: f32x8::splat(profile.alpha_min) }
    }

    /// Decides about the raw α of vector `v` by comparison, or as stored in `frozen`.
    #[inline(always)]
    pub(super) fn decide(self, raw: f32x8, frozen: Option<EntryMasks<'_>>, v: usize) -> Decided {
        let cap = self.max;
        match frozen {
            None => {
                let capped = Real::gt(raw, cap);
                let alpha = Real::select(capped, cap, raw);
                Decided { alpha, keep: Real::ge(alpha, self.min), capped }
            }
            Some(masks) => {
                let capped = byte_lanes(masks.cap[v]);
                // The plan of another program may mark as uncapped an α that exceeds the cap by rounding, and
                // 1 − α must stay away from 0.
                let free = Real::min(raw, f32x8::splat(0.5) * (cap + f32x8::splat(1.0)));
                Decided { alpha: Real::select(capped, cap, free), keep: byte_lanes(masks.alpha[v]), capped }
            }
        }
    }
}
