//! `body.pose`: transforms of joints along the skeleton, from rotations or from a capture; a correction is
//! multiplied from the right.
//!
//! From rotations: Q_k = Q_p ℛ(θ_k) ℛ(δ_k),   c_k = c_p + Q_p (j_k − j_p),   B_k = [Q_k | c_k − Q_k j_k],
//! p = parent of k; without one
//! Q_k = ℛℛ, c_k = j_k
//!
//! From a capture: B_k = B_p A_p⁻¹ A_k T(j_k) ℛ(δ_k) T(−j_k);   without a parent B_p = A_p = I
//!
//! ℛ(w) = I + a K + b K²,   K v = w × v,   a = sin θ/θ,   b = (1 − cos θ)/θ²,   θ = ‖w‖
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | θ | `pose` | (J, 3), or `captured` | axis times angle, rad |
//! | A | `captured` | (J, 3, 4), or `pose` | world from rest, constant |
//! | δ | `correction` | (J, 3), optional | axis times angle, rad |
//! | j | `joints` | (J, 3) | places at rest, scene units |
//! | p | `parents` | (J) | index below the joint's own; −1 for none |
//! | B | `transforms` | (J, 3, 4) | posed from rest |
//!
//! # Rounding
//! Left folds. 1 − cos θ is 2 sin²(θ/2), which does not cancel; below θ = 1e-4 a and b are computed by two
//! terms of their series. A⁻¹ by Cramer's rule.
//!
//! # Kinks and domain
//! Smooth everywhere. J ≥ 1; |det| of the linear part of every A_k is between 10⁻¹² and 10¹².

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `body.pose`.
    pub struct In<'a, S> {
        pose: Option<&'a Arr<S>> = Port::var("J,3", "axis times angle, rad; or captured"),
        captured: Option<&'a Arr<S>> =
            Port::fixed("J,3,4", "upper rows of affine transforms, world from rest; or pose"),
        correction: Option<&'a Arr<S>> = Port::var("J,3", "axis times angle, rad; absent: none"),
        joints: &'a Arr<S> = Port::var("J,3", "places at rest, scene units"),
        parents: &'a Arr<S> = Port::int("J", Dtype::I32, "index of an earlier joint, -1 for none"),
    }
}

/// `body.pose`
pub static SIGNATURE: Signature = Signature {
    name: "body.pose",
    summary: "transforms of joints along the skeleton, from rotations or a capture, with corrections",
    inputs: In::<f64>::PORTS,
    outputs: ports![transforms: Port::var("J,3,4", "upper rows, posed from rest")],
    ..Signature::EMPTY
};

type Mat3<S> = [[S; 3]; 3];

/// ℛ(w).
pub fn rotation<S: Scalar>(w: [S; 3]) -> Mat3<S> {
    let square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    let (a, b) = if square.value() < 1e-8 {
        (S::one() - square / 6.0, S::from_f64(0.5) - square / 24.0)
    } else {
        let theta = square.sqrt();
        let half = (theta * 0.5).sin() / (theta * 0.5);
        (theta.sin() / theta, half * half * 0.5)
    };
    let zero = S::zero();
    let cross = [[zero, -w[2], w[1]], [w[2], zero, -w[0]], [-w[1], w[0], zero]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let squared = cross[i][0] * cross[0][j] + cross[i][1] * cross[1][j] + cross[i][2] * cross[2][j];
            a * cross[i][j] + b * squared + if i == j { 1.0 } else { 0.0 }
        })
    })
}

fn product<S: Scalar>(a: &Mat3<S>, b: &Mat3<S>) -> Mat3<S> {
    a.map(|row| std::array::from_fn(|j| row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]))
}

