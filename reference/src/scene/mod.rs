//! What a view is, and the constants of a splatting semantics.
//!
//! ```text
//! view_from_world, intrinsics ── camera ──► one Camera per view      settings ── profile ──► Profile
//! ```
//!
//! Both are read from named arrays and settings and handed to [`crate::splat`].

pub mod camera;
pub mod profile;
