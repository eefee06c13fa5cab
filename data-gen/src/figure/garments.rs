//! The parts of a person, in metres at rest: profiles of tubes along the bones.

use super::appearance::{Appearance, Bottom};
use super::factors::{Drive, LIMB_WIDTH, TRUNK_WIDTH};
use super::loft::{Ring, Shell, along, between, level, tube};
use super::skeleton::{LEFT, METRES, SKIRT, V3, add, cross, scale, sub, unit};
use super::surface::{Folds, OWN_FOLDS, Piece, Under, WRINKLES, section};
use super::texture::{FACE_BOTTOM, FACE_TOP, SHIRT_BOTTOM, SHIRT_TOP};
use reference::num::elem::{cos, exp, sin};
use std::f64::consts::TAU;

/// Indices of the materials in [`super::texture::materials`].
pub(super) const SKIN: usize = 0;
pub(super) const FACE: usize = 1;
pub(super) const HAIR: usize = 2;
pub(super) const SHIRT: usize = 3;
pub(super) const SLEEVE: usize = 4;
pub(super) const CLOTH: usize = 5;
pub(super) const SHOES: usize = 6;

fn smooth(low: f64, high: f64, x: f64) -> f64 {
    let t = super::factors::unit_interval((x - low) / (high - low));
    t * t * (3.0 - 2.0 * t)
}

fn bump(x: f64, middle: f64, width: f64) -> f64 {
    let d = (x - middle) / width;
    exp(-d * d)
}

fn plain(name: &'static str, shell: Shell, material: usize) -> Piece {
    Piece {
        name,
        shell,
        material,
        folds: Folds::None,
        slack: |_| 0.0,
        width: LIMB_WIDTH,
        rim: None,
        under: None,
        uv: |[turn, length], _| [turn, length],
    }
}

/// A part that the width of the body does not affect: the parts of the head.
fn still(piece: Piece) -> Piece {
    Piece { width: 0.0, ..piece }
}

