//! The parts of the body itself: head with hair and ears, neck, arms, hands, legs, and the shoes.

use super::{FACE, HAIR, Piece, SHOES, SKIN, UPPER, arm_tube, both, hinge, leg_tube, plain, smooth};
use crate::figure::appearance::{Appearance, Bottom};
use crate::figure::loft::{Ring, Shell, along, between, level, tube};
use crate::figure::skeleton::{LEFT, V3, add, cross, scale, sub, unit};
use crate::figure::surface::section;
use crate::figure::texture::{FACE_BOTTOM, FACE_TOP};
use reference::num::elem::{cos, exp, sin};
use std::f64::consts::TAU;

fn bump(x: f64, middle: f64, width: f64) -> f64 {
    let d = (x - middle) / width;
    exp(-d * d)
}

/// A part that the width of the body does not affect: the parts of the head.
fn still(piece: Piece) -> Piece {
    Piece { width: 0.0, ..piece }
}

/// Key rings of the head from the chin up.
fn head_keys() -> [Ring; 11] {
    [
        level(1.470, 0.016, 0.020, -0.052),
        level(1.474, 0.034, 0.038, -0.046),
        level(1.492, 0.049, 0.060, -0.033),
        level(1.520, 0.060, 0.077, -0.020),
        level(1.555, 0.068, 0.088, -0.010),
        level(1.595, 0.0735, 0.094, -0.002),
        level(1.635, 0.0725, 0.092, 0.002),
        level(1.665, 0.062, 0.080, 0.004),
        level(1.685, 0.044, 0.058, 0.004),
        level(1.6955, 0.024, 0.032, 0.004),
        level(1.6990, 0.008, 0.010, 0.004),
    ]
}

/// Azimuth from straight ahead of a turn around, rad, −π to π; positive towards the left.
fn ahead(turn: f64) -> f64 {
    TAU * (turn - 0.5)
}

fn head() -> Shell {
    let rings = between(&head_keys(), 0.006);
    tube(&rings, 72, |turn, p| {
        let (a, z) = (ahead(turn), p[2]);
        let side = if a < 0.0 { -a } else { a };
        let nose = 0.022 * smooth(1.600, 1.553, z) * smooth(1.536, 1.549, z) * bump(a, 0.0, 0.17);
        let sockets = -0.007 * bump(side, 0.43, 0.20) * bump(z, 1.587, 0.014);
        let brow = 0.003 * bump(z, 1.607, 0.009) * bump(a, 0.0, 0.7);
        let lips = 0.004 * bump(z, 1.514, 0.009) * bump(a, 0.0, 0.26);
        let chin = 0.006 * bump(z, 1.484, 0.013) * bump(a, 0.0, 0.35);
        let out = nose + sockets + brow + lips + chin;
        [p[0] + out * sin(a), p[1] - out * cos(a), z]
    })
}

/// A shell over the head, open at the face.
fn hair(long: bool) -> Shell {
    let rows = head_keys().map(|r| [r.center[2], r.half[0], r.half[1], r.center[1]]);
    const TOP: f64 = 1.709;
    let rim = move |turn: f64| {
        let a = ahead(turn);
        let side = if a < 0.0 { -a } else { a };
        let forehead = 1.664 - 0.030 * smooth(0.3, 1.05, side);
        let temple = forehead - 0.085 * smooth(0.95, 1.45, side);
        temple - (if long { 0.20 } else { 0.06 }) * smooth(1.55, 2.1, side)
    };
    let at = move |turn: f64, share: f64, thick: f64| {
        let (a, low) = (ahead(turn), rim(turn));
        let z = low + (TOP - low) * share;
        // Heights above the rim are those of the head, stretched to the top of the hair.
        let inner = 1.699 - (TOP - z) * (1.699 - low) / (TOP - low);
        let [_, half_x, half_y, y] = section(&rows, if inner < 1.53 { 1.53 } else { inner });
        // Below the skull, long hair curves slightly inwards.
        let fall = 1.0 - 0.35 * smooth(1.53, 1.36, z);
        let lock = 0.0012 * sin(26.0 * a) * (1.0 - share);
        let t = thick * (0.4 + 0.6 * smooth(0.0, 0.16, share)) + lock;
        [(half_x + t) * fall * sin(a), y * fall - (half_y + t) * fall * cos(a), z]
    };
    const ROWS: usize = 26;
    // The rings only determine the counts, because every vertex is positioned by its turn. The hidden rim
    // inside the head comes first.
    let mut shell = tube(&vec![level(1.6, 0.01, 0.01, 0.0); ROWS + 2], 72, |_, p| p);
    let columns = 73;
    for v in 0..shell.positions.len() - 2 {
        let (row, turn) = (v / columns, (v % columns % 72) as f64 / 72.0);
        let share = if row == 0 { 0.0 } else { (row - 1) as f64 / ROWS as f64 };
        // Rows are denser towards the top, where the head closes.
        let share = sin(share * TAU / 4.0);
        shell.positions[v] = at(turn, share, if row == 0 { -0.02 } else { 0.013 });
        shell.around_along[v] = [(v % columns) as f64 / 72.0, share];
    }
    let n = shell.positions.len();
    shell.positions[n - 2] = [0.0, 0.0, 1.60];
    shell.positions[n - 1] = [0.0, 0.004, TOP + 0.001];
    shell
}

