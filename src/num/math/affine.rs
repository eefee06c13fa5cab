//! Affine transforms of space in f64: composition with its adjoint, inverse, and rotation about a point.
//!
//! A transform is stored as its upper three rows [M | t], row-major: x' = M x + t. Files and operators store
//! transforms in f32; [`wide()`] and [`single()`] convert between the two.
//!
//! # Rounding
//! A sum of three products is (x₀y₀ + x₁y₁) + x₂y₂; a translation is added last. An inverse is the matrix of
//! cofactors divided by the determinant, which is expanded along the first row.
//!
//! # Adjoint
//! c = a ∘ b:   ā = c̄ [B 0; bᵗ 1]ᵀ ([`left_bar`]),   b̄ = Aᵀ c̄ ([`right_bar`])
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::math::affine::{compose, inverse};
//! let a = [[0.0, -2.0, 0.0, 1.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 3.0]];
//! let one = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
//! assert_eq!(compose(&a, &inverse(&a)), one);
//! ```

use std::ops::{Add, Div, Mul, Sub};

/// Upper three rows of a transform, row-major.
pub type Affine = [[f64; 4]; 3];

/// A linear map, row-major.
pub type Linear = [[f64; 3]; 3];

/// Scalar type of a matrix: f32 or f64.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
}

impl Number for f32 {}
impl Number for f64 {}

/// Converts a transform from f32 to f64, exactly.
pub fn wide(a: &[[f32; 4]; 3]) -> Affine {
    a.map(|row| row.map(f64::from))
}

/// Converts a transform to f32; each entry is rounded once.
pub fn single(a: &Affine) -> [[f32; 4]; 3] {
    a.map(|row| row.map(|x| x as f32))
}

/// Returns the linear part M of [M | t].
pub fn linear(a: &Affine) -> Linear {
    a.map(|r| [r[0], r[1], r[2]])
}

/// Returns the composition a ∘ b.
pub fn compose(a: &Affine, b: &Affine) -> Affine {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let s = (a[i][0] * b[0][j] + a[i][1] * b[1][j]) + a[i][2] * b[2][j];
            if j == 3 { s + a[i][3] } else { s }
        })
    })
}

/// Returns the cotangent of a in a ∘ b.
pub fn left_bar(b: &Affine, bar: &Affine) -> Affine {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            if j == 3 {
                return bar[i][3];
            }
            ((bar[i][0] * b[j][0] + bar[i][1] * b[j][1]) + bar[i][2] * b[j][2]) + bar[i][3] * b[j][3]
        })
    })
}

/// Returns the cotangent of b in a ∘ b.
pub fn right_bar(a: &Affine, bar: &Affine) -> Affine {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (a[0][i] * bar[0][j] + a[1][i] * bar[1][j]) + a[2][i] * bar[2][j])
    })
}

/// Returns the matrix of cofactors; divided by the determinant it is the inverse transpose.
pub fn cofactors<T: Number>(m: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
            m[a][c] * m[b][d] - m[a][d] * m[b][c]
        })
    })
}

fn along_first_row<T: Number>(m: &[[T; 3]; 3], c: &[[T; 3]; 3]) -> T {
    (m[0][0] * c[0][0] + m[0][1] * c[0][1]) + m[0][2] * c[0][2]
}

/// Returns det M.
pub fn determinant(m: &Linear) -> f64 {
    along_first_row(m, &cofactors(m))
}

/// Performs one step of Newton's iteration to the nearest rotation, R ← ½(R + R⁻ᵀ), and returns the result
/// and det R of the input (Higham 1986).
pub fn newton_to_rotation(r: &Linear) -> (Linear, f64) {
    let c = cofactors(r);
    let det = along_first_row(r, &c);
    let next = std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (r[i][j] + c[i][j] / det)));
    (next, det)
}

/// Whether a transform whose linear part has this determinant is treated as invertible: 10⁻¹² < |det M| <
/// 10¹².
pub fn is_invertible(determinant: f64) -> bool {
    let size = determinant.abs();
    size > 1e-12 && size < 1e12
}

/// Returns M⁻¹ and det M, which must not be 0.
pub fn inverse_linear<T: Number>(m: &[[T; 3]; 3]) -> ([[T; 3]; 3], T) {
    let c = cofactors(m);
    let det = along_first_row(m, &c);
    (std::array::from_fn(|i| std::array::from_fn(|j| c[j][i] / det)), det)
}

