//! `splat.blend`: composites projected splats into images front to back, tile by tile.
//!
//! C = Σᵢ Tᵢ αᵢ cᵢ + T_end b,  T₀ = 1,  Tᵢ₊₁ = Tᵢ (1 − αᵢ)   (3DGS 2023, eq. 3)
//! αᵢ = min(α_max, oᵢ exp(−½ (w1² + w2²))),  w1 = d_p k1,  w2 = (d_q − s d_p) k2,  d = pixel centre − u
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | u, (s,k1,k2), p, o, c, z | [`Splat`] | (C, N) | see [`super::plan`] |
//! | b | `background` | (3) | sRGB-encoded |
//! | C | `image` | (C, H, W, 3) | sRGB-encoded, not clamped |
//! | 1 − T_end | `alpha` | (C, H, W) | 0..1 |
//! | Σ T α z | `depth` | (C, H, W) | scene units, alpha-weighted, no background |
//!
//! Splats with α < α_min are skipped. The profile defines where the traversal of the list ends
//! ([`Stop`](crate::scene::profile::Stop)). T_end and the list index of the last included splat are saved per
//! pixel.
//!
//! This file splits the images into tiles and writes the tiles back. `walk` processes the list of one tile,
//! `column` is the inner loop over its pixels, `alpha` computes α, `record` converts sums to gradients, and
//! `state` contains their shared state.
//!
//! # Rounding
//! w1² + w2², then times −½; [`exp_lanes`](crate::num::elem::exp_lanes); T·α, then weight·colour added to the
//! sum: left folds over the list, per pixel. The background is added last. Lanes are pixels, so no bit
//! depends on tile size, culling or vector width.
//!
//! Adjoint: there is one record per (splat, tile). For each of 16 columns a left fold over the rows from +0
//! (with pivot x, w1 is a constant of the column and multiplies the column's sums ΣP, ΣPw1, ΣPw2 afterwards),
//! then columns folded 16→8→4→2→1 (l += l+w); records of a splat are summed in slot order in f64 and rounded
//! once.
//!
//! # Kinks and domain
//! There are kinks at α_min (a jump of T·(c−B)/255), at the cap (gradient 0 above it, the uncapped branch at
//! equality; `inria_bwd` passes the gradient), and at the stop. All are decisions in the plan. o is in 0..1;
//! α ≤ α_max < 1 keeps 1 − α away from 0.
//!
//! # Adjoint
//! The list is traversed back to front from T_end: T ← T/(1−α) (relative error 7e-7 at worst). With the
//! pixel's cotangents combined into one number, e = c·C̄ + z·D̄ + Ā: ᾱ = T (e − S), S ← α e + (1−α) S, where
//! S starts at b·C̄. S is the cotangent of everything behind the splat, so there is no division by a small
//! number. With P = ᾱ α, the sums of P, P w1, P w2, P w1², P w1 w2, P w2², T α C̄, T α D̄ over the pixels
//! form the record, and ō = ΣP/o, k̄1 = −ΣPw1²/k1, k̄2 = −ΣPw2²/k2, s̄ = (k2/k1) ΣPw1w2,
//! ū_p = k1 ΣPw1 − s k2 ΣPw2, ū_q = k2 ΣPw2.
//!
//! Twin: `reference::splat::blend`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::scene::profile::Profile;
//! use lastlight::splat::blend::{In, Out, Saved, forward};
//! use lastlight::splat::plan::{Grid, Splat, build};
//! use lastlight::splat::project::cut_radius;
//! let (profile, grid) = (Profile::EXACT, Grid { width: 1, height: 1, tile: 16 });
//! let cut = cut_radius(0.5, profile.alpha_min);
//! let red = Splat::new([0.5, 0.5], [0.0, 1.0, 1.0], 0, 1.0, 0.5, [1.0, 0.0, 0.0], cut);
//! let green = Splat { z: 2.0, color: [0.0, 1.0, 0.0], ..red };
//! let splats = [green, red];
//! let plan = build(&splats, 1, &grid, &profile, true);
//! let background = [0.0, 0.0, 1.0];
//! let x = In {
//!     splats: &splats,
//!     n: 2,
//!     plan: &plan,
//!     grid,
//!     profile: &profile,
//!     background,
//!     cull: true,
//!     frozen: None,
//! };
//! let (mut out, mut saved) = (Out::default(), Saved::default());
//! forward(&x, &mut out, &mut saved);
//! // α = ½ for both: the weights are ½ for red (z = 1), ¼ for green (z = 2) and ¼ for the background
//! assert_eq!(out.image, [0.5, 0.25, 0.25]);
//! assert_eq!((out.alpha[0], out.depth[0]), (0.75, 1.0)); // 1 − ¼ and ½·1 + ¼·2
//! ```

