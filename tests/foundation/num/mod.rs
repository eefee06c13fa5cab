//! Tests of level 0: where bits are decided.

mod elem;
mod gemm;
mod lanes;
mod online;
mod order;
mod rng;
mod sum;
