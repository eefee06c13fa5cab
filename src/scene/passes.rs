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
