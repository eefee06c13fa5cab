//! One view: pose, intrinsics, image size, projection model.
//!
//! Camera axes: x right, y down, z forward; pixel (0, 0) has its centre at (0.5, 0.5). The world is
//! right-handed.

use super::mesh::MAX_COORDINATE;
use crate::math::quat;
use crate::num::{elem, order};
use crate::{Error, Result};

/// How a point in camera coordinates reaches the image.
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
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
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

    /// The ray through a position of the image, in pixels: origin and unit direction in the world. `None`
    /// outside the circle that a fisheye sees (θ > π). Orthographic rays start in the plane of the camera.
    ///
    /// # Rounding
    /// f32; sums of three are (x + y) + z; the direction is divided by its length. θ < 1e-4 takes sin θ/θ =
    /// 1, exact in f32.
    #[inline]
    pub fn ray(&self, px: [f32; 2]) -> Option<([f32; 3], [f32; 3])> {
        let m: [f32; 2] = std::array::from_fn(|k| (px[k] - self.center_px[k]) / self.focal_px[k]);
        let local = match self.model {
            Model::Pinhole => [m[0], m[1], 1.0],
            Model::Orthographic => [0.0, 0.0, 1.0],
            Model::Fisheye => {
                let theta = (m[0] * m[0] + m[1] * m[1]).sqrt();
                if !(theta <= std::f32::consts::PI) {
                    return None;
                }
                let ratio = if theta < 1e-4 { 1.0 } else { elem::sin(theta) / theta };
                [ratio * m[0], ratio * m[1], elem::cos(theta)]
            }
        };
        let r = &self.rotation;
        let turn = |d: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| (r[0][i] * d[0] + r[1][i] * d[1]) + r[2][i] * d[2])
        };
        let d = turn(local);
        let length = ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]).sqrt();
        let origin = match self.model {
            Model::Pinhole | Model::Fisheye => self.center(),
            Model::Orthographic => {
                let t = &self.translation;
                turn([m[0] - t[0], m[1] - t[1], -t[2]])
            }
        };
        Some((origin, d.map(|x| x / length)))
    }

    /// The pose at time `t` (0..1) between this one and `end`; intrinsics are this camera's. The centre moves
    /// on a line, the rotation is the normalised blend of the two quaternions on the shorter way.
    pub fn between(&self, end: &Self, t: f32) -> Self {
        let (a, mut b) = (quaternion(&self.rotation), quaternion(&end.rotation));
        let along = ((a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]) + a[3] * b[3];
        if along < 0.0 {
            b = b.map(|x| -x);
        }
        let q: [f32; 4] = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
        let r = quat::rotation(q);
        let rotation = [[r[0], r[1], r[2]], [r[3], r[4], r[5]], [r[6], r[7], r[8]]];
        let (from, to) = (self.center(), end.center());
        let c: [f32; 3] = std::array::from_fn(|k| from[k] + t * (to[k] - from[k]));
        let translation = rotation.map(|row| -((row[0] * c[0] + row[1] * c[1]) + row[2] * c[2]));
        Self { rotation, translation, ..self.clone() }
    }

    /// Checks what [`Camera::ray`] needs beyond [`Camera::validate`]: a rotation to 1e-3, and pixels and
    /// positions whose squares stay within f32.
    ///
    /// # Errors
    /// Names the field.
    pub fn validate_rays(&self) -> Result<()> {
        let r = &self.rotation;
        let product = |a: [f32; 3], b: [f32; 3]| (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2];
        let turned =
            (0..3).all(|i| (0..3).all(|j| (product(r[i], r[j]) - f32::from(u8::from(i == j))).abs() <= 1e-3));
        let z = [
            r[0][1] * r[1][2] - r[0][2] * r[1][1],
            r[0][2] * r[1][0] - r[0][0] * r[1][2],
            r[0][0] * r[1][1] - r[0][1] * r[1][0],
        ];
        if !(turned && product(z, r[2]) > 0.0) {
            let e = Error::input("camera").at("rotation");
            return Err(e.expected("orthogonal unit rows, right-handed").got(format!("{r:?}")));
        }
        if !self.translation.iter().all(|x| x.abs() <= MAX_COORDINATE) {
            let e = Error::input("camera").at("translation");
            return Err(e
                .expected(format!("at most {MAX_COORDINATE:e}"))
                .got(format!("{:?}", self.translation)));
        }
        let sides = [self.width, self.height];
        let wide = (0..2).all(|k| {
            let far = order::max(self.center_px[k].abs(), (sides[k] as f32 - self.center_px[k]).abs());
            far / self.focal_px[k] <= MAX_SLOPE
        });
        if !wide {
            let got = format!("focal length {:?}, principal point {:?}", self.focal_px, self.center_px);
            return Err(Error::input("camera")
                .at("intrinsics")
                .expected(format!("pixels at most {MAX_SLOPE:e} focal lengths from the principal point"))
                .got(got));
        }
        Ok(())
    }

    /// Whether size, model and intrinsics are those of `other`.
    pub fn differs_in_pose_alone(&self, other: &Self) -> bool {
        let same = (self.focal_px, self.center_px) == (other.focal_px, other.center_px);
        same && (self.width, self.height, self.model) == (other.width, other.height, other.model)
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

    /// Checks that every number is finite, focal lengths are positive and the image is not empty.
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
                .at("image size")
                .expected(format!("1 to {MAX_SIDE} pixels a side"))
                .got(format!("{}x{}", self.width, self.height)));
        }
        Ok(())
    }
}

