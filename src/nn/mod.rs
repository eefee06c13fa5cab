//! Layers of both systems. Level 4.
//!
//! ```text
//! rows x, weights ── linear ──► rows y        over num::gemm; called by `ops`
//! values x, slope ── act ─────► values y      entry by entry
//! pictures x, filters ── conv ► pictures y    patches, over num::gemm
//! ```
//!
//! A layer is a pair of functions over slices: `forward` writes the outputs, `adjoint` adds the gradients into what the caller holds.

pub mod act;
pub mod conv;
pub mod linear;
