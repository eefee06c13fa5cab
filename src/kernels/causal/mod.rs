//! Latent causal structure: factors, their graph, and operations on both. Level 5.
//!
//! ```text
//! logits ── probability ──► p ── edges ──► L       penalty on edges
//! logits ── mask ──► Ã ── acyclic ──► h            measure of the cycles of Ã
//!                    │ └─ repair ───► Graph        an acyclic graph near Ã; levels, descendants
//!                    │
//! μ, ℓ, η ── posterior ──► û ── structure, mode abduct ──► ε        the causes behind factors
//!           ε ── structure ──► Ẑ                   n sweeps of the mechanisms, or a truncated Neumann sum
//!           ε, (i, v) ── intervene ──► Ẑ           as above, with factor i set to v
//! v, w ── code ──► codes of labels            v̄ or u ── held ──► the values of pairs
//! ℓ ── limit ──► ℓ within −8..4                ε, ℓ ── scm_kl ──► KL
//! μ, ℓ ── posterior_kl ──► KL from the prior   μ, ℓ ── independence ──► I between the causes
//! ```
//!
//! There are n factors of k dimensions each, stored row-major as (B, n, k). `A[i][j]` is the edge i → j, so
//! the parents of j are column j. All values are f64, whatever precision a run uses: graphs and covariances
//! are small, but may be badly conditioned.
//!
//! # Rounding
//! Unless a file states otherwise, sums are left folds from +0 in ascending index, on one thread.

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
