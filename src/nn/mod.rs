//! Layers of both systems. Level 4.
//!
//! ```text
//! rows x, weights ── linear ──► rows y        over num::gemm; called by `ops`
//! ```
//!
//! A layer is a pair of functions over slices: `forward` writes the outputs, `adjoint` adds the gradients into what the caller holds.

pub mod linear;
