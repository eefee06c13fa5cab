//! Campaigns against the built program: damaged files, signals at random moments, full disks, closed streams, two writers.
//!
//! Every case is a function of a seed and its number. `main.rs` runs long campaigns and prints their tables, which are recorded in
//! `benches/record/`; `gate.rs` runs a short one of each kind with the other tests.
#![cfg(unix)]

pub mod bases;
pub mod damage;
pub mod disk;
pub mod kill;
pub mod long;
pub mod mutation;
pub mod pipes;
pub mod program;
pub mod table;
pub mod tree;
mod weights;
pub mod writers;

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/lpips_weights.rs"]
mod lpips_weights;
#[path = "../common/mini_person.rs"]
mod mini_person;
#[path = "../common/mutate.rs"]
mod mutate;
#[path = "../common/person_layouts.rs"]
mod person_layouts;
#[path = "../common/python.rs"]
mod python;
#[path = "../samples/mod.rs"]
mod samples;
