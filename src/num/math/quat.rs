//! Rotation matrix of a quaternion of any length.
//!
//! q̂ = q / ‖q‖ with q = (w, x, y, z), and
//!
//! ```text
//!     ⎡ 1−2(y²+z²)  2(xy−wz)    2(xz+wy)   ⎤
//! R = ⎢ 2(xy+wz)    1−2(x²+z²)  2(yz−wx)   ⎥   of q̂, row-major (3, 3)
//!     ⎣ 2(xz−wy)    2(yz+wx)    1−2(x²+y²) ⎦
//! ```
//!
//! # Rounding
//! The components are divided by the largest magnitude m first, then by n = √(Σ (qᵢ/m)²), a left fold. A
//! quaternion scaled by any power of two therefore gives the same bits, and magnitudes such as 1e-20 or 1e20
//! neither underflow nor overflow.
//!
//! # Kinks and domain
//! A quaternion with ‖q‖ = 0 has no rotation; `scene` refuses it.
//!
//! # Adjoint
//! q̄ = (q̂̄ − q̂ (q̂·q̂̄)) / ‖q‖, which is orthogonal to q. Nothing is saved; q̂ is recomputed.

use crate::num::lanes::Real;

/// Returns q̂ and 1/‖q‖.
#[inline(always)]
fn normalize<L: Real>(q: [L; 4]) -> ([L; 4], L) {
    let m = q[0].abs().max(q[1].abs()).max(q[2].abs().max(q[3].abs()));
    let p = q.map(|x| x / m);
    let n = (((p[0] * p[0] + p[1] * p[1]) + p[2] * p[2]) + p[3] * p[3]).sqrt();
    (p.map(|x| x / n), L::splat(1.0) / (m * n))
}

/// Returns the rotation matrix R of `q`, row-major.
#[inline(always)]
pub fn rotation<L: Real>(q: [L; 4]) -> [L; 9] {
    let ([w, x, y, z], _) = normalize(q);
    let (one, two) = (L::splat(1.0), L::splat(2.0));
    [
        one - two * (y * y + z * z),
        two * (x * y - w * z),
        two * (x * z + w * y),
        two * (x * y + w * z),
        one - two * (x * x + z * z),
        two * (y * z - w * x),
        two * (x * z - w * y),
        two * (y * z + w * x),
        one - two * (x * x + y * y),
    ]
}

/// Returns q̄ for the cotangent R̄.
#[inline(always)]
pub fn rotation_adjoint<L: Real>(q: [L; 4], r_bar: [L; 9]) -> [L; 4] {
    let (u, inv_len) = normalize(q);
    let [w, x, y, z] = u;
    let [r00, r01, r02, r10, r11, r12, r20, r21, r22] = r_bar;
    let two = L::splat(2.0);
    // Each line combines the entries of R that contain the component, with their factors.
    let w_bar = two * ((x * (r21 - r12) + y * (r02 - r20)) + z * (r10 - r01));
    let x_bar = two * (((y * (r01 + r10) + z * (r02 + r20)) + w * (r21 - r12)) - two * (x * (r11 + r22)));
    let y_bar = two * (((x * (r01 + r10) + z * (r12 + r21)) + w * (r02 - r20)) - two * (y * (r00 + r22)));
    let z_bar = two * (((x * (r02 + r20) + y * (r12 + r21)) + w * (r10 - r01)) - two * (z * (r00 + r11)));
    let bar = [w_bar, x_bar, y_bar, z_bar];
    // Adjoint of the normalisation q̂ = q / ‖q‖.
    let radial = ((w * bar[0] + x * bar[1]) + y * bar[2]) + z * bar[3];
    std::array::from_fn(|i| (bar[i] - u[i] * radial) * inv_len)
}
