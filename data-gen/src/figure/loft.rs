//! Closed tubes through ellipses, from which limbs and clothes are made.

use super::skeleton::{V3, add, cross, dot, scale, sub, unit};
use reference::num::elem::{cos, sin};
use std::f64::consts::TAU;

/// An ellipse in space, in metres. x × y points along the tube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ring {
    pub(super) center: V3,
    pub(super) x: V3,
    pub(super) y: V3,
    /// Half axes along x and y.
    pub(super) half: [f64; 2],
}

/// A closed surface at rest, in metres. Vertices on the seam are duplicated; `weld` gives the first of each
/// set of duplicates.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Shell {
    pub(super) positions: Vec<V3>,
    /// Turn around the tube (0 at the start of y, which is the back of an upward tube; ½ is opposite) and
    /// length along it in metres.
    pub(super) around_along: Vec<[f64; 2]>,
    /// Unit direction away from the tube's axis, across the tube; zero on the axis.
    pub(super) outward: Vec<V3>,
    /// Smaller and larger half axis of the vertex's ellipse, metres; zero on the axis.
    pub(super) halves: Vec<[f64; 2]>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) weld: Vec<u32>,
}

/// A ring of an upward tube.
pub(super) fn level(z: f64, a: f64, b: f64, y: f64) -> Ring {
    Ring { center: [0.0, y, z], x: [1.0, 0.0, 0.0], y: [0.0, 1.0, 0.0], half: [a, b] }
}

/// Rings across a path, with the given half axes; the first axis is as close to `side` as the path allows.
pub(super) fn along(path: &[V3], side: V3, halves: &[[f64; 2]]) -> Vec<Ring> {
    assert!(path.len() == halves.len() && path.len() > 1, "one pair of half axes per point");
    let last = path.len() - 1;
    let mut ahead = [0.0; 3];
    (0..path.len())
        .map(|i| {
            let (before, behind) =
                (path[if i > 0 { i - 1 } else { 0 }], path[if i < last { i + 1 } else { last }]);
            let forward = unit(sub(behind, before));
            // A hem folds back into its tube; its rings keep their orientation, otherwise the tube would be
            // twisted.
            if i == 0 || dot(forward, ahead) > 0.0 {
                ahead = forward;
            }
            let x = unit(sub(side, scale(ahead, dot(side, ahead))));
            Ring { center: path[i], x, y: cross(ahead, x), half: halves[i] }
        })
        .collect()
}

fn numbers(r: &Ring) -> [f64; 11] {
    let (c, x, y, h) = (r.center, r.x, r.y, r.half);
    [c[0], c[1], c[2], x[0], x[1], x[2], y[0], y[1], y[2], h[0], h[1]]
}

fn ring(n: [f64; 11]) -> Ring {
    let x = unit([n[3], n[4], n[5]]);
    let y = [n[6], n[7], n[8]];
    let y = unit(sub(y, scale(x, dot(x, y))));
    Ring { center: [n[0], n[1], n[2]], x, y, half: [n[9], n[10]] }
}

/// Rings interpolated between key rings: a cubic Hermite curve through all their parameters with
/// finite-difference slopes over chord length, at most `step` metres apart.
pub(super) fn between(keys: &[Ring], step: f64) -> Vec<Ring> {
    let values: Vec<[f64; 11]> = keys.iter().map(numbers).collect();
    let mut chords = vec![0.0];
    for pair in keys.windows(2) {
        let off = sub(pair[1].center, pair[0].center);
        let (da, db) = (pair[1].half[0] - pair[0].half[0], pair[1].half[1] - pair[0].half[1]);
        let chord = (dot(off, off) + da * da + db * db).sqrt();
        chords.push(chords[chords.len() - 1] + chord);
    }
    let last = keys.len() - 1;
    let slope = |i: usize, k: usize| {
        let (lo, hi) = (if i > 0 { i - 1 } else { 0 }, if i < last { i + 1 } else { last });
        (values[hi][k] - values[lo][k]) / (chords[hi] - chords[lo])
    };
    let mut rings = vec![keys[0]];
    for i in 0..last {
        let width = chords[i + 1] - chords[i];
        let pieces = (width / step).ceil() as usize;
        for p in 1..=pieces {
            if p == pieces {
                rings.push(keys[i + 1]);
                continue;
            }
            let t = p as f64 / pieces as f64;
            let (t2, t3) = (t * t, t * t * t);
            rings.push(ring(std::array::from_fn(|k| {
                (2.0 * t3 - 3.0 * t2 + 1.0) * values[i][k]
                    + (t3 - 2.0 * t2 + t) * width * slope(i, k)
                    + (3.0 * t2 - 2.0 * t3) * values[i + 1][k]
                    + (t3 - t2) * width * slope(i + 1, k)
            })));
        }
    }
    rings
}

