//! `body.pose`: rotations of joints, with a correction on their right, along the skeleton to transforms.
//!
//! Q_k = Q_p ℛ(θ_k) ℛ(δ_k),   c_k = c_p + Q_p (j_k − j_p),   T_k = [Q_k | c_k − Q_k j_k],   p = parent of k
//!
//! A joint without a parent has Q_k = ℛ(θ_k) ℛ(δ_k) and c_k = j_k. T_k takes a point at rest to its posed place (SMPL; the correction is that of
//! GauHuman). ℛ is Rodrigues' formula,
//!
//! ℛ(w) = I + a K + b K²,   K v = w × v,   a = sin θ/θ,   b = (1 − cos θ)/θ² = ½ (sin ½θ/½θ)²,   θ = ‖w‖
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | θ | `pose` | (J, 3) | axis times angle, rad |
//! | δ | `correction` | (J, 3), optional | axis times angle, rad |
//! | j | `joints` | (J, 3) | places of the joints at rest, scene units |
//! | p | `parents` | (J) | index of the parent, below the joint's own; −1 for none |
//! | T | `transforms` | (J, 3, 4) | upper rows of affine transforms, posed from rest |
//!
//! # Rounding
//! Everything in f64; entries of T and what is added to a gradient are rounded once. A product of matrices is (x₀y₀ + x₁y₁) + x₂y₂; ℛ and its
//! adjoint are those of [`rodrigues`](crate::math::rodrigues). Children are added to their parents from the last joint to the first.
//!
//! # Kinks and domain
//! None: ℛ is smooth in w, at 0 too. The chain is linear in the joints. At least one joint.
//!
//! # Adjoint
//! With T̄_k = [M̄ | t̄]: Q̄_k += M̄ − t̄ j_kᵀ, c̄_k += t̄, j̄_k −= Q_kᵀ t̄; then from the last joint to the first Q̄_p += Q̄_k R_kᵀ + c̄_k (j_k − j_p)ᵀ,
//! c̄_p += c̄_k, j̄_k += Q_pᵀ c̄_k, j̄_p −= Q_pᵀ c̄_k, R̄_k = Q_pᵀ Q̄_k, from which ℛ's own adjoint gives θ̄_k and δ̄_k. The rotations are saved.
//!
//! Twin: `reference::body::pose`.
//!
//! # Example
//! A quarter turn about z at a joint on the x axis:
//! ```
//! use lastlight::body::pose::{In, forward};
//! let quarter = std::f32::consts::FRAC_PI_2;
//! let x = In { pose: &[[0.0, 0.0, quarter]], correction: None, joints: &[[1.0, 0.0, 0.0]], parents: &[-1] };
//! let (transforms, _) = forward(x)?;
//! let [[a, b, _, t], ..] = transforms[0]; // x' = −y + 1
//! assert!(a.abs() < 1e-7 && (b + 1.0).abs() < 1e-7 && (t - 1.0).abs() < 1e-7);
//! # Ok::<(), lastlight::Error>(())
//! ```

use crate::math::rodrigues::{matrix as rotation, matrix_adjoint as rotation_adjoint};
use crate::{Error, Result};

/// Upper three rows of an affine transform.
pub type Affine = [[f32; 4]; 3];

type Vec3 = [f64; 3];
type Mat3 = [Vec3; 3];

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (J, 3)
    pub pose: &'a [[f32; 3]],
    /// (J, 3); `None` corrects nothing
    pub correction: Option<&'a [[f32; 3]]>,
    /// (J, 3)
    pub joints: &'a [[f32; 3]],
    /// (J), −1 for none
    pub parents: &'a [i32],
}

/// Gradients, accumulated into.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// (J, 3); empty when it is not wanted
    pub pose: Vec<[f32; 3]>,
    /// (J, 3); empty when it is not wanted or there is no correction
    pub correction: Vec<[f32; 3]>,
    /// (J, 3); empty when it is not wanted
    pub joints: Vec<[f32; 3]>,
}

impl InBar {
    /// Zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |n: usize| vec![[0.0; 3]; n];
        let n = x.pose.len();
        Self { pose: zeros(n), correction: zeros(x.correction.map_or(0, <[_]>::len)), joints: zeros(n) }
    }
}

/// What the adjoint needs.
#[derive(Clone, Debug)]
pub struct Saved {
    /// (J) ℛ(θ), ℛ(δ)
    own: Vec<[Mat3; 2]>,
    /// (J) Q
    world: Vec<Mat3>,
}

