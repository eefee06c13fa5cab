//! Rotations of joints, with a correction on their right, along the skeleton to transforms.
//!
//! Q_k = Q_p ℛ(θ_k) ℛ(δ_k),   c_k = c_p + Q_p (j_k − j_p),   T_k = [Q_k | c_k − Q_k j_k],   p = parent of k; without one Q_k = ℛℛ, c_k = j_k
//!
//! ℛ(w) = I + a K + b K²,   K v = w × v,   a = sin θ/θ,   b = (1 − cos θ)/θ²,   θ = ‖w‖
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | θ | `pose` | (J, 3) | axis times angle, rad |
//! | δ | `correction` | (J, 3), optional | axis times angle, rad |
//! | j | `joints` | (J, 3) | places at rest, scene units |
//! | p | `parents` | (J) | index below the joint's own; −1 for none |
//! | T | `transforms` | (J, 3, 4) | posed from rest |
//!
//! # Rounding
//! Left folds. 1 − cos θ is 2 sin²(θ/2), which does not cancel; below θ = 1e-4 two terms of the series of a and b.
//!
//! # Kinks and domain
//! Smooth everywhere.

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;

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

/// The twin of `body.pose`.
///
/// # Errors
/// When an input is missing or shaped otherwise, there is no joint, or a parent is no earlier joint.
pub fn forward<S: Scalar>(x: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let pose = expect(x, "pose", &[ANY, 3])?;
    let n = pose.shape[0];
    if n == 0 {
        return Err("input pose: expected at least one joint, got 0".to_owned());
    }
    let joints = expect(x, "joints", &[n, 3])?;
    let parents = expect(x, "parents", &[n])?;
    let correction = match x.contains_key("correction") {
        true => Some(expect(x, "correction", &[n, 3])?),
        false => None,
    };
    let slot = out.array("transforms", &[n, 3, 4]);
    let (mut world, mut centers): (Vec<Mat3<S>>, Vec<[S; 3]>) = (Vec::new(), Vec::new());
    for k in 0..n {
        let mut turn = rotation(pose.row(k));
        if let Some(correction) = correction {
            turn = product(&turn, &rotation(correction.row(k)));
        }
        let joint: [S; 3] = joints.row(k);
        let parent = parents.data[k].value();
        if parent == -1.0 {
            world.push(turn);
            centers.push(joint);
        } else if 0.0 <= parent && parent < k as f64 {
            let p = parent as usize;
            let start: [S; 3] = joints.row(p);
            let way = apply(&world[p], std::array::from_fn(|i| joint[i] - start[i]));
            world.push(product(&world[p], &turn));
            centers.push(std::array::from_fn(|i| centers[p][i] + way[i]));
        } else {
            return Err(format!("input parents: expected -1 or a joint below {k}, got {parent}"));
        }
    }
    for k in 0..n {
        let moved = apply(&world[k], joints.row(k));
        for i in 0..3 {
            let [a, b, c] = world[k][i];
            out.put_row(slot, 3 * k + i, [a, b, c, centers[k][i] - moved[i]]);
        }
    }
    out.flush();
    Ok(())
}
