//! Environment maps from files: latitude–longitude images in the orientation of the program that wrote them.
//!
//! Our axes are z up; a y-up program's direction (X, Y, Z) is ours by (x, y, z) = (X, −Z, Y), as for models.
//! Every orientation shows the inclination v = acos(up)/π from the top; they differ in the azimuth, here for
//! a direction (x, y, z) of ours:
//!
//! | [`Orientation`] | u of its own axes | the same in our axes | direction at its centre |
//! |---|---|---|---|
//! | `Ours` | atan2(x, y)/2π + ½ | atan2(x, y)/2π + ½ | +y |
//! | `Mitsuba` (y up) | atan2(X, −Z)/2π | atan2(x, y)/2π | +Z, our −y |
//! | `Nvdiffrec` (y up) | atan2(X, −Z)/2π + ½ | atan2(x, y)/2π + ½ | −Z, our +y |
//! | `Blender` (z up) | ½ − atan2(y, x)/2π | atan2(x, y)/2π + ¼ | +x |
//! | `Orb` (y up, per image) | atan2(X, −Z)/2π + ½ in the axes of the camera | with [`Options::world_from_map`] | the camera's view |
//!
//! `Orb` needs the rotation of its image's camera, which a command line does not have: the commands accept
//! the other four ([`Orientation::FIXED`]). Without the rotation it would equal `Nvdiffrec` and take the
//! camera's axes for those of the world.
//!
//! u counts from the left and wraps. Sources: `mitsuba` emitter `envmap`, nvdiffrec `light.py`, Cycles
//! `projection.h` (`direction_to_equirectangular`), Stanford-ORB `env_map.py`. A map made with the other
//! handedness (seen from outside) is turned by [`Options::mirror`]: u → 1 − u before all else.
//!
//! # Exactness
//! The orientations and rotations by an integer number of columns permute texels: radiance keeps its bits.
//! Where ¼ or ½ of the width or the rotation is not an integer number of columns, columns are interpolated
//! linearly; with [`Options::world_from_map`] the image is resampled bilinearly at texel centres. Radiance is
//! multiplied by [`Options::scale`] last.

use super::light::Environment;
use super::material::Transfer;
use crate::io::image_file::{self, Encoding, Picture, Samples};
use crate::io::memory;
use crate::math::vector::unit;
use crate::num::elem::f64 as elem;
use crate::{Error, Result};
use std::f64::consts::PI;
use std::path::Path;

/// Most texels of a map.
pub const MAX_TEXELS: usize = 1 << 27;

/// Whose convention a file follows; see the module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Orientation {
    /// `scene::light`
    #[default]
    Ours,
    /// Mitsuba's `envmap`
    Mitsuba,
    /// nvdiffrec and its relatives
    Nvdiffrec,
    /// Blender's environment texture, the usual view of Poly Haven's maps
    Blender,
    /// Stanford-ORB's `env_map/*.exr`
    Orb,
}

impl Orientation {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Ours, Self::Mitsuba, Self::Nvdiffrec, Self::Blender, Self::Orb];

    /// Those that need no further rotation.
    pub const FIXED: [Self; 4] = [Self::Ours, Self::Mitsuba, Self::Nvdiffrec, Self::Blender];

    /// Its name in options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ours => "ours",
            Self::Mitsuba => "mitsuba",
            Self::Nvdiffrec => "nvdiffrec",
            Self::Blender => "blender",
            Self::Orb => "orb",
        }
    }

    /// The orientation of that name.
    ///
    /// # Errors
    /// When there is none.
    pub fn parse(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|o| o.name() == name).ok_or_else(|| {
            Error::input("environment orientation")
                .expected("ours, mitsuba, nvdiffrec, blender or orb")
                .got(name)
        })
    }

    /// u of the file for a direction of ours with azimuth u_ours: u = u_ours + this, wrapped.
    pub fn offset(self) -> f64 {
        match self {
            Self::Ours | Self::Nvdiffrec | Self::Orb => 0.0,
            Self::Mitsuba => 0.5,
            Self::Blender => -0.25,
        }
    }

    /// (u, v) of a direction in the program's **own** axes, by its own formula; see the module.
    pub fn texture_coordinates(self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        let wrap = |u: f64| u - u.floor();
        match self {
            Self::Ours => [wrap(elem::atan2(x, y) / (2.0 * PI) + 0.5), elem::acos(z) / PI],
            Self::Mitsuba => [wrap(elem::atan2(x, -z) / (2.0 * PI)), elem::acos(y) / PI],
            Self::Nvdiffrec | Self::Orb => [wrap(elem::atan2(x, -z) / (2.0 * PI) + 0.5), elem::acos(y) / PI],
            Self::Blender => [wrap(0.5 - elem::atan2(y, x) / (2.0 * PI)), elem::acos(z) / PI],
        }
    }

    /// A direction of ours in the program's own axes.
    pub fn own_axes(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Ours | Self::Blender => [x, y, z],
            Self::Mitsuba | Self::Nvdiffrec | Self::Orb => [x, z, -y],
        }
    }
}

