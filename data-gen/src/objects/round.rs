//! Star-shaped solids: superquadrics, blobs, rocks, rounded polyhedra; and the supertorus.

use super::sheets::{ball, tube};
use super::{Part, SMOOTH};
use crate::draws::Draws;
use crate::noise::Noise;
use crate::space::{V3, dot, larger, power, scaled, smaller, unit};
use reference::num::elem::{cos, exp, sin};
use std::f64::consts::TAU;

/// Radius of the superquadric (|x|^(2/e₂) + |y|^(2/e₂))^(e₂/e₁) + |z|^(2/e₁) = 1 in a direction.
fn superquadric_radius(d: V3, half: V3, e1: f64, e2: f64) -> f64 {
    let q = |k: usize, e: f64| power(d[k] / half[k], 2.0 / e);
    let f = power(q(0, e2) + q(1, e2), e2 / e1) + q(2, e1);
    1.0 / power(f, 0.5 * e1)
}

/// A rounded box, cylinder, ball, double cone or star, determined by two exponents.
pub(super) fn superquadric(draws: &mut Draws) -> Vec<Part> {
    let e1 = draws.named("exponent_1", 0.25, 2.2);
    let e2 = draws.named("exponent_2", 0.25, 2.2);
    let half = [draws.range(0.5, 1.0), draws.range(0.5, 1.0), draws.range(0.5, 1.4)];
    vec![Part::new(superquadric_soup(40, half, e1, e2), SMOOTH)]
}

/// The same with given parameters.
pub(super) fn superquadric_soup(n: usize, half: V3, e1: f64, e2: f64) -> super::soup::Soup {
    ball(n, |d| scaled(d, superquadric_radius(d, half, e1, e2)))
}

/// A ring with two exponents and a wavy cross-section.
pub(super) fn supertorus(draws: &mut Draws) -> Vec<Part> {
    let (e1, e2) = (draws.named("exponent_1", 0.3, 1.7), draws.named("exponent_2", 0.4, 1.4));
    let thick = draws.named("thickness", 0.18, 0.42);
    let waves = draws.named_whole("waves", 0, 9) as f64;
    let height = draws.range(0.0, 0.25);
    let n = 128;
    // A superellipse with constant steps of direction, so that no two points coincide.
    let ring = |a: f64| {
        let (c, s) = (cos(a), sin(a));
        let r = 1.0 / power(power(c, 2.0 / e2) + power(s, 2.0 / e2), 0.5 * e2);
        [r * c, r * s]
    };
    let places: Vec<(V3, V3, V3)> = (0..n)
        .map(|i| {
            let a = TAU * i as f64 / n as f64;
            let [x, y] = ring(a);
            ([x, y, 0.0], [-cos(a), -sin(a), 0.0], [0.0, 0.0, 1.0])
        })
        .collect();
    let stretch = draws.range(0.6, 1.6);
    let soup = tube(&places, 56, Some(0), |i, j| {
        let b = TAU * j as f64 / 56.0;
        let (c, s) = (cos(b), sin(b));
        let r = 1.0 / power(power(c, 2.0 / e1) + power(s, 2.0 / e1), 0.5 * e1);
        let w = 1.0 + height * cos(waves * TAU * i as f64 / n as f64);
        [thick * w * r * c, stretch * thick * w * r * s]
    });
    vec![Part::new(soup, SMOOTH)]
}

/// A smooth blob, sometimes with bumps or ridges.
pub(super) fn blob(draws: &mut Draws) -> Vec<Part> {
    let noise = Noise::new(draws);
    let frequency = draws.named("frequency", 0.8, 2.6);
    let height = draws.named("height", 0.15, 0.55);
    let kind = draws.named_whole("kind", 0, 4);
    let spikes = draws.range(3.0, 6.0);
    let stretch = [draws.range(0.7, 1.2), draws.range(0.7, 1.2), draws.range(0.7, 1.4)];
    let soup = ball(48, |d| {
        let q = scaled(d, frequency);
        let swell = noise.octaves(q, 2);
        let detail = match kind {
            0 => swell,
            1 => swell + 0.25 * noise.octaves(scaled(q, 4.0), 2),
            2 => 0.6 - 1.6 * noise.octaves(q, 3).abs(),
            _ => {
                let s = noise.at(scaled(d, spikes));
                swell * 0.5 + larger(s, 0.0) * larger(s, 0.0) * 1.4
            }
        };
        let r = larger(1.0 + height * detail, 0.3);
        std::array::from_fn(|k| d[k] * r * stretch[k])
    });
    vec![Part::new(soup, SMOOTH)]
}

