//! Blends projected splats into pictures, nearest first, tile by tile.
//!
//! C = Σᵢ Tᵢ αᵢ cᵢ + T_end b,  T₀ = 1,  Tᵢ₊₁ = Tᵢ (1 − αᵢ)                                  (3DGS 2023, eq. 3)
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
//! Skipped: α < α_min. The walk ends as the profile says ([`Stop`]). Saved per pixel: T_end and the list index of the
//! last splat included.
//!
//! # Rounding
//! w1² + w2² then times −½; [`exp_lanes`]; T·α, then weight·colour added to the sum: left folds over the list, per pixel.
//! The background is added last. Lanes are pixels, so no bit depends on tile size, culling or vector width.
//! Adjoint: per (splat, tile) one record: for each of 16 columns a left fold over the rows from +0 (with pivot x, w1 is
//! a constant of the column and multiplies the column's sums ΣP, ΣPw1, ΣPw2 afterwards), columns folded 16→8→4→2→1
//! (l += l+w); records of a splat are summed in slot order in f64 and rounded once.
//!
//! # Kinks and domain
//! α at α_min (a jump of T·(c−B)/255), the cap (gradient 0 above it, free branch at equality; `inria_bwd` lets it
//! through), the stop. All are decisions in the plan. o in 0..1; α ≤ α_max < 1 keeps 1 − α away from 0.
//!
//! # Adjoint
//! Back to front from T_end: T ← T/(1−α) (relative error 7e-7 at worst), and with the pixel's cotangents folded into one
//! number, e = c·C̄ + z·D̄ + Ā: ᾱ = T (e − S), S ← α e + (1−α) S, S starting at b·C̄. S is the cotangent of what lies
//! behind, so nothing is divided by a small number. Then P = ᾱ α and sums of P, P w1, P w2, P w1², P w1 w2, P w2²,
//! T α C̄, T α D̄ over the pixels make the record, and ō = ΣP/o, k̄1 = −ΣPw1²/k1, k̄2 = −ΣPw2²/k2, s̄ = (k2/k1) ΣPw1w2,
//! ū_p = k1 ΣPw1 − s k2 ΣPw2, ū_q = k2 ΣPw2.
//!
//! Twin: `reference::splat::blend`.

use super::plan::{Grid, Plan, Splat};
use super::tile::{Tile, load_image, load_plane, spans, split_entries};
use crate::num::elem::exp_lanes;
use crate::num::lanes::{Real, f32x8};
use crate::num::{par, sum};
use crate::scene::profile::{Profile, Stop};

/// Pictures of C cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// (C, H, W, 3)
    pub image: Vec<f32>,
    /// (C, H, W)
    pub alpha: Vec<f32>,
    /// (C, H, W)
    pub depth: Vec<f32>,
}

/// Cotangents of [`Out`]; `None` is zero.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutBar<'a> {
    /// (C, H, W, 3)
    pub image: Option<&'a [f32]>,
    /// (C, H, W)
    pub alpha: Option<&'a [f32]>,
    /// (C, H, W)
    pub depth: Option<&'a [f32]>,
}

/// What the adjoint needs of every pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// (C, H, W) transmittance behind the last splat.
    pub final_t: Vec<f32>,
    /// (C, H, W) index in the tile's list of the last splat included, −1 = none. Exact in f32 below 2²⁴.
    pub last_index: Vec<f32>,
    /// (E) rows that were walked, one bit each, left and right half of a 16×16 tile: outside of them the splat is
    /// included nowhere. Empty for other tile sides.
    pub rows: Vec<[u16; 2]>,
}

/// Decisions per pair and pixel to follow instead of making them: (E, 32) bytes, bit 16·row + column. Tiles of 16.
#[derive(Clone, Copy, Debug)]
pub struct FrozenMasks<'a> {
    /// (C, H, W)
    pub last_index: &'a [f32],
    /// (E, 32)
    pub alpha: &'a [[u8; 32]],
    /// (E, 32)
    pub cap: &'a [[u8; 32]],
}

