//! Photos with poses and lenses, as plain records.

use super::gaussian_ply::Points;
use crate::math::affine::newton_to_rotation;
use crate::{Error, Result};
use std::path::PathBuf;

/// Which layout and dialect a capture came in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// `transforms_{train,val,test}.json`
    NerfSynthetic,
    /// `transforms.json` of instant-ngp
    InstantNgp,
    /// `transforms.json` of nerfstudio
    Nerfstudio,
    /// COLMAP sparse model, `.bin`
    ColmapBinary,
    /// COLMAP sparse model, `.txt`
    ColmapText,
}

impl Dialect {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::NerfSynthetic => "NeRF-synthetic transforms",
            Self::InstantNgp => "instant-ngp transforms",
            Self::Nerfstudio => "nerfstudio transforms",
            Self::ColmapBinary => "COLMAP binary",
            Self::ColmapText => "COLMAP text",
        }
    }
}

/// Purpose of a frame in the layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// not specified
    Unknown,
    /// training
    Train,
    /// validation
    Val,
    /// testing
    Test,
}

/// Focal length, in either of the forms files use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Focal {
    /// f_x, f_y in pixels of the declared image size
    Pixels([f64; 2]),
    /// Full angle of view along x, and along y if it is given, in radians
    Angles(f64, Option<f64>),
}

/// Distortion of a lens relative to its ideal projection.
///
/// With (x, y) the ideal pinhole position (z = 1) and r² = x² + y²:
///
/// * `Perspective`: d = (1 + k₁r² + k₂r⁴ + k₃r⁶ + k₄r⁸) / (1 + n₁r² + n₂r⁴ + n₃r⁶),
///   x' = x d + 2p₁xy + p₂(r² + 2x²), y' = y d + 2p₂xy + p₁(r² + 2y²).
/// * `Fisheye`: θ' = θ (1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸) with θ the angle from the axis; the position is θ' from
///   the centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// OpenCV's radial-tangential model; all zero: a pinhole
    Perspective {
        /// k₁ to k₄
        numerator: [f64; 4],
        /// n₁ to n₃
        denominator: [f64; 3],
        /// p₁, p₂
        tangential: [f64; 2],
    },
    /// OpenCV's fisheye model; all zero: equidistant
    Fisheye {
        /// k₁ to k₄
        k: [f64; 4],
    },
}

impl Lens {
    /// A lens without distortion.
    pub const PINHOLE: Self =
        Self::Perspective { numerator: [0.0; 4], denominator: [0.0; 3], tangential: [0.0; 2] };

    /// Whether every coefficient is zero.
    pub fn is_ideal(&self) -> bool {
        match self {
            Self::Perspective { numerator, denominator, tangential } => {
                numerator.iter().chain(denominator).chain(tangential).all(|&x| x == 0.0)
            }
            Self::Fisheye { k } => k.iter().all(|&x| x == 0.0),
        }
    }
}

/// Further data of a photo besides its colour: images of the same size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Passes {
    /// `foreground_path`: coverage of what is reconstructed. Unlike a mask it does not select pixels for the
    /// loss.
    pub foreground: Option<PathBuf>,
    /// `radiance_path`: linear R, G, B before exposure
    pub radiance: Option<PathBuf>,
    /// `depth_path` or `depth_file_path`: camera depth z, 0 where nothing is hit
    pub depth: Option<PathBuf>,
    /// `normal_path`: world normals X, Y, Z
    pub normal: Option<PathBuf>,
    /// `albedo_path`: sRGB-encoded
    pub albedo: Option<PathBuf>,
    /// `material_path`: first channel metallic, second roughness
    pub material: Option<PathBuf>,
    /// `environment_path`: the light of this image, a latitude–longitude map in our orientation
    pub environment: Option<PathBuf>,
    /// `exposure`: the factor from radiance to the photo, before sRGB encoding
    pub exposure: Option<f64>,
}

/// One photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Name with forward slashes, relative to the capture; frames are ordered by it.
    pub name: String,
    /// The image.
    pub image: PathBuf,
    /// A mask: pixels where it is zero are ignored.
    pub mask: Option<PathBuf>,
    /// World to camera, camera axes x right, y down, z forward; the rotation is orthonormal.
    pub view_from_world: [[f64; 4]; 4],
    /// Focal length.
    pub focal: Focal,
    /// Principal point in pixels of the declared size; the centre of the image if absent.
    pub center: Option<[f64; 2]>,
    /// Width and height declared in the file.
    pub size: Option<[usize; 2]>,
    /// Distortion.
    pub lens: Lens,
    /// Purpose of the frame.
    pub split: Split,
    /// Passes written by a renderer.
    pub passes: Passes,
}

