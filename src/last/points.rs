//! Points of a person and how they are drawn: as discs or as Gaussians.

use crate::io::image_file;
use crate::scene::camera::Camera;
use crate::splat::discs;
use crate::splat::render::{Color, In, Settings, Shape};
use crate::{Error, Result};
use data_gen::figure::template::Cloud;

/// Radius of a disc in units of the mean distance to the three nearest points.
pub const DISC: f64 = 0.9;

/// Standard deviation of a Gaussian in the same units.
pub const SIGMA: f64 = 0.6;

/// Its opacity.
pub const OPACITY: f32 = 0.95;

/// What is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// textured surfaces
    Mesh,
    /// points as discs
    Discs,
    /// points as isotropic Gaussians
    Splats,
}

impl Look {
    /// Its name in settings and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mesh => "mesh",
            Self::Discs => "points",
            Self::Splats => "splats",
        }
    }

    /// The look of that name.
    ///
    /// # Errors
    /// When there is none.
    pub fn parse(name: &str) -> Result<Self> {
        match name {
            "mesh" => Ok(Self::Mesh),
            "points" => Ok(Self::Discs),
            "splats" => Ok(Self::Splats),
            other => Err(Error::input("look").expected("mesh, points or splats").got(other)),
        }
    }
}

/// A small picture: bytes of the sRGB-encoded colours on black, and of the covered share.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photo {
    /// (H, W, 3)
    pub image: Vec<u8>,
    /// (H, W)
    pub mask: Vec<u8>,
}

/// A cloud in single precision.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    /// (P, 3) the figure's frame
    pub points: Vec<[f32; 3]>,
    /// (P, 3) sRGB-encoded
    pub rgb: Vec<[f32; 3]>,
}

impl From<&Cloud> for Points {
    fn from(cloud: &Cloud) -> Self {
        Self {
            points: cloud.points.iter().map(single).collect(),
            rgb: cloud.rgb.iter().map(single).collect(),
        }
    }
}

/// How large points are drawn.
#[derive(Clone, Debug)]
pub struct Dots {
    /// (P) mean distance to the three nearest other points at rest
    pub spacing: Vec<f64>,
    radii: Vec<f32>,
    sigmas: Vec<[f32; 3]>,
}

impl Dots {
    /// For points of that spacing.
    pub fn new(spacing: Vec<f64>) -> Self {
        Self {
            radii: spacing.iter().map(|s| (DISC * s) as f32).collect(),
            sigmas: spacing.iter().map(|s| [(SIGMA * s) as f32; 3]).collect(),
            spacing,
        }
    }

    /// A picture of them, as discs or as Gaussians.
    ///
    /// # Errors
    /// When the camera is not valid.
    ///
    /// # Panics
    /// When asked for surfaces.
    pub fn photo(&self, points: &Points, camera: &Camera, look: Look) -> Result<Photo> {
        let (image, alpha) = match look {
            Look::Discs => {
                let p = discs::render(&points.points, &self.radii, &points.rgb, camera, [0.0; 3])?;
                (p.image.into_flattened(), p.alpha)
            }
            Look::Splats => {
                let quats = vec![[1.0, 0.0, 0.0, 0.0]; points.points.len()];
                let opacities = vec![OPACITY; points.points.len()];
                let x = In {
                    means: &points.points,
                    shape: Shape::QuatScale { quats: &quats, scales: &self.sigmas },
                    opacities: &opacities,
                    color: Color::Rgb(&points.rgb),
                    cameras: std::slice::from_ref(camera),
                    background: [0.0; 3],
                };
                let settings = Settings::default();
                x.validate(&settings)?;
                let (out, _) = crate::splat::render::forward(&x, &settings);
                (out.image, out.alpha)
            }
            Look::Mesh => unreachable!("surfaces are rendered from an object"),
        };
        Ok(Photo { image: image_file::to_u8(&image)?, mask: image_file::to_u8(&alpha)? })
    }
}

/// In single precision.
pub(super) fn single(x: &[f64; 3]) -> [f32; 3] {
    x.map(|x| x as f32)
}
