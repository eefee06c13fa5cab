//! The surface in a pose, and the causal factors of the built-in figure for any character.
//!
//! | factor | effect |
//! |---|---|
//! | u_P | mixes two poses: the first with 1 − σ(u_P), the second with σ(u_P) |
//! | u_O | bends the elbow by 1.4 σ(1.5 u_O) rad |
//! | u_W | 0.03 u_W sin(12 z + 3 φ) · m along the normal in canonical space, before skinning |
//! | u_L | light: azimuth 0.8 u_L rad, elevation 30°, ambient share 0.35; nothing moves |
//!
//! m is the share of a point's weight on the trunk: joints whose names hold `hips`, `pelvis`, `spine`,
//! `chest`, `torso`, `body` or `abdomen`; 1 everywhere for a character without such names. The normal is
//! welded over equal positions, so that hard edges do not open.
//!
//! Shading normals are those of the displaced surface. On a face, where x, m and the direction a of the
//! displacement are linear between the corners, an edge e becomes e + (∇h·e) m a + h (∂_e m) a + h m ∂_e a:
//! slope, change of the trunk's share, curvature. The normal of the displaced face is the product of two such
//! edges, that of a vertex the sum over its faces (those of equal positions together), as for the surface at
//! rest. A shading normal turns by the shortest rotation between the two, so hard edges and modelled detail
//! stay.

use super::motion::Pose;
use super::skinned::{Character, INFLUENCES};
use crate::math::vector::unit;
use crate::num::elem::f64::sigmoid;
use crate::num::order;
use crate::scene::mesh::{Mesh, Object};
use crate::{Error, Result};
use data_gen::figure::factors::Drive;
use reference::body::skin::{self, Affine};

/// Meaning of the factors of a character.
#[derive(Clone, Debug, PartialEq)]
pub struct Factors {
    /// Animation and time in seconds of u_P → −∞.
    pub first: (usize, f64),
    /// Animation and time of u_P → +∞.
    pub second: (usize, f64),
    /// The joint u_O bends; none if absent.
    pub elbow: Option<usize>,
}

type V3 = [f64; 3];

fn dot(a: V3, b: V3) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// (V) the first vertex with the same position.
fn weld(mesh: &Mesh) -> Vec<usize> {
    let n = mesh.positions.len();
    let key = |i: usize| mesh.positions[i].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|&i| (key(i), i));
    let mut first = vec![0; n];
    for (k, &i) in order.iter().enumerate() {
        first[i] = if k > 0 && key(order[k - 1]) == key(i) { first[order[k - 1]] } else { i };
    }
    first
}

/// Unit normals, the same at equal positions: the mean of the faces there, weighted by area; zero where that
/// vanishes.
pub(super) fn welded_normals(mesh: &Mesh) -> Vec<[f32; 3]> {
    let first = weld(mesh);
    let mut sum = vec![[0.0f64; 3]; first.len()];
    for t in &mesh.triangles {
        let corners = t.map(|i| mesh.positions[i as usize].map(f64::from));
        let face = Face::at_rest(corners).normal();
        for &i in t {
            let s = &mut sum[first[i as usize]];
            *s = std::array::from_fn(|k| s[k] + face[k]);
        }
    }
    first.iter().map(|&i| unit(sum[i]).map(|x| x as f32)).collect()
}

/// Two edges of a face, from its first corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face([V3; 2]);

impl Face {
    pub(super) fn at_rest([a, b, c]: [V3; 3]) -> Self {
        Self([b, c].map(|x| std::array::from_fn(|k| x[k] - a[k])))
    }

    /// The edges at a point under folds of height h with gradient ∇h, where the point moves along `along`
    /// with share `share`; `ways` and `shares` are those of the corners.
    pub(super) fn folded(
        self,
        (height, gradient): (f64, V3),
        along: V3,
        share: f64,
        ways: [V3; 3],
        shares: [f64; 3],
    ) -> Self {
        Self(std::array::from_fn(|i| {
            let e = self.0[i];
            let slope = share * dot(gradient, e) + height * (shares[i + 1] - shares[0]);
            let turn: V3 = std::array::from_fn(|k| ways[i + 1][k] - ways[0][k]);
            // The derivative of a unit vector is orthogonal to it.
            let forth = dot(turn, along);
            std::array::from_fn(|k| e[k] + slope * along[k] + height * share * (turn[k] - forth * along[k]))
        }))
    }

