//! Intersection of rays with triangles, by brute force, without gradients.
//!
//! `vertices`, `triangles`, `origin`, `direction` ──► [`trace`] ──► `t`, `triangle`. Called by
//! [`crate::twins`].

pub mod trace;
