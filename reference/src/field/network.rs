//! The network of the heads: linear maps without bias, with max(0, ·) between them.

use crate::array::Arr;
use crate::scalar::Scalar;

/// The outputs for one row.
pub(super) fn network<S: Scalar>(weights: &[&Arr<S>], row: &[S]) -> Vec<S> {
    network_by(weights, row, |is_active| is_active)
}

/// The outputs for one row; `choose` decides, layer by layer, which hidden units pass their values.
pub(super) fn network_by<S: Scalar>(
    weights: &[&Arr<S>],
    row: &[S],
    mut choose: impl FnMut(bool) -> bool,
) -> Vec<S> {
    let mut values = row.to_vec();
    for (layer, weight) in weights.iter().enumerate() {
        let k = weight.shape[1];
        let output = |n: usize| {
            let sum = (0..k).fold(S::zero(), |sum, i| sum + weight.data[n * k + i] * values[i]);
            let is_hidden = layer + 1 < weights.len();
            if is_hidden && !choose(!(sum.value() <= 0.0)) { S::zero() } else { sum }
        };
        values = (0..weight.shape[0]).map(output).collect();
    }
    values
}
