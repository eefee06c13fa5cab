//! Optimisers, schedules and density control. Level 8.
//!
//! ```text
//! adam      Adam with per-row counters, in place        adamw     the same with decoupled weight decay
//! muon      momentum made nearly orthogonal, for matrices
//! optimiser named parameters with one state each            initial   initial values of networks
//! clip      gradients of a largest length
//! schedule  learning rates and spherical-harmonics bands over the iterations
//! groups    one optimiser per parameter array of a set of Gaussians, and its learning rates
//! density   clone, split, prune, opacity reset           mcmc      relocation, growth, noise, regularisers
//! ```
//!
//! ```text
//! gradients of one view ──► groups ──► adam per array ──► parameters updated in place
//! screen gradients, radii ──► density (or mcmc) ──► rows cloned, split, moved, removed ──► groups follow row by row
//! ```
//!
//! Called by `fit` once per iteration, in this order; `adam` and `adamw` also by `ops`, on a given list of
//! gradients.

pub mod adam;
pub mod adamw;
pub mod clip;
pub mod density;
pub mod groups;
pub mod initial;
mod kernel;
pub mod mcmc;
pub mod muon;
pub mod optimiser;
mod rule;
pub mod schedule;
