//! The point of a mesh that is nearest to a given one.
//!
//! ```text
//! d² = min over triangles of max(‖p − q‖², (1 − 2⁻²⁰)·box²)     q the closest point of the triangle
//! ```
//!
//! and of equal d² the lowest triangle. ‖p − q‖² is computed in double precision; box² is the squared distance to the triangle's own
//! box in single precision, by operations that are monotonic in its planes, so that a box around it is not further away in floating point
//! either, and a walk that leaves out boxes beyond the best d² leaves out no triangle that would win. Its factor covers the rounding, so
//! that the maximum is the first term up to rounding of the second.
//!
//! # Rounding
//! q: region of the plane by signs of double-precision products (Ericson, "Real-Time Collision Detection", 5.1.5). The distance is rounded once to f32.
//!
//! # Kinks and domain
//! Triangles without area are left out. Points must be finite. Where several triangles are equally near, in the middle of a shape and at edges, the lowest wins.

use super::bvh::Bvh;
use super::tree::{CHILDREN, INDEX, LANES, LEAF, Node, corners, leaf, node, references};
use super::triangle::bounds;
use crate::num::lanes::f32x8;

type Vec3 = [f64; 3];

/// Covers the rounding of the squared distance to a box: 1 − 2⁻²⁰.
const WITHIN: f32 = 1.0 - 1.0 / 1_048_576.0;

/// The nearest point of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Scene units.
    pub distance: f32,
    /// Where it is.
    pub point: [f32; 3],
    /// Index of its triangle.
    pub triangle: u32,
}