/// Quaternion (w, x, y, z) of a rotation matrix, not normalised: the largest of the four is computed without
/// cancellation (Shepperd 1978).
fn quaternion(r: &[[f32; 3]; 3]) -> [f32; 4] {
    let (x, y, z) = (r[0][0], r[1][1], r[2][2]);
    let candidates = [(1.0 + x) + (y + z), (1.0 + x) - (y + z), (1.0 + y) - (x + z), (1.0 + z) - (x + y)];
    let mut best = 0;
    for k in 1..4 {
        if candidates[k] > candidates[best] {
            best = k;
        }
    }
    let c = candidates[best];
    let (wx, wy, wz) = (r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]);
    let (xy, xz, yz) = (r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]);
    let q = match best {
        0 => [c, wx, wy, wz],
        1 => [wx, c, xy, xz],
        2 => [wy, xy, c, yz],
        _ => [wz, xz, yz, c],
    };
    let length = (((q[0] * q[0] + q[1] * q[1]) + q[2] * q[2]) + q[3] * q[3]).sqrt();
    q.map(|x| x / length)
}

/// Largest distance of a pixel from the principal point, in focal lengths.
const MAX_SLOPE: f32 = 1e9;

/// Largest image side accepted, in pixels.
pub const MAX_SIDE: usize = 16_384;

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(angle: f64) -> Camera {
        let (c, s) = (libm::cos(angle) as f32, libm::sin(angle) as f32);
        let m = [c, -s, 0.0, 1.0, s, c, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0];
        Camera::from_matrices(&m, &[9.0, 0.0, 4.0, 0.0, 9.0, 4.0, 0.0, 0.0, 1.0], 8, 8, Model::Pinhole)
    }

    #[test]
    fn half_way_between_two_turns_is_half_the_turn() {
        for (a, b) in [(0.0, 1.0), (0.3, -2.0), (3.0, -3.0), (3.1, 3.1)] {
            // the shorter way round
            let mut d: f64 = b - a;
            if d.abs() > std::f64::consts::PI {
                d -= d.signum() * 2.0 * std::f64::consts::PI;
            }
            let (got, want) = (turned(a).between(&turned(b), 0.5), turned(a + 0.5 * d));
            for i in 0..9 {
                let e = (got.rotation[i / 3][i % 3] - want.rotation[i / 3][i % 3]).abs();
                assert!(e < 1e-6, "{a} to {b}, entry {i}: off by {e}");
            }
            let (p, q, m) = (turned(a).center(), turned(b).center(), got.center());
            for i in 0..3 {
                assert!((m[i] - 0.5 * (p[i] + q[i])).abs() < 2e-6, "{a} to {b}: centre {m:?}");
            }
        }
    }
}
