//! Materials and light. Level 5.
//!
//! ```text
//! operators   ggx       the BRDF                     envmap   a point under a whole map, no shadows
//! light       environment   look-up and drawing of a latitude–longitude map
//! pictures    render    paths through a scene        surface  hits to places, normals, materials      sample   directions for a BRDF
//! afterwards  sensor    noise and levels
//!             tonemap   linear to sRGB bytes         exposure the scale that suits a picture          axes     a map that shows its orientation
//! ```
//!
//! Colours are linear everywhere here; [`tonemap`] alone encodes.

pub mod axes;
pub mod environment;
pub mod envmap;
pub mod exposure;
pub mod ggx;
pub mod render;
pub mod sample;
pub mod sensor;
mod surface;
pub mod tonemap;
pub mod vector;
