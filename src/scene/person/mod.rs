//! A person that moves before cameras: validated template, poses, cameras, split; pictures on demand.
//!
//! ```text
//! io::person (records) ──► check ──► PersonCapture ──┬─ template   points, weights, joints at rest      (template)
//!                            │                       ├─ poses      one per moment                       (pose)
//!                            └─ every problem        ├─ shots      camera, moment, picture; split
//!                                                    └─ box_mask   the pixels that count                (region)
//! io::captures, io::smpl ──► import ──► the layout on disk                                              (import, smpl)
//! ```
//!
//! The layout is that of [`crate::io::person`]. Whoever has a [`PersonCapture`] has consistent data: as many poses as moments, pictures
//! and masks of the declared sizes, weights that sum to 1, joints without a cycle, finite numbers.

mod check;
pub mod import;
mod pose;
mod region;
pub mod smpl;

pub use pose::{Affine, Pose, rotation_matrix, rotation_vector};

use super::camera::Camera;
use crate::io::capture::Split;
use crate::io::image_file::{self, Encoding};
use crate::io::person;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Weights a point keeps.
pub const INFLUENCES: usize = 4;

/// What kind of body moves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The built-in figure.
    Figure,
    /// A skinned character from a file.
    Character,
    /// SMPL: 24 joints.
    Smpl,
    /// SMPL-X: 55 joints.
    SmplX,
    /// Something else.
    Other(String),
}

impl Kind {
    /// From the key `kind` of a capture.
    pub fn parse(name: &str) -> Self {
        match name {
            "figure" => Self::Figure,
            "character" => Self::Character,
            "smpl" => Self::Smpl,
            "smplx" => Self::SmplX,
            other => Self::Other(other.to_owned()),
        }
    }

    /// The name captures write.
    pub fn name(&self) -> &str {
        match self {
            Self::Figure => "figure",
            Self::Character => "character",
            Self::Smpl => "smpl",
            Self::SmplX => "smplx",
            Self::Other(name) => name,
        }
    }
}

/// The body at rest and how its points hang on its joints. P points, K joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// What kind of body it is.
    pub kind: Kind,
    /// Metres per scene unit.
    pub unit_m: f64,
    /// (P) at rest
    pub points: Vec<[f32; 3]>,
    /// (P) at rest, or empty
    pub normals: Vec<[f32; 3]>,
    /// (F) triangles over the points; may be empty
    pub faces: Vec<[u32; 3]>,
    /// (P) the four joints of largest weight, largest first, ties by the smaller joint; unused places have weight 0
    pub joint_of: Vec<[u16; INFLUENCES]>,
    /// (P) their weights, ≥ 0, summing to 1
    pub weight_of: Vec<[f32; INFLUENCES]>,
    /// (K) positions at rest
    pub joints: Vec<[f32; 3]>,
    /// (K) the joint each hangs on; no cycle
    pub parents: Vec<Option<usize>>,
    /// (K) every joint once, parents before children
    pub order: Vec<usize>,
    /// (K) canonical pose from rest; identities where rest is canonical
    pub canonical: Vec<Affine>,
    /// (P, 3, 9(K−1)) row-major: how points move with the rotations of a pose, before skinning
    pub pose_shapes: Option<Vec<f32>>,
}

/// One picture of the person.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Relative path of the picture.
    pub name: String,
    /// Moment: index of [`PersonCapture::poses`].
    pub time: usize,
    /// Number of the camera, as the capture says.
    pub camera_id: usize,
    /// Its camera; ideal, of the size of the picture.
    pub camera: Camera,
    /// Train, val or test.
    pub split: Split,
    image: PathBuf,
    foreground: PathBuf,
    valid: Option<PathBuf>,
}

/// The pixels of a shot, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// (H, W, 3) sRGB-encoded, the person on black
    pub rgb: Vec<u8>,
    /// (H, W) share covered by the person, 0..1
    pub mask: Vec<f32>,
    /// (H, W) 1 where the pixel counts; absent if all do
    pub valid: Option<Vec<u8>>,
}

