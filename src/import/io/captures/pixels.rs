//! Where the pixels of a source come from: image files, containers, arrays.

use crate::io::hdf5::Hdf5;
use crate::io::image_file::{self, Samples};
use crate::io::{MAX_SMALL_FILE_BYTES, name_of, npz, read_bytes};
use crate::{Error, Result};
use std::path::PathBuf;
use std::sync::Arc;

/// First bytes of a JPEG.
const JPEG: [u8; 3] = [0xff, 0xd8, 0xff];

/// Where pixels come from.
#[derive(Clone, Debug)]
pub enum Pixels {
    /// An image file.
    Picture(PathBuf),
    /// An encoded image in a container: path of the data set.
    Encoded(Arc<Container>, String),
    /// A row of a data set (n, H, W).
    Row(Arc<Container>, String, usize),
    /// A `.npy` of shape (H, W).
    Array(PathBuf),
}

/// An open HDF5 file that pixels come from.
#[derive(Debug)]
pub struct Container(pub(in crate::io) Hdf5);

impl Pixels {
    /// Name in messages.
    pub fn name(&self) -> String {
        match self {
            Self::Picture(p) | Self::Array(p) => name_of(p),
            Self::Encoded(c, at) | Self::Row(c, at, _) => format!("{}: '{at}'", c.0.name()),
        }
    }

    /// A photo: bytes (H, W, 3) with width and height.
    ///
    /// # Errors
    /// When it cannot be read or is no image of colours or greys in 8 bits.
    pub fn photograph(&self) -> Result<(Vec<u8>, [usize; 2])> {
        let name = self.name();
        let bytes = match self {
            Self::Picture(p) => read_bytes(p, MAX_SMALL_FILE_BYTES)?,
            Self::Encoded(c, at) => c.0.bytes(at)?,
            _ => return Err(Error::input(name).expected("an encoded image").got("an array")),
        };
        let p = image_file::parse(&bytes, &name)?;
        let Samples::U8(values) = &p.samples else {
            return Err(Error::input(name).at("samples").expected("8 bits").got("more"));
        };
        let c = p.channels.len();
        // Colours as they are: alpha, where a file has it, is the mask's business.
        let rgb =
            values.chunks_exact(c).flat_map(|px| if c < 3 { [px[0]; 3] } else { [px[0], px[1], px[2]] });
        Ok((rgb.collect(), [p.width, p.height]))
    }

    /// A mask: 1 where a value is not zero (in an image of colours: any channel but alpha), with width and
    /// height. In a JPEG, whose edges ring, 1 where it is above ½.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn mask(&self) -> Result<(Vec<u8>, [usize; 2])> {
        let name = self.name();
        let of_picture = |bytes: &[u8]| {
            let p = image_file::parse(bytes, &name)?;
            let c = p.channels.len();
            let colours = if c.is_multiple_of(2) { c - 1 } else { c };
            let above = if bytes.starts_with(&JPEG) { 0.5 } else { 0.0 };
            let any = |i: usize| u8::from((0..colours).any(|k| p.value(i * c + k) > above));
            Ok(((0..p.width * p.height).map(any).collect(), [p.width, p.height]))
        };
        match self {
            Self::Picture(p) => of_picture(&read_bytes(p, MAX_SMALL_FILE_BYTES)?),
            Self::Encoded(c, at) => of_picture(&c.0.bytes(at)?),
            Self::Row(c, at, i) => {
                let (values, [h, w]) = c.0.row(at, *i)?;
                Ok((values.iter().map(|&v| u8::from(v != 0)).collect(), [w, h]))
            }
            Self::Array(path) => {
                let arrays = npz::read(path)?;
                let a = arrays.0.into_values().next();
                let a = a.ok_or_else(|| Error::input(name.clone()).expected("an array").got("none"))?;
                let &[h, w] = a.shape() else {
                    return Err(Error::input(name).expected("shape (H, W)").got(format!("{:?}", a.shape())));
                };
                Ok((a.to_f64().iter().map(|&v| u8::from(v > 0.0)).collect(), [w, h]))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, Luma};

    #[test]
    fn edges_of_a_jpeg_are_no_part_of_the_mask() {
        let dir = tempfile::tempdir().expect("a folder");
        let is_inside = |x: u32, y: u32| (x as i32 - 15).pow(2) + (y as i32 - 17).pow(2) < 90;
        let picture = GrayImage::from_fn(32, 32, |x, y| Luma([if is_inside(x, y) { 255 } else { 0 }]));
        for name in ["mask.png", "mask.jpg"] {
            let path = dir.path().join(name);
            picture.save(&path).expect("written");
            let (mask, size) = Pixels::Picture(path).mask().expect("read");
            assert_eq!(size, [32, 32]);
            let wrong =
                (0..1024u32).filter(|i| (mask[*i as usize] == 1) != is_inside(i % 32, i / 32)).count();
            assert!(wrong <= if name == "mask.png" { 0 } else { 10 }, "{name}: {wrong} pixels");
        }
    }
}
