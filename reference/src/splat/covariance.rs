//! Quaternions and scales to factors of the covariance.
//!
//! F = R(q/‖q‖)·diag(s),   Σ = F·Fᵀ     (3DGS, eq. 6)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | q | `quats` | (N, 4) | w, x, y, z; any length but zero |
//! | s | `scales` | (N, 3) | standard deviations, scene units |
//! | F | `factors` | (N, 3, 3) | scene units |
//!
//! # Rounding
//! q is first multiplied by the power of two that brings its largest component into 1..2, so that neither very long nor
//! very short quaternions leave the range, and a power of two in the length changes no bit.
//!
//! # Kinks and domain
//! q = 0 is refused.
//!
//! # Adjoint
//! The normalisation is differentiated: ⟨q, q̄⟩ = 0.

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;

/// Rotation matrix of a quaternion of any length but zero.
pub fn rotation<S: Scalar>(quat: [S; 4]) -> [[S; 3]; 3] {
    let largest = quat.iter().fold(0.0, |m: f64, q| if q.value().abs() > m { q.value().abs() } else { m });
    let power = -libm::ilogb(largest);
    let q = quat.map(|q| {
        // Two factors, because 2^power alone may leave the range.
        let half = power / 2;
        q * libm::scalbn(1.0, half) * libm::scalbn(1.0, power - half)
    });
    let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    let [w, x, y, z] = q.map(|q| q / norm);
    let one = S::one();
    [
        [one - (y * y + z * z) * 2.0, (x * y - w * z) * 2.0, (x * z + w * y) * 2.0],
        [(x * y + w * z) * 2.0, one - (x * x + z * z) * 2.0, (y * z - w * x) * 2.0],
        [(x * z - w * y) * 2.0, (y * z + w * x) * 2.0, one - (x * x + y * y) * 2.0],
    ]
}

/// F = R(q)·diag(s), row-major.
pub fn factor<S: Scalar>(quat: [S; 4], scale: [S; 3]) -> [[S; 3]; 3] {
    rotation(quat).map(|row| std::array::from_fn(|j| row[j] * scale[j]))
}

/// The factor of Gaussian `i` from `factors`, or from `quats` and `scales`.
///
/// # Errors
/// When the inputs are missing or shaped otherwise, or the quaternion is zero.
pub fn factor_of<S: Scalar>(x: &Named<S>, n: usize, i: usize) -> Result<[[S; 3]; 3], String> {
    if x.contains_key("factors") {
        let f: [S; 9] = expect(x, "factors", &[n, 3, 3])?.row(i);
        return Ok([[f[0], f[1], f[2]], [f[3], f[4], f[5]], [f[6], f[7], f[8]]]);
    }
    Ok(factor(quat_of(x, n, i)?, expect(x, "scales", &[n, 3])?.row(i)))
}

fn quat_of<S: Scalar>(x: &Named<S>, n: usize, i: usize) -> Result<[S; 4], String> {
    let quat: [S; 4] = expect(x, "quats", &[n, 4])?.row(i);
    if quat.iter().all(|q| q.value() == 0.0) {
        return Err(format!("input quats[{i}]: expected any length but zero, got 0"));
    }
    Ok(quat)
}

/// The twin of `splat.covariance`.
///
/// # Errors
/// When an input is missing or shaped otherwise, or a quaternion is zero.
pub fn forward<S: Scalar>(x: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let n = expect(x, "quats", &[ANY, 4])?.shape[0];
    let factors = out.array("factors", &[n, 3, 3]);
    for i in 0..n {
        // not `factor_of`: a pool of arrays may already hold this stage's own result under "factors"
        for (row, f) in
            factor(quat_of(x, n, i)?, expect(x, "scales", &[n, 3])?.row(i)).into_iter().enumerate()
        {
            out.put_row(factors, 3 * i + row, f);
        }
        out.flush();
    }
    Ok(())
}
