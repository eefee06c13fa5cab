//! `splat.covariance`: factors of the covariance from quaternions and scales.
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
//! q is first multiplied by the power of two that brings its largest component into 1..2, so that neither
//! very long nor very short quaternions overflow or underflow, and scaling q by a power of two changes no
//! bit.
//!
//! # Kinks and domain
//! q = 0 is an error.
//!
//! # Adjoint
//! The normalisation is differentiated: ⟨q, q̄⟩ = 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::splat::ports::{QUATS, SCALES};
use crate::twins::Call;

inputs! {
    /// Inputs of `splat.covariance`.
    pub struct In<'a, S> {
        quats: &'a Arr<S> = QUATS,
        scales: &'a Arr<S> = SCALES,
    }
}

/// `splat.covariance`
pub static SIGNATURE: Signature = Signature {
    name: "splat.covariance",
    summary: "factors F = R·S of the covariance Σ = F·Fᵀ from quaternions and scales",
    inputs: In::<f64>::PORTS,
    outputs: ports![factors: Port::var("N,3,3", "scene units")],
    ..Signature::EMPTY
};

/// Rotation matrix of a quaternion of any length but zero.
pub fn rotation<S: Scalar>(quat: [S; 4]) -> [[S; 3]; 3] {
    let largest = quat.iter().fold(0.0, |m: f64, q| if q.value().abs() > m { q.value().abs() } else { m });
    let power = -libm::ilogb(largest);
    let q = quat.map(|q| {
        // Two factors, because 2^power alone may overflow.
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

/// The factor of Gaussian `i`.
///
/// # Errors
/// When its quaternion is zero.
pub fn factor_of<S: Scalar>(input: &In<'_, S>, i: usize) -> Result<[[S; 3]; 3], String> {
    let quat: [S; 4] = input.quats.row(i);
    if quat.iter().all(|q| q.value() == 0.0) {
        return Err(format!("input quats[{i}]: expected any length but zero, got 0"));
    }
    Ok(factor(quat, input.scales.row(i)))
}

/// The twin of `splat.covariance`.
///
/// # Errors
/// When a quaternion is zero.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let n = input.quats.shape[0];
    let factors = out.array("factors", &[n, 3, 3]);
    for i in 0..n {
        for (row, f) in factor_of(input, i)?.into_iter().enumerate() {
            out.put_row(factors, 3 * i + row, f);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a quaternion is zero.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