    /// Of the length of twice the area.
    pub(super) fn normal(self) -> V3 {
        cross(self.0[0], self.0[1])
    }
}

/// `n` under the shortest rotation from direction `from` to direction `to`; as it is where one vanishes or
/// they are opposite.
pub(super) fn swung(n: V3, from: V3, to: V3) -> V3 {
    let (from, to) = (unit(from), unit(to));
    let reach = 1.0 + dot(from, to);
    if from == [0.0; 3] || to == [0.0; 3] || n == [0.0; 3] || !(reach > 1e-9) {
        return n;
    }
    // Mirrored at the plane of `from`, then at that of the bisector.
    let both: V3 = std::array::from_fn(|k| from[k] + to[k]);
    let (along, off) = (2.0 * dot(n, from), dot(n, both) / reach);
    unit(std::array::from_fn(|k| n[k] + along * to[k] - off * both[k]))
}

/// A normal under the linear part: cofactors, unit.
fn turned(t: &Affine<f64>, n: [f64; 3]) -> [f64; 3] {
    let column = |j: usize| [t[0][j], t[1][j], t[2][j]];
    let c = [cross(column(1), column(2)), cross(column(2), column(0)), cross(column(0), column(1))];
    unit(std::array::from_fn(|k| (c[0][k] * n[0] + c[1][k] * n[1]) + c[2][k] * n[2]))
}

impl Character {
    /// (J) whether a joint belongs to the trunk; all do if no name matches.
    pub(super) fn trunk(&self) -> Vec<bool> {
        let like = |n: &str| {
            ["hips", "pelvis", "spine", "chest", "torso", "body", "abdomen"].iter().any(|w| n.contains(w))
        };
        let trunk: Vec<bool> = self.joints.iter().map(|j| like(&j.name.to_ascii_lowercase())).collect();
        if trunk.contains(&true) { trunk } else { vec![true; trunk.len()] }
    }

    /// Canonical positions and shading normals under the folds of `drive`.
    fn folded(&self, drive: &Drive) -> (Vec<V3>, Vec<V3>) {
        let wide = |v: &[f32; 3]| v.map(f64::from);
        let mesh = &self.object.mesh;
        let (rest, mut normals): (Vec<V3>, Vec<V3>) =
            (mesh.positions.iter().map(wide).collect(), mesh.normals.iter().map(wide).collect());
        if drive.wrinkle == 0.0 {
            return (rest, normals);
        }
        let trunk = self.trunk();
        let shares: Vec<f64> = self.influences.iter().map(|(j, w)| share(j, w, &trunk)).collect();
        let ways: Vec<V3> = self.folds.iter().map(wide).collect();
        let fields: Vec<(f64, V3)> = rest.iter().map(|x| drive.wrinkles(*x)).collect();
        let moved = (0..rest.len())
            .map(|i| std::array::from_fn(|k| rest[i][k] + shares[i] * fields[i].0 * ways[i][k]))
            .collect();
        if normals.is_empty() {
            return (moved, normals);
        }
        let first = weld(mesh);
        let mut sums = vec![[[0.0; 3]; 2]; rest.len()];
        for t in &mesh.triangles {
            let t = t.map(|i| i as usize);
            let face = Face::at_rest(t.map(|i| rest[i]));
            let (ways_of, shares_of) = (t.map(|i| ways[i]), t.map(|i| shares[i]));
            for i in t {
                let folded = face.folded(fields[i], ways[i], shares[i], ways_of, shares_of);
                let sum = &mut sums[first[i]];
                for (s, n) in sum.iter_mut().zip([face.normal(), folded.normal()]) {
                    *s = std::array::from_fn(|k| s[k] + n[k]);
                }
            }
        }
        for (n, &i) in normals.iter_mut().zip(&first) {
            *n = swung(*n, sums[i][0], sums[i][1]);
        }
        (moved, normals)
    }

