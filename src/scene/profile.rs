//! The constants of one splatting semantics. There are three profiles and one reference.

use crate::{Error, Result};

/// When the walk along a pixel's list ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// After including the Gaussian that brings T to `t_stop` or below.
    After,
    /// Before the Gaussian that would bring T to `t_stop` or below.
    Before,
    /// Before the Gaussian that would bring T strictly below `t_stop`.
    BeforeStrict,
    /// Never.
    Never,
}

/// Limits of t_x/z, t_y/z in the Jacobian of the pinhole projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TangentClamp {
    /// −(c_x/f_x + 0.3 tan) to (W−c_x)/f_x + 0.3 tan, tan = W/(2 f_x)
    Gsplat,
    /// ±1.3 W/(2 f_x)
    Inria,
}

/// Which tiles a Gaussian is listed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Footprint {
    /// Exactly the pixels with α ≥ α_min; tile lists may only skip what that test rejects.
    Alpha,
    /// All pixels of the 16×16 tiles that the square of half-width ceil(3 √λ_max) touches.
    Inria3Sigma,
}

/// The constants of one splatting semantics.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// `exact`, `gsplat`, `inria` or `unlimited`
    pub name: &'static str,
    /// Added to both diagonal entries of the projected covariance, px².
    pub blur_px2: f32,
    /// Cap of α; the gradient is 0 above it.
    pub alpha_max: f32,
    /// α below it is skipped.
    pub alpha_min: f32,
    /// Transmittance at which the walk ends.
    pub t_stop: f32,
    /// How it ends.
    pub stop: Stop,
    /// Smallest visible camera depth z (inclusive).
    pub near: f32,
    /// Largest visible camera depth z (inclusive).
    pub far: f32,
    /// Clamp of the Jacobian's tangents.
    pub clamp: TangentClamp,
    /// Tile lists.
    pub footprint: Footprint,
    /// Multiply the opacity by √max(0.005², det Σ'₀ / det Σ').
    pub antialiased: bool,
    /// Reproduce the three places where Inria's backward pass is not the derivative of its forward pass:
    /// gradient through the α cap, the doubled ∂J/∂z where a tangent is clamped, 1e-7 added to det².
    pub inria_bwd: bool,
}

impl Profile {
    /// The default; used for every digest.
    pub const EXACT: Self = Self {
        name: "exact",
        blur_px2: 0.3,
        alpha_max: 0.99,
        alpha_min: 1.0 / 255.0,
        t_stop: 1e-4,
        stop: Stop::After,
        near: 0.01,
        far: 1e10,
        clamp: TangentClamp::Gsplat,
        footprint: Footprint::Alpha,
        antialiased: false,
        inria_bwd: false,
    };
    /// gsplat's constants (head of 2026; older releases: `alpha_max` 0.999).
    pub const GSPLAT: Self = Self { name: "gsplat", stop: Stop::Before, ..Self::EXACT };
    /// Constants of the original 3DGS rasterizer.
    pub const INRIA: Self = Self {
        name: "inria",
        stop: Stop::BeforeStrict,
        near: 0.2,
        clamp: TangentClamp::Inria,
        footprint: Footprint::Inria3Sigma,
        ..Self::EXACT
    };
    /// Reference of the plots: `exact` with α cut 0 and no stop.
    pub const UNLIMITED: Self = Self { name: "unlimited", alpha_min: 0.0, stop: Stop::Never, ..Self::EXACT };

    /// The profile of that name.
    ///
    /// # Errors
    /// When there is none.
    pub fn parse(name: &str) -> Result<Self> {
        [Self::EXACT, Self::GSPLAT, Self::INRIA, Self::UNLIMITED]
            .into_iter()
            .find(|p| p.name == name)
            .ok_or_else(|| Error::input("--profile").expected("exact, gsplat, inria or unlimited").got(name))
    }
}