/// How a file becomes a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Whose convention it follows.
    pub orientation: Orientation,
    /// The image is a mirror image.
    pub mirror: bool,
    /// Degrees the light turns about +z, counter-clockwise from above.
    pub rotate: f64,
    /// Factor of the radiance, ≥ 0.
    pub scale: f32,
    /// What the values of PNG and JPEG files mean; HDR and EXR are linear.
    pub transfer: Transfer,
    /// Rotation from the map's axes (in our convention: z up) to the world's, row-major; for maps in the axes
    /// of a camera.
    pub world_from_map: Option<[[f64; 3]; 3]>,
}

impl Default for Options {
    /// Ours, as it is; 8-bit images are sRGB-encoded.
    fn default() -> Self {
        Self {
            orientation: Orientation::Ours,
            mirror: false,
            rotate: 0.0,
            scale: 1.0,
            transfer: Transfer::Srgb,
            world_from_map: None,
        }
    }
}

impl Options {
    /// Checks ranges.
    ///
    /// # Errors
    /// When the rotation is not within ±10⁶ degrees or the scale is negative or not finite.
    pub fn validate(&self) -> Result<()> {
        let option = |which: &str, expected: &str, got: String| {
            Err(Error::input("environment").at(which).expected(expected).got(got))
        };
        if !(self.scale >= 0.0 && self.scale.is_finite()) {
            return option("scale", "a finite number of at least 0", self.scale.to_string());
        }
        if !(self.rotate.abs() <= 1e6) {
            return option("rotation", "degrees between -1e6 and 1e6", self.rotate.to_string());
        }
        Ok(())
    }
}

/// Reads a map: Radiance HDR, OpenEXR (R, G, B), TIFF of floats, or an sRGB-encoded image.
///
/// # Errors
/// When the file is bad, not an image of colours, larger than [`MAX_TEXELS`], or holds a negative number or
/// none; when an option is out of range.
pub fn read(path: &Path, options: &Options) -> Result<Environment> {
    let name = path.display().to_string();
    from_picture(&image_file::read(path)?, options, &name)
}

/// Like [`read`] for a decoded image; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn from_picture(p: &Picture, options: &Options, name: &str) -> Result<Environment> {
    options.validate()?;
    if p.width * p.height > MAX_TEXELS {
        let e = Error::input(name).at("size");
        return Err(e
            .expected(format!("at most {MAX_TEXELS} texels"))
            .got(format!("{}x{}", p.width, p.height)));
    }
    let channel = |n: &str| p.channels.iter().position(|c| c == n);
    let channels = match (channel("R"), channel("G"), channel("B"), channel("Y")) {
        (Some(r), Some(g), Some(b), _) => [r, g, b],
        (_, _, _, Some(y)) => [y; 3],
        _ => {
            return Err(Error::input(name)
                .at("channels")
                .expected("R, G, B or Y")
                .got(p.channels.join(", ")));
        }
    };
    let decode = p.encoding == Encoding::Srgb && options.transfer == Transfer::Srgb;
    let value = |x: f32| if decode { linear(x) } else { x };
    // There are few values of a byte, and many texels.
    let of_byte: [f32; 256] = std::array::from_fn(|x| value(x as f32 / 255.0));
    let n = p.channels.len();
    let at = |i: usize| match &p.samples {
        Samples::U8(bytes) => of_byte[usize::from(bytes[i])],
        _ => value(p.value(i)),
    };
    let mut radiance: Vec<[f32; 3]> = memory::room(name, p.width * p.height)?;
    radiance.extend((0..p.width * p.height).map(|i| channels.map(|c| at(i * n + c))));
    let is_negative = radiance.as_flattened().iter().any(|x| *x < 0.0);
    let map = Environment { width: p.width, height: p.height, radiance };
    map.validate(name).map_err(|e| match is_negative {
        true => e.hint("negative radiance often comes from resampling; clamp it when the file is made"),
        false => e,
    })?;
    Ok(orient(map, options))
}

