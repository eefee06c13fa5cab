//! Layers of networks.
//!
//! Named arrays in, named arrays out; called by [`crate::twins`], one layer at a time.

pub mod act;
pub mod conv;
pub mod linear;