/// The part and its mirror image.
fn both(names: [&'static str; 2], shell: Shell, make: impl Fn(&'static str, Shell) -> Piece) -> [Piece; 2] {
    let right = shell.mirrored();
    [make(names[0], shell), make(names[1], right)]
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

/// Hinge axis of the left elbow, from front to back.
fn hinge() -> V3 {
    let [shoulder, elbow, hand, ..] = LEFT;
    unit(cross(sub(elbow, shoulder), sub(hand, elbow)))
}

/// A point on the left arm: metres from the shoulder along upper arm and forearm.
fn on_arm(length: f64) -> V3 {
    let [shoulder, elbow, hand, ..] = LEFT;
    let upper = sub(elbow, shoulder);
    let reach = super::skeleton::dot(upper, upper).sqrt();
    if length < 0.0 {
        // Inside the chest.
        add(shoulder, [length, 0.0, 0.3 * length])
    } else if length < reach {
        add(shoulder, scale(unit(upper), length))
    } else {
        add(elbow, scale(unit(sub(hand, elbow)), length - reach))
    }
}

/// Length of the upper arm, metres.
const UPPER: f64 = 0.285;

fn arm_tube(profile: &[(f64, f64, f64)], around: usize) -> Shell {
    let path: Vec<V3> = profile.iter().map(|&(l, ..)| on_arm(l)).collect();
    let halves: Vec<[f64; 2]> = profile.iter().map(|&(_, a, b)| [a, b]).collect();
    tube(&between(&along(&path, hinge(), &halves), 0.012), around, |_, p| p)
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

fn leg_tube(profile: &[(f64, f64, f64, f64)], around: usize) -> Shell {
    // For a downward tube, x × y = −z; the centre follows the bones.
    let [.., hip, knee, ankle] = LEFT;
    let rings: Vec<Ring> = profile
        .iter()
        .map(|&(z, a, b, y)| {
            let (from, to) = if z > knee[2] { (hip, knee) } else { (knee, ankle) };
            let t = (z - from[2]) / (to[2] - from[2]);
            let center = [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]) + y, z];
            Ring { center, x: [1.0, 0.0, 0.0], y: [0.0, -1.0, 0.0], half: [a, b] }
        })
        .collect();
    tube(&between(&rings, 0.014), around, |_, p| p)
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
pub(super) fn body(appearance: &Appearance) -> Vec<Piece> {
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

/// Folds vanish where cloth is fixed: at the collar, and on the axis of closing fans.
fn trunk_slack(p: V3) -> f64 {
    let radius = (p[0] * p[0] + p[1] * p[1]).sqrt();
    smooth(1.43, 1.33, p[2]) * smooth(0.05, 0.09, radius)
}

/// The shirt: trunk and sleeves.
pub(super) fn shirt(appearance: &Appearance) -> Vec<Piece> {
    // The shirt extends to the hips over trousers, and is tucked into a skirt.
    let tucked = appearance.bottom == Bottom::Skirt;
    let hem: &[Ring] = if tucked {
        &[level(1.026, 0.100, 0.075, 0.0), level(1.029, 0.122, 0.091, 0.0)]
    } else {
        &[level(0.876, 0.150, 0.110, 0.0), level(0.874, 0.180, 0.139, 0.0), level(0.882, 0.184, 0.143, 0.0)]
    };
    let mut keys = hem.to_vec();
    keys.extend([
        if tucked { level(1.042, 0.128, 0.096, 0.0) } else { level(0.975, 0.170, 0.130, 0.0) },
        level(1.080, 0.140, 0.106, 0.0),
        level(1.180, 0.153, 0.114, -0.004),
        level(1.270, 0.172, 0.121, -0.006),
        level(1.340, 0.178, 0.112, 0.0),
        level(1.385, 0.164, 0.094, 0.004),
        level(1.410, 0.126, 0.080, 0.006),
        level(1.426, 0.088, 0.069, 0.006),
        level(1.438, 0.068, 0.062, 0.005),
        level(1.446, 0.063, 0.060, 0.003),
        level(1.445, 0.057, 0.055, 0.003),
        level(1.425, 0.050, 0.048, 0.003),
    ]);
    let trunk = tube(&between(&keys, 0.012), 88, |_, p| p);
    let mut pieces = vec![Piece {
        folds: Folds::Body,
        slack: trunk_slack,
        width: TRUNK_WIDTH,
        // Over trousers, the length factor of the skirt moves the hem of the shirt instead.
        rim: (!tucked).then_some(1.18),
        under: (!tucked).then_some(Under::Trousers),
        uv: |[turn, _], p| [turn, (SHIRT_TOP - p[2]) / (SHIRT_TOP - SHIRT_BOTTOM)],
        ..plain("shirt", trunk, SHIRT)
    }];
    let short: &[(f64, f64, f64)] = &[
        (-0.075, 0.040, 0.040),
        (-0.05, 0.052, 0.052),
        (0.0, 0.054, 0.053),
        (0.05, 0.056, 0.055),
        (0.12, 0.057, 0.057),
        (0.19, 0.058, 0.058),
        (0.194, 0.056, 0.056),
        (0.190, 0.048, 0.048),
    ];
    let long: &[(f64, f64, f64)] = &[
        (-0.075, 0.040, 0.040),
        (-0.05, 0.052, 0.052),
        (0.0, 0.054, 0.053),
        (0.05, 0.055, 0.054),
        (0.16, 0.050, 0.050),
        (UPPER - 0.03, 0.046, 0.046),
        (UPPER + 0.03, 0.046, 0.046),
        (UPPER + 0.11, 0.045, 0.043),
        (UPPER + 0.20, 0.040, 0.036),
        (UPPER + 0.235, 0.037, 0.032),
        (UPPER + 0.238, 0.034, 0.029),
        (UPPER + 0.233, 0.028, 0.023),
    ];
    let sleeve = arm_tube(if appearance.long_sleeves { long } else { short }, 36);
    pieces.extend(both(["left sleeve", "right sleeve"], sleeve, |name, shell| Piece {
        folds: Folds::Own(OWN_FOLDS),
        // There are no folds where the sleeve is sewn in.
        slack: |p| smooth(0.17, 0.21, if p[0] < 0.0 { -p[0] } else { p[0] }),
        uv: |[turn, length], _| [turn, length / 0.6],
        ..plain(name, shell, SLEEVE)
    }));
    pieces
}

/// A ring of a downward tube.
fn ring(z: f64, a: f64, b: f64) -> Ring {
    Ring { y: [0.0, -1.0, 0.0], ..level(z, a, b, 0.0) }
}

/// Heights and half axes of trousers at the hips, downwards.
const HIPS: [[f64; 3]; 8] = [
    [1.000, 0.120, 0.085],
    [1.003, 0.146, 0.106],
    [0.960, 0.158, 0.114],
    [0.900, 0.172, 0.124],
    [0.850, 0.166, 0.120],
    [0.815, 0.130, 0.098],
    [0.800, 0.080, 0.070],
    [0.795, 0.040, 0.040],
];

/// The same upwards, and inwards above the waistband, so that the shirt leaves them smoothly.
const UNDER_SHIRT: [[f64; 3]; 8] =
    [HIPS[7], HIPS[6], HIPS[5], HIPS[4], HIPS[3], HIPS[2], HIPS[1], [1.10, 0.060, 0.045]];

/// Distance of a position from two legs around x = ±`apart`, with radius `radius` at u_B = 0.
fn from_legs(p: V3, apart: f64, radius: f64, drive: &Drive) -> f64 {
    let side = if p[0] < 0.0 { -p[0] } else { p[0] } - apart;
    let off = if side > 0.0 { side } else { 0.0 };
    (off * off + p[1] * p[1]).sqrt() - radius - METRES * drive.girth(LIMB_WIDTH, radius / METRES)
}

/// Distance of a position from bare legs, metres.
pub(super) fn above_legs(p: V3, drive: &Drive) -> f64 {
    from_legs(p, 0.093, 0.071, drive) + 0.1 * smooth(0.78, 0.84, p[2]) - 0.004
}

/// Distance of a position from the hips and legs of trousers, across the body, metres.
pub(super) fn above_trousers(p: V3, drive: &Drive) -> f64 {
    let [_, a, b] = section(&UNDER_SHIRT, p[2]);
    let (x, y) = (p[0] / a, p[1] / b);
    let radius = (p[0] * p[0] + p[1] * p[1]).sqrt();
    let hips = radius * (1.0 - 1.0 / (x * x + y * y).sqrt()) - METRES * drive.girth(TRUNK_WIDTH, b / METRES);
    // Legs are deeper than they are wide.
    let wrinkle = if drive.wrinkle < 0.0 { -drive.wrinkle } else { drive.wrinkle };
    let folds = METRES * OWN_FOLDS * WRINKLES * wrinkle * leg_slack(p);
    let legs =
        from_legs([p[0], 0.86 * p[1], p[2]], 0.089, 0.087, drive) + 0.1 * smooth(0.88, 0.95, p[2]) - folds;
    (if hips < legs { hips } else { legs }) - 0.003
}

/// Folds of trouser legs begin below the hips.
fn leg_slack(p: V3) -> f64 {
    smooth(0.86, 0.74, p[2])
}

/// A skirt, open below.
pub(super) fn skirt() -> Vec<Piece> {
    let [[_, _], [hem, hem_radius]] = SKIRT;
    let keys = [
        ring(1.046, 0.120, 0.090),
        ring(1.052, 0.142, 0.110),
        ring(1.046, 0.148, 0.115),
        ring(1.000, 0.156, 0.121),
        ring(0.930, 0.178, 0.139),
        ring(0.820, 0.195, 0.163),
        ring(0.700, 0.208, 0.188),
        ring(hem + 0.004, hem_radius, 0.206),
        ring(hem, hem_radius - 0.003, 0.204),
        ring(hem + 0.004, hem_radius - 0.008, 0.199),
        ring(0.720, 0.190, 0.168),
        ring(0.840, 0.170, 0.145),
        ring(0.900, 0.150, 0.115),
        ring(0.915, 0.080, 0.060),
    ];
    vec![Piece {
        folds: Folds::Body,
        slack: |p| smooth(0.05, 0.09, (p[0] * p[0] + p[1] * p[1]).sqrt()),
        width: TRUNK_WIDTH,
        rim: Some(SKIRT[0][0]),
        under: Some(Under::Legs),
        uv: |[turn, length], _| [6.0 * turn, 6.0 * length],
        ..plain("skirt", tube(&between(&keys, 0.014), 88, |_, p| p), CLOTH)
    }]
}

/// Trousers: hips and two legs.
pub(super) fn trousers() -> Vec<Piece> {
    let keys = HIPS.map(|[z, a, b]| ring(z, a, b));
    // Trousers fit tightly; the folds are those of the shirt over them and of the legs.
    let mut pieces = vec![Piece {
        width: TRUNK_WIDTH,
        uv: |[turn, length], _| [6.0 * turn, 6.0 * length],
        ..plain("hips", tube(&between(&keys, 0.012), 72, |_, p| p), CLOTH)
    }];
    let leg = leg_tube(
        &[
            (0.93, 0.060, 0.070, 0.0),
            (0.90, 0.080, 0.090, 0.0),
            (0.84, 0.086, 0.100, 0.0),
            (0.76, 0.084, 0.092, 0.0),
            (0.62, 0.072, 0.078, 0.0),
            (0.50, 0.063, 0.067, 0.0),
            (0.40, 0.060, 0.065, 0.008),
            (0.25, 0.058, 0.064, 0.012),
            (0.12, 0.056, 0.064, 0.008),
            (0.075, 0.056, 0.065, 0.004),
            (0.072, 0.053, 0.062, 0.004),
            (0.080, 0.045, 0.054, 0.004),
        ],
        40,
    );
    pieces.extend(both(["left trouser leg", "right trouser leg"], leg, |name, shell| Piece {
        folds: Folds::Own(OWN_FOLDS),
        slack: leg_slack,
        uv: |[turn, length], _| [2.0 * turn, 6.0 * length],
        ..plain(name, shell, CLOTH)
    }));
    pieces
}