/// Returns the inverse of a transform whose determinant is not 0.
pub fn inverse(a: &Affine) -> Affine {
    inverse_linear(&linear(a))
        .0
        .map(|r| [r[0], r[1], r[2], -((r[0] * a[0][3] + r[1] * a[1][3]) + r[2] * a[2][3])])
}

/// Returns T(j) R T(−j), the rotation R about the point j.
pub fn about(r: &Linear, j: [f64; 3]) -> Affine {
    std::array::from_fn(|i| {
        let moved = (r[i][0] * j[0] + r[i][1] * j[1]) + r[i][2] * j[2];
        [r[i][0], r[i][1], r[i][2], j[i] - moved]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Affine = [[0.3, -1.2, 0.5, 2.0], [0.9, 0.4, -0.7, -1.0], [0.1, 0.8, 1.1, 0.25]];
    const B: Affine = [[1.3, 0.2, -0.5, 0.7], [-0.4, 0.6, 0.3, -0.2], [0.8, -0.1, 0.9, 1.5]];

    #[test]
    fn an_inverse_undoes_its_transform_on_both_sides() {
        for c in [compose(&A, &inverse(&A)), compose(&inverse(&A), &A)] {
            for (i, row) in c.iter().enumerate() {
                for (j, x) in row.iter().enumerate() {
                    let want = f64::from(u8::from(i == j));
                    assert!((x - want).abs() < 1e-15, "({i}, {j}): {x}");
                }
            }
        }
        let both = determinant(&linear(&compose(&A, &B)));
        assert!((both - determinant(&linear(&A)) * determinant(&linear(&B))).abs() < 1e-14, "{both}");
    }

    #[test]
    fn newtons_steps_end_at_a_rotation() {
        let mut r = linear(&A);
        let first = determinant(&r);
        assert_eq!(newton_to_rotation(&r).1, first, "the determinant before the step");
        for _ in 0..12 {
            r = newton_to_rotation(&r).0;
        }
        for (i, j) in (0..9).map(|e| (e / 3, e % 3)) {
            let dot = r[0][i] * r[0][j] + r[1][i] * r[1][j] + r[2][i] * r[2][j];
            assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-15, "orthonormal at ({i}, {j}): {dot}");
        }
        // The nearest one: RᵀA is symmetric (polar decomposition).
        let product = |i: usize, j: usize| (0..3).fold(0.0, |s, k| s + r[k][i] * A[k][j]);
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            assert!((product(i, j) - product(j, i)).abs() < 1e-14, "RᵀA at ({i}, {j})");
        }
    }

    #[test]
    fn composition_is_linear_in_both_and_so_are_its_adjoints() {
        // ⟨c̄, da ∘ B⟩ = ⟨ā, da⟩ and ⟨c̄, A ∘ db⟩ = ⟨b̄, db⟩ for every entry; a step is exact up to rounding.
        let bar: Affine = [[0.5, -0.25, 1.5, 0.75], [-1.0, 0.3, 0.2, -0.6], [0.9, 0.1, -0.4, 0.35]];
        let dot = |x: &Affine| (0..12).fold(0.0, |s, e| s + bar[e / 4][e % 4] * x[e / 4][e % 4]);
        let (left, right) = (left_bar(&B, &bar), right_bar(&A, &bar));
        for (i, j) in (0..12).map(|e| (e / 4, e % 4)) {
            let moved = |m: &Affine, by: f64| {
                let mut m = *m;
                m[i][j] += by;
                m
            };
            let of_a = 0.5 * (dot(&compose(&moved(&A, 1.0), &B)) - dot(&compose(&moved(&A, -1.0), &B)));
            let of_b = 0.5 * (dot(&compose(&A, &moved(&B, 1.0))) - dot(&compose(&A, &moved(&B, -1.0))));
            assert!((of_a - left[i][j]).abs() < 1e-14, "a({i}, {j}): {of_a} and {}", left[i][j]);
            assert!((of_b - right[i][j]).abs() < 1e-14, "b({i}, {j}): {of_b} and {}", right[i][j]);
        }
    }
}