/// sRGB to linear in f64, rounded once.
fn linear(x: f32) -> f32 {
    let x = f64::from(x);
    (if x <= 0.040_45 { x / 12.92 } else { elem::pow((x + 0.055) / 1.055, 2.4) }) as f32
}

/// A map in the file's orientation as ours. The options have been checked.
pub fn orient(map: Environment, options: &Options) -> Environment {
    let (w, h) = (map.width, map.height);
    let mut radiance = map.radiance;
    if options.mirror {
        radiance.chunks_exact_mut(w).for_each(<[_]>::reverse);
    }
    // A rotation about z by ρ shows at u what was at u + ρ/2π: u falls with the angle from x to y.
    let direct = options.world_from_map.is_none();
    let turn = if direct { options.rotate / 360.0 } else { 0.0 };
    roll(&mut radiance, w, (options.orientation.offset() + turn) * w as f64);
    if let Some(r) = &options.world_from_map {
        radiance = resample(&radiance, [w, h], r, options.rotate);
    }
    if options.scale != 1.0 {
        radiance.iter_mut().for_each(|t| *t = t.map(|x| x * options.scale));
    }
    Environment { width: w, height: h, radiance }
}

/// Every row shifted left by `shift` columns: exact for integer shifts, else linear between columns.
fn roll(radiance: &mut [[f32; 3]], width: usize, shift: f64) {
    // Rounding moves a rotation by k·360/W degrees off an integer.
    let whole = shift.round();
    let (base, fraction) =
        if (shift - whole).abs() < 1e-9 { (whole, 0.0) } else { (shift.floor(), shift - shift.floor()) };
    let base = (base as i64).rem_euclid(width as i64) as usize;
    let f = fraction as f32;
    for row in radiance.chunks_exact_mut(width) {
        row.rotate_left(base);
        if fraction == 0.0 {
            continue;
        }
        let first = row[0];
        for j in 0..width {
            let (a, b) = (row[j], if j + 1 < width { row[j + 1] } else { first });
            row[j] = std::array::from_fn(|c| a[c] + f * (b[c] - a[c]));
        }
    }
}

/// Bilinear values at the directions Rᵀ·d of the texel centres, d turned back about z first.
fn resample(radiance: &[[f32; 3]], [w, h]: [usize; 2], r: &[[f64; 3]; 3], rotate: f64) -> Vec<[f32; 3]> {
    let angle = rotate.to_radians();
    let (s, c) = (elem::sin(angle), elem::cos(angle));
    let mut out = Vec::with_capacity(radiance.len());
    for i in 0..h {
        let theta = (i as f64 + 0.5) / h as f64 * PI;
        let (sin, cos) = (elem::sin(theta), elem::cos(theta));
        for j in 0..w {
            let phi = ((j as f64 + 0.5) / w as f64 - 0.5) * 2.0 * PI;
            let d = [sin * elem::sin(phi), sin * elem::cos(phi), cos];
            let d = [c * d[0] + s * d[1], c * d[1] - s * d[0], d[2]];
            let m: [f64; 3] = std::array::from_fn(|k| r[0][k] * d[0] + r[1][k] * d[1] + r[2][k] * d[2]);
            let m = unit(m);
            let [u, v] = Orientation::Ours.texture_coordinates(m);
            let (x, y) = (u * w as f64 - 0.5, v * h as f64 - 0.5);
            let (x0, y0) = (x.floor(), y.floor());
            let (fx, fy) = ((x - x0) as f32, (y - y0) as f32);
            let at = |dx: i64, dy: i64| {
                let column = (x0 as i64 + dx).rem_euclid(w as i64) as usize;
                let row = (y0 as i64 + dy).clamp(0, h as i64 - 1) as usize;
                radiance[row * w + column]
            };
            let mix = |a: [f32; 3], b: [f32; 3], f: f32| {
                std::array::from_fn::<f32, 3, _>(|k| a[k] + f * (b[k] - a[k]))
            };
            out.push(mix(mix(at(0, 0), at(1, 0), fx), mix(at(0, 1), at(1, 1), fx), fy));
        }
    }
    out
}
