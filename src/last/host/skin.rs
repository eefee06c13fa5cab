//! Linear blend skinning from the canonical pose to a moment, of centres and of factors of covariances, with its adjoint.
//!
//! y = M_C⁻¹ (x − t_C) + o,   x' = M_A y + t_A,   F' = M_A M_C⁻¹ F,   T_C = Σ_b w_b C_b,   T_A = Σ_b w_b A_b        (last.md §10.2)
//!
//! | symbol | argument | shape | meaning |
//! |---|---|---|---|
//! | x, F | `means`, `factors` | (G, 3), (G, 3, 3) | canonical centre and factor, Σ = F Fᵀ |
//! | w | `weights` | (G, K) | skinning weights |
//! | A_b | `posed` | (K) | world from rest |
//! | C_b | `canonical` | (K) or absent | canonical pose from rest; absent where rest is canonical, then T_C is the identity |
//! | o | `offsets` | (G, 3) or absent | what the pose adds to the point at rest, a constant |
//!
//! # Rounding
//! f32; T is a left fold over the joints from +0; M_C⁻¹ by cofactors over the determinant; rows of three as (a + b) + c. Sums over Gaussians
//! (the gradient of A) are left folds over blocks of [`BLOCK`] rows in f64, blocks added by the pairwise tree.
//!
//! # Kinks and domain
//! A blend of canonical rotations that is singular has no inverse; big poses are far from it.
//!
//! # Adjoint
//! With H = M_C⁻¹ F: ȳ = M_Aᵀ x̄', H̄ = M_Aᵀ F̄'; T̄_A = (x̄' yᵀ + F̄' Hᵀ, x̄'); x̄ = M_C⁻ᵀ ȳ, F̄ = M_C⁻ᵀ H̄;
//! T̄_C = −M_C⁻ᵀ (ȳ y₀ᵀ + H̄ Hᵀ, ȳ) with y₀ = y − o; w̄_b = ⟨T̄_A, A_b⟩ + ⟨T̄_C, C_b⟩; Ā_b = Σ_g w_gb T̄_A.

use crate::num::{par, sum};
use crate::scene::person::Affine;

/// Gaussians of one task.
pub const BLOCK: usize = 256;

/// The joints' transforms at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Bones {
    /// (K) world from rest
    pub posed: Vec<Affine>,
    /// (K) canonical pose from rest; `None` where rest is canonical
    pub canonical: Option<Vec<Affine>>,
}

/// What is skinned.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// The joints.
    pub bones: &'a Bones,
    /// (G, K)
    pub weights: &'a [f32],
    /// (G, 3)
    pub means: &'a [[f32; 3]],
    /// (G, 3, 3)
    pub factors: &'a [[f32; 9]],
    /// (G, 3)
    pub offsets: Option<&'a [[f32; 3]]>,
}

/// Gradients of the inputs.
#[derive(Clone, Debug, Default)]
pub struct InBar {
    /// (G, 3)
    pub means: Vec<[f32; 3]>,
    /// (G, 3, 3)
    pub factors: Vec<[f32; 9]>,
    /// (G, K); empty if not wanted
    pub weights: Vec<f32>,
    /// (K); empty if not wanted
    pub posed: Vec<[[f64; 4]; 3]>,
}

/// Σ_b w_b G_b.
fn blend(weights: &[f32], bones: &[Affine]) -> Affine {
    let mut t = [[0.0; 4]; 3];
    for (&w, bone) in weights.iter().zip(bones) {
        for i in 0..3 {
            for j in 0..4 {
                t[i][j] += w * bone[i][j];
            }
        }
    }
    t
}

/// The inverse of the linear part, row-major.
fn inverse(t: &Affine) -> [f32; 9] {
    let c: [f32; 9] = std::array::from_fn(|e| {
        let (i, j) = (e / 3, e % 3);
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        t[a][c] * t[b][d] - t[a][d] * t[b][c]
    });
    let det = (t[0][0] * c[0] + t[0][1] * c[1]) + t[0][2] * c[2];
    std::array::from_fn(|e| c[e % 3 * 3 + e / 3] / det)
}

