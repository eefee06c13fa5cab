//! The discrete decisions of a rendering, made once and stored: order, tile lists, emission slots.
//!
//! A **pair** is a Gaussian listed in a tile. Pairs are emitted camera by camera, in Gaussian order, and for
//! each Gaussian by tile in row-major order. The index in this order is the pair's **slot**, the position in
//! which its gradient record is summed. Tile lists contain the same pairs sorted by (tile, z, index); the
//! index in that order is the pair's **entry**.
//!
//! ```text
//! order         (V)       visible Gaussians of each camera by (z, index); camera_start (C+1) bounds them
//! tile_start    (C·TY·TX+1) bounds of each tile's list;  tile_entry (E) Gaussian index
//! entry_of_slot (E)       entry of each slot's pair;   slot_start (C·N+1) bounds of each Gaussian's slots
//! ```
//!
//! # Footprint
//! A pixel belongs to a splat if and only if α ≥ α_min, which `blend` tests. Tile lists and row spans only
//! skip pixels that this test would reject: they use the ellipse of Mahalanobis radius `cut`, enlarged by
//! more than every rounding error of the exponent (1e-3 plus 1e-6 of the splat's extent in its narrow unit).
//! Profile `inria` lists the tiles of its 3σ square instead.
//!
//! # Rounding
//! All values are integers except the ellipse bounds, which affect no result.

mod sort;
mod splat;

pub(crate) use splat::Ellipse;
pub use splat::{Bounds, Splat};

use crate::num::{order, par};
use crate::scene::profile::{Footprint, Profile};
use sort::depth_order;
use std::sync::atomic::{AtomicU32, Ordering};

/// Image size and tile grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Side of a tile in pixels.
    pub tile: usize,
}

impl Grid {
    /// Returns the number of tiles per row.
    pub fn tiles_x(&self) -> usize {
        self.width.div_ceil(self.tile)
    }
    /// Returns the number of rows of tiles.
    pub fn tiles_y(&self) -> usize {
        self.height.div_ceil(self.tile)
    }
    /// Returns the number of tiles of one image.
    pub fn tiles(&self) -> usize {
        self.tiles_x() * self.tiles_y()
    }
}

/// Discrete decisions of one rendering of C cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Visible Gaussians by (z, index), shape (V), cameras concatenated.
    pub order: Vec<u32>,
    /// Bounds of each camera in `order`, shape (C+1).
    pub camera_start: Vec<u32>,
    /// Bounds of each tile's list, shape (C·TY·TX+1).
    pub tile_start: Vec<u32>,
    /// Gaussian of each entry, shape (E).
    pub tile_entry: Vec<u32>,
    /// First slot of each Gaussian in each camera, shape (C·N+1).
    pub slot_start: Vec<u32>,
    /// Entry of each slot, shape (E).
    pub entry_of_slot: Vec<u32>,
}

impl Plan {
    /// Returns the slot of each entry (E), the inverse of `entry_of_slot`.
    pub fn entry_slot(&self) -> Vec<u32> {
        let mut out = vec![0; self.entry_of_slot.len()];
        for (slot, &entry) in self.entry_of_slot.iter().enumerate() {
            out[entry as usize] = slot as u32;
        }
        out
    }
}

/// Gaussians per task, a fixed number.
const CHUNK: usize = 1024;
/// Number of segments of the depth order that fill tile lists in parallel, a fixed number.
const SEGMENTS: usize = 16;

/// Appends the tiles of one Gaussian, in row-major order, to `tiles`.
fn list_tiles(s: &Splat, profile: &Profile, grid: &Grid, cull: bool, tiles: &mut Vec<u32>) {
    let (tx, ty) = (grid.tiles_x() as i32, grid.tiles_y() as i32);
    if !(s.bounds.r2 >= 0.0) && profile.footprint == Footprint::Alpha {
        return;
    }
    let e = Ellipse::new(s.shape, s.axis as u8);
    let side = grid.tile as f32;
    let [mx, my] = s.mean_px;
    // Tiles whose pixel centres (first at ½, last at side − ½) overlap the interval [lo, hi].
    let first = |lo: f32| order::clamp(((lo - (side - 0.5)) / side).ceil(), 0.0, 1e6) as i32;
    let last =
        |hi: f32, n: i32| order::min(order::clamp(((hi - 0.5) / side).floor(), -1.0, 1e6) as i32, n - 1);
    match profile.footprint {
        Footprint::Inria3Sigma => {
            // The rectangle of that program: its pixel positions are these minus ½, its tiles always 16 wide,
            // and its upper bound is rounded up by a complete tile.
            let r = e.inria_radius() as f32;
            let bound = |v: f32, n: i32| order::clamp((v / 16.0).trunc(), 0.0, n as f32) as i32;
            let inria_x = (grid.width as i32 + 15) / 16;
            let inria_y = (grid.height as i32 + 15) / 16;
            let (x0, x1) = (bound(mx - 0.5 - r, inria_x), bound(mx - 0.5 + r + 15.0, inria_x));
            let (y0, y1) = (bound(my - 0.5 - r, inria_y), bound(my - 0.5 + r + 15.0, inria_y));
            for y in y0..y1 {
                for x in x0..x1 {
                    tiles.push((y * tx + x) as u32);
                }
            }
        }
        Footprint::Alpha => {
            let r = s.bounds.r2.sqrt();
            let wide = r * e.xx.sqrt() + s.bounds.margin;
            let top = r * e.yy.sqrt() + s.bounds.margin;
            let tip = r * (e.xy / e.xx.sqrt());
            let (x_first, x_last) = (first(mx - wide), last(mx + wide, tx));
            let (y_first, y_last) = (first(my - top), last(my + top, ty));
            for y in y_first..=y_last {
                // A box of one tile, or of one row of tiles, has no corner tile that could be skipped.
                let (x0, x1) = if cull && x_first < x_last && y_first < y_last {
                    let (lo, hi) = (y as f32 * side + 0.5 - my, (y as f32 + 1.0) * side - 0.5 - my);
                    let (lo, hi) = (order::max(lo, -top), order::min(hi, top));
                    (
                        first(mx - s.bounds.reach(tip, lo, hi, -1.0)),
                        last(mx + s.bounds.reach(tip, lo, hi, 1.0), tx),
                    )
                } else {
                    (x_first, x_last)
                };
                for x in x0..=x1 {
                    tiles.push((y * tx + x) as u32);
                }
            }
        }
    }
}

