//! One render: what is asked for and what comes back.

use super::super::light::Moment;
use super::super::person::Grad;

/// |∂L_lat/∂X| below it: the encoder does not look there.
pub(super) const BLIND: f32 = 1e-8;

/// One render and what came back from it.
pub(super) struct RenderResult {
    pub(super) loss: f32,
    pub(super) grad: Grad,
    /// by the light of the moment
    pub(super) light: Option<Moment>,
    pub(super) means_px: Vec<[f32; 2]>,
    pub(super) radii: Vec<[i32; 2]>,
    /// (G, 3) ∂L_lat/∂μ_world, where asked for
    pub(super) latent: Option<Vec<[f32; 3]>>,
}

/// How to render, and what to make of it.
#[derive(Clone, Copy)]
pub(super) struct Request {
    /// SH bands in use
    pub(super) degree: usize,
    /// behind the person
    pub(super) background: [f32; 3],
    /// gradients of L_lat by the posed centres
    pub(super) latent: bool,
    /// gradients of the networks
    pub(super) networks: bool,
}