/// M x.
fn apply(m: &[f32; 9], x: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| (m[3 * i] * x[0] + m[3 * i + 1] * x[1]) + m[3 * i + 2] * x[2])
}

/// Mᵀ x.
fn apply_t(m: &[f32; 9], x: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| (m[i] * x[0] + m[3 + i] * x[1]) + m[6 + i] * x[2])
}

/// A B.
fn product(a: &[f32; 9], b: &[f32; 9]) -> [f32; 9] {
    std::array::from_fn(|e| {
        let (i, j) = (e / 3, e % 3);
        (a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j]) + a[3 * i + 2] * b[6 + j]
    })
}

/// Aᵀ B.
fn product_t(a: &[f32; 9], b: &[f32; 9]) -> [f32; 9] {
    std::array::from_fn(|e| {
        let (i, j) = (e / 3, e % 3);
        (a[i] * b[j] + a[3 + i] * b[3 + j]) + a[6 + i] * b[6 + j]
    })
}

fn linear(t: &Affine) -> [f32; 9] {
    std::array::from_fn(|e| t[e / 3][e % 3])
}

/// One Gaussian on its way.
struct Row {
    /// M_A
    a: [f32; 9],
    t: [f32; 3],
    /// M_C⁻¹ and t_C
    c: Option<([f32; 9], [f32; 3])>,
    /// y − o
    rest: [f32; 3],
    y: [f32; 3],
    /// M_C⁻¹ F
    h: [f32; 9],
}

impl In<'_> {
    fn row(&self, g: usize) -> Row {
        let k = self.bones.posed.len();
        let weights = &self.weights[g * k..][..k];
        let t_a = blend(weights, &self.bones.posed);
        let (x, f) = (self.means[g], self.factors[g]);
        let c = self.bones.canonical.as_ref().map(|bones| {
            let t = blend(weights, bones);
            (inverse(&t), [t[0][3], t[1][3], t[2][3]])
        });
        let (rest, h) = match &c {
            Some((m, t)) => (apply(m, [x[0] - t[0], x[1] - t[1], x[2] - t[2]]), product(m, &f)),
            None => (x, f),
        };
        let o = self.offsets.map_or([0.0; 3], |o| o[g]);
        let y = [rest[0] + o[0], rest[1] + o[1], rest[2] + o[2]];
        Row { a: linear(&t_a), t: [t_a[0][3], t_a[1][3], t_a[2][3]], c, rest, y, h }
    }
}

/// Posed centres (G, 3) and factors (G, 3, 3).
pub fn forward(x: &In<'_>) -> (Vec<[f32; 3]>, Vec<[f32; 9]>) {
    let n = x.means.len();
    let (mut means, mut factors) = (vec![[0.0; 3]; n], vec![[0.0; 9]; n]);
    par::chunks_mut2(&mut means, BLOCK, &mut factors, BLOCK, |b, means, factors| {
        for (i, (mean, factor)) in means.iter_mut().zip(factors).enumerate() {
            let row = x.row(b * BLOCK + i);
            let m = apply(&row.a, row.y);
            *mean = [m[0] + row.t[0], m[1] + row.t[1], m[2] + row.t[2]];
            *factor = product(&row.a, &row.h);
        }
    });
    (means, factors)
}

/// ⟨T̄, G⟩ of two affine transforms.
fn inner(m_bar: &[f32; 9], t_bar: [f32; 3], bone: &Affine) -> f32 {
    let mut s = 0.0;
    for i in 0..3 {
        for j in 0..3 {
            s += m_bar[3 * i + j] * bone[i][j];
        }
        s += t_bar[i] * bone[i][3];
    }
    s
}

