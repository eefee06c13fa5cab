//! Latent causal structure.

pub mod acyclic;
pub mod code;
pub mod edges;
pub mod held;
pub mod independence;
pub mod intervene;
pub mod limit;
pub mod mask;
pub mod posterior;
pub mod posterior_kl;
pub mod probability;
pub mod scm_kl;
pub mod structure;
