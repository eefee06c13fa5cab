//! Posing a body of the SMPL family, in its own axes (y up) and metres.
//!
//! ```text
//! v̄ = T̄ + S β                      J = 𝒥 v̄
//! v = v̄ + P vec(R_1 − I, …, R_{K−1} − I)
//! G_0 = [R_0 | J_0],  G_k = G_p(k) · [R_k | J_k − J_p(k)],  A_k = G_k · [I | −J_k]
//! x = Rodrigues(Rh) · s · (Σ_k w_k A_k v) + Th
//! ```
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | T̄, S, P, 𝒥, w | [`BodyModel`] | |
//! | R_k | Rodrigues(θ_k) | (K, 3) axis-angle |
//! | Rh, Th, s | global rotation about the origin, translation, scale | (3), (3), 1 |
//!
//! # Rounding
//! f64; sums over coefficients and points are left folds in index order.

use super::rotation_matrix;
use crate::io::smpl::BodyModel;
use crate::math::affine::compose;
use crate::{Error, Result};
use reference::body::skin::Affine;

/// v̄ = T̄ + S β: as many coefficients as are given, the rest zero.
///
/// # Errors
/// When the model has fewer coefficients than are given.
pub fn shaped(model: &BodyModel, betas: &[f64]) -> Result<Vec<[f64; 3]>> {
    let n = model.shape_count;
    // Zeros beyond the model's coefficients have no effect.
    let used = betas.iter().rposition(|b| *b != 0.0).map_or(0, |i| i + 1);
    if used > n {
        return Err(Error::input("betas")
            .expected(format!("at most {n} coefficients, as the body model has"))
            .got(used.to_string()));
    }
    let point = |(v, x): (usize, &[f64; 3])| -> [f64; 3] {
        std::array::from_fn(|c| {
            let row = &model.shapes[(3 * v + c) * n..][..used];
            row.iter().zip(betas).fold(x[c], |s, (a, b)| s + a * b)
        })
    };
    Ok(model.template.iter().enumerate().map(point).collect())
}

/// J = 𝒥 v̄.
pub fn joints(model: &BodyModel, shaped: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let row = |weights: &[f64]| -> [f64; 3] {
        std::array::from_fn(|c| weights.iter().zip(shaped).fold(0.0, |s, (w, x)| s + w * x[c]))
    };
    model.regressor.chunks_exact(shaped.len()).map(row).collect()
}

/// (K) A_k, posed from rest, without the global placement.
pub fn chain(parents: &[Option<usize>], joints: &[[f64; 3]], rotations: &[[f64; 3]]) -> Vec<Affine<f64>> {
    let mut world: Vec<Affine<f64>> = Vec::with_capacity(parents.len());
    for (k, parent) in parents.iter().enumerate() {
        let r = rotation_matrix(rotations[k]);
        let at = parent.map_or(joints[k], |p| std::array::from_fn(|c| joints[k][c] - joints[p][c]));
        let own: Affine<f64> = std::array::from_fn(|i| [r[i][0], r[i][1], r[i][2], at[i]]);
        let g = parent.map_or(own, |p| compose(&world[p], &own));
        world.push(g);
    }
    let from_rest = |(g, j): (&Affine<f64>, &[f64; 3])| -> Affine<f64> {
        g.map(|row| {
            let moved = (row[0] * j[0] + row[1] * j[1]) + row[2] * j[2];
            [row[0], row[1], row[2], row[3] - moved]
        })
    };
    world.iter().zip(joints).map(from_rest).collect()
}

/// x' = Rodrigues(Rh) · s · x + Th as a transform.
pub fn placement(rotation: [f64; 3], translation: [f64; 3], scale: f64) -> Affine<f64> {
    let r = rotation_matrix(rotation);
    std::array::from_fn(|i| [scale * r[i][0], scale * r[i][1], scale * r[i][2], translation[i]])
}

/// The canonical pose of SMPL and SMPL-X: legs apart, hips turned by ±45° and ankles by ∓30° about the z axis
/// of the model.
///
/// Indices 5, 8, 23 and 26 of the flat pose vector: joints 1, 2 (hips), 7, 8 (ankles).
pub fn big_pose(joints: usize) -> Vec<[f64; 3]> {
    let mut out = vec![[0.0; 3]; joints];
    let degree = std::f64::consts::PI / 180.0;
    for (k, angle) in [(1, 45.0), (2, -45.0), (7, -30.0), (8, 30.0)] {
        if let Some(v) = out.get_mut(k) {
            v[2] = angle * degree;
        }
    }
    out
}
