//! `field.embed`: features of the direction of reflection, from panoramas of increasing roughness.
//!
//! r = unit(v − 2(v·n)n), n = unit(normal), or r = n without a ray. Three coordinates: the azimuth
//! atan2(r_x, r_y) as a fraction of the turn from −π, with H cells centred at (k + ½)/H, which wrap; r_z from −1
//! to 1 with W texels, the first and the last at the ends; ρ from 0 to 1 with L levels, likewise. h is linear
//! along each.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | | `normal` | (N, 3), no gradient |
//! | v | `ray_direction` | (N, 3), optional, no gradient |
//! | ρ | `rho` | (N) |
//! | E | `panoramas` | (L, H, W, C) |
//! | h | `h` | (N, C) |
//!
//! # Rounding
//! Interpolation along columns, rows, levels.
//!
//! # Kinks and domain
//! The interval of levels that starts at ρ(L−1), at the end the last one. A vector of length 0 stays 0.

use super::normal_head::unit;
use crate::array::{Arr, Named, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.embed`.
    pub struct In<'a, S> {
        normal: &'a Arr<S> = Port::fixed("N,3", "any length"),
        ray_direction: Option<&'a Arr<S>> = Port::fixed("N,3", "from the camera; absent: the normal is looked up"),
        rho: &'a Arr<S> = Port::var("N", "0 to 1: first to last panorama"),
        panoramas: &'a Arr<S> = Port::var("L,H,W,C", "rows: azimuth; columns: z"),
    }
}

/// `field.embed`
pub static SIGNATURE: Signature = Signature {
    name: "field.embed",
    summary: "features of the direction of reflection, from panoramas of increasing roughness",
    inputs: In::<f64>::PORTS,
    outputs: ports![h: Port::var("N,C", "")],
    plan: ports![
        cell: Port::int("N,2", Dtype::I32, "first row, -1 for the last one, and first column"),
        level: Port::int("N", Dtype::I32, "lower panorama"),
    ],
    ..Signature::EMPTY
};

/// Row and column of a direction.
fn coordinates(r: [f64; 3], h: usize, w: usize) -> [f64; 2] {
    let turn = libm::atan2(r[0], r[1]) / std::f64::consts::TAU + 0.5;
    let column = (r[2] + 1.0) / 2.0 * (w - 1) as f64;
    let last = (w - 1) as f64;
    let column = if column > last { last } else { column };
    [turn * h as f64 - 0.5, if column < 0.0 { 0.0 } else { column }]
}

/// The largest integer not above x, and not above `last`.
fn floor(x: f64, last: f64) -> f64 {
    if x.floor() > last { last } else { x.floor() }
}

/// Unit direction in which a ray is reflected; the unit normal without a ray.
pub fn reflect(normal: [f64; 3], ray: Option<[f64; 3]>) -> [f64; 3] {
    let n = unit(normal);
    let Some(v) = ray else { return n };
    let along = v[0] * n[0] + v[1] * n[1] + v[2] * n[2];
    unit(std::array::from_fn(|k| v[k] - 2.0 * along * n[k]))
}

/// Values of one direction and roughness, with first row, first column and lower level; `chosen` replaces cell and
/// level.
pub fn features<S: Scalar>(
    panoramas: &Arr<S>,
    direction: [f64; 3],
    rho: S,
    chosen: (Option<[f64; 2]>, Option<f64>),
) -> (Vec<S>, [f64; 3]) {
    let [levels, height, width, channels] = panoramas.shape[..] else { panic!("four axes") };
    let [t, c] = coordinates(direction, height, width);
    let l = rho * (levels - 1) as f64;
    let [i, j] = chosen.0.unwrap_or([floor(t, height as f64 - 1.0), floor(c, width as f64 - 2.0)]);
    let lower =
        chosen.1.unwrap_or_else(|| if levels == 1 { 0.0 } else { floor(l.value(), levels as f64 - 2.0) });
    let (a, b, g) = (t - i, c - j, l - lower);
    let first = (i as i64).rem_euclid(height as i64) as usize;
    let value = |channel: usize| {
        let texel = |level: usize, row: usize, column: usize| {
            panoramas.data[((level * height + row % height) * width + column) * channels + channel]
        };
        let j = j as usize;
        let along =
            |level: usize, row: usize| texel(level, row, j) * (1.0 - b) + texel(level, row, j + 1) * b;
        let at = |level: usize| along(level, first) * (1.0 - a) + along(level, first + 1) * a;
        let lower = lower as usize;
        if levels == 1 { at(0) } else { at(lower) * (S::one() - g) + at(lower + 1) * g }
    };
    ((0..channels).map(value).collect(), [i, j, lower])
}

/// The twin of `field.embed`.
///
/// # Errors
/// When a panorama has fewer than two rows or columns, or a ρ is outside 0 to 1.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let In { normal, ray_direction, rho, panoramas } = *input;
    let [levels, height, width, channels] = panoramas.shape[..] else { panic!("four axes") };
    if levels == 0 || height < 2 || width < 2 || channels == 0 {
        return Err(format!(
            "input panoramas: expected 2 rows and columns or more, got {:?}",
            panoramas.shape
        ));
    }
    let n = rho.shape[0];
    let h = out.array("h", &[n, channels]);
    let (mut cell, mut level) = (Arr::filled(&[n, 2], 0.0), Arr::filled(&[n], 0.0));
    let given = |name: &str| plan.and_then(|plan| plan.get(name));
    for row in 0..n {
        let direction = reflect(
            normal.row::<3>(row).map(Scalar::value),
            ray_direction.map(|v| v.row::<3>(row).map(Scalar::value)),
        );
        if !(0.0..=1.0).contains(&rho.data[row].value()) {
            return Err(format!("input rho: expected 0 to 1, got {}", rho.data[row].value()));
        }
        let chosen = (given("cell").map(|p| p.row(row)), given("level").map(|p| p.data[row]));
        let (values, [i, j, lower]) = features(panoramas, direction, rho.data[row], chosen);
        (cell.data[2 * row], cell.data[2 * row + 1], level.data[row]) = (i, j, lower);
        for (channel, value) in values.into_iter().enumerate() {
            out.put(h, row * channels + channel, value);
        }
        out.flush();
    }
    out.plan.insert("cell".to_owned(), cell);
    out.plan.insert("level".to_owned(), level);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.plan, out)
}
