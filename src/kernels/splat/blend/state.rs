//! Inputs of the traversal of one tile, and the state of its pixels from splat to splat.

use super::alpha::{EntryMasks, TileMasks};
use crate::num::lanes::{Real, f32x8};
use crate::scene::profile::Profile;
use crate::splat::plan::Splat;
use crate::splat::tile::Tile;

/// Inputs of one tile.
pub(super) struct TileIn<'a> {
    /// Location of the tile.
    pub(super) tile: Tile,
    /// Splats of its camera, shape (N).
    pub(super) splats: &'a [Splat],
    /// List of the tile: indices of the entries into `splats`, nearest first.
    pub(super) list: &'a [u32],
    /// Profile with the constants of the renderer.
    pub(super) profile: &'a Profile,
    /// Whether rows are skipped by exact ellipses.
    pub(super) cull: bool,
    /// Stored decisions of the entries.
    pub(super) masks: Option<TileMasks<'a>>,
}

/// One entry of a tile's list.
#[derive(Clone, Copy)]
pub(super) struct Entry<'a> {
    /// Index in the list.
    pub(super) k: usize,
    /// The splat of the entry.
    pub(super) splat: &'a Splat,
    /// Stored decisions of the entry.
    pub(super) masks: Option<EntryMasks<'a>>,
}

impl<'a> TileIn<'a> {
    /// Returns entry `k` of the list.
    #[inline(always)]
    pub(super) fn entry(&self, k: usize) -> Entry<'a> {
        Entry { k, splat: &self.splats[self.list[k] as usize], masks: self.masks.map(|m| m.entry(k)) }
    }
}

impl Entry<'_> {
    /// Returns the pivot axis as an index: 0 = x, 1 = y.
    #[inline(always)]
    pub(super) fn axis(self) -> usize {
        self.splat.axis as usize
    }
}

/// State of one tile in the forward pass, with V vectors.
pub(super) struct ForwardState<const V: usize> {
    /// Sums Σ T α c per channel, and Σ T α z.
    pub(super) sums: [[f32x8; V]; 4],
    /// Transmittance T.
    pub(super) t: [f32x8; V],
    /// List index of the last included splat, plus one.
    pub(super) last: [f32x8; V],
    /// Mask of the pixels whose traversal continues; rule `AFTER` compares `t` instead.
    pub(super) live: [f32x8; V],
}

impl<const V: usize> ForwardState<V> {
    /// Returns the state before the first splat, with H vectors per row: T = 1 inside the image, 0 outside.
    #[inline(always)]
    pub(super) fn new<const H: usize>(tile: &Tile) -> Self {
        let (zero, one) = (f32x8::splat(0.0), f32x8::splat(1.0));
        let mut state = Self { sums: [[zero; V]; 4], t: [zero; V], last: [zero; V], live: [zero; V] };
        for v in 0..V {
            let inside = tile.inside(v % H, v / H);
            state.t[v] = Real::select(inside, one, zero);
            state.live[v] = inside;
        }
        state
    }

    /// Returns, per vector, r, g, b over the background, depth, T, and last index.
    pub(super) fn finish(&self, background: [f32; 3]) -> Vec<[f32x8; 6]> {
        let b = background.map(f32x8::splat);
        (0..V)
            .map(|v| {
                let t = self.t[v];
                let over = |c: usize| self.sums[c][v] + t * b[c];
                [over(0), over(1), over(2), self.sums[3][v], t, self.last[v] - f32x8::splat(1.0)]
            })
            .collect()
    }
}

/// Number of vectors of a 16×16 tile.
pub(super) const VECTORS: usize = 32;

/// State of one 16×16 tile in the backward pass.
pub(super) struct AdjointState {
    /// Cotangents C̄ per channel, and D̄.
    pub(super) bar: [[f32x8; VECTORS]; 4],
    /// Cotangent Ā.
    pub(super) alpha_bar: [f32x8; VECTORS],
    /// Transmittance T behind the splats that remain to be processed.
    pub(super) t: [f32x8; VECTORS],
    /// S, the cotangent of everything behind them.
    pub(super) behind: [f32x8; VECTORS],
    /// List index of the last included splat, −1 = none.
    pub(super) last: [f32x8; VECTORS],
}
