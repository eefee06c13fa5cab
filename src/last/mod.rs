//! The LAST system. Level 10.
//!
//! ```text
//! figure    the built-in person: clouds, surfaces, light ──┬─► sets      pictures and points of known causes, in shards
//! character a person from a file, likewise
//! subject   what any moving person must say about itself ──┴─► video     a capture with poses
//! generate  which of these to make, and the record of it; folder: begun, continued, started over
//! structure learners of structure on known factors: exact, local, relaxed
//! model     the image-to-point model and its graph     host      a person of Gaussians, guided by it
//! study     the experiments
//! inspect   what any capture of a person holds and what it lacks, drawn over its pictures
//! ```
//!
//! Truth comes from `data_gen::figure` in f64; this folder renders and writes it.

pub mod character;
pub mod figure;
mod folder;
pub mod generate;
pub mod host;
pub mod inspect;
pub mod model;
pub mod sets;
pub mod structure;
pub mod study;
pub mod subject;
