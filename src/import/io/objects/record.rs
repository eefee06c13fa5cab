//! The records of a set, and how its files are found.

use crate::io::capture::Split;
use crate::io::name_of;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Layout of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Stanford-ORB
    Orb,
    /// renders of the Digital Twin Catalog and of LIRM
    Dtc,
}

impl Layout {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Orb => "Stanford-ORB",
            Self::Dtc => "DTC renders",
        }
    }
}

/// Axes in which normals are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// those of the world
    World,
    /// OpenGL axes of the camera
    Camera,
}

/// Which list of the capture an image belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// training or held-out images, or images without a split
    Own(Split),
    /// images under another light
    Novel,
}

/// One image. Paths are those of files that were there.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectShot {
    /// Name without an ending, unique in the set.
    pub name: String,
    /// Its list.
    pub part: Part,
    /// sRGB-encoded photo.
    pub photo: Option<PathBuf>,
    /// Linear radiance.
    pub radiance: Option<PathBuf>,
    /// Mask of the object.
    pub mask: PathBuf,
    /// World to camera, camera axes x right, y down, z forward.
    pub view_from_world: [[f64; 4]; 4],
    /// Horizontal field of view in radians.
    pub fov_x_rad: f64,
    /// Width and height that the set declares.
    pub size: Option<[usize; 2]>,
    /// Factor from radiance to the photo.
    pub exposure: Option<f64>,
    /// Depth z.
    pub depth: Option<PathBuf>,
    /// Normals.
    pub normal: Option<PathBuf>,
    /// Axes of the normals.
    pub normal_axes: Axes,
    /// sRGB-encoded albedo.
    pub albedo: Option<PathBuf>,
    /// Metallic, roughness.
    pub material: Option<PathBuf>,
    /// Environment map.
    pub environment: Option<PathBuf>,
}

/// A set of images of one object.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectSet {
    /// Layout it was read from.
    pub layout: Layout,
    /// Its images, by part and name.
    pub shots: Vec<ObjectShot>,
    /// The scanned surface, in the axes of the world.
    pub scan: Option<PathBuf>,
}

/// The file, if it is there.
pub(super) fn there(path: PathBuf) -> Option<PathBuf> {
    path.is_file().then_some(path)
}

/// A file that a list names.
pub(super) fn required(path: PathBuf, list: &Path, entry: &str) -> Result<PathBuf> {
    if path.is_file() {
        return Ok(path);
    }
    Err(Error::input(name_of(list))
        .at(entry.to_owned())
        .expected("its files")
        .got(format!("no {}", path.display())))
}
