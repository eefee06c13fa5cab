//! The box around the person: `bound_mask` of the human-avatar programs.
//!
//! Bounds of the posed points, grown by [`PersonCapture::box_margin`] on every side; the eight corners are projected, and a pixel is inside if its
//! centre lies in one of the six projected faces (their union is the outline of the box). A box that reaches behind the camera covers
//! the whole picture.

use super::{PersonCapture, Shot};
use crate::num::order;
use crate::scene::camera::{Camera, Model};

/// Depth below which a corner counts as behind the camera, scene units.
const NEAR: f64 = 1e-3;

/// Corners of the faces; bit k of a corner chooses the upper bound of axis k.
const FACES: [[usize; 4]; 6] =
    [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];

impl PersonCapture {
    /// Lower and upper corner of the box of a moment.
    pub fn bounds(&self, time: usize) -> [[f32; 3]; 2] {
        let mut out = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for x in self.posed_points(time) {
            for k in 0..3 {
                out[0][k] = order::min(out[0][k], x[k]);
                out[1][k] = order::max(out[1][k], x[k]);
            }
        }
        [out[0].map(|x| x - self.box_margin), out[1].map(|x| x + self.box_margin)]
    }

    /// (H, W) 1 inside the projected box of the shot's moment.
    pub fn box_mask(&self, shot: &Shot) -> Vec<u8> {
        box_mask(self.bounds(shot.time), &shot.camera)
    }
}

/// (H, W) 1 inside the projection of an axis-aligned box.
pub(super) fn box_mask([low, high]: [[f32; 3]; 2], camera: &Camera) -> Vec<u8> {
    let (w, h) = (camera.width, camera.height);
    let mut corners = [[0.0f64; 2]; 8];
    for (i, corner) in corners.iter_mut().enumerate() {
        let x: [f64; 3] = std::array::from_fn(|k| f64::from(if i >> k & 1 == 1 { high[k] } else { low[k] }));
        match project(camera, x) {
            Some(p) => *corner = p,
            None => return vec![1; w * h],
        }
    }
    let mut out = vec![0; w * h];
    for face in FACES {
        fill(&mut out, w, h, face.map(|i| corners[i]));
    }
    out
}

/// Pixel position of a point; none behind the camera, nor for a fisheye, where a box is no polygon.
pub fn project(camera: &Camera, x: [f64; 3]) -> Option<[f64; 2]> {
    let v: [f64; 3] = std::array::from_fn(|i| {
        let r = camera.rotation[i].map(f64::from);
        ((r[0] * x[0] + r[1] * x[1]) + r[2] * x[2]) + f64::from(camera.translation[i])
    });
    let scale = match camera.model {
        Model::Pinhole if v[2] > NEAR => 1.0 / v[2],
        Model::Orthographic => 1.0,
        _ => return None,
    };
    Some(std::array::from_fn(|k| {
        f64::from(camera.focal_px[k]) * v[k] * scale + f64::from(camera.center_px[k])
    }))
}

/// Sets the pixels whose centres lie in a convex polygon, its edges included.
fn fill(out: &mut [u8], w: usize, h: usize, polygon: [[f64; 2]; 4]) {
    // Twice the area, for the sign; a face seen from its edge covers nothing.
    let mut area = 0.0;
    for i in 0..4 {
        let (a, b) = (polygon[i], polygon[(i + 1) % 4]);
        area = area + (a[0] * b[1] - a[1] * b[0]);
    }
    let sign = if area < 0.0 { -1.0 } else { 1.0 };
    let limit = |k: usize, n: usize| -> (usize, usize) {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in polygon {
            low = order::min(low, p[k]);
            high = order::max(high, p[k]);
        }
        let end = order::min(order::max(high + 1.0, 0.0), n as f64);
        (order::max(low - 1.0, 0.0) as usize, end as usize)
    };
    let ((x0, x1), (y0, y1)) = (limit(0, w), limit(1, h));
    for row in y0..y1 {
        for column in x0..x1 {
            let p = [column as f64 + 0.5, row as f64 + 0.5];
            let is_inside = (0..4).all(|i| {
                let (a, b) = (polygon[i], polygon[(i + 1) % 4]);
                sign * ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])) >= 0.0
            });
            if is_inside && area != 0.0 {
                out[row * w + column] = 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let eye = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 4., 0., 0., 0., 1.];
        Camera::from_matrices(&eye, &[8., 0., 8., 0., 8., 8., 0., 0., 1.], 16, 16, Model::Pinhole)
    }

    #[test]
    fn a_cube_ahead_is_a_square() {
        // Its near face, at z = 3, spans 8 ± 8/3 pixels: centres 5.5 … 10.5.
        let mask = box_mask([[-1.0; 3], [1.0; 3]], &camera());
        for row in 0..16 {
            for column in 0..16 {
                let inside = |i: usize| (5..=10).contains(&i);
                let expected = u8::from(inside(row) && inside(column));
                assert_eq!(mask[row * 16 + column], expected, "row {row}, column {column}");
            }
        }
    }

    #[test]
    fn a_box_around_the_camera_is_everything() {
        assert!(box_mask([[-9.0; 3], [9.0; 3]], &camera()).iter().all(|&m| m == 1), "whole picture");
    }
}