/// A stone: a blob cut by planes, with a rough surface.
pub(super) fn rock(draws: &mut Draws) -> Vec<Part> {
    let noise = Noise::new(draws);
    let cuts = draws.named_whole("cuts", 6, 22);
    let planes: Vec<(V3, f64)> = (0..cuts).map(|_| (draws.direction(), draws.range(0.65, 0.95))).collect();
    let rough = draws.named("roughness", 0.01, 0.06);
    let stretch = [draws.range(0.7, 1.2), draws.range(0.7, 1.2), draws.range(0.6, 1.1)];
    let soup = ball(48, |d| {
        let lump = 1.0 + 0.25 * noise.octaves(scaled(d, 1.3), 2);
        let cut = planes.iter().fold(lump, |r, (n, h)| {
            let c = dot(*n, d);
            if c > 0.05 { smaller(r, h / c) } else { r }
        });
        let r = cut + rough * noise.octaves(scaled(d, 7.0), 3);
        std::array::from_fn(|k| d[k] * r * stretch[k])
    });
    vec![Part::new(soup, 0.8)]
}

/// Face normals of the five regular solids, not normalised.
fn solid(kind: usize) -> Vec<V3> {
    let g = 0.5 * (1.0 + 5.0_f64.sqrt());
    let cyclic = |p: V3| [p, [p[1], p[2], p[0]], [p[2], p[0], p[1]]];
    let signs = |p: V3| -> Vec<V3> {
        let mut out: Vec<V3> = Vec::new();
        for m in 0..8 {
            let q: V3 = std::array::from_fn(|k| if m >> k & 1 == 1 { -p[k] } else { p[k] });
            if !out.iter().any(|o| (0..3).all(|k| o[k] == q[k])) {
                out.push(q);
            }
        }
        out
    };
    let all = |ps: &[V3]| -> Vec<V3> { ps.iter().flat_map(|&p| signs(p)).map(unit).collect() };
    match kind {
        0 => [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(unit).to_vec(),
        1 => all(&cyclic([1.0, 0.0, 0.0])),
        2 => all(&[[1.0, 1.0, 1.0]]),
        3 => all(&cyclic([0.0, 1.0, g])),
        4 => all(&[&[[1.0, 1.0, 1.0]][..], &cyclic([0.0, 1.0 / g, g])].concat()),
        _ => all(&[&cyclic([1.0, 0.0, 0.0])[..], &cyclic([0.0, 1.0, 1.0]), &[[1.0, 1.0, 1.0]]].concat()),
    }
}

/// A regular solid with rounded edges, or a star over its faces.
pub(super) fn polyhedron(draws: &mut Draws) -> Vec<Part> {
    let normals = solid(draws.named_whole("solid", 0, 6));
    let sharp = draws.named("sharpness", 12.0, 60.0);
    let star = if draws.chance(0.35) { draws.named("star", 0.3, 0.9) } else { 0.0 };
    let stretch = draws.range(0.8, 1.5);
    let soup = ball(48, |d| {
        let sum = normals.iter().fold(0.0, |s, n| {
            let c = dot(*n, d);
            if c > 0.0 { s + power(c, sharp) } else { s }
        });
        let flat = 1.0 / power(sum, 1.0 / sharp);
        let spike = if star > 0.0 {
            normals.iter().fold(0.0, |s, n| s + exp(18.0 * (dot(*n, d) - 1.0)))
        } else {
            0.0
        };
        let r = flat + star * spike;
        [d[0] * r, d[1] * r, d[2] * r * stretch]
    });
    vec![Part::new(soup, if star > 0.0 { SMOOTH } else { 0.9 })]
}
