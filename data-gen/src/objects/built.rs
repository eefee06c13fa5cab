//! Objects composed of several bodies: stacks, furniture, packages, toys.

use super::round::superquadric_soup;
use super::sheets::{lathe, rounded_box, straight_run, tube};
use super::soup::Soup;
use super::turned::{cylinder, turned_soup};
use super::{CREASED, Part, SMOOTH, flat};
use crate::draws::Draws;
use crate::space::{V3, rotation};
use reference::num::elem::{cos, sin};
use std::f64::consts::{PI, TAU};

/// A simple body on z = 0, about `size` wide, with the cosine of its crease angle.
fn body(draws: &mut Draws, size: f64) -> (Soup, f64) {
    let h = size * draws.range(0.5, 1.4);
    match draws.whole(0, 9) {
        0 => {
            let half = [0.5 * size, 0.5 * size * draws.range(0.5, 1.2), 0.5 * h];
            (rounded_box(half, draws.range(0.08, 0.5), 3, 10).moved([0.0, 0.0, half[2]]), SMOOTH)
        }
        1 => (cylinder(0.5 * size, h, 0.5 * size, 0.03 * size), CREASED),
        2 => (cylinder(0.5 * size, h, 0.5 * size * draws.range(0.25, 0.8), 0.03 * size), CREASED),
        3 => {
            let cone = vec![
                straight_run([0.0, 0.0], [0.5 * size, 0.0], 6),
                straight_run([0.5 * size, 0.0], [0.0, h], 20),
            ];
            (lathe(64, &cone, |_, _| 1.0), CREASED)
        }
        4 => {
            let r = 0.5 * size;
            (superquadric_soup(18, [r; 3], 1.0, 1.0).moved([0.0, 0.0, r]), SMOOTH)
        }
        5 => {
            let (big, small) = (0.35 * size, 0.15 * size);
            (ring(big, small).moved([0.0, 0.0, small]), SMOOTH)
        }
        6 => (flat::prism(draws.whole(3, 9), 0.55 * size, h, 0.025 * size), CREASED),
        7 => {
            let half = [0.5 * size, 0.5 * size, 0.4 * h];
            let (a, b) = (draws.range(0.3, 1.9), draws.range(0.3, 1.9));
            (superquadric_soup(18, half, a, b).moved([0.0, 0.0, half[2]]), SMOOTH)
        }
        _ => {
            let soup = turned_soup(draws);
            let [_, top] = soup.span();
            (soup.grown(h / top), CREASED)
        }
    }
}

fn ring(big: f64, small: f64) -> Soup {
    let places: Vec<(V3, V3, V3)> = (0..64)
        .map(|i| {
            let a = TAU * i as f64 / 64.0;
            ([big * cos(a), big * sin(a), 0.0], [-cos(a), -sin(a), 0.0], [0.0, 0.0, 1.0])
        })
        .collect();
    tube(&places, 32, Some(0), |_, j| {
        let b = TAU * j as f64 / 32.0;
        [small * cos(b), small * sin(b)]
    })
}

/// Three to six bodies on top of one another, slightly rotated.
pub(super) fn stack(draws: &mut Draws) -> Vec<Part> {
    let count = draws.named_whole("bodies", 3, 7);
    let shrink = draws.named("shrink", 0.7, 1.05);
    let (mut z, mut size) = (0.0, 1.0);
    (0..count)
        .map(|k| {
            let (soup, crease) = body(draws, size);
            let turn = rotation([0.0, 0.0, 1.0], draws.range(0.0, TAU));
            let shift = [draws.range(-0.08, 0.08) * size, draws.range(-0.08, 0.08) * size];
            let soup = soup.turned(&turn).moved([shift[0], shift[1], z - 0.004]);
            z = soup.span()[1];
            size *= shrink * draws.range(0.8, 1.2);
            Part::new(soup, crease).group(k)
        })
        .collect()
}

/// A box of the given extent around a position.
fn block(at: V3, half: V3, round: f64) -> Soup {
    rounded_box(half, round, 2, 6).moved(at)
}

