//! Updates in the order of the causal graph: parents first, children bounded (last.md §12).
//!
//! Every factor i has key Gaussians K_i: those that move most when the rendered picture's factor is exchanged for the real one's. Factors without parents
//! are level 0, children one above their highest parent. An iteration goes through the levels; each renders anew, and steps its own keys alone. Gaussians
//! that are key to nothing, and the networks, belong to level 0. From level 1 on the step of factor i's keys in attribute a is c·lr·u with
//!
//! u = m̂/(√v̂ + ε),   c = min(1, λ r_ref / RMS_{K_i}(u)),   r_ref = max(1e-3, max over parents j of r_j(a)),   r_i(a) = c·RMS_{K_i}(u)
//!
//! and r_i(a) = RMS_{K_i}(u) at level 0. Attributes: centres, scales, rotations, opacities, colours. A Gaussian in two blocks of a level moves
//! once, with the smaller c.
//!
//! # Rounding
//! u is recovered from the step taken, (before − after)/lr in f64; RMS sums from the left over rows and columns. c = 1 keeps the bits of the
//! plain step, c = 0 those before it; else before + c·(after − before) in f32.

mod plan;
mod settings;
mod steps;
#[cfg(test)]
mod tests;

pub use plan::{Plan, block, keys, random_keys};
pub use settings::{Cap, Keys, Order, Progressive};
pub use steps::{ATTRIBUTES, Level, Sizes, Step, cap, clipped, norm, sizes};
