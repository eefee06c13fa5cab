//! Tests of levels 0 and 1: where bits are decided.

#[path = "../common/mod.rs"]
mod common;
mod env;
mod num;
