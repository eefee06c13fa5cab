//! The surface in a pose, and the factors of `last.md` §3.2 for any character.
//!
//! | factor | effect |
//! |---|---|
//! | u_P | mixes two poses: the first with 1 − σ(u_P), the second with σ(u_P) |
//! | u_O | bends the elbow by 1.4 σ(1.5 u_O) rad |
//! | u_W | 0.03 u_W sin(12 z + 3 φ) · m along the normal in canonical space, before skinning |
//! | u_L | light: azimuth 0.8 u_L rad, elevation 30°, ambient share 0.35; nothing moves |
//!
//! m is the share of a point's weight on the trunk: joints whose names hold `hips`, `pelvis`, `spine`, `chest`, `torso`, `body` or `abdomen`; 1
//! everywhere for a character without such names. The normal is welded over equal positions, so that hard edges do not open; shading normals
//! tilt by the field's gradient, n − (∇h − n(n·∇h)).

use super::{Character, INFLUENCES, Pose};
use crate::num::elem::f64::sigmoid;
use crate::num::order;
use crate::scene::mesh::{Mesh, Object};
use crate::scene::model::unit;
use crate::{Error, Result};
use data_gen::figure::factors::Drive;
use reference::body::skin::{self, Affine};

/// What the factors of a character mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Factors {
    /// Animation and time in seconds of u_P → −∞.
    pub first: (usize, f64),
    /// Animation and time of u_P → +∞.
    pub second: (usize, f64),
    /// The joint u_O bends; none if absent.
    pub elbow: Option<usize>,
}

/// Unit normals, the same at equal positions: the mean of the faces there, weighted by area; zero where that vanishes.
pub(super) fn welded_normals(mesh: &Mesh) -> Vec<[f32; 3]> {
    let n = mesh.positions.len();
    let key = |i: usize| mesh.positions[i].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|&i| (key(i), i));
    let mut first = vec![0; n];
    for (k, &i) in order.iter().enumerate() {
        first[i] = if k > 0 && key(order[k - 1]) == key(i) { first[order[k - 1]] } else { i };
    }
    let mut sum = vec![[0.0f64; 3]; n];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize].map(f64::from));
        let (u, v): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
        let face = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for &i in t {
            let s = &mut sum[first[i as usize]];
            *s = std::array::from_fn(|k| s[k] + face[k]);
        }
    }
    (0..n).map(|i| unit(sum[first[i]]).map(|x| x as f32)).collect()
}

/// n − tangential part of the gradient, unit.
fn tilted(n: [f64; 3], gradient: [f64; 3]) -> [f64; 3] {
    let along = (n[0] * gradient[0] + n[1] * gradient[1]) + n[2] * gradient[2];
    unit(std::array::from_fn(|k| n[k] - (gradient[k] - n[k] * along)))
}

/// A normal under the linear part: cofactors, unit.
fn turned(t: &Affine<f64>, n: [f64; 3]) -> [f64; 3] {
    let column = |j: usize| [t[0][j], t[1][j], t[2][j]];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let c = [cross(column(1), column(2)), cross(column(2), column(0)), cross(column(0), column(1))];
    unit(std::array::from_fn(|k| (c[0][k] * n[0] + c[1][k] * n[1]) + c[2][k] * n[2]))
}

impl Character {
    /// (J) whether a joint belongs to the trunk; all do if no name says so.
    pub(super) fn trunk(&self) -> Vec<bool> {
        let like = |n: &str| {
            ["hips", "pelvis", "spine", "chest", "torso", "body", "abdomen"].iter().any(|w| n.contains(w))
        };
        let trunk: Vec<bool> = self.joints.iter().map(|j| like(&j.name.to_ascii_lowercase())).collect();
        if trunk.contains(&true) { trunk } else { vec![true; trunk.len()] }
    }

    /// Position and shading normal of a canonical point under the folds.
    ///
    /// `along` is the direction it moves in, `normal` the shading normal (zero stays zero), `share` its part m of the displacement.
    pub(super) fn folded(
        drive: &Drive,
        x: [f64; 3],
        along: [f64; 3],
        normal: [f64; 3],
        share: f64,
    ) -> ([f64; 3], [f64; 3]) {
        if drive.wrinkle == 0.0 || share == 0.0 {
            return (x, normal);
        }
        let (height, gradient) = drive.wrinkles(x);
        let moved = std::array::from_fn(|k| x[k] + share * height * along[k]);
        let normal = if normal == [0.0; 3] { normal } else { tilted(normal, gradient.map(|g| share * g)) };
        (moved, normal)
    }

    /// The pose of factors u = (u_P, u_O, …), both animations `later` seconds on (they loop); missing factors are 0.
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
        let trunk = self.trunk();
        let mut object = self.object.clone();
        let wide = |v: [f32; 3]| v.map(f64::from);
        for i in 0..object.mesh.positions.len() {
            let (joints, weights) = self.influences[i];
            let t = blended(&joints, &weights, &transforms);
            let share = share(&joints, &weights, &trunk);
            let normal = object.mesh.normals.get(i).map_or([0.0; 3], |n| wide(*n));
            let (x, n) =
                Self::folded(drive, wide(self.object.mesh.positions[i]), wide(self.folds[i]), normal, share);
            object.mesh.positions[i] = skin::point(&t, x).map(|v| v as f32);
            if let Some(slot) = object.mesh.normals.get_mut(i) {
                *slot = turned(&t, n).map(|v| v as f32);
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
    /// Looks names up. Two animations are mixed in the middle of each; one alone at its beginning and in its middle, which are the opposite
    /// steps of a walk. An elbow that is not named is searched for by [`Character::elbow`].
    ///
    /// # Errors
    /// When a name fits nothing, no elbow is named or found, or the joint cannot bend.
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
                    .hint("name the joint that self-occlusion bends")
            })?,
        };
        c.bend(&mut c.rest(), elbow, 0.1).map_err(|e: Error| e.hint("name another joint"))?;
        Ok(Self { first, second, elbow: Some(elbow) })
    }
}