impl Frame {
    /// Whether an image of the given size is as declared or a scaled version of it.
    pub fn fits(&self, width: usize, height: usize) -> bool {
        let (w, h) = (width as f64, height as f64);
        let [dw, dh] = self.size.map_or([w, h], |s| s.map(|x| x as f64));
        // Both sides scaled by the same factor, to the pixel that rounding may cost.
        (dw * h - dh * w).abs() <= crate::num::order::max(dw, dh)
    }

    /// f_x, f_y, c_x, c_y in pixels of an image of the given size, which may be a scaled version of the declared one.
    ///
    /// # Errors
    /// When the sizes are not proportional.
    pub fn intrinsics(&self, width: usize, height: usize) -> Result<[f64; 4]> {
        let (w, h) = (width as f64, height as f64);
        let [dw, dh] = self.size.map_or([w, h], |s| s.map(|x| x as f64));
        if !self.fits(width, height) {
            return Err(Error::input(self.image.display().to_string())
                .at("image size")
                .expected(format!("{dw}x{dh} as declared, or a scaled version"))
                .got(format!("{w}x{h}")));
        }
        let (sx, sy) = (w / dw, h / dh);
        let [fx, fy] = match self.focal {
            Focal::Pixels([fx, fy]) => [fx * sx, fy * sy],
            Focal::Angles(ax, ay) => {
                let fx = 0.5 * w / libm::tan(0.5 * ax);
                [fx, ay.map_or(fx, |ay| 0.5 * h / libm::tan(0.5 * ay))]
            }
        };
        let [cx, cy] = self.center.map_or([0.5 * w, 0.5 * h], |[cx, cy]| [cx * sx, cy * sy]);
        Ok([fx, fy, cx, cy])
    }
}

/// A capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Layout it was read from.
    pub dialect: Dialect,
    /// Its photos, in the order of their names.
    pub frames: Vec<Frame>,
    /// Points of a reconstruction.
    pub points: Option<Points>,
    /// Frames whose listed photo is missing: cameras only, with the listed path.
    pub missing: Vec<Frame>,
    /// Other missing files that the capture names (points, depth and other passes); their contents are
    /// absent.
    pub missing_files: Vec<String>,
    /// Whether `lirm gen` wrote it: its object is in the ball of radius ½ around the origin.
    pub is_unit_ball: bool,
}

/// The rotation nearest to a matrix that is a rotation up to rounding.
///
/// Newton's iteration for the polar factor, R ← ½(R + R⁻ᵀ); converges quadratically.
///
/// # Errors
/// With a description, when RᵀR departs from the identity by more than 1e-3, or the matrix is a reflection.
pub fn nearest_rotation(m: [[f64; 3]; 3]) -> std::result::Result<[[f64; 3]; 3], String> {
    for i in 0..3 {
        for j in 0..3 {
            let dot = m[0][i] * m[0][j] + m[1][i] * m[1][j] + m[2][i] * m[2][j];
            let off = (dot - if i == j { 1.0 } else { 0.0 }).abs();
            // A NaN is in no range.
            if !(0.0..=1e-3).contains(&off) {
                return Err(format!("columns {i} and {j} with product {dot}"));
            }
        }
    }
    let mut r = m;
    for _ in 0..5 {
        let (next, det) = newton_to_rotation(&r);
        if !(f64::MIN_POSITIVE..).contains(&det) {
            return Err(format!("a reflection (determinant {det})"));
        }
        r = next;
    }
    Ok(r)
}

/// Rotation and translation as a 4×4 matrix.
pub fn rigid(r: [[f64; 3]; 3], t: [f64; 3]) -> [[f64; 4]; 4] {
    let row = |i: usize| [r[i][0], r[i][1], r[i][2], t[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_are_repaired_and_others_refused() {
        let almost = [[1.0, 1e-4, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0 - 1e-4]];
        let r = nearest_rotation(almost).expect("close to one");
        for i in 0..3 {
            for j in 0..3 {
                let dot = r[0][i] * r[0][j] + r[1][i] * r[1][j] + r[2][i] * r[2][j];
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-15, "orthonormal");
            }
        }
        assert!(nearest_rotation([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]).is_err(), "scaled");
        assert!(nearest_rotation([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]).is_err(), "mirrored");
        assert!(nearest_rotation([[f64::NAN; 3]; 3]).is_err(), "not numbers");
    }
}
