//! Points of a person, and rendering them as discs or as Gaussians.

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

/// Opacity of a Gaussian.
pub const OPACITY: f32 = 0.95;

/// How a subject is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rendering {
    /// As textured surfaces.
    Mesh,
    /// As points drawn as discs.
    Discs,
    /// As points drawn as isotropic Gaussians.
    Splats,
}

impl Rendering {
    /// The name used in settings and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mesh => "mesh",
            Self::Discs => "points",
            Self::Splats => "splats",
        }
    }

    /// The value with the given name.
    ///
    /// # Errors
    /// If there is no such name.
    pub fn parse(name: &str) -> Result<Self> {
        match name {
            "mesh" => Ok(Self::Mesh),
            "points" => Ok(Self::Discs),
            "splats" => Ok(Self::Splats),
            other => Err(Error::input("look").expected("mesh, points or splats").got(other)),
        }
    }
}

/// A small image: the sRGB-encoded colours over black and the coverage, as bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photo {
    /// Colours, shape (H, W, 3).
    pub image: Vec<u8>,
    /// Coverage, shape (H, W).
    pub mask: Vec<u8>,
}

/// A set of coloured points in single precision.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    /// Positions in the figure frame, shape (P, 3).
    pub points: Vec<[f32; 3]>,
    /// Colours, sRGB-encoded, shape (P, 3).
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

/// Sizes at which points are drawn.
#[derive(Clone, Debug)]
pub struct Dots {
    /// Mean distance to the three nearest other points at rest, shape (P).
    pub spacing: Vec<f64>,
    radii: Vec<f32>,
    sigmas: Vec<[f32; 3]>,
}

impl Dots {
    /// Sizes for points of the given spacing.
    pub fn new(spacing: Vec<f64>) -> Self {
        Self {
            radii: spacing.iter().map(|s| (DISC * s) as f32).collect(),
            sigmas: spacing.iter().map(|s| [(SIGMA * s) as f32; 3]).collect(),
            spacing,
        }
    }

    /// Renders the points as discs or as Gaussians.
    ///
    /// # Errors
    /// If the camera is invalid.
    ///
    /// # Panics
    /// If surfaces are requested.
    pub fn photo(&self, points: &Points, camera: &Camera, look: Rendering) -> Result<Photo> {
        let (image, alpha) = match look {
            Rendering::Discs => {
                let p = discs::render(&points.points, &self.radii, &points.rgb, camera, [0.0; 3])?;
                (p.image.into_flattened(), p.alpha)
            }
            Rendering::Splats => {
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
            Rendering::Mesh => unreachable!("surfaces are rendered from an object"),
        };
        Ok(Photo { image: image_file::to_u8(&image)?, mask: image_file::to_u8(&alpha)? })
    }
}

/// A vector in single precision.
pub(super) fn single(x: &[f64; 3]) -> [f32; 3] {
    x.map(|x| x as f32)
}
