//! Tubes along curves: knots, shells, chains; and twisted columns.

use super::sheets::{frames, lathe, straight_run, tube};
use super::{CREASED, Part, SMOOTH};
use crate::draws::Draws;
use crate::space::{V3, add, cross, larger, power, rotated, rotation, scaled, sub, unit};
use reference::num::elem::{cos, exp, sin};
use std::f64::consts::{PI, TAU};

/// Radius at an angle of a cross-section of unit size: round, square, polygonal or a star.
fn section_radius(kind: usize, corners: usize, angle: f64) -> f64 {
    let n = corners as f64;
    match kind {
        0 => 1.0,
        1 => {
            // A polygon with rounded corners: the p-norm of the distances of its edges.
            let sum = (0..corners).fold(0.0, |s, k| {
                let c = cos(angle - TAU * k as f64 / n);
                if c > 0.0 { s + power(c, 14.0) } else { s }
            });
            0.85 / power(sum, 1.0 / 14.0)
        }
        _ => 0.85 + 0.22 * cos(n * angle),
    }
}

/// A torus knot; its cross-section may be square or a star, and may rotate along the curve.
pub(super) fn knot(draws: &mut Draws) -> Vec<Part> {
    let (p, q) = draws.pick(&[(2, 3), (3, 2), (2, 5), (3, 4), (3, 5), (1, 3), (1, 0), (2, 7), (4, 3)]);
    draws.note("p", f64::from(p));
    draws.note("q", f64::from(q));
    let minor = draws.named("minor", 0.3, 0.5);
    let flat = draws.range(0.7, 1.3);
    let thick = draws.named("thickness", 0.1, 0.2)
        * if p * q > 10 {
            0.65
        } else if p == 1 {
            1.9
        } else {
            1.1
        };
    let kind = draws.named_whole("section", 0, 3);
    let corners = draws.named_whole("corners", 3, 6);
    let turns = if kind == 0 { 0 } else { draws.whole(0, 2 * corners) };
    let waves = f64::from(draws.whole(0, 12) as u32);
    let swell = draws.range(0.0, 0.3);
    let n = (60 * (p + q) as usize).clamp(180, 480);
    let around = 32 / corners * corners;
    let at = |i: usize| -> V3 {
        let t = TAU * i as f64 / n as f64;
        let (a, b) = (f64::from(p) * t, f64::from(q) * t);
        let r = 1.0 + minor * cos(b);
        [r * cos(a), r * sin(a), flat * minor * sin(b)]
    };
    let places: Vec<(V3, V3, V3)> = (0..n)
        .map(|i| {
            let t = TAU * i as f64 / n as f64;
            let (a, b) = (f64::from(p) * t, f64::from(q) * t);
            let tangent = unit(sub(at((i + 1) % n), at((i + n - 1) % n)));
            // The normal of the torus is the same again after one round.
            let out = [cos(b) * cos(a), cos(b) * sin(a), sin(b)];
            let binormal = unit(cross(tangent, out));
            (at(i), cross(binormal, tangent), binormal)
        })
        .collect();
    // `turns` steps of one corner each; the last ring is connected to the first with an offset of that many
    // corners. The ring runs clockwise.
    let shift = turns * around / corners % around;
    let soup = tube(&places, around, Some((around - shift) % around), |i, j| {
        let along = i as f64 / n as f64;
        let angle = TAU * j as f64 / around as f64;
        let turned = angle + TAU * turns as f64 / corners as f64 * along;
        let r = thick * section_radius(kind, corners, angle) * (1.0 + swell * cos(waves * TAU * along));
        [r * cos(turned), r * sin(turned)]
    });
    vec![Part::new(soup, if kind == 1 { 0.9 } else { SMOOTH })]
}

/// A snail's shell or a horn: a tube that widens along a spiral.
pub(super) fn shell(draws: &mut Draws) -> Vec<Part> {
    let turns = draws.named("turns", 1.2, 4.5);
    let growth = draws.named("growth", 0.09, 0.22);
    let lift = draws.named("lift", 0.0, 1.8);
    let thick = draws.named("thickness", 0.3, 0.5);
    let ribs = draws.whole(0, 30) as f64;
    let deep = if draws.chance(0.6) { draws.range(0.02, 0.09) } else { 0.0 };
    let n = (80.0 * turns) as usize;
    let curve: Vec<V3> = (0..=n)
        .map(|i| {
            let a = TAU * turns * i as f64 / n as f64;
            let r = exp(growth * a);
            [r * cos(a), r * sin(a), -lift * r]
        })
        .collect();
    let grown: Vec<f64> = (0..=n).map(|i| exp(growth * TAU * turns * i as f64 / n as f64)).collect();
    let soup = tube(&frames(&curve), 40, None, |i, j| {
        let b = TAU * j as f64 / 40.0;
        let rib = 1.0 + deep * cos(ribs * TAU * turns * i as f64 / n as f64);
        let r = thick * grown[i] * rib;
        [r * cos(b), r * sin(b)]
    });
    vec![Part::new(soup, 0.6)]
}

