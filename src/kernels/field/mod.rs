//! Fields of an object: feature planes decoded to a signed distance, colours, materials and normals, rendered
//! as a volume. Level 5.
//!
//! ```text
//! points, planes ── fetch ──► features ─┬─ sdf_head ────► sdf s ─┬─ density  (s at a point) ──────► σ
//!                                       │                        ├─ interval (s at both ends) ────► mean σ
//!                                       │                        └─ normal   (s at a stencil) ────► gradient, n
//!                                       ├─ normal_head ─► n ──┐
//!                                       ├─ value_head ──► ρ ──┴─ embed (panoramas, ray) ─► h ─┐
//!                                       ├─ value_head ──► colour from features, or features ‖ h
//!                                       ├─ value_head ──► albedo
//!                                       └─ value_head ──► roughness, metallic
//! σ, δ, values ── composite ──► value, opacity            along a ray
//! ```
//!
//! [`network`] is the bias-free ReLU network of all heads; it is not an operator of its own. [`occupancy`] finds the
//! cells of the box that can have density, and the steps of rays in them. [`render`] runs all of this, fused, for the
//! rays of a crop.
//!
//! # Conventions
//! * The field fills the box [−R, R]³ with the half size R; p = x/R.
//! * s is negative inside. σ is the density of VolSDF (Yariv et al. 2021) with the scale β.
//! * Colours and albedo are sRGB-encoded values in 0..1.

mod bands;
mod channels;
pub mod composite;
pub mod density;
mod direction;
pub mod embed;
pub mod fetch;
pub mod interval;
pub mod network;
pub mod normal;
pub mod normal_head;
pub mod occupancy;
pub mod render;
pub mod scatter;
pub mod sdf_head;
pub mod value_head;
