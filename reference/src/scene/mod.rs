//! Cameras, and the constants of a splatting profile.
//!
//! ```text
//! view_from_world, intrinsics ── camera ──► one Camera per view      settings ── profile ──► Profile
//! ```
//!
//! Both are read from named arrays and settings and passed to [`crate::splat`].

pub mod camera;
pub mod profile;
