//! Conversion of plans between arrays and kernels, and the zeros that follow from a plan.

use crate::num::array::Arrays;
use crate::num::order;
use crate::ops::op::CheckedCall;
use crate::scene::profile::Profile;
use crate::splat::blend;
use crate::splat::plan::{Grid, Plan, Splat};
use crate::splat::project::{Decision, Row};
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// Side of a tile of stored masks.
const TILE: usize = 16;

fn broken(name: &str) -> Error {
    Error::input("plan").at(format!("array '{name}'"))
}

/// Integers of an array of the plan with the given shape, each in `lo..=hi`.
fn whole(plan: &Arrays, name: &str, shape: Option<&[usize]>, lo: i64, hi: i64) -> Result<Vec<i64>> {
    let array = plan.need(name).map_err(|e| e.within("plan"))?;
    let fits = shape.map_or(array.shape().len() == 1, |shape| array.shape() == shape);
    if !fits {
        let expected = shape.map_or("one axis".to_owned(), |shape| format!("shape {shape:?}"));
        return Err(broken(name).expected(expected).got(format!("shape {:?}", array.shape())));
    }
    let values = array.to_i64().ok_or_else(|| broken(name).expected("whole numbers").got("a fraction"))?;
    match values.iter().position(|v| !(lo..=hi).contains(v)) {
        None => Ok(values),
        Some(i) => Err(broken(name)
            .at(format!("entry {i}"))
            .expected(format!("{lo} to {hi}"))
            .got(values[i].to_string())),
    }
}

fn starts(plan: &Arrays, name: &str, parts: usize, total: usize) -> Result<Vec<u32>> {
    let values = whole(plan, name, Some(&[parts + 1]), 0, total as i64)?;
    if values[0] != 0 || values[parts] != total as i64 || values.windows(2).any(|w| w[0] > w[1]) {
        return Err(broken(name)
            .expected(format!("ascending numbers from 0 to {total}"))
            .got("other numbers"));
    }
    Ok(values.into_iter().map(|v| v as u32).collect())
}

/// Copies arrays of a given plan unchanged.
pub(super) fn keep(given: &Arrays, names: &[&str], into: &mut Arrays) -> Result<()> {
    for &name in names {
        into.0.insert(name.to_owned(), given.need(name).map_err(|e| e.within("plan"))?.clone());
    }
    Ok(())
}

/// `t_clamp`, `pivot` of projected rows.
pub(super) fn put_rows(rows: &[Row], cameras: usize, n: usize, into: &mut Arrays) {
    into.put("t_clamp", &[cameras, n, 2], rows.iter().flat_map(|r| r.t_clamp).collect::<Vec<i8>>());
    into.put("pivot", &[cameras, n], rows.iter().map(|r| r.axis).collect::<Vec<u8>>());
}

/// `order`, `camera_start`: visible rows by (z, index).
pub(super) fn put_order(rows: &[Row], cameras: usize, n: usize, into: &mut Arrays) {
    let (mut all, mut start) = (Vec::new(), vec![0_i64]);
    for c in 0..cameras {
        let of = &rows[c * n..(c + 1) * n];
        let mut seen: Vec<(u32, i32)> =
            (0..n).filter(|&i| of[i].visible).map(|i| (order::key_f32(of[i].z), i as i32)).collect();
        seen.sort_unstable();
        all.extend(seen.into_iter().map(|(_, i)| i));
        start.push(all.len() as i64);
    }
    into.put("order", &[all.len()], all);
    into.put("camera_start", &[cameras + 1], start);
}

/// Order of the visible Gaussians, with the bounds of each camera.
fn order_of(plan: &Arrays, cameras: usize, n: usize) -> Result<(Vec<u32>, Vec<u32>)> {
    let order = whole(plan, "order", None, 0, n as i64 - 1)?;
    let start = starts(plan, "camera_start", cameras, order.len())?;
    for c in 0..cameras {
        let mut part = order[start[c] as usize..start[c + 1] as usize].to_vec();
        part.sort_unstable();
        if part.windows(2).any(|w| w[0] == w[1]) {
            return Err(broken("order")
                .at(format!("camera {c}"))
                .expected("every Gaussian at most once")
                .got("a repetition"));
        }
    }
    Ok((order.into_iter().map(|v| v as u32).collect(), start))
}

