//! The progressive update (eq. 10–12 of the LAST paper): Gaussians are updated in the order of the causal
//! graph, parents first, with limited steps for children.
//!
//! Every factor i has key Gaussians K_i: those that are displaced most when this factor of the rendered image
//! is replaced by that of the real image. Factors without parents have level 0; any other factor has the
//! highest level of its parents plus one. An iteration processes the levels in order; each level renders
//! again and updates only its own key Gaussians. Gaussians that are key to no factor and the networks belong
//! to level 0. From level 1 on, the step of the key Gaussians of factor i in attribute a is c·lr·u with
//!
//! u = m̂/(√v̂ + ε),   c = min(1, λ r_ref / RMS_{K_i}(u)),   r_ref = max(1e-3, max over parents j of r_j(a)),   r_i(a) = c·RMS_{K_i}(u)
//!
//! and r_i(a) = RMS_{K_i}(u) at level 0. Attributes are centres, scales, rotations, opacities and colours. A
//! Gaussian in two blocks of the same level moves once, with the smaller c.
//!
//! # Rounding
//! u is computed from the step taken, (before − after)/lr, in f64; the RMS sums from the left over rows and
//! columns. c = 1 keeps the bits of the plain step, c = 0 those of the value before it; otherwise the result
//! is before + c·(after − before) in f32.

mod plan;
mod settings;
mod steps;
#[cfg(test)]
mod tests;

pub use plan::{Plan, block, keys, random_keys};
pub use settings::{Cap, Keys, Order, Progressive};
pub use steps::{ATTRIBUTES, Level, Sizes, Step, cap, clipped, norm, sizes};
