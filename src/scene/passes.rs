//! Passes that a renderer wrote for a photo, read from a capture: foreground, radiance, depth, normals,
//! albedo, material.

use crate::io::capture::Frame;
use crate::io::image_file::{self, Encoding, Picture};
use crate::{Error, Result};
use std::path::Path;

/// How far a normal may be from length 1.
const UNIT: f32 = 1e-3;

/// The passes of one photo; all of its size, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassImages {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// Coverage, 0..1.
    pub foreground: Option<Vec<f32>>,
    /// Linear RGB, before exposure.
    pub radiance: Option<Vec<[f32; 3]>>,
    /// Camera depth z, scene units; 0 where nothing is hit.
    pub depth: Option<Vec<f32>>,
    /// World, unit, or zero where nothing is hit.
    pub normal: Option<Vec<[f32; 3]>>,
    /// sRGB-encoded base colour, 0..1.
    pub albedo: Option<Vec<[f32; 3]>>,
    /// 0..1
    pub metallic: Option<Vec<f32>>,
    /// 0..1
    pub roughness: Option<Vec<f32>>,
    /// Factor from radiance to the photo.
    pub exposure: Option<f64>,
}

impl PassImages {
    /// Reads the passes a frame names.
    ///
    /// # Errors
    /// When a file is bad, has another size than the first, too few channels, the other encoding, or a value
    /// out of range.
    pub fn read(frame: &Frame) -> Result<Self> {
        let p = &frame.passes;
        let unit = |x: f32| (0.0..=1.0).contains(&x);
        let mut out = Self { exposure: p.exposure, ..Self::default() };
        if let Some(size) = frame.size {
            [out.width, out.height] = size;
        }
        if let Some(path) = &p.foreground {
            out.foreground = Some(out.load(path, None, |[x]| unit(*x))?.into_flattened());
        }
        if let Some(path) = &p.radiance {
            out.radiance =
                Some(out.load(path, Some(Encoding::Linear), |x: &[f32; 3]| x.iter().all(|v| *v >= 0.0))?);
        }
        if let Some(path) = &p.depth {
            out.depth = Some(out.load(path, Some(Encoding::Linear), |[z]| *z >= 0.0)?.into_flattened());
        }
        if let Some(path) = &p.normal {
            let normal = |x: &[f32; 3]| {
                let n = x[0] * x[0] + x[1] * x[1] + x[2] * x[2];
                n == 0.0 || (n - 1.0).abs() <= UNIT
            };
            out.normal = Some(out.load(path, Some(Encoding::Linear), normal)?);
        }
        if let Some(path) = &p.albedo {
            out.albedo = Some(out.load(path, Some(Encoding::Srgb), |_| true)?);
        }
        if let Some(path) = &p.material {
            let packed = out.load(path, None, |[m, r]| unit(*m) && unit(*r))?;
            out.metallic = Some(packed.iter().map(|x| x[0]).collect());
            out.roughness = Some(packed.iter().map(|x| x[1]).collect());
        }
        Ok(out)
    }

    /// Returns the passes of the image that is smaller by the factor `s`: means over blocks of s×s pixels. Those of depth and
    /// normals are over the pixels that are hit, those of albedo and material weighted by the foreground. Incomplete blocks at
    /// the right and bottom are left out.
    ///
    /// # Panics
    /// Panics if `s` is 0.
    #[must_use]
    pub fn reduced(&self, s: usize) -> Self {
        let (width, height) = (self.width / s, self.height / s);
        let blocks = Blocks { stride: self.width, width, height, s };
        let cover = |i: usize| self.foreground.as_ref().map_or(1.0, |m| m[i]);
        let scalar = |x: &Option<Vec<f32>>, weight: &dyn Fn(usize) -> f32| {
            x.as_ref().map(|x| blocks.means(&|i| [x[i]], weight).into_flattened())
        };
        let color = |x: &Option<Vec<[f32; 3]>>, weight: &dyn Fn(usize) -> f32| {
            x.as_ref().map(|x| blocks.means(&|i| x[i], weight))
        };
        let hit = |x: f32| f32::from(u8::from(x != 0.0));
        let depth = self.depth.as_deref().unwrap_or_default();
        let normal = self.normal.as_deref().unwrap_or_default();
        let facing = |i: usize| hit(normal[i].iter().fold(0.0, |sum, x| sum + x.abs()));
        let unit = |n: [f32; 3]| {
            let length = ((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2]).sqrt();
            if length > 0.0 { n.map(|x| x / length) } else { n }
        };
        Self {
            width,
            height,
            foreground: scalar(&self.foreground, &|_| 1.0),
            radiance: color(&self.radiance, &|_| 1.0),
            depth: scalar(&self.depth, &|i| hit(depth[i])),
            normal: color(&self.normal, &facing).map(|n| n.into_iter().map(unit).collect()),
            albedo: color(&self.albedo, &cover),
            metallic: scalar(&self.metallic, &cover),
            roughness: scalar(&self.roughness, &cover),
            exposure: self.exposure,
        }
    }

