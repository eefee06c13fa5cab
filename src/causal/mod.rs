//! Latent causal structure: factors, their graph, and what may be asked of it. Level 5.
//!
//! ```text
//! logits ── mask ──► Ã ── acyclic ──► h            how far Ã is from a graph without cycles
//!                    │
//! μ, ℓ, η ── posterior ──► sample                  posterior_kl: its divergence from the prior
//!           ε ── structure ──► Ẑ                   n sweeps of the mechanisms, or a truncated Neumann sum; and back
//! ```
//!
//! n factors of k numbers each, row-major (B, n, k). `A[i][j]` is the edge i → j, so the parents of j are column j.
//! Everything is in f64 in runs of either precision: graphs and covariances are small, and their conditioning is not.
//!
//! # Rounding
//! Sums are left folds from +0 in ascending index unless a file says otherwise; one thread.

pub mod acyclic;
pub mod mask;
mod mechanism;
pub mod posterior;
pub mod posterior_kl;
pub mod structure;
