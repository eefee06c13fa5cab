//! Corrected poses: a rotation multiplied on the right of each joint's own, down the chain, and the adjoint by the rotations.
//!
//! B_k = B_p (A_p⁻¹ A_k) T(j_k) R(v_k) T(−j_k),   B_root = A_root T(j) R(v) T(−j)                       (last.md §10.2)
//!
//! | symbol | meaning |
//! |---|---|
//! | A_k | (K) world from rest of the capture, B_k the corrected one |
//! | j_k | (K) joints at rest, p the joint k hangs on |
//! | v_k | (K) axis-angle of the correction, rad |
//!
//! # Rounding
//! f64 throughout, B rounded once. Rotations as in [`rodrigues`].
//!
//! # Adjoint
//! Children before parents: with N_k = (A_p⁻¹ A_k) Q_k, Q_k = T R T⁻¹: N̄ = B_pᵀ B̄_k and B̄_p += B̄_k Nᵀ (as 4×4 matrices); Q̄ = (A_p⁻¹ A_k)ᵀ N̄;
//! R̄ = Q̄_M − Q̄_t jᵀ. v̄ as [`rodrigues::matrix_adjoint`] gives it.

use crate::math::rodrigues;
use crate::scene::person::{Affine, Template};

type A64 = [[f64; 4]; 3];
type M3 = [[f64; 3]; 3];

fn wide(a: &Affine) -> A64 {
    a.map(|r| r.map(f64::from))
}

/// a ∘ b.
fn compose(a: &A64, b: &A64) -> A64 {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let s = (a[i][0] * b[0][j] + a[i][1] * b[1][j]) + a[i][2] * b[2][j];
            if j == 3 { s + a[i][3] } else { s }
        })
    })
}

fn inverse(a: &A64) -> A64 {
    let c: M3 = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let (p, q, r, s) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
            a[p][r] * a[q][s] - a[p][s] * a[q][r]
        })
    });
    let det = (a[0][0] * c[0][0] + a[0][1] * c[0][1]) + a[0][2] * c[0][2];
    std::array::from_fn(|i| {
        let r: [f64; 3] = std::array::from_fn(|j| c[j][i] / det);
        [r[0], r[1], r[2], -((r[0] * a[0][3] + r[1] * a[1][3]) + r[2] * a[2][3])]
    })
}

/// Cotangent of b in a ∘ b.
fn right_bar(a: &A64, bar: &A64) -> A64 {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (a[0][i] * bar[0][j] + a[1][i] * bar[1][j]) + a[2][i] * bar[2][j])
    })
}

/// Cotangent of a in a ∘ b.
fn left_bar(b: &A64, bar: &A64) -> A64 {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            if j == 3 {
                return bar[i][3];
            }
            ((bar[i][0] * b[j][0] + bar[i][1] * b[j][1]) + bar[i][2] * b[j][2]) + bar[i][3] * b[j][3]
        })
    })
}

/// T(j) R(v) T(−j).
fn about(v: [f64; 3], j: [f64; 3]) -> A64 {
    let r = rodrigues::matrix(v);
    std::array::from_fn(|i| {
        let moved = (r[i][0] * j[0] + r[i][1] * j[1]) + r[i][2] * j[2];
        [r[i][0], r[i][1], r[i][2], j[i] - moved]
    })
}

/// Transforms of a moment under corrections, and what the adjoint needs.
#[derive(Clone, Debug)]
pub struct Corrected {
    /// (K) world from rest
    pub transforms: Vec<Affine>,
    wide: Vec<A64>,
    relative: Vec<A64>,
    own: Vec<A64>,
}

/// B_k for corrections (K) of the transforms of a capture.
pub fn forward(template: &Template, transforms: &[Affine], corrections: &[[f64; 3]]) -> Corrected {
    let k = transforms.len();
    let relative: Vec<A64> = (0..k)
        .map(|k| match template.parents[k] {
            Some(p) => compose(&inverse(&wide(&transforms[p])), &wide(&transforms[k])),
            None => wide(&transforms[k]),
        })
        .collect();
    let (mut out, mut own) = (vec![[[0.0; 4]; 3]; k], vec![[[0.0; 4]; 3]; k]);
    for &k in &template.order {
        own[k] = compose(&relative[k], &about(corrections[k], template.joints[k].map(f64::from)));
        out[k] = match template.parents[k] {
            Some(p) => compose(&out[p], &own[k]),
            None => own[k],
        };
    }
    let transforms = out.iter().map(|a| a.map(|r| r.map(|x| x as f32))).collect();
    Corrected { transforms, wide: out, relative, own }
}

/// (K) v̄ from the cotangents of B.
pub fn adjoint(
    template: &Template,
    corrections: &[[f64; 3]],
    saved: &Corrected,
    bar: &[A64],
) -> Vec<[f64; 3]> {
    let mut bar = bar.to_vec();
    let mut v_bar = vec![[0.0; 3]; bar.len()];
    for &k in template.order.iter().rev() {
        let own_bar = match template.parents[k] {
            Some(p) => {
                let up = left_bar(&saved.own[k], &bar[k]);
                for i in 0..3 {
                    for j in 0..4 {
                        bar[p][i][j] += up[i][j];
                    }
                }
                right_bar(&saved.wide[p], &bar[k])
            }
            None => bar[k],
        };
        let q = right_bar(&saved.relative[k], &own_bar);
        let j = template.joints[k].map(f64::from);
        let r_bar: M3 = std::array::from_fn(|r| std::array::from_fn(|c| q[r][c] - q[r][3] * j[c]));
        v_bar[k] = rodrigues::matrix_adjoint(corrections[k], &r_bar);
    }
    v_bar
}