impl<'a> FrozenMasks<'a> {
    /// The masks of one tile's entries.
    fn tile(&self, entries: std::ops::Range<usize>) -> TileMasks<'a> {
        TileMasks { alpha: &self.alpha[entries.clone()], cap: &self.cap[entries] }
    }
}

/// [`FrozenMasks`] of one tile's entries.
#[derive(Clone, Copy)]
struct TileMasks<'a> {
    alpha: &'a [[u8; 32]],
    cap: &'a [[u8; 32]],
}

impl<'a> TileMasks<'a> {
    /// (α mask, cap mask) of entry `k` of the tile.
    #[inline(always)]
    fn entry(self, k: usize) -> (&'a [u8; 32], &'a [u8; 32]) {
        (&self.alpha[k], &self.cap[k])
    }
}

/// Numbers in one gradient record: P, Pw1, Pw2, Pw1², Pw1w2, Pw2², r, g, b, z, |ū_x|, |ū_y|.
pub const RECORD: usize = 12;

/// One splat's numbers in lanes, for one vector column of a tile.
struct Column {
    dx: f32x8,
    my: f32,
    s: f32x8,
    k1: f32x8,
    k2: f32x8,
    opacity: f32x8,
}

impl Column {
    #[inline(always)]
    fn new(s: &Splat, centers: f32x8) -> Self {
        let c = f32x8::splat;
        let [sh, k1, k2] = s.shape;
        Self {
            dx: centers - c(s.mean_px[0]),
            my: s.mean_px[1],
            s: c(sh),
            k1: c(k1),
            k2: c(k2),
            opacity: c(s.opacity),
        }
    }

    /// (w1, w2) of a row.
    #[inline(always)]
    fn whitened<const X: bool>(&self, center_y: f32) -> (f32x8, f32x8) {
        let dy = f32x8::splat(center_y - self.my);
        let (dp, dq) = if X { (self.dx, dy) } else { (dy, self.dx) };
        whiten(dp, dq, [self.s, self.k1, self.k2])
    }
}

/// (w1, w2) of a pixel at (d_p, d_q) from the centre.
#[inline(always)]
pub fn whiten<L: Real>(dp: L, dq: L, [s, k1, k2]: [L; 3]) -> (L, L) {
    (dp * k1, (dq - s * dp) * k2)
}

/// o·exp(−½(w1² + w2²)), not yet capped: the one place where α is formed, forward, adjoint and masks alike.
#[inline(always)]
pub fn raw_alpha<L: Real>(opacity: L, (w1, w2): (L, L)) -> L {
    opacity * exp_lanes((w1 * w1 + w2 * w2) * L::splat(-0.5))
}

/// Lanes of one byte of a stored mask.
#[inline(always)]
fn byte_lanes(byte: u8) -> f32x8 {
    Real::gt(f32x8::from_fn(|l| f32::from(byte >> l & 1)), f32x8::splat(0.5))
}

/// What happens to a raw α: (capped α, lanes kept, lanes capped), made here or read from stored masks.
#[inline(always)]
fn decide(
    raw: f32x8,
    profile: &Profile,
    frozen: Option<(&[u8; 32], &[u8; 32])>,
    byte: usize,
) -> (f32x8, f32x8, f32x8) {
    let cap = f32x8::splat(profile.alpha_max);
    match frozen {
        None => {
            let capped = Real::gt(raw, cap);
            let alpha = Real::select(capped, cap, raw);
            (alpha, Real::ge(alpha, f32x8::splat(profile.alpha_min)), capped)
        }
        Some((keep, cap_bits)) => {
            let capped = byte_lanes(cap_bits[byte]);
            // A plan of another program may leave a raw α uncapped; rounding apart it lies below the cap, and 1 − α must
            // stay away from 0.
            let free = Real::min(raw, f32x8::splat(0.5) * (cap + f32x8::splat(1.0)));
            (Real::select(capped, cap, free), byte_lanes(keep[byte]), capped)
        }
    }
}

/// State of one tile in the forward walk; V = 8·H·H vectors, row by row.
struct Forward<const V: usize> {
    sums: [[f32x8; V]; 4], // r, g, b, depth
    t: [f32x8; V],
    /// list index of the last splat included, plus one
    last: [f32x8; V],
    /// lanes still walking; `Stop::After` reads it off `t` instead
    live: [f32x8; V],
}