/// Decisions of the projection, (C, N).
pub(super) fn decisions(plan: &Arrays, cameras: usize, n: usize) -> Result<Vec<Decision>> {
    let (order, start) = order_of(plan, cameras, n)?;
    let t_clamp = whole(plan, "t_clamp", Some(&[cameras, n, 2]), -1, 1)?;
    let pivot = whole(plan, "pivot", Some(&[cameras, n]), 0, 1)?;
    let made = |i: usize| Decision {
        visible: false,
        t_clamp: [t_clamp[2 * i] as i8, t_clamp[2 * i + 1] as i8],
        axis: pivot[i] as u8,
    };
    let mut out: Vec<Decision> = (0..cameras * n).map(made).collect();
    for c in 0..cameras {
        for &g in &order[start[c] as usize..start[c + 1] as usize] {
            out[c * n + g as usize].visible = true;
        }
    }
    Ok(out)
}

/// The given decisions of blending.
pub(super) struct StoredPlan {
    /// lists
    pub(super) plan: Plan,
    /// (C, H, W)
    pub(super) last_index: Vec<f32>,
    /// (E, 32)
    pub(super) alpha_mask: Vec<[u8; 32]>,
    /// (E, 32)
    pub(super) cap_mask: Vec<[u8; 32]>,
}

/// Lists and masks of a plan, checked to be consistent.
///
/// # Errors
/// Names the array that is missing, has the wrong shape or is inconsistent with another.
pub(super) fn given(plan: &Arrays, cameras: usize, n: usize, grid: &Grid) -> Result<StoredPlan> {
    let (order, camera_start) = order_of(plan, cameras, n)?;
    let tile_entry = whole(plan, "tile_entry", None, 0, n as i64 - 1)?;
    let entries = tile_entry.len();
    let tile_start = starts(plan, "tile_start", cameras * grid.tiles(), entries)?;
    let entry_slot = whole(plan, "entry_slot", Some(&[entries]), 0, entries as i64 - 1)?;
    // first slot of each (camera, Gaussian): pairs are emitted camera by camera, in Gaussian order
    let mut slot_start = vec![0_u32; cameras * n + 1];
    let mut row_of_entry = vec![0; entries];
    for tile in 0..cameras * grid.tiles() {
        for entry in tile_start[tile] as usize..tile_start[tile + 1] as usize {
            row_of_entry[entry] = tile / grid.tiles() * n + tile_entry[entry] as usize;
            slot_start[row_of_entry[entry] + 1] += 1;
        }
    }
    for row in 0..cameras * n {
        slot_start[row + 1] += slot_start[row];
    }
    let mut entry_of_slot = vec![u32::MAX; entries];
    for (entry, &slot) in entry_slot.iter().enumerate() {
        let row = row_of_entry[entry];
        let own = slot_start[row]..slot_start[row + 1];
        let place = &mut entry_of_slot[slot as usize];
        if !own.contains(&(slot as u32)) || *place != u32::MAX {
            return Err(broken("entry_slot")
                .at(format!("entry {entry}"))
                .expected(format!("a unique slot in {own:?}"))
                .got(slot.to_string()));
        }
        *place = entry as u32;
    }
    let pixels = [cameras, grid.height, grid.width];
    let last = whole(plan, "last_index", Some(&pixels), -1, entries as i64)?;
    let mask = |name: &str| {
        let bytes = whole(plan, name, Some(&[entries, 32]), 0, 255)?;
        Ok::<_, Error>(bytes.chunks_exact(32).map(|b| std::array::from_fn(|k| b[k] as u8)).collect())
    };
    Ok(StoredPlan {
        plan: Plan {
            order,
            camera_start,
            tile_start,
            tile_entry: tile_entry.into_iter().map(|v| v as u32).collect(),
            slot_start,
            entry_of_slot,
        },
        last_index: last.into_iter().map(|v| v as f32).collect(),
        alpha_mask: mask("alpha_mask")?,
        cap_mask: mask("cap_mask")?,
    })
}

/// `order` … `entry_slot` of the lists, `last_index`.
pub(super) fn put_lists(plan: &Plan, last_index: &[f32], pixels: [usize; 3], into: &mut Arrays) {
    let wide = |v: &[u32]| v.iter().map(|&x| i64::from(x)).collect::<Vec<i64>>();
    let index = |v: &[u32]| v.iter().map(|&x| x as i32).collect::<Vec<i32>>();
    into.put("order", &[plan.order.len()], index(&plan.order));
    into.put("camera_start", &[plan.camera_start.len()], wide(&plan.camera_start));
    into.put("tile_start", &[plan.tile_start.len()], wide(&plan.tile_start));
    into.put("tile_entry", &[plan.tile_entry.len()], index(&plan.tile_entry));
    into.put("entry_slot", &[plan.tile_entry.len()], wide(&plan.entry_slot()));
    into.put("last_index", &pixels, last_index.iter().map(|&k| k as i32).collect::<Vec<i32>>());
}

