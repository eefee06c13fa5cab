//! `body.pose`: transforms of joints along the skeleton, from rotations or from a capture, each with an
//! optional correction on its right.
//!
//! B_k = B_p L_k ℛ(δ_k; j_k),   L_k = ℛ(θ_k; j_k)  or  A_p⁻¹ A_k,   ℛ(w; j) = T(j) ℛ(w) T(−j),
//! p = parent of k   (GauHuman)
//!
//! For a joint without a parent, B_p = A_p = I. With rotations, B maps a point at rest to its posed position
//! (SMPL); with the transforms of a capture, B is the corrected capture (GauHuman). ℛ is Rodrigues' formula,
//!
//! ℛ(w) = I + a K + b K²,   K v = w × v,   a = sin θ/θ,   b = (1 − cos θ)/θ² = ½ (sin ½θ/½θ)²,   θ = ‖w‖
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | θ | `pose` | (J, 3), or `captured` | axis times angle, rad |
//! | A | `captured` | (J, 3, 4), or `pose` | upper rows of affine transforms, world from rest; a constant |
//! | δ | `correction` | (J, 3), optional | axis times angle, rad |
//! | j | `joints` | (J, 3) | positions of the joints at rest, scene units |
//! | p | `parents` | (J) | index of the parent, less than the joint's own index; −1 for none |
//! | B | `transforms` | (J, 3, 4) | upper rows of affine transforms, posed from rest |
//!
//! # Rounding
//! All values are f64; entries of B and the values added to a gradient are rounded once. Products and
//! inverses are those of [`affine`], ℛ and its adjoint those of [`rodrigues`]. Children are added to their
//! parents from the last joint to the first.
//!
//! # Kinks and domain
//! There are no kinks: ℛ is smooth in w, also at 0. There is at least one joint. The determinant of the
//! linear part of every captured transform has an absolute value between 10⁻¹² and 10¹², so that the
//! transform has an inverse; [`In::check`] refuses others.
//!
//! # Adjoint
//! Children are processed before parents. With N_k = L_k Q_k, Q_k = ℛ(δ_k; j_k): N̄ = B_pᵀ B̄_k and
//! B̄_p += B̄_k N_kᵀ (as 4×4 matrices); Q̄ = L_kᵀ N̄, L̄ = N̄ Q_kᵀ. From the cotangent [M̄ | t̄] of ℛ(w; j):
//! ℛ̄ = M̄ − t̄ jᵀ, j̄ += t̄ − ℛᵀ t̄; w̄ is computed by the adjoint of ℛ. L, Q, N and B are saved.
//!
//! Twin: `reference::body::pose`.
//!
//! # Example
//! A quarter turn about z at a joint on the x axis:
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::body::pose::{In, forward};
//! let quarter = std::f32::consts::FRAC_PI_2;
//! let joints = [[1.0, 0.0, 0.0]];
//! let x = In { pose: &[[0.0, 0.0, quarter]], captured: &[], correction: None, joints: &joints, parents: &[-1] };
//! let (transforms, _) = forward(x)?;
//! let [[a, b, _, t], ..] = transforms[0]; // x' = −y + 1
//! assert!(a.abs() < 1e-7 && (b + 1.0).abs() < 1e-7 && (t - 1.0).abs() < 1e-7);
//! # Ok::<(), lastlight::Error>(())
//! ```

use crate::math::affine::{
    self, Linear, about, compose, determinant, inverse, is_invertible, left_bar, linear, right_bar, single,
    wide,
};
use crate::math::rodrigues;
use crate::{Error, Result};

/// Upper three rows of an affine transform.
pub type Affine = [[f32; 4]; 3];

type Vec3 = [f64; 3];

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (J, 3); empty if `captured` is given.
    pub pose: &'a [[f32; 3]],
    /// Shape (J); empty if `pose` is given.
    pub captured: &'a [Affine],
    /// Shape (J, 3); `None` for no correction.
    pub correction: Option<&'a [[f32; 3]]>,
    /// Shape (J, 3).
    pub joints: &'a [[f32; 3]],
    /// Shape (J); −1 for a joint without a parent.
    pub parents: &'a [i32],
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (J, 3); empty if not requested.
    pub pose: Vec<[f32; 3]>,
    /// Shape (J, 3); empty if not requested or if there is no correction.
    pub correction: Vec<[f32; 3]>,
    /// Shape (J, 3); empty if not requested.
    pub joints: Vec<[f32; 3]>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |n: usize| vec![[0.0; 3]; n];
        let n = x.joints.len();
        Self {
            pose: zeros(x.pose.len()),
            correction: zeros(x.correction.map_or(0, <[_]>::len)),
            joints: zeros(n),
        }
    }
}

