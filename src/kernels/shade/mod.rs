//! Materials and light. Level 5.
//!
//! ```text
//! operators            ggx          the BRDF
//!                      envmap       a point under a complete map, without shadows
//! operators on renders diffuse      colours under a first-order light
//!                      gain         per-frame brightness
//!                      over_black   background replaced by black
//!                      encode       linear values to sRGB-encoded ones
//!                      decode       and back
//! light                environment  look-up and sampling of a latitude–longitude map
//!                      axes         a map for testing orientation
//!                      alias        draws in proportion to weights
//! images               render       paths through a scene
//!                      surface      hits to positions, normals and materials
//!                      sample       directions for a BRDF
//! post-processing      sensor       noise and quantisation
//!                      exposure     automatic exposure
//!                      tonemap      linear to sRGB bytes
//! ```
//!
//! Colours are linear here, and [`tonemap`] encodes them; the three operators on renders use the encoded
//! colours of Gaussians.

mod alias;
pub mod axes;
pub mod decode;
pub mod diffuse;
pub mod encode;
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
