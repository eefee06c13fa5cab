//! Rays against triangles, by brute force. No gradients.
//!
//! `vertices`, `triangles`, `origin`, `direction` ──► [`trace`] ──► `t`, `triangle`. Called by [`crate::twins`].

pub mod trace;
