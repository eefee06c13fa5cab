//! `field.fetch`: bilinear interpolation of feature planes that are parallel to the axes.
//!
//! p = x/R,   u = (p + 1)/2·(S − 1), limited to 0..S−1, for the two coordinates of the plane; rows of a plane
//! follow the first of them. Six planes xy−, xy+, xz−, xz+, yz−, yz+, chosen by the sign of the missing
//! coordinate, or three planes xy, xz, yz.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `points` | (N, 3) |
//! | T | `planes` | (P, S, S, C) |
//! | R | setting `half_size` | () |
//! | | setting `combine` | `concat` or `sum` |
//! | f | `features` | (N, 3C) or (N, C) |
//!
//! # Rounding
//! Interpolation along the second coordinate first, then along the first.
//!
//! # Kinks and domain
//! The cell that starts at a border; slope 0 where u is limited, and at u = 0 and u = S−1. The plane + where the
//! missing coordinate is > 0.

use super::{HALF_SIZE, half_size};
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.fetch`.
    pub struct In<'a, S> {
        points: &'a Arr<S> = Port::var("N,3", "in the box; outside it the border is read"),
        planes: &'a Arr<S> = Port::var("P,S,S,C", "xy−, xy+, xz−, xz+, yz−, yz+, or xy, xz, yz"),
    }
}

/// `field.fetch`
pub static SIGNATURE: Signature = Signature {
    name: "field.fetch",
    summary: "features of points, interpolated in planes parallel to the axes",
    inputs: In::<f64>::PORTS,
    outputs: ports![features: Port::var("N,F", "of xy, xz, yz one after the other, or their sum")],
    settings: &[
        HALF_SIZE,
        SettingSpec::choice("combine", &["concat", "sum"], "concat", "how the three planes are combined"),
    ],
    ..Signature::EMPTY
};

/// The first texel of the cell, and the place inside it.
pub fn cell<S: Scalar>(p: S, side: usize) -> (usize, S) {
    let last = (side - 1) as f64;
    let u = (p + 1.0) / 2.0 * last;
    let limited = if u.value() <= 0.0 {
        S::zero()
    } else if u.value() >= last {
        S::from_f64(last)
    } else {
        u
    };
    let mut first = limited.value().floor() as usize;
    if first == side - 1 {
        first = side - 2;
    }
    (first, limited - first as f64)
}

/// The features of one point.
pub fn features<S: Scalar>(planes: &Arr<S>, point: [S; 3], half_size: f64, is_sum: bool) -> Vec<S> {
    let [count, side, _, channels] = planes.shape[..] else { panic!("four axes") };
    let p = point.map(|x| x / half_size);
    let mut parts = Vec::new();
    for (pair, [first, second, missing]) in [[0, 1, 2], [0, 2, 1], [1, 2, 0]].into_iter().enumerate() {
        let plane = if count == 6 { 2 * pair + usize::from(p[missing].value() > 0.0) } else { pair };
        let (i, a) = cell(p[first], side);
        let (j, b) = cell(p[second], side);
        let texel =
            |i: usize, j: usize, c: usize| planes.data[((plane * side + i) * side + j) * channels + c];
        let part: Vec<S> = (0..channels)
            .map(|c| {
                let along = |i: usize| texel(i, j, c) * (S::one() - b) + texel(i, j + 1, c) * b;
                along(i) * (S::one() - a) + along(i + 1) * a
            })
            .collect();
        parts.push(part);
    }
    if !is_sum {
        return parts.concat();
    }
    (0..channels).map(|c| parts[0][c] + parts[1][c] + parts[2][c]).collect()
}

/// The twin of `field.fetch`.
///
/// # Errors
/// When there are not three or six planes, or they have no cell.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    half_size: f64,
    is_sum: bool,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let In { points, planes } = *input;
    let [count, side, _, channels] = planes.shape[..] else { panic!("four axes") };
    if !(count == 3 || count == 6) || side < 2 || channels == 0 {
        return Err(format!("input planes: expected 3 or 6 planes with cells, got {:?}", planes.shape));
    }
    let n = points.shape[0];
    let width = if is_sum { channels } else { 3 * channels };
    let slot = out.array("features", &[n, width]);
    for row in 0..n {
        let features = features(planes, points.row(row), half_size, is_sum);
        for (k, x) in features.into_iter().enumerate() {
            out.put(slot, row * width + k, x);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a setting is out of its range.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let is_sum = call.settings.word("combine") == "sum";
    forward(&In::of(call.arrays)?, half_size(&call.settings)?, is_sum, out)
}

/// Number of texels read.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { points, planes } = In::of(call.arrays)?;
    Ok((points.shape[0] * 12 * planes.shape[3]) as u64)
}
