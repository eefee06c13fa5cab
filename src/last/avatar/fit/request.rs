//! One render: the request and the result.

use super::super::light::Moment;
use super::super::person::Grad;

/// Pixels with |∂L_lat/∂X| below this value count as having no effect on the encoder.
pub(super) const BLIND: f32 = 1e-8;

/// The result of a render and its adjoint.
pub(super) struct RenderResult {
    pub(super) loss: f32,
    pub(super) grad: Grad,
    /// Gradient with respect to the light of the moment.
    pub(super) light: Option<Moment>,
    pub(super) means_px: Vec<[f32; 2]>,
    pub(super) radii: Vec<[i32; 2]>,
    /// ∂L_lat/∂μ_world, shape (G, 3), if requested.
    pub(super) latent: Option<Vec<[f32; 3]>>,
}

/// The settings of a render and the gradients to be computed.
#[derive(Clone, Copy)]
pub(super) struct Request {
    /// SH degree in use.
    pub(super) degree: usize,
    /// Background colour.
    pub(super) background: [f32; 3],
    /// Whether to compute gradients of L_lat with respect to the posed centres.
    pub(super) latent: bool,
    /// Whether to compute gradients of the networks.
    pub(super) networks: bool,
}
