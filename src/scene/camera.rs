//! One view: pose, intrinsics, picture size, projection model.
//!
//! Camera axes: x right, y down, z forward; pixel (0, 0) has its centre at (0.5, 0.5). The world is right-handed.

use crate::{Error, Result};

/// How a point in camera coordinates reaches the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// (f_x x/z + c_x, f_y y/z + c_y)
    Pinhole,
    /// (f_x x + c_x, f_y y + c_y)
    Orthographic,
    /// Equidistant: (f_x x θ/ρ + c_x, f_y y θ/ρ + c_y), ρ = √(x²+y²), θ = atan2(ρ, z)
    Fisheye,
}

impl Model {
    /// The name used by settings and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::Orthographic => "orthographic",
            Self::Fisheye => "fisheye",
        }
    }

    /// The model of that name.
    ///
    /// # Errors
    /// When there is none.
    pub fn parse(name: &str) -> Result<Self> {
        match name {
            "pinhole" => Ok(Self::Pinhole),
            "orthographic" => Ok(Self::Orthographic),
            "fisheye" => Ok(Self::Fisheye),
            other => {
                Err(Error::input("setting camera").expected("pinhole, orthographic or fisheye").got(other))
            }
        }
    }
}

/// One view.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Rotation block R of view-from-world, row-major.
    pub rotation: [[f32; 3]; 3],
    /// Translation t of view-from-world: x_view = R x + t.
    pub translation: [f32; 3],
    /// Focal lengths in pixels.
    pub focal_px: [f32; 2],
    /// Principal point in pixels.
    pub center_px: [f32; 2],
    /// Picture width in pixels.
    pub width: usize,
    /// Picture height in pixels.
    pub height: usize,
    /// Projection model.
    pub model: Model,
}

impl Camera {
    /// Camera centre in the world, −Rᵀt (not the inverse: R may be orthogonal to rounding only).
    pub fn center(&self) -> [f32; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|i| -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]))
    }

    /// From row-major `view_from_world` (4×4) and `intrinsics` (3×3).
    pub fn from_matrices(
        view_from_world: &[f32],
        intrinsics: &[f32],
        width: usize,
        height: usize,
        model: Model,
    ) -> Self {
        assert!(view_from_world.len() == 16 && intrinsics.len() == 9, "a 4x4 and a 3x3 matrix");
        let v = view_from_world;
        Self {
            rotation: [[v[0], v[1], v[2]], [v[4], v[5], v[6]], [v[8], v[9], v[10]]],
            translation: [v[3], v[7], v[11]],
            focal_px: [intrinsics[0], intrinsics[4]],
            center_px: [intrinsics[2], intrinsics[5]],
            width,
            height,
            model,
        }
    }

    /// Checks that every number is finite, focal lengths are positive and the picture is not empty.
    ///
    /// # Errors
    /// Names the field.
    pub fn validate(&self) -> Result<()> {
        let numbers = self
            .rotation
            .iter()
            .flatten()
            .chain(&self.translation)
            .chain(&self.focal_px)
            .chain(&self.center_px);
        if let Some(x) = numbers.copied().find(|x| !x.is_finite()) {
            return Err(Error::input("camera").expected("finite pose and intrinsics").got(x.to_string()));
        }
        if !(self.focal_px[0] > 0.0 && self.focal_px[1] > 0.0) {
            return Err(Error::input("camera")
                .at("focal length")
                .expected("positive pixels")
                .got(format!("{:?}", self.focal_px)));
        }
        if self.width == 0 || self.height == 0 || self.width > MAX_SIDE || self.height > MAX_SIDE {
            return Err(Error::input("camera")
                .at("picture size")
                .expected(format!("1 to {MAX_SIDE} pixels a side"))
                .got(format!("{}x{}", self.width, self.height)));
        }
        Ok(())
    }
}

/// Largest picture side accepted, in pixels.
pub const MAX_SIDE: usize = 16_384;
