//! Materials and light.

pub mod envmap;
pub mod ggx;
