//! Twelve bones, and the rotations that the factors apply to them.
//!
//! Defined in metres for a person of 1.7 m whose feet are on z = 0 and who faces −y (the left side is +x),
//! then shifted and divided by 0.85 m, so that the body extends from −1 to 1 in z: this is the **figure
//! frame**. z is up.
//!
//! | bone | parent | rotates about | segment from → to (m) | radius (m) |
//! |---|---|---|---|---|
//! | 0 pelvis | – | – | (0, 0, 0.93) → (0, 0, 1.17) | 0.125 |
//! | 1 torso | 0 | – | (−0.105, 0, 1.315) → (0.105, 0, 1.315) | 0.105 |
//! | 2 head | 1 | neck (0, 0, 1.44), axis z | (0, −0.01, 1.52) → (0, −0.015, 1.605) | 0.095 |
//! | 3, 4 upper arm, left, right | 1 | shoulder (±0.17, 0, 1.385), axis y | shoulder → elbow (±0.374, 0, 1.186) | 0.045 |
//! | 5, 6 forearm with hand | 3, 4 | elbow, axis upper arm × forearm | elbow → (±0.471, −0.115, 0.859) | 0.036 |
//! | 7, 8 thigh | 0 | hip (±0.088, 0, 0.9), axis x | hip → knee (±0.095, −0.01, 0.48) | 0.075 |
//! | 9, 10 shin with foot | 7, 8 | knee, axis x | knee → (±0.1, 0.01, 0.05) | 0.05 |
//! | 11 skirt ring | 0 | – | (0, 0, 0.98) → (0, 0, 0.88) | band, see [`SKIRT`] |
//!
//! The torso is a horizontal capsule across the chest, so that the nearest bone of a point of the chest is
//! the torso and not an arm. At rest, the arms are 0.8 rad off the body and the elbows are bent by 0.6 rad. A
//! bent knee keeps the feet under the body: the thigh swings forward by half of the knee's angle. This
//! rotation of the hips follows u_P as the knee does; it keeps the feet near the ground and near the centre
//! of the image.

use super::factors::Drive;
use reference::body::skin::Affine;
use reference::num::elem::{cos, sin};

/// A point or a vector.
pub type V3 = [f64; 3];

/// Number of bones.
pub const BONES: usize = 12;

/// Metres per unit of the figure frame: half the height.
pub const METRES: f64 = 0.85;

/// A bone, in the figure frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bone {
    /// Name of the bone.
    pub name: &'static str,
    /// The parent bone; its index is smaller.
    pub parent: Option<usize>,
    /// The point about which the bone rotates.
    pub joint: V3,
    /// Start of its segment.
    pub from: V3,
    /// End of its segment.
    pub to: V3,
    /// Radius of its capsule.
    pub radius: f64,
}

/// Index of the torso.
pub const TORSO: usize = 1;
/// Index of the head.
pub const HEAD: usize = 2;
/// Index of the left upper arm; the right one follows.
pub const UPPER_ARM: usize = 3;
/// Index of the left forearm; the right one follows.
pub const FOREARM: usize = 5;
/// Index of the left thigh; the right one follows.
pub const THIGH: usize = 7;
/// Index of the left shin; the right one follows.
pub const SHIN: usize = 9;
/// Index of the skirt ring.
pub const SKIRT_RING: usize = 11;

/// The band on which the template points of the skirt lie: heights and radii of its upper and lower rim, in
/// metres.
pub const SKIRT: [[f64; 2]; 2] = [[0.96, 0.165], [0.6, 0.215]];

/// Converts metres to the figure frame.
pub fn framed(p: V3) -> V3 {
    [p[0] / METRES, p[1] / METRES, (p[2] - METRES) / METRES]
}

/// Converts the figure frame to metres.
pub(super) fn metric(x: V3) -> V3 {
    [METRES * x[0], METRES * x[1], METRES * x[2] + METRES]
}

/// Shoulder, elbow, end of the forearm, hip, knee, ankle of the left side, in metres.
pub(super) const LEFT: [V3; 6] = [
    [0.17, 0.0, 1.385],
    [0.374, 0.0, 1.186],
    [0.471, -0.115, 0.859],
    [0.088, 0.0, 0.9],
    [0.095, -0.01, 0.48],
    [0.1, 0.01, 0.05],
];

/// Mirrors a point to the right side.
pub(super) fn mirrored(p: V3) -> V3 {
    [-p[0], p[1], p[2]]
}

/// The bones in the order of the table.
pub fn bones() -> [Bone; BONES] {
    let bone = |name, parent, joint, from, to, radius: f64| Bone {
        name,
        parent,
        joint: framed(joint),
        from: framed(from),
        to: framed(to),
        radius: radius / METRES,
    };
    let [shoulder, elbow, hand, hip, knee, ankle] = LEFT;
    let right = mirrored;
    [
        bone("pelvis", None, [0.0, 0.0, 0.95], [0.0, 0.0, 0.93], [0.0, 0.0, 1.17], 0.125),
        bone("torso", Some(0), [0.0, 0.0, 1.1], [-0.105, 0.0, 1.315], [0.105, 0.0, 1.315], 0.105),
        bone("head", Some(1), [0.0, 0.0, 1.44], [0.0, -0.01, 1.52], [0.0, -0.015, 1.605], 0.095),
        bone("left upper arm", Some(1), shoulder, shoulder, elbow, 0.045),
        bone("right upper arm", Some(1), right(shoulder), right(shoulder), right(elbow), 0.045),
        bone("left forearm", Some(3), elbow, elbow, hand, 0.036),
        bone("right forearm", Some(4), right(elbow), right(elbow), right(hand), 0.036),
        bone("left thigh", Some(0), hip, hip, knee, 0.075),
        bone("right thigh", Some(0), right(hip), right(hip), right(knee), 0.075),
        bone("left shin", Some(7), knee, knee, ankle, 0.05),
        bone("right shin", Some(8), right(knee), right(knee), right(ankle), 0.05),
        bone("skirt ring", Some(0), [0.0, 0.0, 0.95], [0.0, 0.0, 0.98], [0.0, 0.0, 0.88], SKIRT[0][1]),
    ]
}

