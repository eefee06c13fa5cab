//! Light: environment maps in one orientation, points, and distant sources.
//!
//! An environment map is a latitude–longitude image of linear radiance, row-major, top row up. The direction
//! (x, y, z) it shows at column centre u and row centre v (0..1) is, with z up,
//!
//! ```text
//! u = atan2(x, y)/2π + ½        v = acos(z)/π
//! u = ½ (centre) is +y,  u = ¾ is +x,  u = 0 and 1 are −y,  u = ¼ is −x;  v = 0 is +z
//! ```

use crate::{Error, Result};

/// Largest radiance, intensity or irradiance of a source: sums over samples and texels stay within f32.
pub const MAX_RADIANCE: f32 = 1e24;

/// A latitude–longitude map of linear radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Columns of azimuth.
    pub width: usize,
    /// Rows of inclination, top is +z.
    pub height: usize,
    /// (H, W) linear RGB radiance, 0 to [`MAX_RADIANCE`]
    pub radiance: Vec<[f32; 3]>,
}

/// A source without extent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lamp {
    /// At a place: irradiance on a facing surface at distance d is intensity/d², and not above
    /// [`MAX_RADIANCE`].
    Point {
        /// scene units
        position: [f32; 3],
        /// linear RGB, radiant intensity
        intensity: [f32; 3],
    },
    /// At infinity.
    Distant {
        /// unit vector towards the source
        towards: [f32; 3],
        /// linear RGB irradiance on a facing surface
        irradiance: [f32; 3],
    },
}

/// All light of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lights {
    /// Surrounds the scene; absent: black.
    pub environment: Option<Environment>,
    /// In the order they are summed.
    pub lamps: Vec<Lamp>,
}

impl Environment {
    /// The same radiance from everywhere.
    pub fn constant(radiance: [f32; 3]) -> Self {
        Self { width: 2, height: 1, radiance: vec![radiance; 2] }
    }

    /// Checks sizes and values.
    ///
    /// # Errors
    /// Names the texel; `name` is the name of the map in errors.
    pub fn validate(&self, name: &str) -> Result<()> {
        if self.width == 0 || self.height == 0 || self.radiance.len() != self.width * self.height {
            return Err(Error::input(name)
                .at("size")
                .expected("width × height texels, at least one")
                .got(format!("{}×{} with {}", self.width, self.height, self.radiance.len())));
        }
        match self.radiance.iter().position(|t| !t.iter().all(|x| (0.0..=MAX_RADIANCE).contains(x))) {
            None => Ok(()),
            Some(i) => Err(Error::input(name)
                .at(format!("row {}, column {}", i / self.width, i % self.width))
                .expected(format!("radiance from 0 to {MAX_RADIANCE:e}"))
                .got(format!("{:?}", self.radiance[i]))),
        }
    }
}