fn ear() -> Shell {
    let path: Vec<V3> = [-0.031, -0.024, -0.004, 0.014, 0.027, 0.033]
        .into_iter()
        .enumerate()
        .map(|(i, z)| [0.0755 + 0.004 * smooth(0.0, 3.0, i as f64), 0.008 + 0.12 * z, 1.572 + z])
        .collect();
    let halves =
        [[0.003, 0.004], [0.006, 0.010], [0.007, 0.013], [0.008, 0.018], [0.007, 0.014], [0.003, 0.005]];
    tube(&between(&along(&path, [1.0, 0.0, 0.0], &halves), 0.005), 14, |_, p| p)
}

/// The visible part of the arm below the sleeve.
fn arm(long_sleeves: bool) -> Shell {
    let from = if long_sleeves { 5 } else { 0 };
    arm_tube(
        &[
            (0.155, 0.036, 0.036),
            (0.20, 0.041, 0.042),
            (UPPER - 0.03, 0.036, 0.037),
            (UPPER + 0.03, 0.037, 0.036),
            (UPPER + 0.09, 0.040, 0.037),
            (UPPER + 0.17, 0.033, 0.029),
            (UPPER + 0.235, 0.027, 0.020),
            (UPPER + 0.265, 0.031, 0.018),
            (UPPER + 0.31, 0.040, 0.0165),
            (UPPER + 0.345, 0.039, 0.0145),
            (UPPER + 0.358, 0.035, 0.010),
        ][from..],
        28,
    )
}

/// Four fingers and the thumb of the left hand, slightly bent.
fn fingers() -> Vec<Shell> {
    let [_, elbow, hand, ..] = LEFT;
    let forward = unit(sub(hand, elbow));
    // The little finger is towards the back of the figure; the palm faces the body.
    let (back, palm) = (hinge(), cross(forward, hinge()));
    let palm = if palm[0] > 0.0 { scale(palm, -1.0) } else { palm };
    let knuckles = add(elbow, scale(forward, 0.345));
    let mut shells = Vec::new();
    for (place, length) in [(-0.029, 0.072), (-0.0097, 0.082), (0.0097, 0.077), (0.029, 0.060)] {
        let base = add(knuckles, scale(back, place));
        let path: Vec<V3> = [0.0, 0.35, 0.7, 0.93, 1.0]
            .into_iter()
            .map(|t| {
                add(
                    base,
                    add(scale(forward, length * t * (1.0 - 0.12 * t)), scale(palm, 0.35 * length * t * t)),
                )
            })
            .collect();
        let halves = [[0.0098; 2], [0.0096; 2], [0.0086; 2], [0.0062; 2], [0.003; 2]];
        shells.push(tube(&between(&along(&path, back, &halves), 0.012), 10, |_, p| p));
    }
    let base = add(add(elbow, scale(forward, 0.272)), scale(back, -0.022));
    let out = unit(add(add(scale(forward, 0.75), scale(back, -0.55)), scale(palm, 0.35)));
    let path: Vec<V3> = [0.0, 0.03, 0.055, 0.072, 0.078].map(|l| add(base, scale(out, l))).to_vec();
    let halves = [[0.013; 2], [0.0125; 2], [0.011; 2], [0.008; 2], [0.003; 2]];
    shells.push(tube(&between(&along(&path, back, &halves), 0.012), 12, |_, p| p));
    shells
}

