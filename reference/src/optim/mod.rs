//! Optimisers. They have no gradient.
//!
//! `param`, `grads` ──► `trajectory`, `m`, `v`, `steps`; `adamw` is `adam` with its decay taken outside the moments. Called by [`crate::twins`].

pub mod adam;
pub mod adamw;
