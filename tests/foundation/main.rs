//! Tests of levels 0 and 1: where bits are decided.

#[path = "../common/chains.rs"]
mod chains;
#[path = "../common/mod.rs"]
mod common;
mod env;
mod num;
