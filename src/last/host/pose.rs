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

use crate::math::affine::{self, Linear, about, compose, left_bar, right_bar};
use crate::math::rodrigues;
use crate::scene::person::{Affine, Template};

/// Transforms of a moment under corrections, and what the adjoint needs.
#[derive(Clone, Debug)]
pub struct Corrected {
    /// (K) world from rest
    pub transforms: Vec<Affine>,
    wide: Vec<affine::Affine>,
    relative: Vec<affine::Affine>,
    own: Vec<affine::Affine>,
}

/// B_k for corrections (K) of the transforms of a capture.
pub fn forward(template: &Template, transforms: &[Affine], corrections: &[[f64; 3]]) -> Corrected {
    let k = transforms.len();
    let relative = template.relative(transforms);
    let (mut out, mut own) = (vec![[[0.0; 4]; 3]; k], vec![[[0.0; 4]; 3]; k]);
    for &k in &template.order {
        own[k] = compose(
            &relative[k],
            &about(&rodrigues::matrix(corrections[k]), template.joints[k].map(f64::from)),
        );
        out[k] = match template.parents[k] {
            Some(p) => compose(&out[p], &own[k]),
            None => own[k],
        };
    }
    let transforms = out.iter().map(affine::single).collect();
    Corrected { transforms, wide: out, relative, own }
}

/// (K) v̄ from the cotangents of B.
pub fn adjoint(
    template: &Template,
    corrections: &[[f64; 3]],
    saved: &Corrected,
    bar: &[affine::Affine],
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
        let r_bar: Linear = std::array::from_fn(|r| std::array::from_fn(|c| q[r][c] - q[r][3] * j[c]));
        v_bar[k] = rodrigues::matrix_adjoint(corrections[k], &r_bar);
    }
    v_bar
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::person::Kind;

    /// A root with a chain of two and a second branch; the joints are not stored parents first.
    fn template() -> Template {
        Template {
            kind: Kind::Figure,
            unit_m: 1.0,
            points: Vec::new(),
            normals: Vec::new(),
            faces: Vec::new(),
            joint_of: Vec::new(),
            weight_of: Vec::new(),
            joints: vec![[0.5, 1.5, 0.25], [0.0, 0.0, 0.0], [0.25, 1.0, -0.5], [-0.75, 0.5, 0.0]],
            parents: vec![Some(2), None, Some(1), Some(1)],
            order: vec![1, 2, 0, 3],
            canonical: Vec::new(),
            pose_shapes: None,
        }
    }

    /// A pose of the four joints, world from rest.
    fn transforms(t: &Template) -> Vec<Affine> {
        let turns = [[0.2, -0.4, 0.1], [0.0, 0.7, 0.3], [-0.5, 0.1, 0.9], [0.3, 0.3, -0.2]];
        let still = vec![[[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, -0.25], [0.0, 0.0, 1.0, 2.0]]; 4];
        forward(t, &still, &turns).transforms
    }

    #[test]
    fn gradients_are_those_of_differences() {
        let t = template();
        let posed = transforms(&t);
        // The second joint has no correction: the limit of small angles.
        let v = [[0.1, -0.2, 0.05], [0.3, 0.1, -0.4], [0.0; 3], [-0.6, 0.2, 0.7]];
        let entry = |k: usize, i: usize, j: usize| 0.25 * ((5 * k + 3 * i + j) % 7) as f64 - 0.7;
        let bar: Vec<affine::Affine> =
            (0..4).map(|k| std::array::from_fn(|i| std::array::from_fn(|j| entry(k, i, j)))).collect();
        let loss = |v: &[[f64; 3]]| {
            let b = forward(&t, &posed, v).wide;
            let terms = (0..48).map(|e| (e / 12, e / 4 % 3, e % 4));
            terms.fold(0.0, |s, (k, i, j)| s + bar[k][i][j] * b[k][i][j])
        };
        let grad = adjoint(&t, &v, &forward(&t, &posed, &v), &bar);
        for (k, c) in (0..12).map(|e| (e / 3, e % 3)) {
            let at = |by: f64| {
                let mut v = v;
                v[k][c] += by;
                loss(&v)
            };
            // Fourth order: the error is of order h⁴ and of rounding over h.
            let h = 1e-3;
            let slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let g = grad[k][c];
            assert!((slope - g).abs() < 1e-10, "joint {k}, axis {c}: {g} and {slope} by differences");
        }
    }
}