const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn wide(v: [f32; 3]) -> Vec3 {
    v.map(f64::from)
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

fn transposed(m: &Mat3) -> Mat3 {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

fn product(a: &Mat3, b: &Mat3) -> Mat3 {
    let columns = transposed(b);
    std::array::from_fn(|i| std::array::from_fn(|j| dot(a[i], columns[j])))
}

fn apply(m: &Mat3, v: Vec3) -> Vec3 {
    m.map(|row| dot(row, v))
}

fn add(to: &mut Vec3, v: Vec3) {
    for (to, v) in to.iter_mut().zip(v) {
        *to += v;
    }
}

fn add_matrix(to: &mut Mat3, m: Mat3) {
    for (to, row) in to.iter_mut().zip(m) {
        add(to, row);
    }
}

impl In<'_> {
    /// Checks sizes and the order of parents.
    ///
    /// # Errors
    /// When something does not fit, naming it.
    pub fn check(&self) -> Result<()> {
        let n = self.pose.len();
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
        Ok(())
    }

    fn parent(&self, k: usize) -> Option<usize> {
        usize::try_from(self.parents[k]).ok()
    }
}

/// The transforms (J) and what the adjoint needs.
///
/// # Errors
/// Sizes that differ, no joint, a parent that is no earlier joint.
pub fn forward(x: In<'_>) -> Result<(Vec<Affine>, Saved)> {
    x.check()?;
    let n = x.pose.len();
    let own: Vec<[Mat3; 2]> = (0..n)
        .map(|k| [rotation(wide(x.pose[k])), x.correction.map_or(IDENTITY, |c| rotation(wide(c[k])))])
        .collect();
    let (mut world, mut centers) = (Vec::<Mat3>::with_capacity(n), Vec::<Vec3>::with_capacity(n));
    let mut transforms = Vec::with_capacity(n);
    for k in 0..n {
        let turn = product(&own[k][0], &own[k][1]);
        let joint = wide(x.joints[k]);
        let (q, c) = match x.parent(k) {
            None => (turn, joint),
            Some(p) => {
                let start = wide(x.joints[p]);
                let mut c = apply(&world[p], std::array::from_fn(|i| joint[i] - start[i]));
                add(&mut c, centers[p]);
                (product(&world[p], &turn), c)
            }
        };
        let moved = apply(&q, joint);
        transforms.push(std::array::from_fn(|i| {
            [q[i][0] as f32, q[i][1] as f32, q[i][2] as f32, (c[i] - moved[i]) as f32]
        }));
        world.push(q);
        centers.push(c);
    }
    Ok((transforms, Saved { own, world }))
}

/// The transforms (J, 4, 4) with their last rows 0 0 0 1, as [`super::skin`] takes them.
pub fn squared(transforms: &[Affine]) -> Vec<[f32; 16]> {
    let entry =
        |t: &Affine, at: usize| t.get(at / 4).map_or(f32::from(u8::from(at == 15)), |row| row[at % 4]);
    transforms.iter().map(|t| std::array::from_fn(|at| entry(t, at))).collect()
}

/// Cotangents of [`squared`] as those of the transforms: the last rows are constant.
pub fn squared_adjoint(bar: &[[f32; 16]]) -> Vec<Affine> {
    bar.iter().map(|b| std::array::from_fn(|i| std::array::from_fn(|j| b[4 * i + j]))).collect()
}

/// Adds the gradients for the cotangent `transforms_bar` (J) to `x_bar`.
///
/// # Panics
/// When a buffer does not have the size of its shape.
pub fn adjoint(x: In<'_>, saved: &Saved, transforms_bar: &[Affine], x_bar: &mut InBar) {
    let n = x.pose.len();
    assert_eq!(transforms_bar.len(), n, "one cotangent per transform");
    let mut world_bar = vec![[[0.0; 3]; 3]; n];
    let (mut center_bar, mut joint_bar) = (vec![[0.0; 3]; n], vec![[0.0; 3]; n]);
    for k in 0..n {
        let joint = wide(x.joints[k]);
        let rows = transforms_bar[k].map(|row| row.map(f64::from));
        let t_bar = rows.map(|row| row[3]);
        // undo t = c − Q j
        world_bar[k] = std::array::from_fn(|i| std::array::from_fn(|j| rows[i][j] - t_bar[i] * joint[j]));
        center_bar[k] = t_bar;
        joint_bar[k] = apply(&transposed(&saved.world[k]), t_bar).map(|v| -v);
    }
    for k in (0..n).rev() {
        let turn_bar = match x.parent(k) {
            None => {
                // undo c = j
                add(&mut joint_bar[k], center_bar[k]);
                world_bar[k]
            }
            Some(p) => {
                let turn = product(&saved.own[k][0], &saved.own[k][1]);
                let (joint, start, c_bar) = (wide(x.joints[k]), wide(x.joints[p]), center_bar[k]);
                // undo Q = Q_p R, c = c_p + Q_p (j − j_p)
                let through = product(&world_bar[k], &transposed(&turn));
                add_matrix(&mut world_bar[p], through);
                let way: Vec3 = std::array::from_fn(|i| joint[i] - start[i]);
                add_matrix(&mut world_bar[p], c_bar.map(|c| way.map(|w| c * w)));
                add(&mut center_bar[p], c_bar);
                let back = transposed(&saved.world[p]);
                let way_bar = apply(&back, c_bar);
                add(&mut joint_bar[k], way_bar);
                add(&mut joint_bar[p], way_bar.map(|v| -v));
                product(&back, &world_bar[k])
            }
        };
        // undo R = ℛ(θ) ℛ(δ)
        let [turned, corrected] = &saved.own[k];
        if !x_bar.pose.is_empty() {
            let bar = rotation_adjoint(wide(x.pose[k]), &product(&turn_bar, &transposed(corrected)));
            add_rounded(&mut x_bar.pose[k], bar);
        }
        if let (Some(correction), false) = (x.correction, x_bar.correction.is_empty()) {
            let bar = rotation_adjoint(wide(correction[k]), &product(&transposed(turned), &turn_bar));
            add_rounded(&mut x_bar.correction[k], bar);
        }
    }
    for (to, bar) in x_bar.joints.iter_mut().zip(joint_bar) {
        add_rounded(to, bar);
    }
}

fn add_rounded(to: &mut [f32; 3], v: Vec3) {
    for (to, v) in to.iter_mut().zip(v) {
        *to += v as f32;
    }
}
