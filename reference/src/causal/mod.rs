//! Latent causal structure.

pub mod acyclic;
pub mod mask;
pub mod structure;