fn shoe() -> Shell {
    let ring = |y: f64, a: f64, b: f64, z: f64| Ring {
        center: [LEFT[5][0] + 0.004, y, z],
        x: [1.0, 0.0, 0.0],
        y: [0.0, 0.0, 1.0],
        half: [a, b],
    };
    let keys = [
        ring(0.058, 0.012, 0.016, 0.036),
        ring(0.052, 0.026, 0.034, 0.040),
        ring(0.030, 0.034, 0.048, 0.046),
        ring(0.000, 0.037, 0.052, 0.048),
        ring(-0.050, 0.039, 0.042, 0.040),
        ring(-0.110, 0.046, 0.032, 0.031),
        ring(-0.155, 0.042, 0.025, 0.025),
        ring(-0.185, 0.028, 0.018, 0.021),
        ring(-0.196, 0.012, 0.009, 0.018),
    ];
    tube(&between(&keys, 0.012), 28, |_, p| {
        // A flat sole.
        [p[0], p[1], if p[2] < 0.006 { 0.006 + 0.05 * (p[2] - 0.006) } else { p[2] }]
    })
}

/// Head, neck, hair, arms, hands, legs or ankles, shoes.
pub(in crate::figure) fn body(appearance: &Appearance) -> Vec<Piece> {
    let mut pieces = vec![
        Piece {
            uv: |[turn, _], p| [turn, (FACE_TOP - p[2]) / (FACE_TOP - FACE_BOTTOM)],
            ..still(plain("head", head(), FACE))
        },
        still(plain("hair", hair(appearance.long_hair), HAIR)),
        still(plain(
            "neck",
            tube(
                &between(
                    &[
                        level(1.385, 0.055, 0.050, 0.006),
                        level(1.420, 0.058, 0.054, 0.006),
                        level(1.450, 0.052, 0.052, 0.002),
                        level(1.490, 0.050, 0.053, -0.002),
                        level(1.540, 0.048, 0.050, -0.004),
                    ],
                    0.01,
                ),
                36,
                |_, p| p,
            ),
            SKIN,
        )),
    ];
    pieces.extend(both(["left ear", "right ear"], ear(), |n, s| still(plain(n, s, SKIN))));
    pieces.extend(both(["left arm", "right arm"], arm(appearance.long_sleeves), |n, s| plain(n, s, SKIN)));
    for finger in fingers() {
        pieces.extend(both(["left finger", "right finger"], finger, |n, s| plain(n, s, SKIN)));
    }
    let bare: &[(f64, f64, f64, f64)] = &[
        (0.79, 0.048, 0.048, 0.0),
        (0.78, 0.066, 0.070, 0.0),
        (0.68, 0.065, 0.069, 0.0),
        (0.64, 0.063, 0.067, 0.0),
        (0.53, 0.052, 0.055, 0.0),
        (0.48, 0.050, 0.053, 0.0),
        (0.43, 0.047, 0.052, 0.006),
        (0.34, 0.051, 0.056, 0.016),
        (0.22, 0.041, 0.044, 0.012),
        (0.12, 0.030, 0.034, 0.006),
        (0.07, 0.031, 0.036, 0.004),
        (0.045, 0.028, 0.032, 0.004),
    ];
    // There is no body under cloth, except for the part that a short skirt shows.
    let from = if appearance.bottom == Bottom::Skirt { 0 } else { 8 };
    pieces.extend(both(["left leg", "right leg"], leg_tube(&bare[from..], 32), |n, s| plain(n, s, SKIN)));
    pieces.extend(both(["left shoe", "right shoe"], shoe(), |n, s| plain(n, s, SHOES)));
    pieces
}
