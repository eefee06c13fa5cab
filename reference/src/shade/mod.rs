//! Materials and light.

pub mod diffuse;
pub mod envmap;
pub mod gain;
pub mod ggx;
pub mod over_black;
