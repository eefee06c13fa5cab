//! Extruded outlines: letters and digits, gears, stars, hearts.

use super::soup::Soup;
use super::{CREASED, Part, glyphs, polygon};
use crate::draws::Draws;
use crate::space::{V3, rotation, scaled};
use reference::num::elem::{cos, sin};
use std::f64::consts::{PI, TAU};

/// Rotates a flat shape upright: the up direction of the page becomes z, and the front faces −y.
fn upright(soup: Soup) -> Soup {
    soup.map(|p| [p[0], -p[2], p[1]])
}

/// One to four letters in one or two rows, of one or two materials.
pub(super) fn letters(draws: &mut Draws) -> Vec<Part> {
    let count = draws.named_whole("letters", 1, 5);
    let depth = draws.named("depth", 0.2, 0.6);
    let bevel = if draws.chance(0.75) { draws.named("bevel", 0.008, 0.03) } else { 0.0 };
    let two = draws.chance(0.4);
    let slant = draws.range(-0.2, 0.2);
    let rows = if count == 4 { 2 } else { 1 };
    let per = count / rows;
    let mut parts = Vec::new();
    for k in 0..count {
        let glyph = draws.named_whole("glyph", 0, glyphs::COUNT);
        let outline = glyphs::outline(glyph, 8);
        let (column, row) = (k % per, k / per);
        let soup = polygon::extrude(&outline, depth, bevel, 3).refined(3000 / count);
        let wide = outline[0].iter().fold(0.0, |m, p| crate::space::larger(m, p[0]));
        let tilt = rotation([0.0, 0.0, 1.0], draws.range(-0.25, 0.25));
        let at = [column as f64 - 0.5 * wide, row as f64 * -1.1, -0.5 * depth];
        let soup =
            upright(soup.moved([-0.5 * wide, 0.0, -0.5 * depth]).map(|p| [p[0] + slant * p[1], p[1], p[2]]));
        let soup = soup.turned(&tilt).moved([at[0] + 0.5 * wide, 0.0, at[1]]);
        parts.push(Part::new(soup, CREASED).group(if two { k % 2 } else { 0 }));
    }
    super::joined(parts)
}

/// A gear, star, flower or cookie, often with holes.
pub(super) fn cutout(draws: &mut Draws) -> Vec<Part> {
    let kind = draws.named_whole("outline", 0, 4);
    let teeth = draws.named_whole("teeth", 5, 17);
    let n = teeth * 16;
    let depth = draws.named("depth", 0.12, 0.7);
    let high = draws.range(0.12, 0.3);
    let waves: Vec<[f64; 3]> =
        (2..6).map(|k| [draws.range(-0.07, 0.07), f64::from(k), draws.range(0.0, TAU)]).collect();
    let outline: Vec<[f64; 2]> = (0..n)
        .map(|i| {
            let a = TAU * i as f64 / n as f64;
            let phase = (i % 16) as f64 / 16.0;
            let r = match kind {
                0 => {
                    // Trapezoidal teeth.
                    let up = crate::space::clamp(4.0 * (0.5 - (phase - 0.5).abs()) - 0.4, 0.0, 1.0);
                    1.0 - high + high * up
                }
                1 => {
                    // A straight-edged star: with sixteen steps, edges that are linear in the inverse radius
                    // are straight enough.
                    let t = 2.0 * (phase - 0.5).abs();
                    1.0 / (1.0 + (1.6 * high + 0.25) * 2.0 * t)
                }
                2 => 0.85 + 0.6 * high * cos(teeth as f64 * a),
                // A cookie: a few waves around.
                _ => waves.iter().fold(0.8, |r, w| r + w[0] * cos(w[1] * a + w[2])),
            };
            [r * cos(a), r * sin(a)]
        })
        .collect();
    let mut contours = vec![outline];
    if draws.chance(0.6) {
        let hole = if kind == 1 { draws.range(0.1, 0.2) } else { draws.range(0.15, 0.4) };
        contours.push(circle([0.0; 2], hole, 48));
        if draws.chance(0.5) && kind == 0 && hole < 0.3 {
            let spokes = draws.whole(3, 7);
            for k in 0..spokes {
                let a = TAU * (k as f64 + 0.5) / spokes as f64;
                let r = 0.5 * (hole + 0.62);
                let small = crate::space::smaller(0.35 * (0.62 - hole), 0.7 * r * sin(PI / spokes as f64));
                contours.push(circle([r * cos(a), r * sin(a)], small, 24));
            }
        }
    }
    let soup = polygon::extrude(&contours, depth, 0.02, 4).refined(2500);
    let soup = upright(soup.moved([0.0, 0.0, -0.5 * depth]));
    vec![Part::new(soup, CREASED)]
}

fn circle(center: [f64; 2], r: f64, n: usize) -> Vec<[f64; 2]> {
    (0..n)
        .map(|i| {
            let a = TAU * i as f64 / n as f64;
            [center[0] + r * cos(a), center[1] + r * sin(a)]
        })
        .collect()
}

/// A prism over a regular polygon, standing on z = 0.
pub(super) fn prism(corners: usize, r: f64, h: f64, bevel: f64) -> Soup {
    let outline = circle([0.0; 2], r, corners);
    polygon::extrude(&[outline], h, bevel, 6).refined(500)
}

/// A wedge or fin: a triangle with the given corners, `thick` deep, upright in the x–z plane.
pub(super) fn fin(places: &[[f64; 2]], thick: f64) -> Soup {
    let soup = polygon::extrude(&[places.to_vec()], thick, 0.2 * thick, 2).refined(300);
    let half: V3 = scaled([0.0, 0.0, thick], -0.5);
    upright(soup.moved(half))
}
