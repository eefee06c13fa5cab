//! `field.sdf_head`: signed distance of points, from their features; bounded, and a sphere where the network is 0.
//!
//! s = 1.5·1.732·R·tanh(z) + (‖x‖ − 0.1 R),   z = W² max(0, W¹ max(0, W⁰ f))       (head of LIRM, Li et al. 2025)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | f | `features` | (N, K) | of [`super::fetch`] |
//! | x | `points` | (N, 3) | |
//! | W⁰, W¹, W² | `w0`, `w1`, `w2` | (A, K), (B, A), (1, B) | finite |
//! | R | setting `half_size` | () | > 0 |
//! | s | `sdf` | (N) | negative inside |
//!
//! 1.732 is the constant of the published code, not √3.
//!
//! # Rounding
//! z rounds as [`network`]. ‖x‖ is computed in f64 and rounded once, so that it is not 0 for small x;
//! s = (2.598 R)·tanh(z) + (‖x‖ − 0.1 R).
//!
//! # Kinks and domain
//! Those of the ReLU. At x = 0 the gradient of ‖x‖ is 0.
//!
//! # Adjoint
//! z̄ = s̄·(2.598 R)·(1 − t)(1 + t) with t = tanh z; x̄ = s̄·x/‖x‖; then the adjoint of the network. t and the hidden
//! layers are saved.
//!
//! Twin: `reference::field::sdf_head`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::sdf_head::{In, forward};
//! let weights: [&[f32]; 3] = [&[1.0, 0.0], &[1.0], &[0.0]];
//! let points = [[3.0, 4.0, 0.0]];
//! let x = In { features: &[1.0, 2.0], points: &points, weights: &weights, half_size: 10.0 };
//! assert_eq!(forward(&x).0, [4.0]); // tanh 0 + (5 − 1)
//! ```

use super::direction::{length, unit};
use super::network::{self, Network, NetworkBar};
use crate::num::elem;

/// 1.5·1.732.
const SCALE: f32 = 2.598;
/// Radius of the sphere for tanh z = 0, relative to R.
const RADIUS: f32 = 0.1;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, K).
    pub features: &'a [f32],
    /// Shape (N, 3).
    pub points: &'a [[f32; 3]],
    /// Layers, the last with one output.
    pub weights: &'a [&'a [f32]],
    /// Half size R of the box.
    pub half_size: f32,
}

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    /// tanh z, shape (N).
    pub tanh: Vec<f32>,
    network: network::Saved,
}

impl<'a> In<'a> {
    fn network(&self) -> Network<'a> {
        let n = Ord::max(self.points.len(), 1);
        let network = Network { weights: self.weights, inputs: self.features.len() / n };
        assert_eq!(self.features.len(), n * network.inputs, "one row of features per point");
        assert_eq!(network.widths().last(), Some(&1), "the last layer has one output");
        network
    }
}

/// Returns s for tanh z at a point.
#[inline(always)]
pub fn distance(tanh: f32, point: [f32; 3], half_size: f32) -> f32 {
    (SCALE * half_size) * tanh + (length(point) as f32 - RADIUS * half_size)
}

/// Returns the cotangent of z for that of s.
#[inline(always)]
pub fn distance_bar(tanh: f32, sdf_bar: f32, half_size: f32) -> f32 {
    (sdf_bar * (SCALE * half_size)) * ((1.0 - tanh) * (1.0 + tanh))
}

/// Returns `sdf` (N) and the intermediate values that the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, or there is no point.
pub fn forward(x: &In<'_>) -> (Vec<f32>, Saved) {
    let (z, network) = network::forward(&x.network(), x.features);
    let mut tanh = vec![0.0; z.len()];
    elem::tanh_slice(&z, &mut tanh);
    let sdf = tanh.iter().zip(x.points).map(|(t, point)| distance(*t, *point, x.half_size)).collect();
    (sdf, Saved { tanh, network })
}

/// Adds the gradients for the cotangent `sdf_bar` (N) to `points_bar` (N, 3; empty if not requested) and to those
/// of features and weights.
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(
    x: &In<'_>,
    saved: &Saved,
    sdf_bar: &[f32],
    points_bar: &mut [[f32; 3]],
    network_bar: &mut NetworkBar,
) {
    assert_eq!(sdf_bar.len(), x.points.len(), "one cotangent per point");
    for ((bar, point), g) in points_bar.iter_mut().zip(x.points).zip(sdf_bar) {
        let n = unit(*point);
        (0..3).for_each(|k| bar[k] += g * n[k]);
    }
    let z_bar: Vec<f32> =
        saved.tanh.iter().zip(sdf_bar).map(|(t, g)| distance_bar(*t, *g, x.half_size)).collect();
    network::adjoint(&x.network(), x.features, &saved.network, &z_bar, network_bar);
}
