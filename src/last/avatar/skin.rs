//! Skinning from the canonical pose to a moment: transforms points to rest, then applies `body.skin`; with
//! its adjoint.
//!
//! y = M_C⁻¹ (x − t_C) + o,   H = M_C⁻¹ F,   T_C = [M_C | t_C] = Σ_b w_b C_b;   then `body.skin` of y, H by
//! the transforms A
//!
//! | symbol | argument | shape | meaning |
//! |---|---|---|---|
//! | x, F | `means`, `factors` | (G, 3), (G, 3, 3) | canonical centre and factor, Σ = F Fᵀ |
//! | w | `weights` | (G, K) | skinning weights |
//! | A_b | `posed` | (K) | world from rest |
//! | C_b | `canonical` | (K) or absent | canonical pose from rest; absent if rest is canonical, then T_C is the identity |
//! | o | `offsets` | (G, 3) or absent | offset that the pose adds to the point at rest, a constant |
//!
//! The module composes [`mod@crate::body::rest`] and [`mod@crate::body::skin`], including their rounding and
//! adjoints; w̄ is the result of `body.skin`, to which the result of `body.rest` is added.

use crate::body::{pose, rest, skin};
use crate::scene::person::Affine;

/// The transforms of the joints at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Bones {
    /// Transforms from rest to the world, shape (K).
    pub posed: Vec<Affine>,
    /// Transforms from rest to the canonical pose, shape (K); `None` if rest is canonical.
    pub canonical: Option<Vec<Affine>>,
}

/// The inputs of skinning.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// The joints.
    pub bones: &'a Bones,
    /// Skinning weights, shape (G, K).
    pub weights: &'a [f32],
    /// Canonical centres, shape (G, 3).
    pub means: &'a [[f32; 3]],
    /// Canonical factors, shape (G, 3, 3).
    pub factors: &'a [[f32; 9]],
    /// Offsets of the points at rest, shape (G, 3).
    pub offsets: Option<&'a [[f32; 3]]>,
}

/// Gradients with respect to the inputs.
#[derive(Clone, Debug, Default)]
pub struct InBar {
    /// Gradient with respect to the centres, shape (G, 3).
    pub means: Vec<[f32; 3]>,
    /// Gradient with respect to the factors, shape (G, 3, 3).
    pub factors: Vec<[f32; 9]>,
    /// Gradient with respect to the weights, shape (G, K); empty if not requested.
    pub weights: Vec<f32>,
    /// Gradient with respect to the joints, shape (K); empty if not requested.
    pub posed: Vec<Affine>,
}

impl<'a> In<'a> {
    fn rest(&self) -> rest::In<'a> {
        rest::In {
            points: self.means,
            factors: self.factors,
            weights: self.weights,
            canonical: self.bones.canonical.as_deref(),
            offsets: self.offsets,
        }
    }
}

/// The inputs of `body.skin`: points, factors, transforms.
struct SkinInputs {
    rest: rest::Out,
    transforms: Vec<[f32; 16]>,
}

impl SkinInputs {
    fn input<'a>(&'a self, weights: &'a [f32]) -> skin::In<'a> {
        skin::In {
            points: &self.rest.points,
            weights,
            transforms: &self.transforms,
            factors: &self.rest.factors,
        }
    }
}

/// Posed centres (G, 3) and factors (G, 3, 3).
pub fn forward(x: &In<'_>) -> (Vec<[f32; 3]>, Vec<[f32; 9]>) {
    let skinned = SkinInputs { rest: rest::forward(&x.rest()).0, transforms: pose::squared(&x.bones.posed) };
    let out = skin::forward(skinned.input(x.weights));
    (out.skinned, out.skinned_factors)
}

/// Gradients of the inputs, given those of posed centres and factors; of weights and joints only if
/// requested.
pub fn adjoint(
    x: &In<'_>,
    means_bar: &[[f32; 3]],
    factors_bar: &[[f32; 9]],
    wants_weights: bool,
    wants_bones: bool,
) -> InBar {
    let (at_rest, saved) = rest::forward(&x.rest());
    let skinned = SkinInputs { rest: at_rest, transforms: pose::squared(&x.bones.posed) };
    let (n, k) = (x.means.len(), x.bones.posed.len());
    let mut bar = skin::InBar {
        points: vec![[0.0; 3]; n],
        factors: vec![[0.0; 9]; n],
        weights: if wants_weights { vec![0.0; n * k] } else { Vec::new() },
        transforms: if wants_bones { vec![[0.0; 16]; k] } else { Vec::new() },
    };
    let out_bar = skin::Out { skinned: means_bar.to_vec(), skinned_factors: factors_bar.to_vec() };
    skin::adjoint(skinned.input(x.weights), &out_bar, &mut bar);
    let out_bar = rest::Out { points: bar.points, factors: bar.factors };
    let mut rest_bar =
        rest::InBar { points: vec![[0.0; 3]; n], factors: vec![[0.0; 9]; n], weights: bar.weights };
    rest::adjoint(&x.rest(), &saved, &out_bar, &mut rest_bar);
    let rest::InBar { points: means, factors, weights } = rest_bar;
    InBar { means, factors, weights, posed: pose::squared_adjoint(&bar.transforms) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The product M x.
    fn apply(m: &[f32; 9], x: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|i| (m[3 * i] * x[0] + m[3 * i + 1] * x[1]) + m[3 * i + 2] * x[2])
    }

    /// The product A B.
    fn product(a: &[f32; 9], b: &[f32; 9]) -> [f32; 9] {
        std::array::from_fn(|e| {
            let (i, j) = (e / 3, e % 3);
            (a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j]) + a[3 * i + 2] * b[6 + j]
        })
    }

    fn turn(angle: f64, t: [f32; 3]) -> Affine {
        let (s, c) = (libm::sin(angle) as f32, libm::cos(angle) as f32);
        [[c, -s, 0.0, t[0]], [s, c, 0.0, t[1]], [0.0, 0.0, 1.0, t[2]]]
    }

    /// Bones, weights, points, factors and offsets.
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

    /// Sum of fixed multiples of every output.
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
        let turned = turn(0.7, [0.0; 3]);
        let r: [f32; 9] = std::array::from_fn(|e| turned[e / 3][e % 3]);
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
                check("joint", f64::from(bar.posed[i / 12][i % 12 / 4][i % 4]), moved(h), moved(-h));
            }
        }
    }
}
