//! (in work)
pub mod render;
