//! Where bits are decided. Level 0.
//!
//! ```text
//! env      probe: refuse a thread whose floating-point environment is not the default one
//! lanes    one body for f32 and f32x8         order   comparisons with a tie rule
//! double   one body for f64 and f64x4         sum     16 logical lanes, pairwise trees
//! elem     elementary functions, own bodies   gemm    matrix products: one chain per output element, k ascending
//! rng      Philox4x32-10, uniforms, normals   par     ordered maps over fixed chunks
//! bits     digests, ULP distance              array   named arrays at the border of the library
//! ```
//!
//! Everything above calls down into this level and nothing here calls up. Kernels are written over `lanes`, take functions from
//! `elem` and sums from `sum`, hand their chunks to `par`, and pin what comes out with `bits`.

pub mod array;
pub mod bits;
pub mod double;
pub mod elem;
pub mod env;
pub mod gemm;
pub mod lanes;
pub mod order;
pub mod par;
pub mod rng;
pub mod sum;