/// Blends one tile of H vectors a row, V vectors in all. `frozen` (α masks, cap masks, last indices) needs H = 2.
/// `walked` is per entry, or empty where nobody asks.
fn tile_forward<const H: usize, const V: usize>(
    splats: &[Splat],
    list: &[u32],
    tile: &Tile,
    profile: &Profile,
    cull: bool,
    frozen: Option<(TileMasks<'_>, [f32x8; V])>,
    walked: &mut [[u16; 2]],
) -> Forward<V> {
    let (zero, one) = (f32x8::splat(0.0), f32x8::splat(1.0));
    let mut out = Forward { sums: [[zero; V]; 4], t: [zero; V], last: [zero; V], live: [zero; V] };
    for v in 0..V {
        let inside = tile.inside(v % H, v / H);
        out.t[v] = Real::select(inside, one, zero);
        out.live[v] = inside;
    }
    let mut alive = [u32::MAX >> (32 - tile.rows); H];
    for (h, rows) in alive.iter_mut().enumerate() {
        if 8 * h >= tile.cols {
            *rows = 0;
        }
    }
    let frozen_last = frozen.as_ref().map(|f| &f.1);
    let rule = match (frozen_last, profile.stop) {
        (Some(_), _) => FROZEN,
        (None, Stop::After) => AFTER,
        (None, Stop::Before) => BEFORE,
        (None, Stop::BeforeStrict) => BEFORE_STRICT,
        (None, Stop::Never) => NEVER,
    };
    let walk = match rule {
        FROZEN => [column_forward::<true, FROZEN, H, V>, column_forward::<false, FROZEN, H, V>],
        AFTER => [column_forward::<true, AFTER, H, V>, column_forward::<false, AFTER, H, V>],
        BEFORE => [column_forward::<true, BEFORE, H, V>, column_forward::<false, BEFORE, H, V>],
        BEFORE_STRICT => {
            [column_forward::<true, BEFORE_STRICT, H, V>, column_forward::<false, BEFORE_STRICT, H, V>]
        }
        _ => [column_forward::<true, NEVER, H, V>, column_forward::<false, NEVER, H, V>],
    };
    // spans a batch ahead of the walk: their latency overlaps, and the splats are in cache when they are blended
    let mut ahead = [[0_u32; H]; BATCH];
    for (batch, part) in list.chunks(BATCH).enumerate() {
        if alive == [0; H] {
            if let Some(rest) = walked.get_mut(batch * BATCH..) {
                rest.fill([0; 2]); // nothing behind an opaque tile is walked
            }
            break;
        }
        for (rows, &g) in ahead.iter_mut().zip(part) {
            *rows = spans::<H>(&splats[g as usize], tile, cull && frozen.is_none());
            for h in 0..H {
                rows[h] &= alive[h];
            }
        }
        for (rows_of, (i, &g)) in ahead.iter().zip(part.iter().enumerate()) {
            let k = batch * BATCH + i;
            let s = &splats[g as usize];
            let masks = frozen.as_ref().map(|f| f.0.entry(k));
            let column = walk[s.axis as usize];
            for h in 0..H {
                if rows_of[h] != 0 {
                    column(s, h, rows_of[h], k, tile, profile, masks, frozen_last, &mut out);
                }
            }
            if let Some(entry) = walked.get_mut(k) {
                *entry = [rows_of[0] as u16, rows_of[H - 1] as u16];
            }
        }
        if frozen.is_none() {
            for v in 0..V {
                let live = if rule == AFTER {
                    Real::gt(out.t[v], f32x8::splat(profile.t_stop))
                } else {
                    out.live[v]
                };
                alive[v % H] &= !(u32::from(<f32x8 as Real>::bits(live) == 0) << (v / H));
            }
        }
    }
    out
}

/// Splats whose row spans are worked out together.
const BATCH: usize = 16;

// how a walk ends, as constants so that the loop is compiled once for each
const AFTER: u8 = 0;
const BEFORE: u8 = 1;
const BEFORE_STRICT: u8 = 2;
const NEVER: u8 = 3;
const FROZEN: u8 = 4;

/// One splat over one vector column.
fn column_forward<const X: bool, const RULE: u8, const H: usize, const V: usize>(
    s: &Splat,
    h: usize,
    mut rows: u32,
    k: usize,
    tile: &Tile,
    profile: &Profile,
    masks: Option<(&[u8; 32], &[u8; 32])>,
    frozen_last: Option<&[f32x8; V]>,
    out: &mut Forward<V>,
) {
    let one = f32x8::splat(1.0);
    let t_stop = f32x8::splat(profile.t_stop);
    let index = f32x8::splat(k as i32 as f32);
    let count = f32x8::splat((k + 1) as i32 as f32);
    let color = [s.color[0], s.color[1], s.color[2], s.z].map(f32x8::splat);
    let column = Column::new(s, tile.centers[h & 3]);
    while rows != 0 {
        let r = rows.trailing_zeros() as usize;
        rows &= rows - 1;
        let v = (r * H + h) & (V - 1); // V is a power of two: the mask only tells the compiler so
        let w = column.whitened::<X>(tile.center_y(r));
        let (alpha, mut keep, _) = decide(raw_alpha(column.opacity, w), profile, masks, v);
        let t = out.t[v];
        match RULE {
            AFTER => keep = keep & Real::gt(t, t_stop),
            FROZEN => keep = keep & Real::le(index, frozen_last.expect("set with this rule")[v]),
            NEVER => keep = keep & out.live[v],
            _ => {
                let next = t * (one - alpha);
                let ends = if RULE == BEFORE { Real::le(next, t_stop) } else { Real::lt(next, t_stop) };
                let live = out.live[v] & !(ends & keep);
                out.live[v] = live;
                keep = keep & live;
            }
        }
        // α = 0 where the splat is skipped: then the products below change nothing, and no lane needs a selection
        let alpha = keep & alpha;
        let weight = t * alpha;
        for (sum, c) in out.sums.iter_mut().zip(color) {
            sum[v] = sum[v] + weight * c;
        }
        let t = t * (one - alpha);
        out.t[v] = t;
        // exact for integers; a selection here would become a masked store, several times the cost of the step
        out.last[v] = out.last[v] + (keep & (count - out.last[v]));
    }
}

/// Views of one band of tiles in every output.
struct Band<'a> {
    image: &'a mut [f32],
    alpha: &'a mut [f32],
    depth: &'a mut [f32],
    final_t: &'a mut [f32],
    last_index: &'a mut [f32],
}