fn apply<S: Scalar>(m: &Mat3<S>, v: [S; 3]) -> [S; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Linear part and translation.
type Motion<S> = (Mat3<S>, [S; 3]);

/// a after b.
fn compose<S: Scalar>(a: &Motion<S>, b: &Motion<S>) -> Motion<S> {
    let moved = apply(&a.0, b.1);
    (product(&a.0, &b.0), std::array::from_fn(|i| moved[i] + a.1[i]))
}

/// Whether a matrix of that determinant counts as invertible.
pub fn is_invertible(determinant: f64) -> bool {
    1e-12 < determinant.abs() && determinant.abs() < 1e12
}

/// The determinant without row i and column j, with its sign.
fn cofactor<S: Scalar>(m: &Mat3<S>, i: usize, j: usize) -> S {
    let [r, s] = [(i + 1) % 3, (i + 2) % 3];
    let [c, d] = [(j + 1) % 3, (j + 2) % 3];
    m[r][c] * m[s][d] - m[r][d] * m[s][c]
}

fn determinant<S: Scalar>(m: &Mat3<S>) -> S {
    m[0][0] * cofactor(m, 0, 0) + m[0][1] * cofactor(m, 0, 1) + m[0][2] * cofactor(m, 0, 2)
}

/// The inverse: Cramer's rule, entry (i, j) is the cofactor (j, i) over the determinant.
fn inverse<S: Scalar>(a: &Motion<S>) -> Motion<S> {
    let determinant = determinant(&a.0);
    let entry = |i: usize, j: usize| cofactor(&a.0, j, i) / determinant;
    let linear: Mat3<S> = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
    let back = apply(&linear, a.1);
    (linear, back.map(|x| -x))
}

/// Parent of joint k.
fn parent<S: Scalar>(parents: &Arr<S>, k: usize) -> Result<Option<usize>, String> {
    match parents.data[k].value() {
        -1.0 => Ok(None),
        p if 0.0 <= p && p < k as f64 => Ok(Some(p as usize)),
        p => Err(format!("input parents: expected -1 or a joint below {k}, got {p}")),
    }
}

/// From rotations: Q and the posed places of the joints.
fn from_rotations<S: Scalar>(pose: &Arr<S>, x: &In<'_, S>) -> Result<Vec<Motion<S>>, String> {
    let (mut world, mut centers): (Vec<Mat3<S>>, Vec<[S; 3]>) = (Vec::new(), Vec::new());
    for k in 0..pose.shape[0] {
        let mut turn = rotation(pose.row(k));
        if let Some(correction) = x.correction {
            turn = product(&turn, &rotation(correction.row(k)));
        }
        let joint: [S; 3] = x.joints.row(k);
        match parent(x.parents, k)? {
            None => {
                world.push(turn);
                centers.push(joint);
            }
            Some(p) => {
                let start: [S; 3] = x.joints.row(p);
                let way = apply(&world[p], std::array::from_fn(|i| joint[i] - start[i]));
                world.push(product(&world[p], &turn));
                centers.push(std::array::from_fn(|i| centers[p][i] + way[i]));
            }
        }
    }
    let moved = world.iter().enumerate().map(|(k, q)| {
        let moved = apply(q, x.joints.row(k));
        (*q, std::array::from_fn(|i| centers[k][i] - moved[i]))
    });
    Ok(moved.collect())
}

/// From a capture.
fn from_capture<S: Scalar>(captured: &Arr<S>, x: &In<'_, S>) -> Result<Vec<Motion<S>>, String> {
    let given = |k: usize| -> Motion<S> {
        let row = |i: usize| captured.row::<4>(3 * k + i);
        ([0, 1, 2].map(|i| [row(i)[0], row(i)[1], row(i)[2]]), [0, 1, 2].map(|i| row(i)[3]))
    };
    let mut world: Vec<Motion<S>> = Vec::new();
    for k in 0..captured.shape[0] {
        let mut b = given(k);
        let d = determinant(&b.0.map(|row| row.map(S::value)));
        if !is_invertible(d) {
            return Err(format!(
                "input captured: expected an invertible transform, joint {k} has determinant {d:e}"
            ));
        }
        if let Some(p) = parent(x.parents, k)? {
            b = compose(&world[p], &compose(&inverse(&given(p)), &b));
        }
        if let Some(correction) = x.correction {
            let (turn, joint): (Mat3<S>, [S; 3]) = (rotation(correction.row(k)), x.joints.row(k));
            let moved = apply(&turn, joint);
            b = compose(&b, &(turn, std::array::from_fn(|i| joint[i] - moved[i])));
        }
        world.push(b);
    }
    Ok(world)
}

/// The twin of `body.pose`.
///
/// # Errors
/// When there is no joint, a parent is not an earlier joint, a captured transform has no inverse, or `pose`
/// and `captured` are both present or both absent.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let n = input.joints.shape[0];
    if n == 0 {
        return Err("input joints: expected at least one joint, got 0".to_owned());
    }
    let world = match (input.pose, input.captured) {
        (Some(pose), None) => from_rotations(pose, input)?,
        (None, Some(captured)) => from_capture(captured, input)?,
        _ => return Err("inputs pose, captured: expected exactly one of them".to_owned()),
    };
    let slot = out.array("transforms", &[n, 3, 4]);
    for (k, (q, t)) in world.into_iter().enumerate() {
        for i in 0..3 {
            let [a, b, c] = q[i];
            out.put_row(slot, 3 * k + i, [a, b, c, t[i]]);
        }
    }
    out.flush();
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
