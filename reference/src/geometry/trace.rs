//! `geometry.trace`: nearest hits of rays with a triangle mesh; every ray is tested against every triangle.
//!
//! With A, B, C the corners relative to the origin o, and d the direction,
//!
//! u = d·(C×B),   v = d·(A×C),   w = d·(B×A),   n = (B−A)×(C−A),   t = n·A / n·d
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | | `vertices` | (V, 3) |
//! | | `triangles` | (T, 3), rows of `vertices` |
//! | o | `origin` | (R, 3) |
//! | d | `direction` | (R, 3), any length but 0 |
//! | t | `t` | (R), +∞ = miss |
//! | | `triangle` | (R), −1 = miss |
//!
//! A triangle is hit from either side if u, v, w have the same sign (0 counts as either) and t ≥ 0. The
//! nearest hit has the smallest t; of equal t the triangle with the lowest index.
//!
//! # Kinks and domain
//! A triangle with n = 0 (no area) or n·d = 0 (parallel to the ray) is never hit. On an edge or a vertex one
//! of u, v, w is 0 up to rounding; then one or several of the adjacent triangles are hit.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, Signature, ports};
use crate::twins::Call;

inputs! {
    /// Inputs of `geometry.trace`.
    pub struct In<'a, S> {
        vertices: &'a Arr<S> = Port::fixed("V,3", "positions"),
        triangles: &'a Arr<S> = Port::int(
            "T,3",
            Dtype::I32,
            "rows of vertices; hit from both sides, never hit if the area is 0",
        ),
        origin: &'a Arr<S> = Port::fixed("R,3", "starts of rays"),
        direction: &'a Arr<S> = Port::fixed("R,3", "any length but 0; the unit of t"),
    }
}

/// `geometry.trace`
pub static SIGNATURE: Signature = Signature {
    name: "geometry.trace",
    summary: "nearest hits of rays with a triangle mesh",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        t: Port::fixed("R", "parameter of the nearest hit, inf = miss"),
        triangle: Port::int("R", Dtype::I32, "of equal t the lowest, -1 = miss"),
    ],
    companions: &["crossings"],
    ..Signature::EMPTY
};

type Vec3 = [f64; 3];

fn minus(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Intersection of one ray with one triangle.
fn meet(o: Vec3, d: Vec3, corners: [Vec3; 3]) -> Option<f64> {
    let [a, b, c] = corners.map(|p| minus(p, o));
    let signs = [dot(d, cross(c, b)), dot(d, cross(a, c)), dot(d, cross(b, a))];
    if !(signs.iter().all(|&s| s >= 0.0) || signs.iter().all(|&s| s <= 0.0)) {
        return None;
    }
    let n = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]));
    let slope = dot(n, d);
    if slope == 0.0 {
        return None;
    }
    let t = dot(n, a) / slope;
    (t >= 0.0).then_some(t + 0.0)
}

/// The twin of `geometry.trace`.
///
/// # Errors
/// When an index is out of range, or a direction is 0.
pub fn forward(input: &In<'_, f64>, out: &mut Out<'_, f64>) -> Result<(), String> {
    let In { vertices, triangles, origin, direction } = *input;
    let [rays, count] = [origin.shape[0], vertices.shape[0]];
    let mut corners = Vec::new();
    for row in 0..triangles.shape[0] {
        let index: Vec3 = triangles.row(row);
        if let Some(i) = index.iter().find(|&&i| !(0.0 <= i && i < count as f64)) {
            return Err(format!("input triangles: expected rows below {count}, got {i} in triangle {row}"));
        }
        corners.push(index.map(|i| vertices.row::<3>(i as usize)));
    }
    let (t_slot, triangle_slot) = (out.array("t", &[rays]), out.array("triangle", &[rays]));
    for ray in 0..rays {
        let (o, d): (Vec3, Vec3) = (origin.row(ray), direction.row(ray));
        if d == [0.0; 3] {
            return Err(format!("input direction: expected a nonzero direction, got zeros in ray {ray}"));
        }
        let (mut best, mut hit) = (f64::INFINITY, -1.0);
        for (i, &triangle) in corners.iter().enumerate() {
            if let Some(t) = meet(o, d, triangle)
                && t < best
            {
                (best, hit) = (t, i as f64);
            }
        }
        out.put(t_slot, ray, best);
        out.put(triangle_slot, ray, hit);
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, an index is out of range, or a direction is 0.
pub fn run(call: &Call<'_, f64>, out: &mut Out<'_, f64>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}

/// Number of (ray, triangle) pairs.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { triangles, origin, .. } = In::of(call.arrays)?;
    Ok((origin.shape[0] * triangles.shape[0]) as u64)
}