/// Blends C pictures; `splats` is (C, N), `out` and `saved` are resized to fit.
pub fn forward(
    splats: &[Splat],
    n: usize,
    plan: &Plan,
    grid: &Grid,
    profile: &Profile,
    background: [f32; 3],
    cull: bool,
    frozen: Option<FrozenMasks<'_>>,
    out: &mut Out,
    saved: &mut Saved,
) {
    let cameras = plan.camera_start.len() - 1;
    let pixels = grid.width * grid.height;
    assert!(frozen.is_none() || grid.tile == 16, "stored masks are those of 16x16 tiles");
    assert_eq!(splats.len(), cameras * n, "splats are (C, N)");
    out.image.resize(cameras * pixels * 3, 0.0);
    for plane in [&mut out.alpha, &mut out.depth, &mut saved.final_t, &mut saved.last_index] {
        plane.resize(cameras * pixels, 0.0);
    }
    saved.rows.resize(if grid.tile == 16 { plan.tile_entry.len() } else { 0 }, [0; 2]);
    let mut included = split_entries(plan, &mut saved.rows).into_iter();
    let row = grid.width * grid.tile;
    let mut bands = Vec::new();
    // bands restart with every camera, so chunk the pictures one by one
    let pictures = out
        .image
        .chunks_mut(pixels * 3)
        .zip(out.alpha.chunks_mut(pixels).zip(out.depth.chunks_mut(pixels)))
        .zip(saved.final_t.chunks_mut(pixels).zip(saved.last_index.chunks_mut(pixels)));
    for ((image, (alpha, depth)), (final_t, last)) in pictures {
        let parts = image
            .chunks_mut(row * 3)
            .zip(alpha.chunks_mut(row).zip(depth.chunks_mut(row)))
            .zip(final_t.chunks_mut(row).zip(last.chunks_mut(row)));
        for ((image, (alpha, depth)), (final_t, last_index)) in parts {
            let included = included.by_ref().take(grid.tiles_x()).collect();
            bands.push((Band { image, alpha, depth, final_t, last_index }, included));
        }
    }
    let (tiles_x, tiles_y) = (grid.tiles_x(), grid.tiles_y());
    par::each(bands, |b, (mut band, included): (Band<'_>, Vec<&mut [[u16; 2]]>)| {
        let camera = b / tiles_y;
        let local = &splats[camera * n..(camera + 1) * n];
        let run = |(x, rows): (usize, &mut [[u16; 2]])| {
            let at = b * tiles_x + x;
            let entries = plan.tile_start[at] as usize..plan.tile_start[at + 1] as usize;
            let tile = Tile::new(grid, at % grid.tiles());
            let list = &plan.tile_entry[entries.clone()];
            let lines = match grid.tile {
                8 => finish(&tile_forward::<1, 8>(local, list, &tile, profile, cull, None, rows), background),
                16 => {
                    let masks = frozen.map(|f| {
                        let plane = &f.last_index[camera * pixels..(camera + 1) * pixels];
                        let last = load_plane::<2, 32>(plane, &tile, grid, -1.0);
                        (f.tile(entries.clone()), last)
                    });
                    finish(&tile_forward::<2, 32>(local, list, &tile, profile, cull, masks, rows), background)
                }
                32 => {
                    finish(&tile_forward::<4, 128>(local, list, &tile, profile, cull, None, rows), background)
                }
                other => unreachable!("tile side {other}: settings allow 8, 16 and 32"),
            };
            (tile, lines)
        };
        for (tile, lines) in par::map_each(included, |x, rows| run((x, rows))) {
            band.store(&tile, &lines, grid.width);
        }
    });
}

