//! Inputs and settings of the renderer, with checks of their consistency.

use crate::math::sh::MAX_DEGREE;
use crate::scene::camera::Camera;
use crate::scene::profile::{Footprint, Profile};
use crate::splat::color::Sh;
use crate::splat::covariance;
use crate::splat::plan::Grid;
use crate::{Error, Result};

/// Shape of the Gaussians.
#[derive(Clone, Copy, Debug)]
pub enum Shape<'a> {
    /// Rotation and scales.
    QuatScale {
        /// Quaternions, shape (N, 4), wxyz, any length but zero.
        quats: &'a [[f32; 4]],
        /// Standard deviations, shape (N, 3), not their logarithms.
        scales: &'a [[f32; 3]],
    },
    /// Factors, shape (N, 3, 3), row-major, Σ = F Fᵀ.
    Factors(&'a [[f32; 9]]),
}

/// Colour of the Gaussians.
#[derive(Clone, Copy, Debug)]
pub enum Color<'a> {
    /// Spherical-harmonics coefficients.
    Sh(Sh<'a>),
    /// Shape (N, 3).
    Rgb(&'a [[f32; 3]]),
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, 3).
    pub means: &'a [[f32; 3]],
    /// Rotation and scales, or factors.
    pub shape: Shape<'a>,
    /// Opacities, shape (N), in 0..1.
    pub opacities: &'a [f32],
    /// Spherical harmonics or rgb.
    pub color: Color<'a>,
    /// Cameras, shape (C), all with the same image size.
    pub cameras: &'a [Camera],
    /// Shape (3).
    pub background: [f32; 3],
}

/// Settings of the renderer.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Profile with the constants of the renderer.
    pub profile: Profile,
    /// Side of a tile: 16, or 8 and 32 for images without gradients. It affects no result.
    pub tile: usize,
    /// Whether tiles and rows are skipped by exact ellipses; this affects no result.
    pub cull: bool,
    /// Whether the adjoint also sums |∂L/∂u| over pixels.
    pub absgrad: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { profile: Profile::EXACT, tile: 16, cull: true, absgrad: false }
    }
}

impl In<'_> {
    /// Checks that lengths agree, that all cameras have the same image size, and that the settings are valid.
    ///
    /// # Errors
    /// Returns an error that names the array.
    pub fn validate(&self, settings: &Settings) -> Result<()> {
        let n = self.means.len();
        let length = |name: &str, got: usize| {
            if got == n {
                Ok(())
            } else {
                Err(Error::input("splat.render")
                    .at(name)
                    .expected(format!("N = {n} rows"))
                    .got(got.to_string()))
            }
        };
        length("opacities", self.opacities.len())?;
        match self.shape {
            Shape::QuatScale { quats, scales } => {
                length("quats", quats.len())?;
                length("scales", scales.len())?;
            }
            Shape::Factors(f) => length("factors", f.len())?,
        }
        match self.color {
            Color::Sh(sh) => {
                length("sh", sh.values.len() / (3 * sh.coefficients))?;
                if (sh.degree + 1) * (sh.degree + 1) > sh.coefficients || sh.degree > MAX_DEGREE {
                    return Err(Error::input("splat.render")
                        .at("sh_degree")
                        .expected(format!("at most 3, with (degree+1)² ≤ K = {}", sh.coefficients))
                        .got(sh.degree.to_string()));
                }
            }
            Color::Rgb(rgb) => length("rgb", rgb.len())?,
        }
        let Some(first) = self.cameras.first() else {
            return Err(Error::input("splat.render").at("cameras").expected("at least one").got("none"));
        };
        for camera in self.cameras {
            camera.validate()?;
            if (camera.width, camera.height) != (first.width, first.height) {
                return Err(Error::input("splat.render")
                    .at("cameras")
                    .expected("the same image size for all cameras")
                    .got("several"));
            }
        }
        let tile_fits = match settings.profile.footprint {
            Footprint::Alpha => matches!(settings.tile, 8 | 16 | 32),
            Footprint::Inria3Sigma => settings.tile == 16,
        };
        if !tile_fits {
            return Err(Error::input("setting tile")
                .expected("8, 16 or 32; 16 in profile inria")
                .got(settings.tile.to_string()));
        }
        Ok(())
    }

    /// Returns the image size, and the tiles of the side in the settings.
    pub(super) fn grid(&self, settings: &Settings) -> Grid {
        Grid { width: self.cameras[0].width, height: self.cameras[0].height, tile: settings.tile }
    }

    /// Returns the factors of the rows `from..to`; they are computed in `buffer` if necessary.
    pub(super) fn factors<'b>(
        &'b self,
        from: usize,
        to: usize,
        buffer: &'b mut Vec<[f32; 9]>,
    ) -> &'b [[f32; 9]] {
        match self.shape {
            Shape::Factors(f) => &f[from..to],
            Shape::QuatScale { quats, scales } => {
                buffer.resize(to - from, [0.0; 9]);
                covariance::forward_rows(&quats[from..to], &scales[from..to], buffer);
                buffer
            }
        }
    }
}
