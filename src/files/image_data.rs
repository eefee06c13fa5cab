//! Images as records: size, channels and values as a file stores them.

use crate::{Error, Result};

/// Largest image side that is read, in pixels.
pub const MAX_SIDE: usize = 16_384;

/// Encoding of the values of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// sRGB-encoded, 0 to 1
    Srgb,
    /// proportional to radiance (or a depth, a normal), any finite value
    Linear,
}

/// Values of an image as the file stores them.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 0 to 255 for 0 to 1
    U8(Vec<u8>),
    /// 0 to 65 535 for 0 to 1
    U16(Vec<u16>),
    /// linear values, unscaled
    F32(Vec<f32>),
}

/// An image.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Names of the channels: Y, YA, RGB, RGBA, or those of the EXR file.
    pub channels: Vec<String>,
    /// Encoding of the values.
    pub encoding: Encoding,
    /// (H, W, C) row-major.
    pub samples: Samples,
}

impl Picture {
    /// Value `i` in file encoding: x/255, x/65535, or x itself.
    pub fn value(&self, i: usize) -> f32 {
        match &self.samples {
            Samples::U8(v) => f32::from(v[i]) / 255.0,
            Samples::U16(v) => f32::from(v[i]) / 65535.0,
            Samples::F32(v) => v[i],
        }
    }

    /// All values, (H, W, C) row-major.
    pub fn values(&self) -> Vec<f32> {
        (0..self.width * self.height * self.channels.len()).map(|i| self.value(i)).collect()
    }
}

/// Checks a declared size: sides, and pixels against the length of the file.
pub(super) fn check_size(w: u64, h: u64, bytes: usize, pixels_per_byte: u64, name: &str) -> Result<()> {
    let side = MAX_SIDE as u64;
    let bound = bytes as u64 * pixels_per_byte;
    if w == 0 || h == 0 || w > side || h > side || w * h > bound {
        return Err(Error::input(name)
            .at("image size")
            .expected(format!("1 to {side} pixels a side, and no more pixels than {bytes} bytes can hold"))
            .got(format!("{w}x{h}")));
    }
    Ok(())
}