/// Per vector: r, g, b over the background, depth, T, last index.
fn finish<const V: usize>(state: &Forward<V>, background: [f32; 3]) -> Vec<[f32x8; 6]> {
    let b = background.map(f32x8::splat);
    (0..V)
        .map(|v| {
            let t = state.t[v];
            let over = |c: usize| state.sums[c][v] + t * b[c];
            [over(0), over(1), over(2), state.sums[3][v], t, state.last[v] - f32x8::splat(1.0)]
        })
        .collect()
}

impl Band<'_> {
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

/// Sums over one (splat, tile), in the order of [`RECORD`].
pub type Record = [f32; RECORD];

/// Which cotangents are there, and what statistics are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Wanted {
    depth: bool,
    abs: bool,
}

/// State of one tile in the backward walk.
struct Backward<const V: usize> {
    /// C̄ per channel, D̄
    bar: [[f32x8; V]; 4],
    alpha_bar: [f32x8; V],
    t: [f32x8; V],
    /// cotangent of what lies behind
    behind: [f32x8; V],
    last: [f32x8; V],
}

/// Folds twelve sums over their 8 lanes: l += l+4, then +2, +1.
#[inline(always)]
fn fold(eight: &[f32x8; RECORD]) -> Record {
    let zero = f32x8::splat(0.0);
    let tree = |rows: [f32x8; 8]| {
        let r = f32x8::transpose(rows);
        (((r[0] + r[4]) + (r[2] + r[6])) + ((r[1] + r[5]) + (r[3] + r[7]))).to_array()
    };
    let a = tree(std::array::from_fn(|i| eight[i]));
    let b = tree(std::array::from_fn(|i| if i < RECORD - 8 { eight[8 + i] } else { zero }));
    std::array::from_fn(|i| if i < 8 { a[i] } else { b[i - 8] })
}

