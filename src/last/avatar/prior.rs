//! The prior for surfaces that the camera does not see ([`mod@crate::loss::prior`]). Its anchors are the
//! nearest template points; the neighbours are the K = 6 nearest Gaussians in the canonical pose, found when
//! the number of Gaussians last changed.
//!
//! For a Gaussian that the camera sees, the gradient of the image loss is much larger than that of the prior.
//! For a Gaussian that the camera never sees, the prior is the only gradient, and Adam applies the full
//! learning rate to it: colour, opacity and size spread over the unseen side from its border. Without the
//! prior, the back of a person who never turns round keeps its initial state, grey and nearly transparent.

use super::person::Avatar;
pub use super::prior_settings::Prior;
use crate::Result;
use crate::loss::prior;
use crate::math::knn;
use crate::num::order;
use crate::scene::gaussians::Gaussians;

/// The number of neighbours K.
pub const NEAR: usize = 6;

/// The nearest neighbours of each Gaussian: found when the number of Gaussians changes, and part of the state
/// until then.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Near {
    /// Indices of the nearest Gaussians of each Gaussian, shape (G); `u32::MAX` for missing entries.
    pub(super) of: Vec<[u32; NEAR]>,
    /// Logarithm ln d of the gap, shape (G).
    pub(super) gap: Vec<f32>,
}

/// Smallest squared gap of which the logarithm is taken.
const LEAST_SQUARE: f64 = 1e-12;

impl Near {
    /// Finds the neighbours of the given Gaussians.
    ///
    /// # Errors
    /// If a centre is not finite.
    pub(super) fn new(g: &Gaussians) -> Result<Self> {
        let found = knn::neighbours::<NEAR>(&g.means)?;
        let gap = found.iter().map(|n| {
            let there = n[..3].iter().filter(|(_, i)| *i != u32::MAX);
            let (sum, count) = there.fold((0.0, 0.0), |(s, c), (d, _)| (s + d, c + 1.0));
            (0.5 * libm::log(order::max(sum / order::max(count, 1.0), LEAST_SQUARE))) as f32
        });
        Ok(Self { gap: gap.collect(), of: found.iter().map(|n| n.map(|(_, i)| i)).collect() })
    }
}

/// Adds the gradient of the prior and returns its value P. `most` is r, in scene units.
pub(super) fn add(weights: &Prior, avatar: &Avatar, near: &Near, most: f64, grad: &mut Gaussians) -> f64 {
    if *weights == Prior::NONE {
        return 0.0;
    }
    let g = &avatar.gaussians;
    let anchors: Vec<[f32; 3]> = avatar.nearest.iter().map(|&p| avatar.body.points[p as usize]).collect();
    let x = prior::In {
        means: &g.means,
        scales_log: &g.scales_log,
        opacity_logits: &g.opacity_logits,
        sh: &g.sh,
        coefficients: g.sh_coefficients(),
        near: &near.of,
        gap: &near.gap,
        anchors: &anchors,
        radius: most,
    };
    let mut bar = prior::InBar {
        means: &mut grad.means,
        scales_log: &mut grad.scales_log,
        opacity_logits: &mut grad.opacity_logits,
        sh: &mut grad.sh,
    };
    prior::adjoint(weights, &x, 1.0, &mut bar);
    prior::forward(weights, &x)
}
