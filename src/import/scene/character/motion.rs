//! Poses: animations at a time, mixtures of two, a bent joint.
//!
//! | between keys t_k ≤ t < t_(k+1), s = (t − t_k)/τ, τ = t_(k+1) − t_k | value |
//! |---|---|
//! | step | v_k |
//! | linear, translation and scale | v_k + s (v_(k+1) − v_k) |
//! | linear, rotation | sin((1−s)Ω)/sin Ω · q_k + sin(sΩ)/sin Ω · ±q_(k+1), cos Ω = \|q_k·q_(k+1)\|; normalised linear above cos Ω = 0.9999 |
//! | cubic | (2s³−3s²+1) v_k + τ(s³−2s²+s) b_k + (3s²−2s³) v_(k+1) + τ(s³−s²) a_(k+1), rotations normalised |
//!
//! with a the tangent into and b the one out of a key (glTF 2.0, appendix C). Before the first and after the
//! last key the value is theirs.

use super::local::{Local, dot, normalized};
use super::skinned::{Character, rows};
use crate::io::gltf::{Channel, Interpolation, Path};
use crate::math::vector::unit;
use crate::num::elem::f64 as elem;
use crate::scene::model;
use crate::{Error, Result};
use glam::{DAffine3, DVec3};
use reference::body::skin::Affine;

/// Normalised (1 − w) a ± w b, on the shorter way.
fn nlerp(a: [f64; 4], b: [f64; 4], w: f64) -> [f64; 4] {
    let b = if dot(a, b) < 0.0 { b.map(|x| -x) } else { b };
    normalized(std::array::from_fn(|k| (1.0 - w) * a[k] + w * b[k]))
}

fn slerp(a: [f64; 4], b: [f64; 4], s: f64) -> [f64; 4] {
    let b = if dot(a, b) < 0.0 { b.map(|x| -x) } else { b };
    let cos = dot(a, b);
    if cos > 0.9999 {
        return nlerp(a, b, s);
    }
    let angle = elem::acos(cos);
    let (wa, wb) = (elem::sin((1.0 - s) * angle) / elem::sin(angle), elem::sin(s * angle) / elem::sin(angle));
    normalized(std::array::from_fn(|k| wa * a[k] + wb * b[k]))
}

/// Hamilton product, xyzw.
pub(super) fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (a, b);
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// Transforms of all nodes in their parents.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    locals: Vec<Local>,
}

impl Pose {
    /// Node by node the mixture (1 − w) of this pose and w of another one of the same character: rotations by
    /// normalised linear interpolation on the shorter way, translations and scales linearly.
    #[must_use]
    pub fn mix(&self, other: &Self, w: f64) -> Self {
        let one = |(a, b): (&Local, &Local)| match (*a, *b) {
            (Local::Trs { t, q, s }, Local::Trs { t: u, q: r, s: v }) => {
                Local::Trs { t: t * (1.0 - w) + u * w, q: nlerp(q, r, w), s: s * (1.0 - w) + v * w }
            }
            (fixed, _) => fixed,
        };
        Self { locals: self.locals.iter().zip(&other.locals).map(one).collect() }
    }
}

fn dot3(a: DVec3, b: DVec3) -> f64 {
    (a.x * b.x + a.y * b.y) + a.z * b.z
}

/// Whether columns are those of a rotation times one scale, to 10⁻³ of its square: what files written in f32
/// keep.
fn is_similarity(columns: [DVec3; 3]) -> bool {
    let [x, y, z] = columns;
    let square = dot3(x, x);
    [dot3(y, y) - square, dot3(z, z) - square, dot3(x, y), dot3(y, z), dot3(z, x)]
        .iter()
        .all(|off| off.abs() <= 1e-3 * square)
}

/// Value of a channel at a time.
fn value(c: &Channel, time: f64) -> [f64; 4] {
    let times = &c.times;
    let per_key = if c.interpolation == Interpolation::Cubic { 3 } else { 1 };
    let at = |k: usize, which: usize| c.values[k * per_key + which].map(f64::from);
    let key = |k: usize| at(k, per_key / 2);
    let finish = |v| if c.path == Path::Rotation { normalized(v) } else { v };
    let next = times.partition_point(|&t| f64::from(t) <= time);
    if next == 0 {
        return finish(key(0));
    }
    if next == times.len() {
        return finish(key(next - 1));
    }
    let k = next - 1;
    let span = f64::from(times[next]) - f64::from(times[k]);
    let s = (time - f64::from(times[k])) / span;
    let (a, b) = (key(k), key(next));
    finish(match c.interpolation {
        Interpolation::Step => a,
        Interpolation::Linear if c.path == Path::Rotation => slerp(normalized(a), normalized(b), s),
        Interpolation::Linear => std::array::from_fn(|i| a[i] + s * (b[i] - a[i])),
        Interpolation::Cubic => {
            let (out, into) = (at(k, 2), at(next, 0));
            let (s2, s3) = (s * s, s * s * s);
            std::array::from_fn(|i| {
                (2.0 * s3 - 3.0 * s2 + 1.0) * a[i]
                    + span * (s3 - 2.0 * s2 + s) * out[i]
                    + (3.0 * s2 - 2.0 * s3) * b[i]
                    + span * (s3 - s2) * into[i]
            })
        }
    })
}