/// Walks one 16×16 tile back to front and writes one record per entry.
fn tile_adjoint(
    splats: &[Splat],
    list: &[u32],
    included: &[[u16; 2]],
    tile: &Tile,
    profile: &Profile,
    frozen: Option<TileMasks<'_>>,
    wanted: Wanted,
    mut x: Backward<32>,
    records: &mut [Record],
) {
    let zero = f32x8::splat(0.0);
    let walk = match (wanted.depth, wanted.abs) {
        (false, false) => [column_adjoint::<true, false, false>, column_adjoint::<false, false, false>],
        (true, false) => [column_adjoint::<true, true, false>, column_adjoint::<false, true, false>],
        (false, true) => [column_adjoint::<true, false, true>, column_adjoint::<false, false, true>],
        (true, true) => [column_adjoint::<true, true, true>, column_adjoint::<false, true, true>],
    };
    for (k, record) in records.iter_mut().enumerate().rev() {
        let rows = included[k];
        if rows == [0, 0] {
            continue; // never read: see `gather_records`
        }
        let s = &splats[list[k] as usize];
        let masks = frozen.map(|f| f.entry(k));
        let column = walk[s.axis as usize];
        let mut sums = [zero; RECORD];
        if rows[0] != 0 {
            column(s, 0, u32::from(rows[0]), k, tile, profile, masks, &mut x, &mut sums);
        }
        if rows[1] != 0 {
            // 16 → 8: the right half of the tile is added to the left one
            let mut right = [zero; RECORD];
            column(s, 1, u32::from(rows[1]), k, tile, profile, masks, &mut x, &mut right);
            for (l, r) in sums.iter_mut().zip(right) {
                *l = *l + r;
            }
        }
        *record = fold(&sums);
    }
}

/// One vector column of one entry: a left fold over its rows.
fn column_adjoint<const X: bool, const DEPTH: bool, const ABS: bool>(
    s: &Splat,
    h: usize,
    mut rows: u32,
    k: usize,
    tile: &Tile,
    profile: &Profile,
    masks: Option<(&[u8; 32], &[u8; 32])>,
    x: &mut Backward<32>,
    out: &mut [f32x8; RECORD],
) {
    let one = f32x8::splat(1.0);
    let color = s.color.map(f32x8::splat);
    let z = f32x8::splat(s.z);
    let index = f32x8::splat(k as i32 as f32);
    let column = Column::new(s, tile.centers[h & 3]);
    let through_cap = f32x8::splat(f32::from_bits(if profile.inria_bwd { u32::MAX } else { 0 }));
    let mut sums = [f32x8::splat(0.0); RECORD];
    while rows != 0 {
        let r = rows.trailing_zeros() as usize;
        rows &= rows - 1;
        let v = (2 * r + h) & 31;
        let (w1, w2) = column.whitened::<X>(tile.center_y(r));
        let raw = raw_alpha(column.opacity, (w1, w2));
        let (alpha, keep, capped) = decide(raw, profile, masks, v);
        let keep = keep & Real::le(index, x.last[v]);
        // α = 0 where the splat was skipped: T and what lies behind stay as they are, and every product is 0
        let alpha = keep & alpha;
        // undo T' = T (1 − α)
        let rest = one - alpha;
        let t = x.t[v] / rest;
        x.t[v] = t;
        // the splat's colour, depth and presence against the pixel's cotangents
        let mut e = (color[0] * x.bar[0][v] + color[1] * x.bar[1][v]) + color[2] * x.bar[2][v];
        if DEPTH {
            e = (e + z * x.bar[3][v]) + x.alpha_bar[v];
        }
        let behind = x.behind[v];
        let alpha_bar = t * (e - behind);
        x.behind[v] = alpha * e + rest * behind;
        let weight = t * alpha;
        sums[6] = sums[6] + weight * x.bar[0][v];
        sums[7] = sums[7] + weight * x.bar[1][v];
        sums[8] = sums[8] + weight * x.bar[2][v];
        if DEPTH {
            sums[9] = sums[9] + weight * x.bar[3][v];
        }
        // the derivative is that of the uncapped product: the same number where the cap is not reached
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
        // along the rows w1 is a constant of the column: it comes out of the sums
        let w1 = column.dx * column.k1;
        sums[1] = w1 * sums[0];
        sums[3] = w1 * sums[1];
        sums[4] = w1 * sums[2];
    }
    *out = sums;
}