/// Rings or links in a row, each through the next.
pub(super) fn chain(draws: &mut Draws) -> Vec<Part> {
    let links = draws.named_whole("links", 2, 5);
    let thick = draws.named("thickness", 0.16, 0.26);
    let long = draws.named("length", 0.1, 0.9);
    let n = 72;
    let kind = draws.whole(0, 2);
    let bow = draws.range(-0.25, 0.25);
    let mut parts: Vec<Part> = Vec::new();
    let spacing = 2.0 * (1.0 - 1.2 * thick) * 0.5 + long;
    for k in 0..links {
        let places: Vec<(V3, V3, V3)> = (0..n)
            .map(|i| {
                let a = TAU * i as f64 / n as f64;
                let (c, s) = (cos(a), sin(a));
                // A stadium: two half circles separated by `long`, joined smoothly.
                let x = 0.5 * c + 0.5 * long * crate::space::clamp(1.6 * c, -1.0, 1.0);
                ([x, 0.5 * s, 0.0], [-c, -s, 0.0], [0.0, 0.0, 1.0])
            })
            .collect();
        let soup = tube(&places, 28, Some(0), |_, j| {
            let b = TAU * j as f64 / 28.0;
            let r = thick * 0.5 * section_radius(kind, 4, b);
            [r * cos(b), r * sin(b)]
        });
        let upright = rotation([1.0, 0.0, 0.0], if k % 2 == 0 { 0.15 } else { 0.5 * PI + 0.15 });
        let middle = k as f64 - 0.5 * (links - 1) as f64;
        let yaw = rotation([0.0, 0.0, 1.0], bow * middle);
        let mut at = [0.0; 3];
        for step in 0..k {
            let half = rotation([0.0, 0.0, 1.0], bow * (step as f64 + 0.5 - 0.5 * (links - 1) as f64));
            at = add(at, rotated(&half, [spacing, 0.0, 0.0]));
        }
        let link = soup.turned(&upright).turned(&yaw).moved(at);
        parts.push(Part::new(link, if kind == 0 { SMOOTH } else { 0.9 }).group(k % 2));
    }
    super::joined(parts)
}

/// A twisted and tapered column over a polygon or a star, sometimes leaning.
pub(super) fn column(draws: &mut Draws) -> Vec<Part> {
    let corners = draws.named_whole("corners", 3, 9);
    let kind = draws.named_whole("section", 0, 3);
    let twist = draws.named("twist", -1.5, 1.5) * PI;
    let top = draws.named("taper", 0.25, 1.1);
    let height = draws.named("height", 1.0, 3.0);
    let belly = draws.range(-0.25, 0.4);
    let lean = draws.range(-0.4, 0.4);
    let around = 12 * corners;
    let rows = 60;
    // A body of revolution of radius 1, deformed afterwards.
    let r = 0.5;
    let side = |t: f64| 1.0 + (top - 1.0) * t + belly * sin(PI * t);
    let edge = 0.02;
    let runs = vec![
        straight_run([0.0, 0.0], [r, 0.0], 5),
        straight_run([r, 0.0], [r + edge, edge], 2),
        straight_run([r + edge, edge], [r + edge, height - edge], rows),
        straight_run([r + edge, height - edge], [r, height], 2),
        straight_run([r, height], [0.0, height], 5),
    ];
    let mut soup = lathe(around, &runs, |a, _| section_radius(kind, corners, a));
    soup = soup.map(|p| {
        let t = p[2] / height;
        let m = rotation([0.0, 0.0, 1.0], twist * t);
        let q = rotated(&m, scaled([p[0], p[1], 0.0], larger(side(t), 0.1)));
        [q[0] + lean * t * t * height, q[1], p[2]]
    });
    vec![Part::new(soup, if kind == 2 { 0.7 } else { CREASED })]
}
