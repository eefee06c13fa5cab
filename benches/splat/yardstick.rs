//! The yardstick: a plain scalar tile rasteriser, so that speed can be stated as a ratio measured in one run.
//!
//! f32, pixel by pixel, 16×16 tiles, lists from the 3σ square, std's exponential (the system's libm), conic
//! from the covariance, one nine-number record per (Gaussian, tile) summed in slot order, all gradients.
//! Threads split tiles. It shares the library's projection, colour and covariance stages, which makes the
//! ratio smaller, not larger.

use lastlight::num::par;
use lastlight::splat::plan::{Plan, Splat};

const TILE: usize = 16;

struct Flat {
    u: [f32; 2],
    conic: [f32; 3],
    opacity: f32,
    color: [f32; 3],
}

/// Lists of the 3σ square, depth order, slots: the plan of profile `inria` serves, it is those lists.
pub(crate) fn forward_backward(
    splats: &[Splat],
    plan: &Plan,
    width: usize,
    height: usize,
    image_bar: impl Fn(usize, [f32; 3]) -> [f32; 3] + Sync,
) -> (Vec<[f32; 3]>, Vec<[f32; 9]>) {
    let flat: Vec<Flat> = splats
        .iter()
        .map(|s| {
            let [sh, k1, k2] = s.shape;
            // Σ'⁻¹ from the shape: k1² + s²k2² on the pivot axis, −s k2², k2²
            let (pp, pq, qq) = (k1 * k1 + sh * sh * k2 * k2, -sh * k2 * k2, k2 * k2);
            let conic = if s.axis == 0 { [pp, pq, qq] } else { [qq, pq, pp] };
            Flat { u: s.mean_px, conic, opacity: s.opacity, color: s.color }
        })
        .collect();
    let tiles_x = width.div_ceil(TILE);
    let tiles = plan.tile_start.len() - 1;
    let done = par::map(tiles, |t| {
        let list = &plan.tile_entry[plan.tile_start[t] as usize..plan.tile_start[t + 1] as usize];
        let mut records = vec![[0.0_f32; 9]; list.len()];
        let mut pixels = Vec::new();
        let (x0, y0) = (t % tiles_x * TILE, t / tiles_x * TILE);
        for y in y0..Ord::min(y0 + TILE, height) {
            for x in x0..Ord::min(x0 + TILE, width) {
                let p = [x as f32 + 0.5, y as f32 + 0.5];
                let (color, t_end, last) = walk(&flat, list, p);
                pixels.push((y * width + x, color));
                unwalk(&flat, list, p, t_end, last, image_bar(y * width + x, color), &mut records);
            }
        }
        (pixels, records)
    });
    let mut image = vec![[0.0; 3]; width * height];
    let mut records = vec![[0.0; 9]; plan.tile_entry.len()];
    for (t, (pixels, tile_records)) in done.into_iter().enumerate() {
        for (at, c) in pixels {
            image[at] = c;
        }
        let start = plan.tile_start[t] as usize;
        records[start..start + tile_records.len()].copy_from_slice(&tile_records);
    }
    let sums = (0..splats.len())
        .map(|g| {
            let slots = plan.slot_start[g] as usize..plan.slot_start[g + 1] as usize;
            plan.entry_of_slot[slots]
                .iter()
                .fold([0.0; 9], |sum: [f32; 9], &e| std::array::from_fn(|i| sum[i] + records[e as usize][i]))
        })
        .collect();
    (image, sums)
}

#[expect(clippy::disallowed_methods, reason = "the yardstick uses the system's exponential on purpose")]
fn alpha(s: &Flat, p: [f32; 2]) -> Option<(f32, f32, [f32; 2])> {
    let d = [p[0] - s.u[0], p[1] - s.u[1]];
    let power = -0.5 * (s.conic[0] * d[0] * d[0] + s.conic[2] * d[1] * d[1]) - s.conic[1] * d[0] * d[1];
    if power > 0.0 {
        return None;
    }
    let e = power.exp();
    let a = if s.opacity * e > 0.99 { 0.99 } else { s.opacity * e };
    (a >= 1.0 / 255.0).then_some((a, e, d))
}

fn walk(flat: &[Flat], list: &[u32], p: [f32; 2]) -> ([f32; 3], f32, usize) {
    let (mut color, mut t, mut last) = ([0.0; 3], 1.0, 0);
    for (k, &g) in list.iter().enumerate() {
        let s = &flat[g as usize];
        let Some((a, _, _)) = alpha(s, p) else { continue };
        let next = t * (1.0 - a);
        if next < 1e-4 {
            break;
        }
        for c in 0..3 {
            color[c] += s.color[c] * a * t;
        }
        t = next;
        last = k + 1;
    }
    (color, t, last)
}

fn unwalk(
    flat: &[Flat],
    list: &[u32],
    p: [f32; 2],
    t_end: f32,
    last: usize,
    bar: [f32; 3],
    records: &mut [[f32; 9]],
) {
    let (mut t, mut behind) = (t_end, [0.0; 3]);
    for k in (0..last).rev() {
        let s = &flat[list[k] as usize];
        let Some((a, e, d)) = alpha(s, p) else { continue };
        t /= 1.0 - a;
        let mut a_bar = 0.0;
        let r = &mut records[k];
        for c in 0..3 {
            a_bar += (s.color[c] - behind[c]) * t * bar[c];
            behind[c] = a * s.color[c] + (1.0 - a) * behind[c];
            r[c] += a * t * bar[c];
        }
        if s.opacity * e <= 0.99 {
            let power_bar = a_bar * s.opacity * e;
            r[3] += power_bar * (s.conic[0] * d[0] + s.conic[1] * d[1]);
            r[4] += power_bar * (s.conic[2] * d[1] + s.conic[1] * d[0]);
            r[5] += -0.5 * power_bar * d[0] * d[0];
            r[6] += -power_bar * d[0] * d[1];
            r[7] += -0.5 * power_bar * d[1] * d[1];
            r[8] += a_bar * e;
        }
    }
}
