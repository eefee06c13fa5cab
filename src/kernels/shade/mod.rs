//! Materials and light. Level 5.
//!
//! ```text
//! operators   ggx       the BRDF                     envmap   a point under a whole map, no shadows
//! of renders  diffuse   colours under light of the first order   gain   as bright as a moment   over_black   without the background
//! light       environment   look-up and drawing of a latitude–longitude map
//! pictures    render    paths through a scene        surface  hits to places, normals, materials      sample   directions for a BRDF
//! afterwards  sensor    noise and levels
//!             tonemap   linear to sRGB bytes         exposure the scale that suits a picture          axes     a map that shows its orientation
//! ```
//!
//! Colours are linear here, and [`tonemap`] encodes them; the three of renders take those of Gaussians, which are encoded.

pub mod axes;
pub mod diffuse;
pub mod environment;
pub mod envmap;
pub mod exposure;
pub mod gain;
pub mod ggx;
pub mod over_black;
pub mod render;
pub mod sample;
pub mod sensor;
mod surface;
pub mod tonemap;
pub mod vector;
