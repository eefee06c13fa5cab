//! Random numbers, elementary functions, digests.
//!
//! ```text
//! rng   Philox, uniforms, normals      elem   functions over Scalar and plain f64      bits   FNV-1a digests
//! ```
//!
//! Called by the twins and by `data-gen`.

pub mod bits;
pub mod elem;
pub mod rng;
