//! Gradients of the renderer's inputs, and their blocks of Gaussians.

use super::inputs::{Color, In, Shape};
use crate::num::par;

/// Gaussians per task.
pub const BLOCK: usize = 512;

/// Gradients; [`adjoint`](super::adjoint) adds to them. Vectors that do not belong to the chosen shape and
/// colour stay empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (N, 3).
    pub means: Vec<[f32; 3]>,
    /// Shape (N, 4).
    pub quats: Vec<[f32; 4]>,
    /// Shape (N, 3).
    pub scales: Vec<[f32; 3]>,
    /// Shape (N, 3, 3).
    pub factors: Vec<[f32; 9]>,
    /// Shape (N).
    pub opacities: Vec<f32>,
    /// Shape (N, K, 3).
    pub sh: Vec<f32>,
    /// Shape (N, 3).
    pub rgb: Vec<[f32; 3]>,
    /// Shape (3).
    pub background: [f32; 3],
    /// Statistic ∂L/∂u for density control in 1/pixels, shape (C, N, 2); it is overwritten.
    pub means_px: Vec<[f32; 2]>,
    /// Statistic Σ over pixels of |∂L/∂u|, shape (C, N, 2); it is overwritten, with `Settings::absgrad` only.
    pub means_px_abs: Vec<[f32; 2]>,
}

impl InBar {
    /// Returns zeros in the shapes of `x`.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let mut bar = Self::default();
        bar.reset(x);
        bar
    }

    /// Sets all gradients to zeros in the shapes of `x`, reusing memory.
    pub fn reset(&mut self, x: &In<'_>) {
        fn zero<T: Clone + Default + Send>(v: &mut Vec<T>, n: usize) {
            v.resize(n, T::default());
            par::chunks_mut(v, 1 << 16, |_, c| c.fill(T::default()));
        }
        let n = x.means.len();
        zero(&mut self.means, n);
        zero(&mut self.opacities, n);
        let (quat_scale, factors) = match x.shape {
            Shape::QuatScale { .. } => (n, 0),
            Shape::Factors(_) => (0, n),
        };
        zero(&mut self.quats, quat_scale);
        zero(&mut self.scales, quat_scale);
        zero(&mut self.factors, factors);
        let (sh, rgb) = match x.color {
            Color::Sh(sh) => (sh.values.len(), 0),
            Color::Rgb(_) => (0, n),
        };
        zero(&mut self.sh, sh);
        zero(&mut self.rgb, rgb);
        self.background = [0.0; 3];
        self.means_px.clear();
        self.means_px_abs.clear();
    }
}

/// One block of Gaussians in every gradient.
pub(super) struct Block<'a> {
    pub(super) means: &'a mut [[f32; 3]],
    pub(super) opacities: &'a mut [f32],
    pub(super) quats: &'a mut [[f32; 4]],
    pub(super) scales: &'a mut [[f32; 3]],
    pub(super) factors: &'a mut [[f32; 9]],
    pub(super) sh: &'a mut [f32],
    pub(super) rgb: &'a mut [[f32; 3]],
    /// Statistic of ū per camera.
    pub(super) means_px: Vec<&'a mut [[f32; 2]]>,
    pub(super) means_px_abs: Vec<&'a mut [[f32; 2]]>,
}

/// Splits every gradient into blocks of [`BLOCK`] Gaussians.
pub(super) fn blocks<'a>(x: &In<'_>, bar: &'a mut InBar) -> Vec<Block<'a>> {
    let n = x.means.len();
    let width = match x.color {
        Color::Sh(sh) => 3 * sh.coefficients,
        Color::Rgb(_) => 1,
    };
    let mut px: Vec<_> = bar.means_px.chunks_mut(n.max(1)).map(|c| c.chunks_mut(BLOCK)).collect();
    let mut abs: Vec<_> = bar.means_px_abs.chunks_mut(n.max(1)).map(|c| c.chunks_mut(BLOCK)).collect();
    let (mut quats, mut scales) = (bar.quats.chunks_mut(BLOCK), bar.scales.chunks_mut(BLOCK));
    let mut factors = bar.factors.chunks_mut(BLOCK);
    let (mut sh, mut rgb) = (bar.sh.chunks_mut(BLOCK * width), bar.rgb.chunks_mut(BLOCK));
    let rest = bar.means.chunks_mut(BLOCK).zip(bar.opacities.chunks_mut(BLOCK));
    rest.map(|(means, opacities)| Block {
        means,
        opacities,
        quats: quats.next().unwrap_or_default(),
        scales: scales.next().unwrap_or_default(),
        factors: factors.next().unwrap_or_default(),
        sh: sh.next().unwrap_or_default(),
        rgb: rgb.next().unwrap_or_default(),
        means_px: px.iter_mut().filter_map(Iterator::next).collect(),
        means_px_abs: abs.iter_mut().filter_map(Iterator::next).collect(),
    })
    .collect()
}
