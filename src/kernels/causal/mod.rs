//! Latent causal structure: factors, their graph, and what may be asked of it. Level 5.
//!
//! ```text
//! logits ── probability ──► p ── edges ──► L       what edges cost
//! logits ── mask ──► Ã ── acyclic ──► h            how far Ã is from a graph without cycles
//!                    │ └─ repair ───► Graph        the nearest graph without cycles; levels, descendants
//!                    │
//! μ, ℓ, η ── posterior ──► û ── structure, mode abduct ──► ε        the causes behind factors
//!           ε ── structure ──► Ẑ                   n sweeps of the mechanisms, or a truncated Neumann sum
//!           ε, (i, v) ── intervene ──► Ẑ           the same with factor i set to v
//! v, w ── code ──► codes of labels         v̄ or u ── held ──► the values of pairs    ℓ ── limit ──► ℓ within −8..4
//! ε, ℓ ── scm_kl ──► KL     μ, ℓ ── posterior_kl ──► KL from the prior     μ, ℓ ── independence ──► I between the causes
//! ```
//!
//! n factors of k numbers each, row-major (B, n, k). `A[i][j]` is the edge i → j, so the parents of j are column j.
//! Everything is in f64 in runs of either precision: graphs and covariances are small, and their conditioning is not.
//!
//! # Rounding
//! Sums are left folds from +0 in ascending index unless a file says otherwise; one thread.

pub mod acyclic;
pub mod code;
pub mod edges;
pub mod held;
pub mod independence;
pub mod intervene;
pub mod limit;
pub mod mask;
mod mechanism;
pub mod posterior;
pub mod posterior_kl;
pub mod probability;
pub mod repair;
pub mod scm_kl;
pub mod structure;