mod alpha;
mod column;
mod record;
mod state;
mod walk;

pub use alpha::{FrozenMasks, raw_alpha, whiten};
pub use record::{RECORD, Record, SplatBar, gather_records};

use super::plan::{Grid, Plan, Splat};
use super::tile::{Tile, load_image, load_plane, split_entries};
use crate::num::lanes::f32x8;
use crate::num::{par, sum};
use crate::scene::profile::Profile;
use state::{AdjointState, TileIn, VECTORS};
use std::ops::Range;
use walk::{RecordSums, tile_adjoint, tile_forward};

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Projected splats, shape (C, N).
    pub splats: &'a [Splat],
    /// Number of Gaussians, N.
    pub n: usize,
    /// Depth order and tile lists of these splats.
    pub plan: &'a Plan,
    /// Image size, and the tiles of the plan.
    pub grid: Grid,
    /// Profile with the constants of the renderer.
    pub profile: &'a Profile,
    /// Background b, shape (3), sRGB-encoded.
    pub background: [f32; 3],
    /// Whether rows are skipped by exact ellipses; this affects no result.
    pub cull: bool,
    /// Stored decisions that replace new ones; they require tiles of side 16.
    pub frozen: Option<FrozenMasks<'a>>,
}

/// Images of C cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Shape (C, H, W, 3).
    pub image: Vec<f32>,
    /// Shape (C, H, W).
    pub alpha: Vec<f32>,
    /// Shape (C, H, W).
    pub depth: Vec<f32>,
}

/// Cotangents of [`Out`]; `None` means zero.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutBar<'a> {
    /// Shape (C, H, W, 3).
    pub image: Option<&'a [f32]>,
    /// Shape (C, H, W).
    pub alpha: Option<&'a [f32]>,
    /// Shape (C, H, W).
    pub depth: Option<&'a [f32]>,
}

/// Per-pixel values that the adjoint needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Transmittance behind the last splat, shape (C, H, W).
    pub final_t: Vec<f32>,
    /// Index of the last included splat in the tile's list, shape (C, H, W), −1 = none. It is exact in f32
    /// below 2²⁴.
    pub last_index: Vec<f32>,
    /// Rows that were processed, shape (E), one bit each, for the left and right half of a 16×16 tile; in
    /// other rows the splat is not included. Empty for other tile sides.
    pub rows: Vec<[u16; 2]>,
}

impl<'a> In<'a> {
    /// Returns the number of pixels of one image.
    fn pixels(&self) -> usize {
        self.grid.width * self.grid.height
    }

    /// Returns the range of entries of tile `at` of all C·TY·TX.
    fn entries(&self, at: usize) -> Range<usize> {
        self.plan.tile_start[at] as usize..self.plan.tile_start[at + 1] as usize
    }

    /// Returns the camera of tile `at`.
    fn camera(&self, at: usize) -> usize {
        at / self.grid.tiles()
    }

