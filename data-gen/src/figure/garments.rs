//! The parts of a person, in metres at rest: profiles of tubes along the bones.

mod body;

pub(super) use body::body;

use super::appearance::{Appearance, Bottom};
use super::factors::{Drive, LIMB_WIDTH, TRUNK_WIDTH};
use super::loft::{Ring, Shell, along, between, level, tube};
use super::skeleton::{LEFT, METRES, SKIRT, V3, add, cross, scale, sub, unit};
use super::surface::{Folds, OWN_FOLDS, Piece, Under, WRINKLES, section};
use super::texture::{SHIRT_BOTTOM, SHIRT_TOP};

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

/// The part and its mirror image.
fn both(names: [&'static str; 2], shell: Shell, make: impl Fn(&'static str, Shell) -> Piece) -> [Piece; 2] {
    let right = shell.mirrored();
    [make(names[0], shell), make(names[1], right)]
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