fn minus(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a + s·e + t·f
fn at(a: Vec3, s: f64, e: Vec3, t: f64, f: Vec3) -> Vec3 {
    [0, 1, 2].map(|k| a[k] + s * e[k] + t * f[k])
}

/// The point of a triangle that has an area which is nearest to p.
fn closest([a, b, c]: [Vec3; 3], p: Vec3) -> Vec3 {
    let (e, f, ap) = (minus(b, a), minus(c, a), minus(p, a));
    let (d1, d2) = (dot(e, ap), dot(f, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = minus(p, b);
    let (d3, d4) = (dot(e, bp), dot(f, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return at(a, d1 / (d1 - d3), e, 0.0, f);
    }
    let cp = minus(p, c);
    let (d5, d6) = (dot(e, cp), dot(f, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return at(a, 0.0, e, d2 / (d2 - d6), f);
    }
    let va = d3 * d6 - d5 * d4;
    let (b_side, c_side) = (d4 - d3, d5 - d6);
    if va <= 0.0 && b_side >= 0.0 && c_side >= 0.0 && b_side + c_side > 0.0 {
        return at(b, b_side / (b_side + c_side), minus(c, b), 0.0, f);
    }
    let sum = va + vb + vc;
    at(a, vb / sum, e, vc / sum, f)
}

/// Squared distance to a box, a little less than it is; monotonic in the planes.
fn to_box(p: [f32; 3], [lo, hi]: [[f32; 3]; 2]) -> f32 {
    let gap = |k: usize| {
        let (below, above) = (lo[k] - p[k], p[k] - hi[k]);
        let outside = if below > above { below } else { above };
        if outside > 0.0 { outside * outside } else { 0.0 }
    };
    (gap(0) + gap(1) + gap(2)) * WITHIN
}

/// [`to_box`] of the children of a node, with the same operations.
fn to_children(p: [f32x8; 3], node: &Node) -> [f32; LANES] {
    let gap = |k: usize| {
        let outside = (node[2 * k] - p[k]).fast_max(p[k] - node[2 * k + 1]).fast_max(f32x8::splat(0.0));
        outside * outside
    };
    ((gap(0) + gap(1) + gap(2)) * f32x8::splat(WITHIN)).to_array()
}

/// Squared distance of one triangle as the minimum sees it, and its closest point.
fn measure(corners: [[f32; 3]; 3], p: [f32; 3]) -> (f64, Vec3) {
    let wide = p.map(f64::from);
    let q = closest(corners.map(|c| c.map(f64::from)), wide);
    let d = minus(wide, q);
    let (squared, least) = (dot(d, d), f64::from(to_box(p, bounds(corners))));
    (if least > squared { least } else { squared }, q)
}

impl Bvh {
    /// The nearest point of the mesh; none if no triangle has an area. The shape of the tree changes no bit.
    pub fn nearest(&self, point: [f32; 3]) -> Option<Nearest> {
        let scale = self.scale();
        let p = point.map(|x| x * scale);
        let lanes = p.map(f32x8::splat);
        let (rows, root) = self.rows();
        let (mut best, mut found, mut triangle) = (f64::INFINITY, [0.0; 3], u32::MAX);
        let mut waiting = Vec::with_capacity(64);
        if !rows.is_empty() {
            waiting.push((0.0_f32, root));
        }
        while let Some((bound, at)) = waiting.pop() {
            if f64::from(bound) > best {
                continue;
            }
            if at & LEAF == 0 {
                let node = node(rows, at);
                let bounds = to_children(lanes, node);
                let base = waiting.len();
                for (&child, &bound) in references(&node[CHILDREN]).iter().zip(&bounds) {
                    // a child that is not there is infinitely far away
                    if bound < f32::INFINITY && f64::from(bound) <= best {
                        waiting.push((bound, child));
                    }
                }
                waiting[base..].sort_by(|a, b| b.0.total_cmp(&a.0));
                continue;
            }
            let leaf = leaf(rows, at);
            for lane in 0..LANES {
                let index = references(&leaf[INDEX])[lane];
                let (squared, q) = measure(corners(leaf, lane), p);
                if squared < best || (squared == best && index < triangle) {
                    (best, found, triangle) = (squared, q, index);
                }
            }
        }
        (triangle != u32::MAX).then(|| Nearest {
            distance: (best.sqrt() / f64::from(scale)) as f32,
            point: found.map(|x| (x / f64::from(scale)) as f32),
            triangle,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    #[test]
    fn the_minimum_is_that_over_all_triangles() {
        let r = Rng::new(5);
        let point =
            |i: usize, s: f32| [0, 1, 2].map(|k| s * (2.0 * r.uniform_f32(i as u64, k, 0x6702, 0) - 1.0));
        for spread in [1.0_f32, 0.02] {
            let p: Vec<[f32; 3]> = (0..900)
                .map(|i| {
                    let (c, d) = (point(i / 3, 1.0), point(1000 + i, spread));
                    [c[0] + d[0], c[1] + d[1], c[2] + d[2]]
                })
                .collect();
            let mut t: Vec<[u32; 3]> = (0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            t.extend_from_within(..50); // copies: the lowest index wins
            t.push([0, 0, 1]); // no area
            let bvh = Bvh::build(&p, &t);
            for i in 0..2000 {
                let q = if i % 4 == 0 { p[i % 900] } else { point(5000 + i, 1.5) };
                let got = bvh.nearest(q).expect("there are triangles");
                let mut best = (f64::INFINITY, 0);
                for (k, t) in t[..350].iter().enumerate() {
                    let (d, _) = measure(t.map(|i| p[i as usize]), q);
                    if d < best.0 {
                        best = (d, k as u32);
                    }
                }
                assert_eq!((got.triangle, got.distance), (best.1, best.0.sqrt() as f32), "point {i} {q:?}");
            }
        }
    }

    #[test]
    fn every_region_of_one_triangle() {
        let t = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        for (p, q) in [
            ([1.0, 1.0, 2.0], [1.0, 1.0, 0.0]),   // above
            ([-1.0, -2.0, 0.0], [0.0, 0.0, 0.0]), // corners
            ([6.0, -1.0, 1.0], [4.0, 0.0, 0.0]),
            ([-1.0, 7.0, 0.0], [0.0, 4.0, 0.0]),
            ([1.0, -3.0, 0.0], [1.0, 0.0, 0.0]), // edges
            ([-2.0, 3.0, 1.0], [0.0, 3.0, 0.0]),
            ([4.0, 4.0, 5.0], [2.0, 2.0, 0.0]),
        ] {
            assert_eq!(closest(t, p), q, "closest to {p:?}");
        }
    }

    #[test]
    fn scales_and_nothing() {
        assert_eq!(Bvh::build(&[], &[]).nearest([0.0; 3]), None, "no triangles");
        for s in [1e-20_f32, 1.0, 1e20] {
            let p = [[0.0, 0.0, 0.0], [s, 0.0, 0.0], [0.0, s, 0.0]];
            let near = Bvh::build(&p, &[[0, 1, 2]]).nearest([0.25 * s, 0.25 * s, 3.0 * s]).expect("one");
            assert_eq!((near.distance, near.triangle), (3.0 * s, 0), "scale {s:e}");
        }
    }
}