/// A chair, stool, table or shelf made of boards and legs.
pub(super) fn furniture(draws: &mut Draws) -> Vec<Part> {
    let kind = draws.named_whole("furniture", 0, 4);
    let (w, d) = (draws.range(0.35, 0.5), draws.range(0.32, 0.5));
    let board = draws.range(0.025, 0.05);
    let leg = draws.range(0.025, 0.05);
    let seat = match kind {
        2 => draws.range(0.6, 0.8),
        _ => draws.range(0.4, 0.6),
    };
    let wide = if kind == 2 { 1.8 } else { 1.0 };
    let is_turned = draws.chance(0.4);
    let mut frame = Soup::default();
    let mut top = Soup::default();
    if kind == 3 {
        // A shelf: two sides, boards between, objects on them.
        let (h, levels) = (draws.range(0.9, 1.4), draws.whole(2, 5));
        for side in [-1.0, 1.0] {
            frame.append(&block([side * w, 0.0, 0.5 * h], [board, 0.5 * d, 0.5 * h], 0.3));
        }
        let mut things: Vec<Part> = Vec::new();
        for level in 0..levels {
            let z = board + (h - 2.0 * board) * level as f64 / (levels - 1) as f64;
            frame.append(&block([0.0, 0.0, z], [w, 0.48 * d, 0.7 * board], 0.3));
            if level + 1 < levels {
                let (soup, crease) = body(draws, 0.5 * h / levels as f64);
                let x = draws.range(-0.5, 0.5) * w;
                things.push(
                    Part::new(soup.moved([x, 0.0, z + 0.7 * board - 0.002]), crease).group(1 + level % 2),
                );
            }
        }
        let mut parts = vec![Part::new(frame, SMOOTH)];
        parts.extend(things);
        return super::joined(parts);
    }
    top.append(&block([0.0, 0.0, seat], [wide * w, d, board], draws.range(0.3, 0.9)));
    let splay = draws.range(0.0, 0.12);
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let h = seat - 0.5 * board;
        let soup = if is_turned {
            cylinder(leg * 0.6, h, leg * 1.3, 0.01)
        } else {
            block([0.0, 0.0, 0.5 * h], [leg, leg, 0.5 * h], 0.25)
        };
        let at = [x * (wide * w - 1.5 * leg), y * (d - 1.5 * leg), 0.0];
        let lean = soup.map(|p| [p[0] + x * splay * (h - p[2]), p[1] + y * splay * (h - p[2]), p[2]]);
        frame.append(&lean.moved(at));
    }
    if kind == 0 {
        let back = draws.range(0.45, 0.75);
        let slats = draws.whole(1, 5);
        for x in [-1.0, 1.0] {
            frame.append(&block([x * (w - leg), d - leg, seat + 0.5 * back], [leg, leg, 0.5 * back], 0.3));
        }
        for k in 0..slats {
            let z = seat + back * (k as f64 + 1.0) / slats as f64 - 0.06;
            let high = crate::space::smaller(0.4 * back / slats as f64, 0.09);
            top.append(&block([0.0, d - leg, z], [w - leg, 0.5 * leg, high], 0.4));
        }
    }
    if draws.chance(0.5) {
        frame.append(&top);
        vec![Part::new(frame, SMOOTH)]
    } else {
        vec![Part::new(frame, SMOOTH), Part::new(top, SMOOTH).group(1)]
    }
}

/// A printed carton, a book, or a stack of them.
pub(super) fn package(draws: &mut Draws) -> Vec<Part> {
    let count = if draws.chance(0.5) { 1 } else { draws.named_whole("boxes", 2, 5) };
    let mut z = 0.0;
    let mut parts = Vec::new();
    for k in 0..count {
        let is_book = draws.chance(0.4);
        let half = if is_book {
            [draws.range(0.3, 0.45), draws.range(0.4, 0.6), draws.range(0.05, 0.14)]
        } else if count == 1 {
            [draws.range(0.3, 0.5), draws.range(0.12, 0.4), draws.range(0.3, 0.7)]
        } else {
            [draws.range(0.25, 0.5), draws.range(0.25, 0.5), draws.range(0.1, 0.25)]
        };
        let turn = rotation([0.0, 0.0, 1.0], draws.range(-0.5, 0.5));
        if is_book {
            // Cover boards and spine around a block of paper.
            let c = 0.018;
            let mut cover = block([0.0, 0.0, half[2]], [half[0], half[1], c], 0.4);
            cover.append(&block([0.0, 0.0, -half[2]], [half[0], half[1], c], 0.4));
            cover.append(&block([-half[0], 0.0, 0.0], [c, half[1], half[2] + c], 0.8));
            let paper = block([0.01, 0.0, 0.0], [half[0] - 0.03, half[1] - 0.03, half[2] - 0.004], 0.05);
            let up = [0.0, 0.0, z + half[2] + c];
            parts.push(Part::new(cover.turned(&turn).moved(up), SMOOTH).printed().group(k));
            parts.push(Part::new(paper.turned(&turn).moved(up), SMOOTH).paper().group(100));
            z += 2.0 * (half[2] + c);
        } else {
            let soup = rounded_box(half, draws.range(0.03, 0.12), 3, 14).turned(&turn);
            parts.push(Part::new(soup.moved([0.0, 0.0, z + half[2]]), SMOOTH).printed().group(k));
            z += 2.0 * half[2];
        }
        z -= 0.002;
    }
    super::joined(parts)
}

