//! A person before cameras, as data: template, poses, shots.

use crate::io::capture::Split;
use crate::scene::camera::Camera;
use reference::body::skin;
use std::path::PathBuf;

/// Upper three rows of an affine transform, row-major.
pub type Affine = skin::Affine<f32>;

/// The body at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// (K) world from rest: x' = Σ_k w_k A_k x
    pub transforms: Vec<Affine>,
    /// (K) axis-angle of each joint relative to its parent, rad; from the file, or that of the rotations in
    /// `transforms` (then the root's holds the global rotation)
    pub axis_angles: Vec<[f32; 3]>,
    /// Rh and Th, where the file has them: contained in `transforms`.
    pub global: Option<[[f32; 3]; 2]>,
}

/// Weights a point keeps.
pub const INFLUENCES: usize = 4;

/// Kind of body.
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

    /// The name in captures.
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

/// The body at rest and the weights that bind its points to its joints. P points, K joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// Kind of body.
    pub kind: Kind,
    /// Metres per scene unit.
    pub unit_m: f64,
    /// (P) at rest
    pub points: Vec<[f32; 3]>,
    /// (P) at rest, or empty
    pub normals: Vec<[f32; 3]>,
    /// (F) triangles over the points; may be empty
    pub faces: Vec<[u32; 3]>,
    /// (P) the four joints of largest weight, largest first, ties by the smaller joint; unused places have
    /// weight 0
    pub joint_of: Vec<[u16; INFLUENCES]>,
    /// (P) their weights, ≥ 0, summing to 1
    pub weight_of: Vec<[f32; INFLUENCES]>,
    /// (K) positions at rest
    pub joints: Vec<[f32; 3]>,
    /// (K) the parent of each joint; no cycle
    pub parents: Vec<Option<usize>>,
    /// (K) every joint once, parents before children
    pub order: Vec<usize>,
    /// (K) canonical pose from rest; identities where rest is canonical
    pub canonical: Vec<Affine>,
    /// (P, 3, 9(K−1)) row-major: how points move with the rotations of a pose, before skinning
    pub pose_shapes: Option<Vec<f32>>,
}

/// One image of the person.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Relative path of the image.
    pub name: String,
    /// Moment: index of [`PersonCapture::poses`].
    pub time: usize,
    /// Number of the camera in the capture.
    pub camera_id: usize,
    /// Its camera; ideal, of the size of the image.
    pub camera: Camera,
    /// Train, val or test.
    pub split: Split,
    pub(super) image: PathBuf,
    pub(super) foreground: PathBuf,
    pub(super) valid: Option<PathBuf>,
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
    /// (T) numbers of the moments in the source; 0 … T−1 if not specified
    pub numbers: Vec<i64>,
    /// (T) causal factors, if known; else empty
    pub factors: Vec<Vec<f64>>,
    /// All images: training, validation, test, each by (camera, moment).
    pub shots: Vec<Shot>,
    /// Indices of the training images, by (moment, camera).
    pub train: Vec<usize>,
    /// Indices of the held-out images, by (moment, camera).
    pub test: Vec<usize>,
    /// Margin of the box around the posed points, scene units.
    pub box_margin: f32,
    /// Notes for the user that are not errors, one sentence each.
    pub notes: Vec<String>,
}