    /// The first N values of every pixel.
    fn load<const N: usize>(
        &mut self,
        path: &Path,
        encoding: Option<Encoding>,
        valid: impl Fn(&[f32; N]) -> bool,
    ) -> Result<Vec<[f32; N]>> {
        let name = path.display().to_string();
        let picture: Picture = image_file::read(path)?;
        if self.width == 0 {
            (self.width, self.height) = (picture.width, picture.height);
        }
        if (picture.width, picture.height) != (self.width, self.height) {
            return Err(Error::input(name)
                .at("image size")
                .expected(format!("{}x{}, as the photo", self.width, self.height))
                .got(format!("{}x{}", picture.width, picture.height)));
        }
        let stride = picture.channels.len();
        if stride < N {
            let e = Error::input(name).at("channels");
            return Err(e.expected(format!("at least {N}")).got(stride.to_string()));
        }
        if let Some(encoding) = encoding
            && picture.encoding != encoding
        {
            let expected = match encoding {
                Encoding::Linear => "an OpenEXR or Radiance file of linear values",
                Encoding::Srgb => "an image of encoded values, such as PNG",
            };
            return Err(Error::input(name).expected(expected).got("the other kind"));
        }
        let mut out = Vec::with_capacity(self.width * self.height);
        for i in 0..self.width * self.height {
            let x: [f32; N] = std::array::from_fn(|c| picture.value(i * stride + c));
            if !valid(&x) {
                return Err(Error::input(name)
                    .at(format!("row {}, column {}", i / self.width, i % self.width))
                    .expected("a value in the range of this pass")
                    .got(format!("{x:?}")));
            }
            out.push(x);
        }
        Ok(out)
    }
}

/// Square blocks of pixels of an image.
struct Blocks {
    /// Pixels in a row of the image.
    stride: usize,
    /// Blocks in a row.
    width: usize,
    /// Rows of blocks.
    height: usize,
    /// Pixels along a side of a block.
    s: usize,
}

impl Blocks {
    /// Weighted means, 0 where there is no weight: left folds over rows, then columns.
    fn means<const N: usize>(
        &self,
        value: &dyn Fn(usize) -> [f32; N],
        weight: &dyn Fn(usize) -> f32,
    ) -> Vec<[f32; N]> {
        let Self { stride, width, height, s } = *self;
        let mean = |block: usize| {
            let [row, column] = [block / width * s, block % width * s];
            let (mut sum, mut total) = ([0.0; N], 0.0);
            for i in (row..row + s).flat_map(|y| (column..column + s).map(move |x| y * stride + x)) {
                let (x, w) = (value(i), weight(i));
                (0..N).for_each(|k| sum[k] += w * x[k]);
                total += w;
            }
            if total > 0.0 { sum.map(|x| x / total) } else { sum }
        };
        (0..width * height).map(mean).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_passes_are_means_over_what_each_pass_is_about() {
        // 5×2 pixels: two blocks of 2×2, and a column that is left out
        let full = PassImages {
            width: 5,
            height: 2,
            foreground: Some(vec![1.0, 0.0, 0.0, 0.0, 9.0, 0.5, 0.0, 0.0, 0.0, 9.0]),
            depth: Some(vec![2.0, 0.0, 0.0, 0.0, 9.0, 4.0, 0.0, 0.0, 0.0, 9.0]),
            normal: Some([[0.0, 0.0, 1.0], [0.0; 3], [0.0; 3], [0.0; 3], [9.0; 3]].repeat(2)),
            albedo: Some([[0.3; 3], [0.9; 3], [0.9; 3], [0.9; 3], [9.0; 3]].repeat(2)),
            ..PassImages::default()
        };
        let half = full.reduced(2);
        assert_eq!((half.width, half.height), (2, 1), "whole blocks");
        assert_eq!(half.foreground, Some(vec![0.375, 0.0]), "coverage: a mean over all pixels");
        assert_eq!(half.depth, Some(vec![3.0, 0.0]), "depth: a mean over pixels that are hit");
        assert_eq!(half.normal, Some(vec![[0.0, 0.0, 1.0], [0.0; 3]]), "normals have length 1, or none");
        let albedo = half.albedo.expect("a pass");
        assert!(
            (albedo[0][0] - 0.3).abs() < 1e-6 && albedo[1] == [0.0; 3],
            "weighted by coverage: {albedo:?}"
        );
        assert_eq!(full.reduced(1).depth, full.depth, "a factor of 1 changes nothing");
    }
}
