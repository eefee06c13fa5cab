//! Layers of both systems. Level 4.

pub mod linear;
