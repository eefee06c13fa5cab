//! The constants of a splatting profile.

use crate::scene::camera::Model;
use crate::settings::Settings;

/// When the loop over a pixel's list ends.
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

/// Which pixels a Gaussian may affect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Footprint {
    /// Exactly the pixels with α ≥ α_min.
    Alpha,
    /// All pixels of the 16×16 tiles that the square of half-width ceil(3 √λ_max) touches.
    Inria,
}

/// The constants of a splatting profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Added to both diagonal entries of the projected covariance, px².
    pub blur_px2: f64,
    /// Cap of α; the gradient is 0 above it.
    pub alpha_max: f64,
    /// α below it is skipped.
    pub alpha_min: f64,
    /// Transmittance at which the loop ends.
    pub t_stop: f64,
    /// How the loop ends.
    pub stop: Stop,
    /// Smallest visible camera depth z (inclusive).
    pub near: f64,
    /// Largest visible camera depth z (inclusive).
    pub far: f64,
    /// Clamp of the Jacobian's tangents.
    pub clamp: TangentClamp,
    /// Tile lists.
    pub footprint: Footprint,
    /// Multiply the opacity by √max(0.005², det Σ'₀ / det Σ').
    pub antialiased: bool,
    /// Reproduce the three places where Inria's backward pass is not the derivative of its forward pass.
    pub inria_bwd: bool,
    /// Projection model of all cameras.
    pub camera: Model,
}

impl Profile {
    /// `exact`, the default.
    pub const EXACT: Self = Self {
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
        camera: Model::Pinhole,
    };

    /// The profile named by the setting `profile` (default `exact`), with every constant replaced that
    /// has a setting of its own.
    ///
    /// # Panics
    /// When a word is unknown; the signature checks the words before.
    pub fn of(settings: &Settings<'_>) -> Self {
        let mut p = match settings.word("profile") {
            "exact" => Self::EXACT,
            "gsplat" => Self { stop: Stop::Before, ..Self::EXACT },
            "inria" => Self {
                stop: Stop::BeforeStrict,
                near: 0.2,
                clamp: TangentClamp::Inria,
                footprint: Footprint::Inria,
                ..Self::EXACT
            },
            "unlimited" => Self { alpha_min: 0.0, stop: Stop::Never, ..Self::EXACT },
            other => unreachable!("profile {other}"),
        };
        let number = |key: &str, constant: f64| settings.given_number(key).unwrap_or(constant);
        p.blur_px2 = number("blur_px2", p.blur_px2);
        p.alpha_max = number("alpha_max", p.alpha_max);
        p.alpha_min = number("alpha_min", p.alpha_min);
        p.t_stop = number("t_stop", p.t_stop);
        p.near = number("near", p.near);
        p.far = number("far", p.far);
        p.antialiased = settings.flag("antialiased");
        p.inria_bwd = settings.flag("inria_bwd");
        p.stop = settings.given_word("stop").map_or(p.stop, |word| match word {
            "after" => Stop::After,
            "before" => Stop::Before,
            "before_strict" => Stop::BeforeStrict,
            "never" => Stop::Never,
            other => unreachable!("stop {other}"),
        });
        p.clamp = settings.given_word("clamp").map_or(p.clamp, |word| match word {
            "gsplat" => TangentClamp::Gsplat,
            "inria" => TangentClamp::Inria,
            other => unreachable!("clamp {other}"),
        });
        p.footprint = settings.given_word("footprint").map_or(p.footprint, |word| match word {
            "alpha" => Footprint::Alpha,
            "inria" => Footprint::Inria,
            other => unreachable!("footprint {other}"),
        });
        p.camera = Model::of(settings.word("camera"));
        p
    }
}
