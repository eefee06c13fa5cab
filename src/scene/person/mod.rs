//! A person that moves before cameras: validated template, poses, cameras, split; images on demand.
//!
//! ```text
//! io::person (records) ──► check ──► PersonCapture ──┬─ template   points, weights, joints at rest      (records)
//!                            │                       ├─ poses      one per moment                       (pose)
//!                            └─ every problem        ├─ shots      camera, moment, image; split
//!                                                    └─ box_mask   the pixels that count                (region)
//! io::captures, io::smpl ──► import ──► the layout on disk                                              (of the member import)
//! ```
//!
//! The layout is that of [`crate::io::person`]. A [`PersonCapture`] is always consistent: as many poses as
//! moments, images and masks of the declared sizes, weights that sum to 1, joints without a cycle, finite
//! numbers.

mod check;
mod pose;
mod records;
mod region;

pub use pose::{rotation_matrix, rotation_vector};
pub use records::{Affine, INFLUENCES, Kind, PersonCapture, Photo, Pose, Shot, Template};

use crate::io::image_file::{self, Encoding};
use crate::io::person;
use crate::{Error, Result};
use std::path::Path;

impl PersonCapture {
    /// Opens a capture and checks everything but the pixels. Images are read by [`Shot::photo`].
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

    /// All problems of a capture, and its valid part: the images whose files exist, if the body is complete.
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
    /// When an image is damaged, not sRGB-encoded, or of another size than the camera's.
    pub fn photo(&self) -> Result<Photo> {
        let (w, h) = (self.camera.width, self.camera.height);
        let read = |path: &Path, at: &str| {
            let p = image_file::read(path)?;
            if (p.width, p.height) != (w, h) {
                return Err(check::size_error(path, at, [p.width, p.height], [w, h]));
            }
            Ok(p)
        };
        let image = read(&self.image, "image size")?;
        if image.encoding != Encoding::Srgb {
            return Err(Error::input(self.image.display().to_string())
                .at("encoding")
                .expected("an sRGB-encoded photo (PNG, JPEG, WebP, TIFF or BMP)")
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
