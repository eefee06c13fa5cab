//! Materials and light.

pub mod decode;
pub mod diffuse;
pub mod encode;
pub mod envmap;
pub mod gain;
pub mod ggx;
pub mod over_black;
