//! What LAST rests on and what it must show: metrics, scores of structures, learners on known factors.

#[path = "../common/mod.rs"]
mod common;

mod learners;
mod metrics;
mod structure;
