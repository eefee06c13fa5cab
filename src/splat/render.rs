//! (in work) signatures that callers may rely on
use crate::scene::{camera::Camera, profile::Profile};

/// Shape of the Gaussians.
#[derive(Clone, Copy)]
pub enum Shape<'a> {
    /// quats (N,4) wxyz, scales (N,3) linear
    QuatScale {
        /// (N, 4)
        quats: &'a [[f32; 4]],
        /// (N, 3)
        scales: &'a [[f32; 3]],
    },
    /// factors F (N,3,3) row-major, Σ = F Fᵀ
    Factors(&'a [[f32; 9]]),
}
/// Colour of the Gaussians.
#[derive(Clone, Copy)]
pub enum Color<'a> {
    /// sh (N,K,3) with K ≥ (degree+1)²
    Sh {
        /// (N, K, 3)
        sh: &'a [f32],
        /// K
        coefficients: usize,
        /// bands in use
        degree: usize,
    },
    /// rgb (N,3)
    Rgb(&'a [[f32; 3]]),
}
/// Inputs.
#[derive(Clone, Copy)]
pub struct In<'a> {
    /// (N, 3)
    pub means: &'a [[f32; 3]],
    /// quats+scales or factors
    pub shape: Shape<'a>,
    /// (N) in 0..1
    pub opacities: &'a [f32],
    /// sh or rgb
    pub color: Color<'a>,
    /// (C)
    pub cameras: &'a [Camera],
    /// (3)
    pub background: [f32; 3],
}
/// How to render. `tile` 8, 16 or 32 (adjoint: 16 only); `cull` false evaluates every pixel of a listed tile.
#[derive(Clone, Debug)]
pub struct Settings {
    /// constants
    pub profile: Profile,
    /// tile side in pixels
    pub tile: usize,
    /// skip by the exact ellipse per row
    pub cull: bool,
}
/// Outputs; all cameras have one picture size.
pub struct Out {
    /// (C, H, W, 3)
    pub image: Vec<f32>,
    /// (C, H, W)
    pub alpha: Vec<f32>,
    /// (C, H, W)
    pub depth: Vec<f32>,
}
/// Cotangents of the outputs; `None` is zero.
#[derive(Clone, Copy, Default)]
pub struct OutBar<'a> {
    /// (C, H, W, 3)
    pub image: Option<&'a [f32]>,
    /// (C, H, W)
    pub alpha: Option<&'a [f32]>,
    /// (C, H, W)
    pub depth: Option<&'a [f32]>,
}
/// Gradients (accumulated into). Vectors that do not belong to the chosen Shape/Color are empty.
#[derive(Default, Clone, Debug)]
pub struct InBar {
    /// (N, 3)
    pub means: Vec<[f32; 3]>,
    /// (N, 4)
    pub quats: Vec<[f32; 4]>,
    /// (N, 3)
    pub scales: Vec<[f32; 3]>,
    /// (N, 3, 3)
    pub factors: Vec<[f32; 9]>,
    /// (N)
    pub opacities: Vec<f32>,
    /// (N, K, 3)
    pub sh: Vec<f32>,
    /// (N, 3)
    pub rgb: Vec<[f32; 3]>,
    /// (3)
    pub background: [f32; 3],
    /// Screen statistics for density control, (C, N, 2): ∂L/∂means_px in pixel units; overwritten, not accumulated.
    pub means_px: Vec<[f32; 2]>,
    /// (C, N, 2): Σ over pixels of |∂L/∂means_px| (absgrad); only filled when `Settings::absgrad`… see Saved
    pub means_px_abs: Vec<[f32; 2]>,
}
// pub struct Saved { pub projected: …, pub plan: …, per-pixel final T and last index; pub fn radii(&self) -> &[[i32;2]] (C,N,2), 0 = not visible }
// pub fn forward(x: &In, settings: &Settings) -> (Out, Saved);
// pub fn adjoint(x: &In, settings: &Settings, saved: &Saved, out_bar: OutBar, x_bar: &mut InBar);
// impl InBar { pub fn zeros_like(x: &In) -> Self }
