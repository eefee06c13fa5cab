//! Tiles: their location, the rows that a splat can reach, and the split of images into vectors.
//!
//! A tile of side 8·H has H vectors of eight pixels per row; vector v = row·H + h. `blend` processes them.
//! Nothing here affects a result: [`spans`] only skips pixels that the test of α would reject.

use super::plan::{Grid, Plan, Splat};
use crate::num::lanes::{Real, f32x8};

/// Location of a tile in its image.
#[derive(Clone, Copy)]
pub(crate) struct Tile {
    /// Side in pixels.
    pub(crate) side: usize,
    /// Left edge in pixels.
    pub(crate) x0: usize,
    /// Upper edge in pixels.
    pub(crate) y0: usize,
    /// Number of columns inside the image.
    pub(crate) cols: usize,
    /// Number of rows inside the image.
    pub(crate) rows: usize,
    /// Pixel-centre x of each vector of a row.
    pub(crate) centers: [f32x8; 4],
    /// Pixel-centre y of row 0.
    top: f32,
}

impl Tile {
    pub(crate) fn new(grid: &Grid, index: usize) -> Self {
        let (x0, y0) = (index % grid.tiles_x() * grid.tile, index / grid.tiles_x() * grid.tile);
        Self {
            side: grid.tile,
            x0,
            y0,
            cols: Ord::min(grid.tile, grid.width - x0),
            rows: Ord::min(grid.tile, grid.height - y0),
            centers: std::array::from_fn(|h| f32x8::from_fn(|l| (x0 + 8 * h + l) as f32 + 0.5)),
            top: y0 as f32 + 0.5,
        }
    }

    /// Returns the pixel-centre y of row `r`, which is exact because image sides are below 2²³.
    #[inline(always)]
    pub(crate) fn center_y(&self, r: usize) -> f32 {
        self.top + r as i32 as f32
    }

    /// Returns the mask of the lanes of vector `h` that are inside the image.
    pub(crate) fn inside(&self, h: usize, row: usize) -> f32x8 {
        let n = if row < self.rows { self.cols } else { 0 };
        Real::lt(f32x8::from_fn(|l| (8 * h + l) as f32), f32x8::splat(n as f32))
    }
}

/// Returns the rows of each vector column that can contain a pixel with α ≥ α_min, one bit per row.
#[inline(always)]
pub(crate) fn spans<const H: usize>(s: &Splat, tile: &Tile, cull: bool) -> [u32; H] {
    let all = [u32::MAX >> (32 - tile.rows); H];
    if !cull {
        return all;
    }
    let e = &s.bounds;
    let c = f32x8::splat;
    let mut out = [0_u32; H];
    let rel = s.mean_px[0] - tile.x0 as f32; // centre relative to the tile's left edge
    for group in 0..H {
        let dy = f32x8::from_fn(|l| tile.center_y(8 * group + l)) - c(s.mean_px[1]);
        let left = c(e.r2) - (dy * dy) * c(e.inv_yy);
        let reach = (Real::max(left, c(0.0)) * c(e.half2)).sqrt() + c(e.margin);
        let mid = c(rel) + c(e.slope) * dy;
        let (lo, hi) = (mid - reach, mid + reach);
        let open = Real::ge(left, c(0.0));
        for (h, rows) in out.iter_mut().enumerate() {
            let first = c(8.0 * h as f32 + 0.5);
            let meets = <f32x8 as Real>::and(Real::le(lo, first + c(7.0)), Real::ge(hi, first));
            *rows |= <f32x8 as Real>::bits(<f32x8 as Real>::and(open, meets)) << (8 * group);
        }
    }
    for rows in &mut out {
        *rows &= all[0];
    }
    out
}

/// Loads the part of a (H, W) plane in a tile as vectors; lanes outside the image are `outside`.
pub(crate) fn load_plane<const H: usize, const V: usize>(
    plane: &[f32],
    tile: &Tile,
    grid: &Grid,
    outside: f32,
) -> [f32x8; V] {
    let mut out = [f32x8::splat(outside); V];
    for r in 0..tile.rows {
        let row = &plane[(tile.y0 + r) * grid.width + tile.x0..][..tile.cols];
        for h in 0..H {
            if let Some(full) = row.get(8 * h..8 * h + 8) {
                out[r * H + h] = f32x8::new(full.try_into().expect("the slice has eight pixels"));
            } else if 8 * h < row.len() {
                out[r * H + h] = f32x8::from_fn(|l| row.get(8 * h + l).copied().unwrap_or(outside));
            }
        }
    }
    out
}

/// Splits a buffer with one element per entry into the lists of the tiles; an empty buffer gives empty parts.
pub(crate) fn split_entries<'a, T>(plan: &Plan, mut rest: &'a mut [T]) -> Vec<&'a mut [T]> {
    let filled = !rest.is_empty();
    let length = |pair: &[u32]| if filled { (pair[1] - pair[0]) as usize } else { 0 };
    plan.tile_start
        .windows(2)
        .map(|pair| {
            let (part, tail) = std::mem::take(&mut rest).split_at_mut(length(pair));
            rest = tail;
            part
        })
        .collect()
}

/// Loads the three channels of a (H, W, 3) image in a tile; lanes outside are 0.
pub(crate) fn load_image(image: &[f32], tile: &Tile, grid: &Grid, bar: &mut [[f32x8; 32]; 4]) {
    for r in 0..tile.rows {
        let row = image[3 * ((tile.y0 + r) * grid.width + tile.x0)..][..3 * tile.cols].as_chunks::<3>().0;
        for h in 0..2 {
            let part = row.get(8 * h..).unwrap_or(&[]);
            for (c, plane) in bar.iter_mut().take(3).enumerate() {
                plane[2 * r + h] = f32x8::from_fn(|l| part.get(l).map_or(0.0, |p| p[c]));
            }
        }
    }
}