    /// Returns the inputs of tile `at`.
    fn tile(&self, at: usize) -> TileIn<'a> {
        let (camera, entries) = (self.camera(at), self.entries(at));
        TileIn {
            tile: Tile::new(&self.grid, at % self.grid.tiles()),
            splats: &self.splats[camera * self.n..(camera + 1) * self.n],
            list: &self.plan.tile_entry[entries.clone()],
            profile: self.profile,
            cull: self.cull && self.frozen.is_none(),
            masks: self.frozen.map(|f| f.tile(entries)),
        }
    }

    /// Returns the vectors of a 16×16 tile from an array (C, H, W).
    fn load(&self, array: &[f32], at: usize, tile: &Tile, outside: f32) -> [f32x8; VECTORS] {
        let (camera, pixels) = (self.camera(at), self.pixels());
        load_plane::<2, VECTORS>(&array[camera * pixels..(camera + 1) * pixels], tile, &self.grid, outside)
    }
}

/// Renders C images; `out` and `saved` are resized as required.
pub fn forward(x: &In<'_>, out: &mut Out, saved: &mut Saved) {
    let cameras = x.plan.camera_start.len() - 1;
    assert!(x.frozen.is_none() || x.grid.tile == 16, "stored masks require tiles of side 16");
    assert_eq!(x.splats.len(), cameras * x.n, "splats have the shape (C, N)");
    out.image.resize(cameras * x.pixels() * 3, 0.0);
    for plane in [&mut out.alpha, &mut out.depth, &mut saved.final_t, &mut saved.last_index] {
        plane.resize(cameras * x.pixels(), 0.0);
    }
    saved.rows.resize(if x.grid.tile == 16 { x.plan.tile_entry.len() } else { 0 }, [0; 2]);
    let tiles_x = x.grid.tiles_x();
    par::each(bands(x, out, saved), |b, mut band| {
        let run = |i: usize, rows: &mut [[u16; 2]]| {
            let at = b * tiles_x + i;
            let tile = x.tile(at);
            let lines = match x.grid.tile {
                8 => tile_forward::<1, 8>(&tile, None, rows).finish(x.background),
                16 => {
                    let last = x.frozen.map(|f| x.load(f.last_index, at, &tile.tile, -1.0));
                    tile_forward::<2, VECTORS>(&tile, last.as_ref(), rows).finish(x.background)
                }
                32 => tile_forward::<4, 128>(&tile, None, rows).finish(x.background),
                other => unreachable!("tile side {other}: settings allow 8, 16 and 32"),
            };
            (tile.tile, lines)
        };
        for (tile, lines) in par::map_each(std::mem::take(&mut band.rows), run) {
            band.store(&tile, &lines, x.grid.width);
        }
    });
}

/// One row of tiles in every output.
struct Band<'a> {
    image: &'a mut [f32],
    alpha: &'a mut [f32],
    depth: &'a mut [f32],
    final_t: &'a mut [f32],
    last_index: &'a mut [f32],
    /// Rows of the entries of each tile.
    rows: Vec<&'a mut [[u16; 2]]>,
}

/// Splits the outputs into rows of tiles, camera by camera.
fn bands<'a>(x: &In<'_>, out: &'a mut Out, saved: &'a mut Saved) -> Vec<Band<'a>> {
    let (pixels, row) = (x.pixels(), x.grid.width * x.grid.tile);
    let mut rows = split_entries(x.plan, &mut saved.rows).into_iter();
    let mut bands = Vec::new();
    // The rows of tiles restart with every camera, so the images are split one by one.
    let images = out
        .image
        .chunks_mut(pixels * 3)
        .zip(out.alpha.chunks_mut(pixels).zip(out.depth.chunks_mut(pixels)))
        .zip(saved.final_t.chunks_mut(pixels).zip(saved.last_index.chunks_mut(pixels)));
    for ((image, (alpha, depth)), (final_t, last)) in images {
        let parts = image
            .chunks_mut(row * 3)
            .zip(alpha.chunks_mut(row).zip(depth.chunks_mut(row)))
            .zip(final_t.chunks_mut(row).zip(last.chunks_mut(row)));
        for ((image, (alpha, depth)), (final_t, last_index)) in parts {
            let rows = rows.by_ref().take(x.grid.tiles_x()).collect();
            bands.push(Band { image, alpha, depth, final_t, last_index, rows });
        }
    }
    bands
}

