//! What LAST rests on and what it must show: metrics, scores of structures, learners on known factors, bodies.

#[path = "../common/mod.rs"]
mod common;

mod body;
mod learners;
mod lpips;
mod metrics;
mod skin;
mod structure;
