//! y = x·Wᵀ + b.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (M, K) |
//! | W | `weight` | (N, K) |
//! | b | `bias` | (N) |
//! | y | `y` | (M, N) |
//!
//! # Rounding
//! One chain per entry from 0, k ascending; the bias is added last.

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;

/// The twin of `nn.linear`.
///
/// # Errors
/// When an input is missing or shaped otherwise.
pub fn forward<S: Scalar>(arrays: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let x = expect(arrays, "x", &[ANY, ANY])?;
    let (m, k) = (x.shape[0], x.shape[1]);
    let weight = expect(arrays, "weight", &[ANY, k])?;
    let n = weight.shape[0];
    let bias = expect(arrays, "bias", &[n])?;
    let y = out.array("y", &[m, n]);
    for row in 0..m {
        for column in 0..n {
            let mut sum = S::zero();
            for i in 0..k {
                sum = sum + x.data[row * k + i] * weight.data[column * k + i];
            }
            out.put(y, row * n + column, sum + bias.data[column]);
        }
        out.flush();
    }
    Ok(())
}