/// Gradients from those of posed centres and factors; of weights and joints only where wanted.
pub fn adjoint(
    x: &In<'_>,
    means_bar: &[[f32; 3]],
    factors_bar: &[[f32; 9]],
    wants_weights: bool,
    wants_bones: bool,
) -> InBar {
    let (n, k) = (x.means.len(), x.bones.posed.len());
    let mut bar = InBar {
        means: vec![[0.0; 3]; n],
        factors: vec![[0.0; 9]; n],
        weights: if wants_weights { vec![0.0; n * k] } else { Vec::new() },
        posed: Vec::new(),
    };
    let mut weights = bar.weights.chunks_mut(BLOCK * k);
    let tasks: Vec<_> = (bar.means.chunks_mut(BLOCK))
        .zip(bar.factors.chunks_mut(BLOCK))
        .map(|(m, f)| (m, f, weights.next().unwrap_or_default()))
        .collect();
    let sums = par::map_each(tasks, |b, (means, factors, weights)| {
        let mut sums = if wants_bones { vec![0.0f64; 12 * k] } else { Vec::new() };
        for (i, (mean, factor)) in means.iter_mut().zip(factors).enumerate() {
            let g = b * BLOCK + i;
            let row = x.row(g);
            let (x_bar, f_bar) = (means_bar[g], &factors_bar[g]);
            let (y_bar, h_bar) = (apply_t(&row.a, x_bar), product_t(&row.a, f_bar));
            (*mean, *factor) = match &row.c {
                Some((m, _)) => (apply_t(m, y_bar), product_t(m, &h_bar)),
                None => (y_bar, h_bar),
            };
            if !(wants_weights || wants_bones) {
                continue;
            }
            // T̄_A = (x̄' yᵀ + F̄' Hᵀ, x̄')
            let outer = |u: [f32; 3], v: [f32; 3], f: &[f32; 9]| -> [f32; 9] {
                std::array::from_fn(|e| {
                    let (i, j) = (e / 3, e % 3);
                    let along = (f[3 * i] * row.h[3 * j] + f[3 * i + 1] * row.h[3 * j + 1])
                        + f[3 * i + 2] * row.h[3 * j + 2];
                    u[i] * v[j] + along
                })
            };
            let a_bar = outer(x_bar, row.y, f_bar);
            if wants_weights {
                let c_bar = row.c.as_ref().map(|(m, _)| {
                    let inside = outer(y_bar, row.rest, &h_bar);
                    (product_t(m, &inside).map(|v| -v), apply_t(m, y_bar).map(|v| -v))
                });
                for (j, w) in weights[i * k..][..k].iter_mut().enumerate() {
                    *w = inner(&a_bar, x_bar, &x.bones.posed[j]);
                    if let (Some((m, t)), Some(bones)) = (&c_bar, &x.bones.canonical) {
                        *w += inner(m, *t, &bones[j]);
                    }
                }
            }
            if wants_bones {
                for (j, &w) in x.weights[g * k..][..k].iter().enumerate() {
                    for e in 0..12 {
                        let v = if e % 4 == 3 { x_bar[e / 4] } else { a_bar[e / 4 * 3 + e % 4] };
                        sums[12 * j + e] += f64::from(w) * f64::from(v);
                    }
                }
            }
        }
        sums
    });
    if wants_bones {
        let total = sum::tree_arrays(sums);
        bar.posed = (0..k)
            .map(|j| std::array::from_fn(|i| std::array::from_fn(|c| total[12 * j + 4 * i + c])))
            .collect();
    }
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(angle: f64, t: [f32; 3]) -> Affine {
        let (s, c) = (libm::sin(angle) as f32, libm::cos(angle) as f32);
        [[c, -s, 0.0, t[0]], [s, c, 0.0, t[1]], [0.0, 0.0, 1.0, t[2]]]
    }

    /// Bones, weights, points, factors, offsets.
    type Sample = (Bones, Vec<f32>, Vec<[f32; 3]>, Vec<[f32; 9]>, Vec<[f32; 3]>);

    fn sample(canonical: bool) -> Sample {
        let bones = Bones {
            posed: vec![turn(0.4, [0.1, 0.2, 0.3]), turn(-0.9, [0.0, -0.4, 1.0])],
            canonical: canonical.then(|| vec![turn(0.2, [0.0, 0.1, 0.0]), turn(-0.3, [0.3, 0.0, 0.0])]),
        };
        let f = [0.5, 0.1, -0.2, 0.05, 0.7, 0.3, -0.1, 0.2, 0.9];
        (
            bones,
            vec![0.3, 0.7, 0.9, 0.1],
            vec![[0.2, 0.5, -0.1], [1.0, -0.3, 0.4]],
            vec![f; 2],
            vec![[0.01, 0.02, -0.03]; 2],
        )
    }

    /// Σ of fixed multiples of every output.
    fn value(x: &In<'_>) -> f64 {
        let (m, f) = forward(x);
        let all = m.as_flattened().iter().chain(f.as_flattened());
        all.enumerate().fold(0.0, |s, (i, &v)| s + f64::from(v) * (0.3 + 0.1 * i as f64))
    }

    #[test]
    fn identity_returns_the_template_and_rotations_rotate() {
        let still = Bones { posed: vec![turn(0.0, [0.0; 3]); 2], canonical: None };
        let (_, w, x, f, _) = sample(false);
        let out = forward(&In { bones: &still, weights: &w, means: &x, factors: &f, offsets: None });
        for (a, b) in out.0.as_flattened().iter().zip(x.as_flattened()) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
        let turned = Bones { posed: vec![turn(0.7, [1.0, 2.0, 3.0]); 2], canonical: None };
        let (m, g) = forward(&In { bones: &turned, weights: &w, means: &x, factors: &f, offsets: None });
        let r = linear(&turn(0.7, [0.0; 3]));
        let direct = apply(&r, x[1]);
        for k in 0..3 {
            assert!((m[1][k] - direct[k] - [1.0, 2.0, 3.0][k]).abs() < 1e-6, "rigid motion of a point");
        }
        // Σ' = R Σ Rᵀ
        let square = |f: &[f32; 9]| -> [f32; 9] {
            let t: [f32; 9] = std::array::from_fn(|e| f[e % 3 * 3 + e / 3]);
            product(f, &t)
        };
        let rotated = product(&r, &product(&square(&f[0]), &std::array::from_fn(|e| r[e % 3 * 3 + e / 3])));
        for (a, b) in square(&g[0]).iter().zip(rotated) {
            assert!((a - b).abs() < 2e-6, "covariance: {a} {b}");
        }
    }

    #[test]
    fn gradients_are_those_of_differences() {
        for canonical in [false, true] {
            let (bones, w, x, f, o) = sample(canonical);
            let seeds: Vec<f32> = (0..24).map(|i| 0.3 + 0.1 * i as f32).collect();
            let input = In { bones: &bones, weights: &w, means: &x, factors: &f, offsets: Some(&o) };
            let bar = adjoint(&input, seeds[..6].as_chunks().0, seeds[6..].as_chunks().0, true, true);
            let h = 2e-3f32;
            let check = |name: &str, got: f64, up: f64, down: f64| {
                let slope = (up - down) / (2.0 * f64::from(h));
                assert!((got - slope).abs() < 6e-3 * (1.0 + slope.abs()), "{name}: {got} against {slope}");
            };
            for i in 0..6 {
                let moved = |d: f32| {
                    let mut x = x.clone();
                    x.as_flattened_mut()[i] += d;
                    value(&In { means: &x, ..input })
                };
                check("mean", f64::from(bar.means.as_flattened()[i]), moved(h), moved(-h));
            }
            for i in 0..18 {
                let moved = |d: f32| {
                    let mut f = f.clone();
                    f.as_flattened_mut()[i] += d;
                    value(&In { factors: &f, ..input })
                };
                check("factor", f64::from(bar.factors.as_flattened()[i]), moved(h), moved(-h));
            }
            for i in 0..4 {
                let moved = |d: f32| {
                    let mut w = w.clone();
                    w[i] += d;
                    value(&In { weights: &w, ..input })
                };
                check("weight", f64::from(bar.weights[i]), moved(h), moved(-h));
            }
            for i in 0..24 {
                let moved = |d: f32| {
                    let mut bones = bones.clone();
                    bones.posed[i / 12][i % 12 / 4][i % 4] += d;
                    value(&In { bones: &bones, ..input })
                };
                check("joint", bar.posed[i / 12][i % 12 / 4][i % 4], moved(h), moved(-h));
            }
        }
    }
}
