//! Latent causal structure.

pub mod acyclic;
pub mod mask;
pub mod posterior;
pub mod posterior_kl;
pub mod structure;