/// Connects rings to a tube with `around` vertices each, and closes both ends by a fan around their centre.
/// `shape` may move a vertex, given its turn around; it must move vertices at the same position equally.
pub(super) fn tube(rings: &[Ring], around: usize, shape: impl Fn(f64, V3) -> V3) -> Shell {
    let mut shell = Shell::default();
    let (start, end) = (rings[0].center, rings[rings.len() - 1].center);
    let mut length = 0.0;
    for (i, r) in rings.iter().enumerate() {
        if i > 0 {
            let off = sub(r.center, rings[i - 1].center);
            let wider = r.half[0] - rings[i - 1].half[0];
            length += (dot(off, off) + wider * wider).sqrt();
        }
        let first = shell.positions.len() as u32;
        for k in 0..=around {
            let turn = k as f64 / around as f64;
            // The vertex after the last one equals the first one.
            let place = (k % around) as f64 / around as f64;
            let angle = TAU * (place + 0.25);
            let [a, b] = r.half;
            let (c, s) = (cos(angle), sin(angle));
            let p = add(r.center, add(scale(r.x, a * c), scale(r.y, b * s)));
            shell.positions.push(shape(place, p));
            // The gradient of x²/a² + y²/b², times a b.
            shell.outward.push(unit(add(scale(r.x, b * c), scale(r.y, a * s))));
            shell.halves.push(if a < b { [a, b] } else { [b, a] });
            shell.around_along.push([turn, length]);
            shell.weld.push(first + (k % around) as u32);
        }
    }
    let row = around as u32 + 1;
    for i in 0..rings.len() as u32 - 1 {
        for k in 0..around as u32 {
            let (a, b) = (i * row + k, (i + 1) * row + k);
            shell.triangles.push([a, a + 1, b + 1]);
            shell.triangles.push([a, b + 1, b]);
        }
    }
    let n = shell.positions.len() as u32;
    let top = (rings.len() as u32 - 1) * row;
    shell.positions.extend([start, end]);
    shell.around_along.extend([[0.5, 0.0], [0.5, length]]);
    shell.outward.extend([[0.0; 3]; 2]);
    shell.halves.extend([[0.0; 2]; 2]);
    shell.weld.extend([n, n + 1]);
    for k in 0..around as u32 {
        shell.triangles.push([n, k + 1, k]);
        shell.triangles.push([n + 1, top + k, top + k + 1]);
    }
    shell
}

impl Shell {
    /// The mirror image, for the other side of the body.
    pub(super) fn mirrored(&self) -> Self {
        let mut m = self.clone();
        m.positions.iter_mut().for_each(|p| p[0] = -p[0]);
        m.outward.iter_mut().for_each(|o| o[0] = -o[0]);
        m.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        m
    }
}

/// Unit vertex normals: area-weighted normals of the triangles around each welded vertex, summed in the order
/// of the triangles.
pub(super) fn normals(positions: &[V3], triangles: &[[u32; 3]], weld: &[u32]) -> Vec<V3> {
    let mut sums = vec![[0.0; 3]; positions.len()];
    for t in triangles {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let face = cross(sub(b, a), sub(c, a));
        for &i in t {
            let at = weld[i as usize] as usize;
            sums[at] = add(sums[at], face);
        }
    }
    weld.iter().map(|&w| unit(sums[w as usize])).collect()
}
