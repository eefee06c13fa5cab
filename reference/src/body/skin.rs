//! `body.skin`: linear blend skinning of points and of factors of covariances.
//!
//! T_p = Σ_b w_pb G_b,   x'_p = M_p x_p + t_p,   F'_p = M_p F_p,
//! M_p = linear part of T_p, t_p its last column
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `points` | (P, 3) | rest position, scene units |
//! | w | `weights` | (P, K) | ≥ 0, each row sums to 1 |
//! | G | `transforms` | (K, 4, 4) | posed from rest, affine: the last row is 0 0 0 1 and is not read |
//! | F | `factors` | (P, 3, 3), optional | Σ = F·Fᵀ at rest, scene units |
//! | x' | → `skinned` | (P, 3) | posed position, scene units |
//! | F' | → `skinned_factors` | (P, 3, 3) | Σ' = F'·F'ᵀ: a blend of rotations is not a rotation, so Σ' has no quaternion form |
//!
//! # Rounding
//! T_p is a left fold over the bones in their order, from the first product on, zero weights included; a row
//! of M·x + t is ((M₀x₀ + M₁x₁) + M₂x₂) + t, an entry of M·F the same without t.
//!
//! # Kinks and domain
//! Polynomial in every input: no kinks. Weights need not sum to 1; a row of zeros gives the origin.
//!
//! # Adjoint
//! x̄ = Mᵀ x̄',  F̄ = Mᵀ F̄',  T̄ = (x̄' x̃ᵀ + F̄' Fᵀ, x̄') with x̃ = x,  w̄_pb = ⟨T̄_p, G_b⟩,  Ḡ_b = Σ_p
//! w_pb T̄_p.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `body.skin`.
    pub struct In<'a, S> {
        points: &'a Arr<S> = Port::var("P,3", "rest positions"),
        weights: &'a Arr<S> = Port::var("P,K", "of each bone, not normalised"),
        transforms: &'a Arr<S> = Port::var("K,4,4", "posed from rest; the last row is not read"),
        factors: Option<&'a Arr<S>> = Port::var("P,3,3", "F with covariance F·Fᵀ at rest"),
    }
}

/// `body.skin`
pub static SIGNATURE: Signature = Signature {
    name: "body.skin",
    summary: "linear blend skinning of points and of factors of covariances",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        skinned: Port::var("P,3", "posed positions"),
        skinned_factors: Port::var("P,3,3", "M·F; with factors").or_absent(),
    ],
    ..Signature::EMPTY
};

/// Upper three rows of an affine transform.
pub type Affine<S> = [[S; 4]; 3];

/// Σ_b w_b G_b, a left fold over the bones.
///
/// # Panics
/// When there are no bones, or the number of weights differs from the number of bones.
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
/// When there is no bone.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { points, weights, transforms, factors } = *input;
    let [p, k] = [weights.shape[0], weights.shape[1]];
    if k == 0 {
        return Err("input weights: expected at least one bone, got 0".to_owned());
    }
    let row = |bone: usize, i: usize| transforms.row::<4>(4 * bone + i);
    let transforms: Vec<Affine<S>> = (0..k).map(|b| [row(b, 0), row(b, 1), row(b, 2)]).collect();
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

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or there is no bone.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
