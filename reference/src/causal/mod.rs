//! Latent causal structure.

pub mod acyclic;
pub mod independence;
pub mod intervene;
pub mod mask;
pub mod posterior;
pub mod posterior_kl;
pub mod scm_kl;
pub mod structure;