impl Character {
    /// Names of the animations, in the order of the file.
    pub fn animations(&self) -> Vec<&str> {
        self.rig.animations.iter().map(|a| a.name.as_str()).collect()
    }

    /// Index of an animation.
    ///
    /// # Errors
    /// When there is none of that name; the error lists the names.
    pub fn animation(&self, name: &str) -> Result<usize> {
        self.rig.animations.iter().position(|a| a.name == name).ok_or_else(|| {
            let all = self.animations();
            let names = if all.is_empty() {
                "none: the file has no animations".to_owned()
            } else {
                format!("one of {}", all.join(", "))
            };
            Error::input(self.name.clone()).at("animation").expected(names).got(name)
        })
    }

    /// Time of the last key of an animation, seconds.
    pub fn duration(&self, animation: usize) -> f64 {
        let last = |c: &Channel| c.times.last().map_or(0.0, |&t| f64::from(t));
        self.rig.animations[animation].channels.iter().fold(0.0, |m, c| crate::num::order::max(m, last(c)))
    }

    /// The pose of the file.
    pub fn rest(&self) -> Pose {
        Pose { locals: self.rest.clone() }
    }

    /// An animation at a time in seconds; nodes it does not move rest.
    pub fn pose(&self, animation: usize, time: f64) -> Pose {
        let mut pose = self.rest();
        for c in &self.rig.animations[animation].channels {
            let v = value(c, time);
            // A matrix cannot be animated; such a channel changes nothing.
            if let Local::Trs { t, q, s } = &mut pose.locals[c.node] {
                let three = DVec3::new(v[0], v[1], v[2]);
                match c.path {
                    Path::Translation => *t = three,
                    Path::Rotation => *q = v,
                    Path::Scale => *s = three,
                }
            }
        }
        pose
    }

    /// World transforms of all nodes.
    fn globals(&self, pose: &Pose) -> Vec<DAffine3> {
        let locals: Vec<DAffine3> = pose.locals.iter().map(Local::map).collect();
        model::globals(&self.rig, &locals, self.frame)
    }

    /// (J) posed from canonical.
    pub fn transforms(&self, pose: &Pose) -> Vec<Affine<f64>> {
        let globals = self.globals(pose);
        let one = |j: &super::skinned::Joint| j.node.map_or(DAffine3::IDENTITY, |n| globals[n] * j.bind);
        self.joints.iter().map(|j| rows(&one(j))).collect()
    }

    /// Turns a hinge joint by an angle, so that its limb swings forward (to −y) for a positive one.
    ///
    /// The axis is that of d × f at rest, d from the joint to its first child (or, without one, from its
    /// parent to it) and f = −y; it goes with the joint, R' = R · Rot(axis in the joint's frame, angle).
    ///
    /// # Errors
    /// When the joint has neither child nor parent to give a direction, is a fixed matrix, or its frame at
    /// rest is no rotation times a scale.
    pub fn bend(&self, pose: &mut Pose, joint: usize, angle: f64) -> Result<()> {
        let fail = |got: &str| {
            let e = Error::input(self.name.clone()).at(format!("joint '{}'", self.joints[joint].name));
            Err(e.expected("a joint that can bend").got(got.to_owned()))
        };
        let globals = self.globals(&self.rest());
        let Some(node) = self.joints[joint].node else { return fail("one that stands still") };
        let at = |n: usize| globals[n].translation;
        let n = &self.rig.nodes[node];
        let child = n.children.iter().copied().find(|&c| (at(c) - at(node)).length_squared() > 0.0);
        let d = match (child, n.parent) {
            (Some(c), _) => at(c) - at(node),
            (None, Some(p)) => at(node) - at(p),
            (None, None) => return fail("one without child or parent"),
        };
        let forward = DVec3::new(0.0, -1.0, 0.0);
        let mut axis = d.cross(forward);
        // A limb that already points forward swings upwards.
        if axis.length_squared() <= 1e-6 * d.length_squared() {
            axis = d.cross(DVec3::Z);
        }
        let m = globals[node].matrix3;
        if !is_similarity([m.x_axis, m.y_axis, m.z_axis]) {
            return fail("one in a stretched or sheared frame, where a turn bends the limb");
        }
        let inside = m.inverse() * axis;
        let inside = unit(inside.to_array());
        if inside == [0.0; 3] {
            return fail("no direction to bend in");
        }
        let (s, c) = (elem::sin(0.5 * angle), elem::cos(0.5 * angle));
        match &mut pose.locals[node] {
            Local::Trs { q, .. } => {
                *q = normalized(product(*q, [s * inside[0], s * inside[1], s * inside[2], c]))
            }
            Local::Fixed(_) => return fail("a node with a matrix"),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretched_and_sheared_frames_are_no_similarities() {
        let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
        assert!(is_similarity([x, y, z]), "a uniform scale");
        assert!(is_similarity([y, z, x]), "a turn");
        assert!(!is_similarity([x, y, 1.1 * z]), "stretched");
        assert!(!is_similarity([x, y + 0.1 * x, z]), "sheared");
    }
}
