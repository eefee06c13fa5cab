//! Random numbers, elementary functions, digests.

pub mod bits;
pub mod elem;
pub mod rng;
