//! One view. Camera axes: x right, y down, z forward; pixel (0, 0) has its centre at (0.5, 0.5).

use crate::array::Arr;
use crate::scalar::Scalar;

/// Projection of a point in camera coordinates to the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// (f_x x/z + c_x, f_y y/z + c_y)
    Pinhole,
    /// (f_x x + c_x, f_y y + c_y)
    Orthographic,
    /// (f_x x θ/ρ + c_x, f_y y θ/ρ + c_y) with ρ = √(x²+y²), θ = atan2(ρ, z)
    Fisheye,
}

impl Model {
    /// The model named by the setting `camera`.
    ///
    /// # Panics
    /// When there is no model of that name; the signature checks the words before.
    pub(super) fn of(name: &str) -> Self {
        match name {
            "pinhole" => Self::Pinhole,
            "orthographic" => Self::Orthographic,
            "fisheye" => Self::Fisheye,
            other => unreachable!("camera {other}"),
        }
    }
}

/// One view.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// R of x_view = R x + t.
    pub rotation: [[f64; 3]; 3],
    /// t of x_view = R x + t.
    pub translation: [f64; 3],
    /// Focal lengths in pixels.
    pub focal_px: [f64; 2],
    /// Principal point in pixels.
    pub center_px: [f64; 2],
    /// Image width and height in pixels.
    pub size_px: [usize; 2],
    /// Projection model.
    pub model: Model,
}

impl Camera {
    /// R x + t, each row a left fold.
    pub fn view<S: Scalar>(&self, x: [S; 3]) -> [S; 3] {
        std::array::from_fn(|i| {
            let r = self.rotation[i];
            x[0] * r[0] + x[1] * r[1] + x[2] * r[2] + self.translation[i]
        })
    }

    /// Camera centre in the world, −Rᵀt (R need not be orthogonal).
    pub fn center(&self) -> [f64; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|i| -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]))
    }
}

/// Image width and height from the inputs `width` and `height`.
///
/// # Errors
/// When one is not a positive integer.
pub fn size_px<S: Scalar>(width: &Arr<S>, height: &Arr<S>) -> Result<[usize; 2], String> {
    let side = |name: &str, x: &Arr<S>| {
        let value = x.data[0].value();
        if (1.0..=16_384.0).contains(&value) && value.fract() == 0.0 {
            Ok(value as usize)
        } else {
            Err(format!("input {name}: expected a whole number from 1 to 16384, got {value}"))
        }
    };
    Ok([side("width", width)?, side("height", height)?])
}

/// Poses from `view_from_world` (C,4,4), with default intrinsics of one pixel per unit.
pub fn poses<S: Scalar>(view_from_world: &Arr<S>) -> Vec<Camera> {
    (0..view_from_world.shape[0])
        .map(|c| {
            let v: [f64; 16] = view_from_world.row(c).map(Scalar::value);
            Camera {
                rotation: [[v[0], v[1], v[2]], [v[4], v[5], v[6]], [v[8], v[9], v[10]]],
                translation: [v[3], v[7], v[11]],
                focal_px: [1.0; 2],
                center_px: [0.0; 2],
                size_px: [1; 2],
                model: Model::Pinhole,
            }
        })
        .collect()
}

/// Cameras from `view_from_world` (C,4,4) and `intrinsics` (C,3,3).
///
/// # Errors
/// When a focal length is not positive.
pub fn cameras<S: Scalar>(
    view_from_world: &Arr<S>,
    intrinsics: &Arr<S>,
    size_px: [usize; 2],
    model: Model,
) -> Result<Vec<Camera>, String> {
    let mut cameras = poses(view_from_world);
    for (c, camera) in cameras.iter_mut().enumerate() {
        let k: [f64; 9] = intrinsics.row(c).map(Scalar::value);
        camera.focal_px = [k[0], k[4]];
        camera.center_px = [k[2], k[5]];
        camera.size_px = size_px;
        camera.model = model;
        if !(k[0] > 0.0 && k[4] > 0.0) {
            return Err(format!(
                "input intrinsics[{c}]: expected positive focal lengths, got {}, {}",
                k[0], k[4]
            ));
        }
    }
    Ok(cameras)
}
