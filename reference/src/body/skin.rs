//! Linear blend skinning of points and of factors of covariances.
//!
//! T_p = Σ_b w_pb G_b,   x'_p = M_p x_p + t_p,   F'_p = M_p F_p,   M_p = linear part of T_p, t_p its last column
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `points` | (P, 3) | rest position, scene units |
//! | w | `weights` | (P, K) | ≥ 0, each row sums to 1 |
//! | G | `transforms` | (K, 4, 4) | posed from rest, affine: the last row is 0 0 0 1 and is not read |
//! | F | `factors` | (P, 3, 3), optional | Σ = F·Fᵀ at rest, scene units |
//! | x' | → `skinned` | (P, 3) | posed position, scene units |
//! | F' | → `skinned_factors` | (P, 3, 3) | Σ' = F'·F'ᵀ: a blend of rotations is no rotation, so Σ' has no quaternion form |
//!
//! # Rounding
//! T_p is a left fold over the bones in their order, from the first product on, zero weights included; a row of M·x + t is
//! ((M₀x₀ + M₁x₁) + M₂x₂) + t, an entry of M·F the same without t.
//!
//! # Kinks and domain
//! Polynomial in every input: no kinks. Weights need not sum to 1; a row of zeros gives the origin.
//!
//! # Adjoint
//! x̄ = Mᵀ x̄',  F̄ = Mᵀ F̄',  T̄ = (x̄' x̃ᵀ + F̄' Fᵀ, x̄') with x̃ = x,  w̄_pb = ⟨T̄_p, G_b⟩,  Ḡ_b = Σ_p w_pb T̄_p.

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;

/// Upper three rows of an affine transform.
pub type Affine<S> = [[S; 4]; 3];

/// Σ_b w_b G_b, a left fold over the bones.
///
/// # Panics
/// When there are no bones, or not one weight for each.
pub fn blend<S: Scalar>(weights: &[S], transforms: &[Affine<S>]) -> Affine<S> {
    assert!(!weights.is_empty() && weights.len() == transforms.len(), "one weight per bone");
    let term = |b: usize, i: usize, j: usize| weights[b] * transforms[b][i][j];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (1..weights.len()).fold(term(0, i, j), |sum, b| sum + term(b, i, j)))
    })
}

/// M x + t.
pub fn point<S: Scalar>(t: &Affine<S>, x: [S; 3]) -> [S; 3] {
    t.map(|r| r[0] * x[0] + r[1] * x[1] + r[2] * x[2] + r[3])
}

/// M F.
pub fn factor<S: Scalar>(t: &Affine<S>, f: [[S; 3]; 3]) -> [[S; 3]; 3] {
    t.map(|r| std::array::from_fn(|j| r[0] * f[0][j] + r[1] * f[1][j] + r[2] * f[2][j]))
}

/// The twin of `body.skin`.
///
/// # Errors
/// When an input is missing or shaped otherwise.
pub fn forward<S: Scalar>(x: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let points = expect(x, "points", &[ANY, 3])?;
    let p = points.shape[0];
    let weights = expect(x, "weights", &[p, ANY])?;
    let k = weights.shape[1];
    if k == 0 {
        return Err("input weights: expected at least one bone, got 0".to_owned());
    }
    let transforms: Vec<Affine<S>> = {
        let g = expect(x, "transforms", &[k, 4, 4])?;
        let row = |b: usize, i: usize| g.row::<4>(4 * b + i);
        (0..k).map(|b| [row(b, 0), row(b, 1), row(b, 2)]).collect()
    };
    let factors = match x.contains_key("factors") {
        true => Some(expect(x, "factors", &[p, 3, 3])?),
        false => None,
    };
    let skinned = out.array("skinned", &[p, 3]);
    let skinned_factors = factors.map(|_| out.array("skinned_factors", &[p, 3, 3]));
    for i in 0..p {
        let t = blend(&weights.data[i * k..(i + 1) * k], &transforms);
        out.put_row(skinned, i, point(&t, points.row(i)));
        if let (Some(f), Some(slot)) = (factors, skinned_factors) {
            let rest = [f.row(3 * i), f.row(3 * i + 1), f.row(3 * i + 2)];
            for (row, entries) in factor(&t, rest).into_iter().enumerate() {
                out.put_row(slot, 3 * i + row, entries);
            }
        }
        out.flush();
    }
    Ok(())
}
