//! `field.normal_head`: unit normals from features; radial where the network is 0.
//!
//! n = v/‖v‖,   v = W³ max(0, W² max(0, W¹ max(0, W⁰ f))) + x/‖x‖             (head of LIRM, Li et al. 2025)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | f | `features` | (N, K) | of [`super::fetch`] |
//! | x | `points` | (N, 3) | |
//! | Wˡ | `w0` to `w3` | (A, K), (B, A), (D, B), (3, D) | finite |
//! | n | `normal` | (N, 3) | unit, or 0 |
//!
//! # Rounding
//! The network rounds as [`network`]. Both unit vectors are computed in f64 and rounded once; the sum is in f32.
//!
//! # Kinks and domain
//! 0/0 is 0 with gradient 0, for x = 0 and for v = 0. Otherwise the kinks of the ReLU.
//!
//! # Adjoint
//! v̄ = (n̄ − n(n·n̄))/‖v‖, which is the cotangent of the network; x̄ = (v̄ − r(r·v̄))/‖x‖ with r = x/‖x‖. v and the
//! hidden layers are saved.
//!
//! Twin: `reference::field::normal_head`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::{network::Network, normal_head::forward};
//! let weights: [&[f32]; 2] = [&[1.0], &[2.0, 3.0, 0.0]];
//! let network = Network { weights: &weights, inputs: 1 };
//! let (normal, _) = forward(&network, &[1.0], &[[5.0, 0.0, 0.0]]);
//! assert_eq!(normal, [[0.70710677, 0.70710677, 0.0]]); // of (2, 3, 0) + (1, 0, 0)
//! ```

use super::direction::{unit, unit_back};
use super::network::{self, Network, NetworkBar};

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    sum: Vec<[f32; 3]>,
    network: network::Saved,
}

/// Returns `normal` (N, 3) for `features` (N, K), and the intermediate values that the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(network: &Network<'_>, features: &[f32], points: &[[f32; 3]]) -> (Vec<[f32; 3]>, Saved) {
    let (mut sum, network) = network::forward(network, features);
    let (rows, rest) = sum.as_chunks_mut::<3>();
    assert!(rest.is_empty() && rows.len() == points.len(), "three outputs per point");
    for (row, point) in rows.iter_mut().zip(points) {
        let radial = unit(*point);
        (0..3).for_each(|k| row[k] += radial[k]);
    }
    let sum = rows.to_vec();
    (sum.iter().map(|v| unit(*v)).collect(), Saved { sum, network })
}

/// Adds the gradients for the cotangent `normal_bar` (N, 3) to `points_bar` (N, 3; empty if not requested) and to
/// `bar`.
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(
    network: &Network<'_>,
    (features, points): (&[f32], &[[f32; 3]]),
    saved: &Saved,
    normal_bar: &[[f32; 3]],
    points_bar: &mut [[f32; 3]],
    bar: &mut NetworkBar,
) {
    assert_eq!(normal_bar.len(), points.len(), "one cotangent per point");
    let sum_bar: Vec<[f32; 3]> = saved.sum.iter().zip(normal_bar).map(|(v, g)| unit_back(*v, *g)).collect();
    for ((bar, point), g) in points_bar.iter_mut().zip(points).zip(&sum_bar) {
        let own = unit_back(*point, *g);
        (0..3).for_each(|k| bar[k] += own[k]);
    }
    network::adjoint(network, features, &saved.network, sum_bar.as_flattened(), bar);
}
