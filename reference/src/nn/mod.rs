//! Layers of networks.

pub mod linear;