/// A robot of boxes and joints, or a rocket with fins.
pub(super) fn toy(draws: &mut Draws) -> Vec<Part> {
    if draws.named_whole("toy", 0, 2) == 0 { robot(draws) } else { rocket(draws) }
}

fn robot(draws: &mut Draws) -> Vec<Part> {
    let round = draws.range(0.15, 0.7);
    let torso = [draws.range(0.2, 0.35), draws.range(0.14, 0.22), draws.range(0.22, 0.36)];
    let head = [draws.range(0.14, 0.22), draws.range(0.12, 0.2), draws.range(0.1, 0.18)];
    let (leg, arm) = (draws.range(0.2, 0.4), draws.range(0.2, 0.38));
    let limb = draws.range(0.05, 0.09);
    let hip = 2.0 * leg + 0.06;
    let neck = hip + 2.0 * torso[2];
    let mut main = block([0.0, 0.0, hip + torso[2]], torso, round);
    main.append(&block([0.0, 0.0, neck + 0.06 + head[2]], head, round));
    let mut limbs = cylinder(0.06, 0.12, 0.06, 0.01).moved([0.0, 0.0, neck - 0.02]);
    let mut eyes = Soup::default();
    let swing = draws.range(-0.6, 0.6);
    for side in [-1.0, 1.0] {
        let x = side * 0.6 * torso[0];
        limbs.append(&block([x, 0.0, leg + 0.04], [limb, limb, leg], 0.4));
        main.append(&block([x, -0.05, 0.045], [1.3 * limb, 1.9 * limb, 0.045], round));
        let shoulder = hip + 2.0 * torso[2] - limb;
        let upper = block([0.0, 0.0, -arm], [0.8 * limb, 0.8 * limb, arm], 0.5);
        let turn = rotation([1.0, 0.0, 0.0], side * swing);
        limbs.append(&upper.turned(&turn).moved([side * (torso[0] + limb), 0.0, shoulder]));
        let eye = superquadric_soup(8, [0.045; 3], 1.0, 1.0);
        eyes.append(&eye.moved([side * 0.5 * head[0], -head[1], neck + 0.08 + 1.1 * head[2]]));
    }
    vec![Part::new(main, SMOOTH), Part::new(limbs, CREASED).group(1), Part::new(eyes, SMOOTH).group(2)]
}

fn rocket(draws: &mut Draws) -> Vec<Part> {
    let (r, h) = (draws.range(0.16, 0.28), draws.range(1.2, 1.8));
    let nose = draws.range(0.3, 0.5) * h;
    let n = 16;
    let mut tip: Vec<[f64; 2]> = (0..=n)
        .map(|i| {
            let t = f64::from(i) / f64::from(n);
            [r * cos(0.5 * PI * t), h - nose + nose * crate::space::power(sin(0.5 * PI * t), 1.4)]
        })
        .collect();
    tip[0] = [r, h - nose];
    tip[n as usize] = [0.0, h];
    let body = vec![
        straight_run([0.0, 0.06], [0.5 * r, 0.02], 4),
        straight_run([0.5 * r, 0.02], [0.8 * r, 0.0], 2),
        straight_run([0.8 * r, 0.0], [r, 0.35 * h], 8),
        straight_run([r, 0.35 * h], [r, h - nose], 8),
        tip,
    ];
    let count = draws.whole(3, 6);
    let mut fins = Soup::default();
    let reach = draws.range(0.18, 0.35);
    for k in 0..count {
        let fin =
            flat::fin(&[[0.75 * r, 0.06], [r + reach, -0.12], [r + reach, 0.08], [0.9 * r, 0.45 * h]], 0.045);
        fins.append(&fin.turned(&rotation([0.0, 0.0, 1.0], TAU * k as f64 / count as f64)));
    }
    vec![Part::new(lathe(72, &body, |_, _| 1.0), 0.8), Part::new(fins, CREASED).group(1)]
}