pub(super) fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn add(a: V3, b: V3) -> V3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn scale(a: V3, s: f64) -> V3 {
    a.map(|x| x * s)
}

pub(super) fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A vector scaled to length 1; the zero vector is unchanged.
pub(super) fn unit(a: V3) -> V3 {
    let length = dot(a, a).sqrt();
    if length > 0.0 { a.map(|x| x / length) } else { a }
}

/// Squared distance of a point from a bone's segment.
pub fn distance_squared(bone: &Bone, x: V3) -> f64 {
    let (along, from) = (sub(bone.to, bone.from), sub(x, bone.from));
    let t = dot(along, from) / dot(along, along);
    let t = super::factors::unit_interval(t);
    let off = sub(from, scale(along, t));
    dot(off, off)
}

/// Skinning weights of a point at rest: w_b ∝ exp(−(d_b/0.05)²), d_b the distance to segment b in the
/// figure frame; the four largest are kept (ties to the lowest index) and sum to 1.
///
/// # Rounding
/// The smallest d² is subtracted in the exponent, so nothing underflows; the sum is a left fold in index
/// order.
pub fn weights(bones: &[Bone; BONES], x: V3) -> [f64; BONES] {
    let squares: [f64; BONES] = std::array::from_fn(|b| distance_squared(&bones[b], x));
    let least = squares.iter().fold(f64::INFINITY, |m, &d| if d < m { d } else { m });
    let raw = squares.map(|d| reference::num::elem::exp(-(d - least) / (0.05 * 0.05)));
    let rank = |b: usize| (0..BONES).filter(|&c| raw[c] > raw[b] || (raw[c] == raw[b] && c < b)).count();
    let kept: [f64; BONES] = std::array::from_fn(|b| if rank(b) < 4 { raw[b] } else { 0.0 });
    let sum = kept.iter().fold(0.0, |sum, w| sum + w);
    kept.map(|w| w / sum)
}

/// Rotation by an angle about a unit axis through a point (Rodrigues).
pub fn turn(about: V3, axis: V3, angle: f64) -> Affine<f64> {
    let (s, c) = (sin(angle), cos(angle));
    let [x, y, z] = axis;
    let k = 1.0 - c;
    let r = [
        [c + x * x * k, x * y * k - z * s, x * z * k + y * s],
        [y * x * k + z * s, c + y * y * k, y * z * k - x * s],
        [z * x * k - y * s, z * y * k + x * s, c + z * z * k],
    ];
    std::array::from_fn(|i| [r[i][0], r[i][1], r[i][2], about[i] - dot(r[i], about)])
}

/// The identity.
pub const REST: Affine<f64> = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// The composition b·a, which applies a first.
pub(super) fn after(b: &Affine<f64>, a: &Affine<f64>) -> Affine<f64> {
    b.map(|r| {
        std::array::from_fn(|j| {
            let linear = r[0] * a[0][j] + r[1] * a[1][j] + r[2] * a[2][j];
            if j == 3 { linear + r[3] } else { linear }
        })
    })
}

/// Posed-from-rest transforms of the bones.
///
/// | rotation | angle (rad) |
/// |---|---|
/// | shoulders about ∓y | 0.45 u_P outwards and up, mirrored |
/// | knees about x | 0.9 σ(1.5 u_P); the hips rotate back by half of it |
/// | right elbow | 1.4 σ(1.5 u_O), bringing the forearm in front of the torso |
/// | neck about z | 0.35 u_Y |
pub fn pose(bones: &[Bone; BONES], drive: &Drive) -> [Affine<f64>; BONES] {
    let elbow_axis =
        |b: usize| unit(cross(sub(bones[b - 2].to, bones[b - 2].from), sub(bones[b].to, bones[b].from)));
    let mut posed = [REST; BONES];
    for b in 0..BONES {
        let about = bones[b].joint;
        let own = match b {
            HEAD => turn(about, [0.0, 0.0, 1.0], drive.yaw),
            3 => turn(about, [0.0, -1.0, 0.0], drive.raise),
            4 => turn(about, [0.0, 1.0, 0.0], drive.raise),
            6 => turn(about, elbow_axis(b), drive.elbow),
            THIGH | 8 => turn(about, [1.0, 0.0, 0.0], -0.5 * drive.knee),
            SHIN | 10 => turn(about, [1.0, 0.0, 0.0], drive.knee),
            _ => REST,
        };
        posed[b] = match bones[b].parent {
            Some(p) => after(&posed[p], &own),
            None => own,
        };
    }
    posed
}
