//! `field.value_head`: values from 0 to 1 from features: colour, albedo, roughness and metallic, or the level of
//! the panoramas.
//!
//! value = 1/(1 + e⁻ᶻ),   z = Wᴸ max(0, … max(0, W⁰ f))        (heads of LIRM, Li et al. 2025; L = 2 or 3)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | f | `features` | (N, K) | of [`super::fetch`]; for a colour that depends on direction followed by `h` of `field.embed` |
//! | Wˡ | `w0`, `w1`, `w2`, optional `w3` | (A, K), (B, A), (D, B), (E, D) | finite |
//! | | `value` | (N, O) | 0 to 1; O outputs of the last layer; colours sRGB-encoded |
//!
//! # Rounding
//! z rounds as [`network`]; the sigmoid is rounded once.
//!
//! # Kinks and domain
//! Those of the ReLU.
//!
//! # Adjoint
//! z̄ = value̅·(y(1 − y)) with y = value; then the adjoint of the network. y and the hidden layers are saved.
//!
//! Twin: `reference::field::value_head`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::{network::Network, value_head::forward};
//! let weights: [&[f32]; 2] = [&[1.0, -1.0], &[1.0, 0.0, 0.0, 100.0]];
//! let network = Network { weights: &weights, inputs: 1 };
//! assert_eq!(forward(&network, &[-2.0]).0, [0.5, 1.0]); // of 1·0 and 100·2
//! ```

use super::network::{self, Network, NetworkBar};
use crate::num::{elem, par};

/// Values per task of an elementwise loop.
const CHUNK: usize = 1 << 14;

/// Returns `value` (N, O) for `features` (N, K), and the intermediate values of the network.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(network: &Network<'_>, features: &[f32]) -> (Vec<f32>, network::Saved) {
    let (z, saved) = network::forward(network, features);
    let mut value = vec![0.0; z.len()];
    par::chunks_mut(&mut value, CHUNK, |c, value| {
        elem::sigmoid_slice(&z[c * CHUNK..][..value.len()], value);
    });
    (value, saved)
}

/// Adds the gradients for the cotangent `value_bar` (N, O) to `bar`; `value` is the result of [`forward`].
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(
    network: &Network<'_>,
    features: &[f32],
    (value, saved): (&[f32], &network::Saved),
    value_bar: &[f32],
    bar: &mut NetworkBar,
) {
    assert_eq!(value.len(), value_bar.len(), "one cotangent per value");
    let z_bar: Vec<f32> = value.iter().zip(value_bar).map(|(y, g)| g * (y * (1.0 - y))).collect();
    network::adjoint(network, features, saved, &z_bar, bar);
}