/// `alpha_mask`, `cap_mask` and `counts`: which pixels of its tile every entry contributes to, by the α of
/// `blend` (same formula, same bits) up to the last index.
pub(super) struct Masks {
    /// (E, 32)
    pub(super) alpha: Vec<u8>,
    /// (E, 32)
    pub(super) cap: Vec<u8>,
    /// (C, H, W)
    pub(super) counts: Vec<i64>,
}

/// Computes the masks; `splats` is (C, N).
pub(super) fn masks(
    splats: &[Splat],
    n: usize,
    plan: &Plan,
    grid: &Grid,
    profile: &Profile,
    last_index: &[f32],
) -> Masks {
    let entries = plan.tile_entry.len();
    let mut out =
        Masks { alpha: vec![0; 32 * entries], cap: vec![0; 32 * entries], counts: vec![0; last_index.len()] };
    for tile in 0..plan.tile_start.len() - 1 {
        let (camera, place) = (tile / grid.tiles(), tile % grid.tiles());
        let (x0, y0) = (place % grid.tiles_x() * TILE, place / grid.tiles_x() * TILE);
        let (start, end) = (plan.tile_start[tile] as usize, plan.tile_start[tile + 1] as usize);
        for entry in start..end {
            let s = &splats[camera * n + plan.tile_entry[entry] as usize];
            for y in y0..Ord::min(y0 + TILE, grid.height) {
                for x in x0..Ord::min(x0 + TILE, grid.width) {
                    let pixel = (camera * grid.height + y) * grid.width + x;
                    if (entry - start) as f32 > last_index[pixel] {
                        continue;
                    }
                    let raw = raw_alpha(s, x, y);
                    let capped = raw > profile.alpha_max;
                    if !(if capped { profile.alpha_max } else { raw } >= profile.alpha_min) {
                        continue;
                    }
                    let bit = TILE * (y - y0) + (x - x0);
                    out.alpha[32 * entry + bit / 8] |= 1 << (bit % 8);
                    out.cap[32 * entry + bit / 8] |= u8::from(capped) << (bit % 8);
                    out.counts[pixel] += 1;
                }
            }
        }
    }
    out
}

/// o·exp(−½(w1² + w2²)) at the centre of pixel (x, y), before the cap.
fn raw_alpha(s: &Splat, x: usize, y: usize) -> f32 {
    let (dx, dy) = (x as f32 + 0.5 - s.mean_px[0], y as f32 + 0.5 - s.mean_px[1]);
    let (dp, dq) = if s.axis == 0 { (dx, dy) } else { (dy, dx) };
    blend::raw_alpha(s.opacity, blend::whiten(dp, dq, s.shape))
}

/// Per (camera, Gaussian): whether it contributes to any pixel, and whether it does so below the cap.
pub(super) struct Reach {
    /// (C·N)
    pub(super) anywhere: Vec<bool>,
    /// (C·N)
    pub(super) below_cap: Vec<bool>,
}

/// Computes [`Reach`] from the masks of a plan.
pub(super) fn reach(plan: &Arrays, cameras: usize, n: usize, grid: &Grid) -> Result<Reach> {
    let given = given(plan, cameras, n, grid)?;
    let mut out = Reach { anywhere: vec![false; cameras * n], below_cap: vec![false; cameras * n] };
    for tile in 0..given.plan.tile_start.len() - 1 {
        for entry in given.plan.tile_start[tile] as usize..given.plan.tile_start[tile + 1] as usize {
            let row = tile / grid.tiles() * n + given.plan.tile_entry[entry] as usize;
            for (a, c) in given.alpha_mask[entry].iter().zip(&given.cap_mask[entry]) {
                out.anywhere[row] |= *a != 0;
                out.below_cap[row] |= a & !c != 0;
            }
        }
    }
    Ok(out)
}

/// Zeros of whole rows of the named inputs that are present; ⟨q, q̄⟩ = 0 if `quats` is among them.
pub(super) fn row_prediction(
    x: &CheckedCall<'_>,
    names: &[&str],
    zero: impl Fn(usize) -> bool,
) -> Prediction {
    let mut known = Prediction::default();
    for &name in names.iter().filter(|name| x.has(name)) {
        let (n, len) = (x.shape(name)[0], x.f32s(name).len());
        known.zeros.insert(name.to_owned(), (0..len).map(|e| zero(e / (len / Ord::max(n, 1)))).collect());
        if name == "quats" {
            known.nulls.insert(name.to_owned(), (4, x.f64s(name)));
        }
    }
    known
}
