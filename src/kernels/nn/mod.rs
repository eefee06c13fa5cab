//! Layers of both systems. Level 4.
//!
//! ```text
//! rows x, weights ── linear ──► rows y        over num::gemm; called by `ops`
//! values x, slope ── act ─────► values y      entry by entry
//! images x, filters ──── conv ► images y      patches, over num::gemm
//! rows x, layers ── mlp ──────► rows y        linear layers with max(0, ·) between them
//! logits x, weights ─ softmax ► softmax y     row by row
//! codes, factors ── decoder ──► points        a network at every coordinate, conditioned on factors
//! images ── window ───────────► squares       means over cells
//! ```
//!
//! A layer is a pair of functions over slices: `forward` writes the outputs, `adjoint` adds the gradients into what the caller holds.

pub mod act;
pub mod conv;
pub mod decoder;
pub mod linear;
pub mod mlp;
pub mod softmax;
pub mod window;
