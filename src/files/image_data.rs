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

/// How the stored pixels are turned to be upright, as EXIF defines it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orientation(u8);

impl Orientation {
    /// Upright as stored.
    pub const STORED: Self = Self(1);

    /// The orientation of the EXIF value 1 to 8; any other value is that of stored pixels.
    pub fn of_exif(value: u8) -> Self {
        if (1..=8).contains(&value) { Self(value) } else { Self::STORED }
    }

    /// Whether width and height are exchanged.
    pub fn swaps_sides(self) -> bool {
        self.0 >= 5
    }

    /// Column and row of the stored pixel (of `w` × `h`) that is at (x, y) of the upright image.
    fn stored(self, [x, y]: [usize; 2], [w, h]: [usize; 2]) -> [usize; 2] {
        match self.0 {
            2 => [w - 1 - x, y],
            3 => [w - 1 - x, h - 1 - y],
            4 => [x, h - 1 - y],
            5 => [y, x],
            6 => [y, h - 1 - x],
            7 => [w - 1 - y, h - 1 - x],
            8 => [w - 1 - y, x],
            _ => [x, y],
        }
    }
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
    /// How it is turned to be upright; `samples` are as stored.
    pub orientation: Orientation,
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

    /// The upright image: pixels turned as [`Self::orientation`] demands.
    #[must_use]
    pub fn upright(self) -> Self {
        let turned = self.orientation;
        self.turned(turned)
    }

    /// The image with pixels turned by an orientation, upright as it is then stored.
    #[must_use]
    pub fn turned(self, by: Orientation) -> Self {
        if by == Orientation::STORED {
            return Self { orientation: Orientation::STORED, ..self };
        }
        let stored = [self.width, self.height];
        let [width, height] = if by.swaps_sides() { [stored[1], stored[0]] } else { stored };
        let channels = self.channels.len();
        let mut order = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let [column, row] = by.stored([x, y], stored);
                order.push(channels * (row * stored[0] + column));
            }
        }
        let samples = match self.samples {
            Samples::U8(v) => Samples::U8(gather(&v, &order, channels)),
            Samples::U16(v) => Samples::U16(gather(&v, &order, channels)),
            Samples::F32(v) => Samples::F32(gather(&v, &order, channels)),
        };
        Self { width, height, samples, orientation: Orientation::STORED, ..self }
    }

    /// All values, (H, W, C) row-major.
    pub fn values(&self) -> Vec<f32> {
        (0..self.width * self.height * self.channels.len()).map(|i| self.value(i)).collect()
    }
}

/// Runs of `channels` values at the given places.
fn gather<T: Copy>(values: &[T], order: &[usize], channels: usize) -> Vec<T> {
    order.iter().flat_map(|&at| values[at..at + channels].iter().copied()).collect()
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
