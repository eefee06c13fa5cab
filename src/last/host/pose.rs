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
//! f64 throughout, B rounded once. Rodrigues' formula and its series as in [`rotation_matrix`].
//!
//! # Adjoint
//! Children before parents: with N_k = (A_p⁻¹ A_k) Q_k, Q_k = T R T⁻¹: N̄ = B_pᵀ B̄_k and B̄_p += B̄_k Nᵀ (as 4×4 matrices); Q̄ = (A_p⁻¹ A_k)ᵀ N̄;
//! R̄ = Q̄_M − Q̄_t jᵀ. With R = I + a⌊v⌋ₓ + b⌊v⌋ₓ²: v̄ from the skew part of R̄, its product with ⌊v⌋ₓ, and a' = da/dθ², b' = db/dθ².

use crate::scene::person::{Affine, Template, rotation_matrix};

type A64 = [[f64; 4]; 3];
type M3 = [[f64; 3]; 3];

/// Below this angle a, b and their derivatives by θ² come from series.
const SMALL: f64 = 1e-2;

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
    let r = rotation_matrix(v);
    std::array::from_fn(|i| {
        let moved = (r[i][0] * j[0] + r[i][1] * j[1]) + r[i][2] * j[2];
        [r[i][0], r[i][1], r[i][2], j[i] - moved]
    })
}

/// v̄ from R̄ of Rodrigues' formula.
pub fn rotation_adjoint(v: [f64; 3], r_bar: &M3) -> [f64; 3] {
    let [x, y, z] = v;
    let q = (x * x + y * y) + z * z;
    let theta = q.sqrt();
    let (a, b, a_q, b_q) = if theta < SMALL {
        (
            1.0 - q / 6.0 * (1.0 - q / 20.0),
            0.5 - q / 24.0 * (1.0 - q / 30.0),
            -1.0 / 6.0 + q / 60.0 * (1.0 - q / 28.0),
            -1.0 / 24.0 + q / 360.0 * (1.0 - q / 37.333_333_333_333_336),
        )
    } else {
        let (s, c) = (libm::sin(theta), libm::cos(theta));
        let (a, b) = (s / theta, (1.0 - c) / q);
        (a, b, (c - a) / (2.0 * q), (0.5 * a - b) / q)
    };
    let g = r_bar;
    let skew = [g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]];
    // [v]ₓ² = v vᵀ − q I
    let trace = (g[0][0] + g[1][1]) + g[2][2];
    let gv: [f64; 3] = std::array::from_fn(|i| (g[i][0] * x + g[i][1] * y) + g[i][2] * z);
    let tv: [f64; 3] = std::array::from_fn(|i| (g[0][i] * x + g[1][i] * y) + g[2][i] * z);
    let along_a = (skew[0] * x + skew[1] * y) + skew[2] * z;
    let along_b = ((gv[0] * x + gv[1] * y) + gv[2] * z) - q * trace;
    let by_q = 2.0 * (a_q * along_a + b_q * along_b);
    std::array::from_fn(|i| (a * skew[i] + b * ((gv[i] + tv[i]) - 2.0 * v[i] * trace)) + by_q * v[i])
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
        v_bar[k] = rotation_adjoint(corrections[k], &r_bar);
    }
    v_bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_differentiate() {
        for v in
            [[0.0, 0.0, 0.0], [1e-3, -2e-3, 5e-4], [0.006, -0.004, 0.003], [0.4, -1.1, 0.7], [-1.8, 1.2, 2.0]]
        {
            let seeds: M3 =
                std::array::from_fn(|i| std::array::from_fn(|j| 0.2 + 0.37 * i as f64 - 0.21 * j as f64));
            let value = |v: [f64; 3]| {
                let r = rotation_matrix(v);
                (0..9).fold(0.0, |s, e| s + seeds[e / 3][e % 3] * r[e / 3][e % 3])
            };
            let bar = rotation_adjoint(v, &seeds);
            for k in 0..3 {
                let h = 1e-5;
                let at = |d: f64| {
                    let mut v = v;
                    v[k] += d;
                    value(v)
                };
                let slope = (at(h) - at(-h)) / (2.0 * h);
                assert!((bar[k] - slope).abs() < 1e-6 * (1.0 + slope.abs()), "{v:?} {k}: {} {slope}", bar[k]);
            }
        }
    }
}