/// Cotangents of one projected splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatBar {
    /// ∂L/∂u, pixels⁻¹
    pub mean_px: [f32; 2],
    /// ∂L/∂(s, k1, k2)
    pub shape: [f32; 3],
    /// ∂L/∂o of the opacity in [`Splat`]
    pub opacity: f32,
    /// ∂L/∂c
    pub color: [f32; 3],
    /// ∂L/∂z
    pub z: f32,
    /// Σ over pixels of |∂L/∂u|, if asked for
    pub mean_px_abs: [f32; 2],
}

impl SplatBar {
    /// From the sum of a splat's records.
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

/// Sums the records of one Gaussian in slot order; `None` if it is listed nowhere.
///
/// Pairs that were not walked have no record.
pub fn gather_records(
    plan: &Plan,
    included: &[[u16; 2]],
    records: &[Record],
    camera_row: usize,
) -> Option<[f64; RECORD]> {
    let slots = plan.slot_start[camera_row] as usize..plan.slot_start[camera_row + 1] as usize;
    if slots.is_empty() {
        return None;
    }
    let mut sum = [0.0_f64; RECORD];
    for &entry in &plan.entry_of_slot[slots] {
        if included[entry as usize] == [0, 0] {
            continue;
        }
        for (total, x) in sum.iter_mut().zip(&records[entry as usize]) {
            *total += f64::from(*x);
        }
    }
    Some(sum)
}

/// Walks C pictures back to front: one record per entry into `records`, and the gradient of the background.
///
/// Tiles of 16 only. `abs` also fills the sums of |ū|.
pub fn adjoint(
    splats: &[Splat],
    n: usize,
    plan: &Plan,
    grid: &Grid,
    profile: &Profile,
    background: [f32; 3],
    frozen: Option<FrozenMasks<'_>>,
    saved: &Saved,
    out_bar: OutBar<'_>,
    abs: bool,
    records: &mut Vec<Record>,
) -> [f32; 3] {
    assert_eq!(grid.tile, 16, "gradient records are those of 16x16 tiles");
    let pixels = grid.width * grid.height;
    records.resize(plan.tile_entry.len(), [0.0; RECORD]);
    let parts = split_entries(plan, records);
    let wanted = Wanted { depth: out_bar.depth.is_some() || out_bar.alpha.is_some(), abs };
    let b = background.map(f32x8::splat);
    par::each(parts, |at, part| {
        let camera = at / grid.tiles();
        let tile = Tile::new(grid, at % grid.tiles());
        let entries = plan.tile_start[at] as usize..plan.tile_start[at + 1] as usize;
        let plane = |p: &[f32], outside| {
            load_plane::<2, 32>(&p[camera * pixels..(camera + 1) * pixels], &tile, grid, outside)
        };
        let zero = [f32x8::splat(0.0); 32];
        let mut bar = [zero; 4];
        if let Some(image) = out_bar.image {
            load_image(&image[camera * pixels * 3..(camera + 1) * pixels * 3], &tile, grid, &mut bar);
        }
        if let Some(depth) = out_bar.depth {
            bar[3] = plane(depth, 0.0);
        }
        let state = Backward {
            alpha_bar: out_bar.alpha.map_or(zero, |a| plane(a, 0.0)),
            behind: std::array::from_fn(|v| (b[0] * bar[0][v] + b[1] * bar[1][v]) + b[2] * bar[2][v]),
            bar,
            t: plane(&saved.final_t, 1.0),
            last: plane(&saved.last_index, -1.0),
        };
        let masks = frozen.map(|f| f.tile(entries.clone()));
        let local = &splats[camera * n..(camera + 1) * n];
        let (list, included) = (&plan.tile_entry[entries.clone()], &saved.rows[entries]);
        tile_adjoint(local, list, included, &tile, profile, masks, wanted, state, part);
    });
    background_adjoint(saved, out_bar.image)
}

/// b̄ = Σ T_end C̄: rows of 4096 pixels in f64, a left fold each, then the pairwise tree.
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
