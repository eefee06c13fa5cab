//! What a view is, and the constants of a splatting semantics.

pub mod camera;
pub mod profile;