/// A capture of a moving person.
#[derive(Clone, Debug, PartialEq)]
pub struct PersonCapture {
    /// Its folder.
    pub folder: PathBuf,
    /// The body.
    pub template: Template,
    /// (T) one per moment
    pub poses: Vec<Pose>,
    /// (T) numbers of the moments in the source; 0 … T−1 if it does not say
    pub numbers: Vec<i64>,
    /// (T) causes, where they are known; else empty
    pub factors: Vec<Vec<f64>>,
    /// All pictures: training, validation, test, each by (camera, moment).
    pub shots: Vec<Shot>,
    /// Indices of the pictures to learn from, by (moment, camera).
    pub train: Vec<usize>,
    /// Indices of the pictures held out, by (moment, camera).
    pub test: Vec<usize>,
    /// What the box around the posed points gets on every side, scene units.
    pub box_margin: f32,
    /// Things worth knowing that are no errors, a sentence each.
    pub notes: Vec<String>,
}

impl PersonCapture {
    /// Opens a capture and checks everything but the pixels. Pictures are read by [`Shot::photo`].
    ///
    /// # Errors
    /// With the first of the problems that [`Self::examine`] finds.
    pub fn open(path: &Path) -> Result<Self> {
        let (capture, problems) = Self::examine(path)?;
        match problems.into_iter().next() {
            Some(e) => Err(e),
            None => capture.ok_or_else(|| {
                Error::input(path.display().to_string()).expected("a person's capture").got("nothing")
            }),
        }
    }

    /// Everything that is wrong with a capture, and what could be made of it all the same: pictures whose files are there, if the body is whole.
    ///
    /// # Errors
    /// When there is nothing to examine.
    pub fn examine(path: &Path) -> Result<(Option<Self>, Vec<Error>)> {
        Ok(check::check(person::read(path)?))
    }

    /// Number of moments T.
    pub fn moments(&self) -> usize {
        self.poses.len()
    }
}

impl Shot {
    /// Reads its pixels.
    ///
    /// # Errors
    /// When a picture is damaged, not sRGB-encoded, or of another size than the camera's.
    pub fn photo(&self) -> Result<Photo> {
        let (w, h) = (self.camera.width, self.camera.height);
        let read = |path: &Path, at: &str| {
            let p = image_file::read(path)?;
            if (p.width, p.height) != (w, h) {
                return Err(check::size_error(path, at, [p.width, p.height], [w, h]));
            }
            Ok(p)
        };
        let image = read(&self.image, "picture size")?;
        if image.encoding != Encoding::Srgb {
            return Err(Error::input(self.image.display().to_string())
                .at("encoding")
                .expected("an sRGB-encoded photograph (PNG or JPEG)")
                .got("linear values"));
        }
        let c = image.channels.len();
        let rgb = (0..w * h)
            .flat_map(|i| {
                let alpha = if c.is_multiple_of(2) { image.value(i * c + c - 1) } else { 1.0 };
                let x: [f32; 3] =
                    std::array::from_fn(|k| image.value(i * c + if c < 3 { 0 } else { k }) * alpha);
                x
            })
            .collect::<Vec<f32>>();
        let first = |path: &Path, at: &str| -> Result<Vec<f32>> {
            let p = read(path, at)?;
            let c = p.channels.len();
            // Alpha where there is one, else the first channel.
            let channel = if c.is_multiple_of(2) { c - 1 } else { 0 };
            Ok((0..w * h).map(|i| p.value(i * c + channel)).collect())
        };
        let mask = first(&self.foreground, "mask size")?;
        let valid = match &self.valid {
            Some(path) => Some(first(path, "mask size")?.into_iter().map(|x| u8::from(x >= 0.5)).collect()),
            None => None,
        };
        Ok(Photo { rgb: image_file::to_u8(&rgb)?, mask, valid })
    }
}
