//! Optimisers. They have no gradient.
//!
//! `param`, `grads` ──► `trajectory`, `m`, `v`, `steps`; `adamw` is `adam` with decoupled weight decay; `muon` has `m` alone.
//! Called by [`crate::twins`].

pub mod adam;
pub mod adamw;
pub mod muon;
