//! The operations that determine the bits of all results. Level 0.
//!
//! ```text
//! env      a probe that refuses a thread with a non-default floating-point environment
//! lanes    one body for f32 and f32x8         order   comparisons with a defined tie rule
//! double   one body for f64 and f64x4         sum     16 logical lanes, pairwise trees
//! elem     elementary functions               gemm    matrix products: one chain per element, k ascending
//! rng      Philox4x32-10, uniforms, normals   par     ordered maps over fixed chunks
//! bits     digests, ULP distance              array   named arrays at the library's interfaces
//! online   rows of a softmax by blocks        registers   the widest of the processor (not public)
//! ```
//!
//! All other levels call this one, which depends on none of them. Kernels are generic over `lanes`, take
//! elementary functions from `elem` and sums from `sum`, run their chunks with `par`, and have their results
//! checked with the digests of `bits`.

pub mod array;
pub mod bits;
pub mod double;
pub mod elem;
pub mod env;
pub mod gemm;
pub mod lanes;
pub mod online;
pub mod order;
pub mod par;
mod registers;
pub mod rng;
pub mod sum;