/// Makes the plan of `cameras` images; `splats` is (C, N).
///
/// `cull` selects exact ellipses instead of bounding boxes for the tile lists; it affects no result.
pub fn build(splats: &[Splat], cameras: usize, grid: &Grid, profile: &Profile, cull: bool) -> Plan {
    let n = splats.len() / cameras.max(1);
    let mut plan =
        Plan { camera_start: vec![0], tile_start: vec![0], slot_start: vec![0], ..Plan::default() };
    for camera in 0..cameras {
        append_camera(&mut plan, &splats[camera * n..(camera + 1) * n], grid, profile, cull);
    }
    plan
}

fn append_camera(plan: &mut Plan, splats: &[Splat], grid: &Grid, profile: &Profile, cull: bool) {
    let n = splats.len();
    // 1. List the tiles of every Gaussian, in slot order.
    let chunks: Vec<(Vec<u32>, Vec<u32>)> = par::map(n.div_ceil(CHUNK), |c| {
        let rows = &splats[c * CHUNK..order::min((c + 1) * CHUNK, n)];
        let mut tiles = Vec::with_capacity(4 * rows.len());
        let ends = rows
            .iter()
            .map(|s| {
                if s.is_visible() {
                    list_tiles(s, profile, grid, cull, &mut tiles);
                }
                tiles.len() as u32
            })
            .collect();
        (tiles, ends)
    });
    let slot_base = plan.entry_of_slot.len() as u32;
    let mut base = slot_base;
    for (tiles, ends) in &chunks {
        plan.slot_start.extend(ends.iter().map(|e| base + e));
        base += tiles.len() as u32;
    }
    let pairs = (base - slot_base) as usize;
    let first_row = plan.slot_start.len() - 1 - n;
    let starts = &plan.slot_start[first_row..];
    let tiles_of = |g: usize| {
        let (tiles, ends) = &chunks[g / CHUNK];
        let from = if g.is_multiple_of(CHUNK) { 0 } else { ends[g % CHUNK - 1] as usize };
        &tiles[from..ends[g % CHUNK] as usize]
    };
    // 2. Sort by depth.
    let order = depth_order(splats);
    // 3. Count the pairs that each segment of the order puts into each tile.
    let len = order.len().div_ceil(SEGMENTS);
    let segment = |s: usize| &order[Ord::min(s * len, order.len())..Ord::min((s + 1) * len, order.len())];
    let mut cursors: Vec<Vec<u32>> = par::map(SEGMENTS, |s| {
        let mut count = vec![0_u32; grid.tiles()];
        for &g in segment(s) {
            for &t in tiles_of(g as usize) {
                count[t as usize] += 1;
            }
        }
        count
    });
    // 4. Compute the start of each segment in each tile.
    let entry_base = plan.tile_entry.len() as u32;
    let mut next = 0_u32;
    for t in 0..grid.tiles() {
        for cursor in &mut cursors {
            (cursor[t], next) = (next, next + cursor[t]);
        }
        plan.tile_start.push(entry_base + next);
    }
    // 5. Fill: every entry and every slot is written exactly once, so relaxed stores of integers suffice.
    let entries: Vec<AtomicU32> = zeroed(pairs);
    let of_slot: Vec<AtomicU32> = zeroed(pairs);
    par::each(cursors, |s, mut cursor| {
        for &g in segment(s) {
            let slot = (starts[g as usize] - slot_base) as usize;
            for (k, &t) in tiles_of(g as usize).iter().enumerate() {
                let at = cursor[t as usize];
                cursor[t as usize] += 1;
                entries[at as usize].store(g, Ordering::Relaxed);
                of_slot[slot + k].store(entry_base + at, Ordering::Relaxed);
            }
        }
    });
    append(&mut plan.tile_entry, entries);
    append(&mut plan.entry_of_slot, of_slot);
    plan.order.extend(order);
    plan.camera_start.push(plan.order.len() as u32);
}

/// Returns zeros in zeroed pages of the allocator, which are not written again.
fn zeroed(n: usize) -> Vec<AtomicU32> {
    vec![0_u32; n].into_iter().map(AtomicU32::new).collect()
}

/// Appends, without a copy if the target is empty.
fn append(to: &mut Vec<u32>, from: Vec<AtomicU32>) {
    let from: Vec<u32> = from.into_iter().map(AtomicU32::into_inner).collect();
    if to.is_empty() {
        *to = from;
    } else {
        to.extend(from);
    }
}
