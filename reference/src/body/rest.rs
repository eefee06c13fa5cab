//! `body.rest`: maps the canonical pose to the rest pose, the inverse of linear blend skinning.
//!
//! T_p = Σ_b w_pb C_b = [M_p | t_p],   y_p = M_p⁻¹ (x_p − t_p) + o_p,   H_p = M_p⁻¹ F_p;
//! without C the identity
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `points` | (P, 3) | canonical position, scene units |
//! | F | `factors` | (P, 3, 3) | Σ = F·Fᵀ |
//! | w | `weights` | (P, K) | |
//! | C | `canonical` | (K, 3, 4), optional | canonical pose from rest |
//! | o | `offsets` | (P, 3), optional | |
//! | y, H | `rest_points`, `rest_factors` | (P, 3), (P, 3, 3) | |
//!
//! # Rounding
//! M⁻¹ by Cramer's rule.
//!
//! # Kinks and domain
//! No kinks. K ≥ 1; with C, |det M_p| is between 10⁻¹² and 10¹².

use crate::array::{Arr, Out};
use crate::body::pose::is_invertible;
use crate::body::skin::{Affine, blend};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `body.rest`.
    pub struct In<'a, S> {
        points: &'a Arr<S> = Port::var("P,3", "canonical positions"),
        factors: &'a Arr<S> = Port::var("P,3,3", "F with covariance F·Fᵀ in the canonical pose"),
        weights: &'a Arr<S> = Port::var("P,K", "of each bone, not normalised"),
        canonical: Option<&'a Arr<S>> =
            Port::fixed("K,3,4", "canonical pose from rest; absent if the rest pose is the canonical one"),
        offsets: Option<&'a Arr<S>> = Port::fixed("P,3", "pose-dependent offset of a point at rest"),
    }
}

/// `body.rest`
pub static SIGNATURE: Signature = Signature {
    name: "body.rest",
    summary: "points and factors of covariances from a canonical pose to rest",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        rest_points: Port::var("P,3", "positions at rest"),
        rest_factors: Port::var("P,3,3", "factors at rest"),
    ],
    ..Signature::EMPTY
};

type Vec3<S> = [S; 3];

fn cross<S: Scalar>(a: Vec3<S>, b: Vec3<S>) -> Vec3<S> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot<S: Scalar>(a: Vec3<S>, b: Vec3<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// det M = a·(b×c) for the columns a, b, c of M; computed on values because it is used in a decision.
fn determinant<S: Scalar>(t: &Affine<S>) -> f64 {
    let [a, b, c] = [0, 1, 2].map(|j| [0, 1, 2].map(|i| t[i][j].value()));
    dot(a, cross(b, c))
}

/// The x of M x = v: with the columns a, b, c of M, x = (v·(b×c), v·(c×a), v·(a×b)) / a·(b×c).
fn solve<S: Scalar>(t: &Affine<S>, v: Vec3<S>) -> Vec3<S> {
    let [a, b, c] = [0, 1, 2].map(|j| [t[0][j], t[1][j], t[2][j]]);
    let determinant = dot(a, cross(b, c));
    [cross(b, c), cross(c, a), cross(a, b)].map(|n| dot(v, n) / determinant)
}

/// The twin of `body.rest`.
///
/// # Errors
/// When there is no joint, or M_p has no inverse.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { points, factors, weights, canonical, offsets } = *input;
    let (p, k) = (points.shape[0], weights.shape[1]);
    if k == 0 {
        return Err("input weights: expected at least one joint, got 0".to_owned());
    }
    let bones: Option<Vec<Affine<S>>> =
        canonical.map(|c| (0..k).map(|b| [c.row(3 * b), c.row(3 * b + 1), c.row(3 * b + 2)]).collect());
    let rest_points = out.array("rest_points", &[p, 3]);
    let rest_factors = out.array("rest_factors", &[p, 3, 3]);
    for i in 0..p {
        let back = bones.as_ref().map(|bones| blend(&weights.data[i * k..(i + 1) * k], bones));
        if let Some(d) = back.as_ref().map(determinant).filter(|d| !is_invertible(*d)) {
            return Err(format!("point {i}: expected an invertible blend, got determinant {d:e}"));
        }
        let x: Vec3<S> = points.row(i);
        let place = match &back {
            Some(t) => solve(t, [0, 1, 2].map(|c| x[c] - t[c][3])),
            None => x,
        };
        let o: Vec3<S> = offsets.map_or([S::zero(); 3], |o| o.row(i));
        out.put_row(rest_points, i, [0, 1, 2].map(|c| place[c] + o[c]));
        let f: [S; 9] = factors.row(i);
        for j in 0..3 {
            let column = [f[j], f[3 + j], f[6 + j]];
            let h = back.as_ref().map_or(column, |t| solve(t, column));
            (0..3).for_each(|r| out.put(rest_factors, 9 * i + 3 * r + j, h[r]));
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