impl Band<'_> {
    /// Writes the completed vectors of a tile; `width` is that of the image.
    fn store(&mut self, tile: &Tile, lines: &[[f32x8; 6]], width: usize) {
        let h_count = lines.len() / tile.side;
        for r in 0..tile.rows {
            for h in 0..h_count {
                let [red, green, blue, depth, t, last] = lines[r * h_count + h].map(f32x8::to_array);
                for l in 0..Ord::min(8, tile.cols.saturating_sub(8 * h)) {
                    let at = r * width + tile.x0 + 8 * h + l;
                    self.image[3 * at..3 * at + 3].copy_from_slice(&[red[l], green[l], blue[l]]);
                    self.alpha[at] = 1.0 - t[l];
                    self.depth[at] = depth[l];
                    self.final_t[at] = t[l];
                    self.last_index[at] = last[l];
                }
            }
        }
    }
}

/// Traverses C images back to front: writes one record per entry to `records` and returns the gradient of the
/// background.
///
/// Requires tiles of side 16. `absgrad` also computes the sums of |ū|.
pub fn adjoint(
    x: &In<'_>,
    saved: &Saved,
    out_bar: OutBar<'_>,
    absgrad: bool,
    records: &mut Vec<Record>,
) -> [f32; 3] {
    assert_eq!(x.grid.tile, 16, "gradients require tiles of side 16");
    records.resize(x.plan.tile_entry.len(), [0.0; RECORD]);
    let sums = RecordSums { depth: out_bar.depth.is_some() || out_bar.alpha.is_some(), abs: absgrad };
    par::each(split_entries(x.plan, records), |at, part| {
        let tile = x.tile(at);
        let state = adjoint_state(x, at, &tile.tile, saved, out_bar);
        tile_adjoint(&tile, &saved.rows[x.entries(at)], state, sums, part);
    });
    background_adjoint(saved, out_bar.image)
}

/// Returns the state of tile `at` behind its last splats: T_end, and S = b·C̄.
fn adjoint_state(x: &In<'_>, at: usize, tile: &Tile, saved: &Saved, out_bar: OutBar<'_>) -> AdjointState {
    let (camera, pixels) = (x.camera(at), x.pixels());
    let b = x.background.map(f32x8::splat);
    let zero = [f32x8::splat(0.0); VECTORS];
    let mut bar = [zero; 4];
    if let Some(image) = out_bar.image {
        load_image(&image[camera * pixels * 3..(camera + 1) * pixels * 3], tile, &x.grid, &mut bar);
    }
    if let Some(depth) = out_bar.depth {
        bar[3] = x.load(depth, at, tile, 0.0);
    }
    AdjointState {
        alpha_bar: out_bar.alpha.map_or(zero, |a| x.load(a, at, tile, 0.0)),
        behind: std::array::from_fn(|v| (b[0] * bar[0][v] + b[1] * bar[1][v]) + b[2] * bar[2][v]),
        bar,
        t: x.load(&saved.final_t, at, tile, 1.0),
        last: x.load(&saved.last_index, at, tile, -1.0),
    }
}

/// Returns b̄ = Σ T_end C̄: blocks of 4096 pixels in f64, a left fold each, then the pairwise tree.
fn background_adjoint(saved: &Saved, image_bar: Option<&[f32]>) -> [f32; 3] {
    const RUN: usize = 4096;
    let Some(image) = image_bar else { return [0.0; 3] };
    let parts = par::map(saved.final_t.len().div_ceil(RUN), |i| {
        let (t, g) = (&saved.final_t[i * RUN..], &image[3 * i * RUN..]);
        t.iter().zip(g.as_chunks::<3>().0).take(RUN).fold([0.0_f64; 3], |total, (&t, g)| {
            std::array::from_fn(|c| total[c] + f64::from(t) * f64::from(g[c]))
        })
    });
    std::array::from_fn(|c| sum::tree(parts.iter().map(|p: &[f64; 3]| p[c]).collect()) as f32)
}