    /// The pose of factors u = (u_P, u_O, …), both animations `later` seconds on (they loop); missing factors
    /// are 0.
    ///
    /// # Errors
    /// When the elbow cannot bend.
    pub fn pose_of(&self, f: &Factors, later: f64, u: &[f64]) -> Result<Pose> {
        let [a, b] = [f.first, f.second].map(|(k, t)| self.pose(k, wrapped(t + later, self.duration(k))));
        let mut pose = a.mix(&b, sigmoid(u.first().copied().unwrap_or(0.0)));
        if let Some(elbow) = f.elbow {
            self.bend(&mut pose, elbow, Drive::new(u).elbow)?;
        }
        Ok(pose)
    }

    /// The surface in a pose: folds of `drive`, then linear blend skinning by `reference::body::skin`.
    ///
    /// # Rounding
    /// f64 throughout, positions and normals rounded once.
    ///
    /// # Errors
    /// When a position leaves the range of f32.
    pub fn posed(&self, pose: &Pose, drive: &Drive) -> Result<Object> {
        let transforms = self.transforms(pose);
        let (positions, normals) = self.folded(drive);
        let mut object = self.object.clone();
        for (i, x) in positions.into_iter().enumerate() {
            let (joints, weights) = self.influences[i];
            let t = blended(&joints, &weights, &transforms);
            object.mesh.positions[i] = skin::point(&t, x).map(|v| v as f32);
            if let Some(slot) = object.mesh.normals.get_mut(i) {
                *slot = turned(&t, normals[i]).map(|v| v as f32);
            }
        }
        object.mesh.validate(&self.name).map_err(|e| e.hint("the animation leaves the range of numbers"))?;
        Ok(object)
    }
}

/// Σ w A over the influences.
pub(super) fn blended(
    joints: &[u16; INFLUENCES],
    weights: &[f64; INFLUENCES],
    all: &[Affine<f64>],
) -> Affine<f64> {
    skin::blend(weights, &joints.map(|j| all[usize::from(j)]))
}

/// Weight on the trunk.
pub(super) fn share(joints: &[u16; INFLUENCES], weights: &[f64; INFLUENCES], trunk: &[bool]) -> f64 {
    let on = |k: usize| if trunk[usize::from(joints[k])] { weights[k] } else { 0.0 };
    order::min((0..INFLUENCES).fold(0.0, |s, k| s + on(k)), 1.0)
}

/// Posed normal of a canonical one.
pub(super) fn posed_normal(t: &Affine<f64>, n: [f64; 3]) -> [f64; 3] {
    turned(t, n)
}

/// A time within a loop of that length.
fn wrapped(time: f64, duration: f64) -> f64 {
    if duration > 0.0 { time - (time / duration).floor() * duration } else { 0.0 }
}

impl Factors {
    /// Resolves names. Two animations are mixed in the middle of each; one alone at its beginning and in its
    /// middle, which are the opposite steps of a walk. Without a name, the elbow is found by
    /// [`Character::elbow`].
    ///
    /// # Errors
    /// When a name does not exist, no elbow is named or found, or the joint cannot bend.
    pub fn of(c: &Character, first: &str, second: Option<&str>, elbow: Option<&str>) -> Result<Self> {
        let middle = |k: usize| (k, 0.5 * c.duration(k));
        let first = c.animation(first)?;
        let (first, second) = match second {
            Some(name) => (middle(first), middle(c.animation(name)?)),
            None => ((first, 0.0), middle(first)),
        };
        let elbow = match elbow {
            Some(n) => c.joint(n)?,
            None => c.elbow().ok_or_else(|| {
                let names: Vec<&str> = c.joints().iter().map(|j| j.name.as_str()).collect();
                Error::input(c.name().to_owned())
                    .at("elbow")
                    .expected("a joint named like an elbow or a forearm")
                    .got(format!("the joints {}", names.join(", ")))
                    .hint("name the joint that self-occlusion bends: --elbow NAME")
            })?,
        };
        c.bend(&mut c.rest(), elbow, 0.1).map_err(|e: Error| e.hint("name another joint: --elbow NAME"))?;
        Ok(Self { first, second, elbow: Some(elbow) })
    }
}