/// The kinematic chain in f64.
#[derive(Clone, Debug)]
struct Chain {
    /// θ; empty if the transforms of a capture are given.
    pose: Vec<Vec3>,
    /// A_p⁻¹ A_k; empty if rotations are given.
    relative: Vec<affine::Affine>,
    /// δ; empty without correction.
    correction: Vec<Vec3>,
    joints: Vec<Vec3>,
    parents: Vec<Option<usize>>,
}

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug)]
pub struct Saved {
    chain: Chain,
    /// L, Q and L Q of each joint, shape (J).
    own: Vec<[affine::Affine; 3]>,
    /// B of each joint, shape (J).
    world: Vec<affine::Affine>,
}

/// Gradients in f64, one row per joint.
struct Bars {
    pose: Vec<Vec3>,
    correction: Vec<Vec3>,
    joints: Vec<Vec3>,
}

const IDENTITY: affine::Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// Returns ℛ(w; j).
fn turn(w: Vec3, joint: Vec3) -> affine::Affine {
    about(&rodrigues::matrix(w), joint)
}

/// Returns w̄ for the cotangent of ℛ(w; j), and adds to j̄.
fn turn_adjoint(w: Vec3, joint: Vec3, bar: &affine::Affine, joint_bar: &mut Vec3) -> Vec3 {
    let (r, t_bar) = (rodrigues::matrix(w), bar.map(|row| row[3]));
    for i in 0..3 {
        joint_bar[i] += t_bar[i] - ((r[0][i] * t_bar[0] + r[1][i] * t_bar[1]) + r[2][i] * t_bar[2]);
    }
    let r_bar: Linear = std::array::from_fn(|i| std::array::from_fn(|j| bar[i][j] - bar[i][3] * joint[j]));
    rodrigues::matrix_adjoint(w, &r_bar)
}

impl Chain {
    fn new(x: &In<'_>) -> Self {
        let vectors = |v: &[[f32; 3]]| v.iter().map(|v| v.map(f64::from)).collect();
        let parents: Vec<Option<usize>> = x.parents.iter().map(|p| usize::try_from(*p).ok()).collect();
        let relative = |(a, p): (&Affine, &Option<usize>)| match p {
            Some(p) => compose(&inverse(&wide(&x.captured[*p])), &wide(a)),
            None => wide(a),
        };
        Self {
            pose: vectors(x.pose),
            relative: x.captured.iter().zip(&parents).map(relative).collect(),
            correction: vectors(x.correction.unwrap_or_default()),
            joints: vectors(x.joints),
            parents,
        }
    }

    fn forward(self) -> Saved {
        let n = self.joints.len();
        let (mut own, mut world) = (Vec::with_capacity(n), Vec::<affine::Affine>::with_capacity(n));
        for k in 0..n {
            let joint = self.joints[k];
            let link = self.relative.get(k).copied().unwrap_or_else(|| turn(self.pose[k], joint));
            let (corrected, both) = match self.correction.get(k) {
                Some(w) => {
                    let corrected = turn(*w, joint);
                    (corrected, compose(&link, &corrected))
                }
                None => (IDENTITY, link),
            };
            world.push(match self.parents[k] {
                Some(p) => compose(&world[p], &both),
                None => both,
            });
            own.push([link, corrected, both]);
        }
        Saved { chain: self, own, world }
    }
}

impl Saved {
    /// Returns the gradients for the cotangents of B.
    fn bars(&self, mut bar: Vec<affine::Affine>) -> Bars {
        let (n, chain) = (bar.len(), &self.chain);
        let zeros = || vec![[0.0; 3]; n];
        let mut bars = Bars { pose: zeros(), correction: zeros(), joints: zeros() };
        for k in (0..n).rev() {
            let [link, corrected, both] = &self.own[k];
            let own_bar = match chain.parents[k] {
                Some(p) => {
                    let up = left_bar(both, &bar[k]);
                    for i in 0..3 {
                        for j in 0..4 {
                            bar[p][i][j] += up[i][j];
                        }
                    }
                    right_bar(&self.world[p], &bar[k])
                }
                None => bar[k],
            };
            let (joint, joint_bar) = (chain.joints[k], &mut bars.joints[k]);
            if let Some(w) = chain.correction.get(k) {
                bars.correction[k] = turn_adjoint(*w, joint, &right_bar(link, &own_bar), joint_bar);
            }
            if let Some(w) = chain.pose.get(k) {
                bars.pose[k] = turn_adjoint(*w, joint, &left_bar(corrected, &own_bar), joint_bar);
            }
        }
        bars
    }
}

