//! Points spread evenly over a surface.
//!
//! Point i lies on the triangle whose share of the area contains u₀ (shares in the order of the triangles), at
//!
//! ```text
//! (1 − s)·a + s·(1 − u₂)·b + s·u₂·c,    s = √u₁        u₀, u₁, u₂ the draws 0, 1, 2 of item i
//! ```
//!
//! # Rounding
//! Double precision; areas are added in the order of the triangles; results are rounded once to f32.
//!
//! # Kinks and domain
//! Triangles without area get no points. A mesh without any area is refused.

use crate::num::{par, rng::Rng};
use crate::{Error, Result};

/// Purpose word of the draws made here (see `num::rng`).
const PURPOSE: u16 = 0x0601;
/// Points of one task.
const CHUNK: usize = 4096;

/// A point of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Scene units.
    pub point: [f32; 3],
    /// Unit normal of its triangle.
    pub normal: [f32; 3],
    /// Index of its triangle.
    pub triangle: u32,
}

/// Twice the area of a triangle along its normal.
pub(super) fn cross_product([a, b, c]: [[f32; 3]; 3]) -> [f64; 3] {
    let edge = |p: [f32; 3]| [0, 1, 2].map(|k| f64::from(p[k]) - f64::from(a[k]));
    let (e, f) = (edge(b), edge(c));
    [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]]
}

pub(super) fn length(n: [f64; 3]) -> f64 {
    (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt()
}

/// `count` points of a surface, evenly spread: point i depends on the seed and i alone.
///
/// # Errors
/// When no triangle has an area.
///
/// # Panics
/// When an index is out of range.
pub fn surface(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    count: usize,
    seed: u64,
) -> Result<Vec<Sample>> {
    let corners = |t: usize| triangles[t].map(|i| positions[i as usize]);
    // twice the area up to and with each triangle
    let mut up_to = Vec::with_capacity(triangles.len());
    let mut total = 0.0;
    for t in 0..triangles.len() {
        total += length(cross_product(corners(t)));
        up_to.push(total);
    }
    if count > 0 && !(total > 0.0) {
        return Err(Error::input("mesh").expected("a triangle that has an area").got("none"));
    }
    let rng = Rng::new(seed);
    let mut samples = vec![Sample::default(); count];
    par::chunks_mut(&mut samples, CHUNK, |chunk, samples| {
        for (i, sample) in samples.iter_mut().enumerate() {
            let u = |draw: u16| rng.uniform_f64((chunk * CHUNK + i) as u64, 0, PURPOSE, draw);
            let share = u(0) * total;
            // The first whose sum exceeds the share has an area; if the product rounds up to the total, the last one that has.
            let t = up_to.partition_point(|&sum| sum <= share);
            let t = if t < up_to.len() { t } else { up_to.partition_point(|&sum| sum < total) };
            let [a, b, c] = corners(t).map(|p| p.map(f64::from));
            let (s, v) = (u(1).sqrt(), u(2));
            let n = cross_product(corners(t));
            let size = length(n);
            *sample = Sample {
                point: [0, 1, 2].map(|k| ((1.0 - s) * a[k] + s * (1.0 - v) * b[k] + s * v * c[k]) as f32),
                normal: n.map(|x| (x / size) as f32),
                triangle: t as u32,
            };
        }
    });
    Ok(samples)
}
