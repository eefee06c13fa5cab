//! Materials and light. Level 5.
//!
//! ```text
//! operators   ggx       the BRDF                     envmap   a point under a whole map, no shadows
//! light       environment   look-up and drawing of a latitude–longitude map
//! pictures    render    paths through a scene        surface  hits to places, normals, materials      sample   directions for a BRDF
//! afterwards  tonemap   linear to sRGB bytes         exposure the scale that suits a picture          axes     a map that shows its orientation
//! ```
//!
//! Colours are linear everywhere here; [`tonemap`] alone encodes.

pub mod environment;
pub mod envmap;
pub mod exposure;
pub mod ggx;
pub mod render;
pub mod sample;
mod surface;
pub mod tonemap;
pub mod vector;