impl In<'_> {
    /// Checks sizes, the order of parents and the captured transforms.
    ///
    /// # Errors
    /// Returns an error that names the first mismatch.
    pub fn check(&self) -> Result<()> {
        let n = Ord::max(self.pose.len(), self.captured.len());
        let sizes = [
            ("correction", self.correction.map_or(n, <[_]>::len)),
            ("joints", self.joints.len()),
            ("parents", self.parents.len()),
        ];
        if n == 0 {
            return Err(Error::input("body.pose")
                .at("array 'pose'")
                .expected("at least one joint")
                .got("none"));
        }
        if !self.pose.is_empty() && !self.captured.is_empty() {
            return Err(Error::input("body.pose")
                .expected("either the array 'pose' or the array 'captured'")
                .got("both"));
        }
        if let Some((name, len)) = sizes.into_iter().find(|(_, len)| *len != n) {
            return Err(Error::input("body.pose")
                .at(format!("array '{name}'"))
                .expected(format!("{n} joints"))
                .got(len.to_string()));
        }
        if let Some(k) = (0..n).find(|&k| !(-1 <= self.parents[k] && i64::from(self.parents[k]) < k as i64)) {
            return Err(Error::input("body.pose")
                .at(format!("array 'parents', joint {k}"))
                .expected(format!("-1 or a joint below {k}"))
                .got(self.parents[k].to_string())
                .hint("sort the joints so that parents come first"));
        }
        for (k, a) in self.captured.iter().enumerate() {
            let d = determinant(&linear(&wide(a)));
            if !is_invertible(d) {
                return Err(Error::input("body.pose")
                    .at(format!("array 'captured', joint {k}"))
                    .expected("a transform that has an inverse")
                    .got(format!("determinant {d:e}")));
            }
        }
        Ok(())
    }
}

/// Returns the transforms (J) and the intermediate values that the adjoint needs.
///
/// # Errors
/// Returns an error if sizes differ, if there is no joint, if a parent is not an earlier joint, or if a
/// captured transform has no inverse.
pub fn forward(x: In<'_>) -> Result<(Vec<Affine>, Saved)> {
    x.check()?;
    let saved = Chain::new(&x).forward();
    Ok((saved.world.iter().map(single).collect(), saved))
}

/// Returns the transforms as (J, 4, 4) with last rows 0 0 0 1, the form that [`super::skin`] accepts.
pub fn squared(transforms: &[Affine]) -> Vec<[f32; 16]> {
    let entry =
        |t: &Affine, at: usize| t.get(at / 4).map_or(f32::from(u8::from(at == 15)), |row| row[at % 4]);
    transforms.iter().map(|t| std::array::from_fn(|at| entry(t, at))).collect()
}

/// Converts the cotangents of [`squared`] to those of the transforms; the last rows are constant.
pub fn squared_adjoint(bar: &[[f32; 16]]) -> Vec<Affine> {
    bar.iter().map(|b| std::array::from_fn(|i| std::array::from_fn(|j| b[4 * i + j]))).collect()
}

/// Adds the gradients for the cotangent `transforms_bar` (J) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: In<'_>, saved: &Saved, transforms_bar: &[Affine], x_bar: &mut InBar) {
    assert_eq!(transforms_bar.len(), x.joints.len(), "one cotangent per transform");
    let bars = saved.bars(transforms_bar.iter().map(wide).collect());
    let into = [&mut x_bar.pose, &mut x_bar.correction, &mut x_bar.joints];
    for (to, bars) in into.into_iter().zip([bars.pose, bars.correction, bars.joints]) {
        for (to, bar) in to.as_flattened_mut().iter_mut().zip(bars.as_flattened()) {
            *to += *bar as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_those_of_differences() {
        let parents = [None, Some(0), Some(1), Some(0)];
        let joints = vec![[0.0, 0.0, 0.0], [0.25, 1.0, -0.5], [0.5, 1.5, 0.25], [-0.75, 0.5, 0.0]];
        let turns = [[0.0, 0.7, 0.3], [-0.5, 0.1, 0.9], [0.2, -0.4, 0.1], [0.3, 0.3, -0.2]];
        let place = |k: usize| [0.5 + k as f64, -0.25, 2.0];
        let relative = turns.iter().enumerate().map(|(k, w)| turn(*w, place(k))).collect();
        // The third joint has no correction: the limit of small angles.
        let v = vec![[0.3, 0.1, -0.4], [0.1, -0.2, 0.05], [0.0; 3], [-0.6, 0.2, 0.7]];
        let chain = Chain { pose: Vec::new(), relative, correction: v, joints, parents: parents.to_vec() };
        let entry = |k: usize, i: usize, j: usize| 0.25 * ((5 * k + 3 * i + j) % 7) as f64 - 0.7;
        let bar: Vec<affine::Affine> =
            (0..4).map(|k| std::array::from_fn(|i| std::array::from_fn(|j| entry(k, i, j)))).collect();
        let loss = |chain: Chain| {
            let b = chain.forward().world;
            let terms = (0..48).map(|e| (e / 12, e / 4 % 3, e % 4));
            terms.fold(0.0, |s, (k, i, j)| s + bar[k][i][j] * b[k][i][j])
        };
        let grad = chain.clone().forward().bars(bar.clone()).correction;
        for (k, c) in (0..12).map(|e| (e / 3, e % 3)) {
            let at = |by: f64| {
                let mut chain = chain.clone();
                chain.correction[k][c] += by;
                loss(chain)
            };
            // Fourth order: the error is of order h⁴ and of rounding over h.
            let h = 1e-3;
            let slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let g = grad[k][c];
            assert!((slope - g).abs() < 1e-10, "joint {k}, axis {c}: {g} and {slope} by differences");
        }
    }
}
