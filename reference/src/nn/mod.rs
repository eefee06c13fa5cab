//! Layers of networks.
//!
//! One layer per file: its inputs and signature, the function over them, and its binding to named arrays for
//! [`crate::twins`].

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
