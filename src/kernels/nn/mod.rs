//! Neural network layers of both systems. Level 4.
//!
//! ```text
//! rows x, weights ── linear ──► rows y        over num::gemm
//! values x, slope ── act ─────► values y      elementwise
//! images x, filters ──── conv ► images y      patches, over num::gemm
//! rows x, layers ── mlp ──────► rows y        linear layers with max(0, ·) between them
//! logits x, weights ─ softmax ► softmax y     row by row
//! codes, factors ── decoder ──► points        a network at every coordinate, conditioned on factors
//! images ── window ───────────► squares       crops resampled by area
//!
//! tokens x, weights ─ attention ► tokens y    softmax of products between all tokens; projections over linear
//! tokens x, weights ── block ──► tokens y     layernorm, attention, linear and gelu with two residual sums
//! rows x ──── layernorm ──────► rows y        mean 0, variance 1, gain and bias
//! values x ── gelu ───────────► values y      elementwise
//! values x ── softplus ───────► values y      elementwise
//! directions, lengths ── weight_norm ► matrix
//! images, rays, photos ─ tokens ► tokens    one token per square of pixels, over conv and layernorm
//! last and learned tokens ─── fuse ► tokens    two linear layers with GELU between them
//! tokens ──── unpatch ────────► images y       one square of texels per token, the transpose of conv
//! ```
//!
//! A layer is a pair of functions over slices: `forward` writes the outputs, and `adjoint` adds to the
//! caller's gradients.

pub mod act;
pub mod attention;
pub mod block;
pub mod conv;
pub mod decoder;
pub mod fuse;
pub mod gelu;
pub mod layernorm;
pub mod linear;
pub mod mlp;
pub mod softmax;
pub mod softplus;
pub mod tokens;
pub mod unpatch;
pub mod weight_norm;
pub mod window;
