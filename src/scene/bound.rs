//! The projected box of a person, `bound_mask`: where published scores of people count.
//!
//! The eight corners of a box in the world are projected, the six faces are filled, and the mask is their
//! union: 1 inside or on an edge, 0 elsewhere. What lies outside can be set to the background before an image
//! is scored ([`clear_outside`]), as GauHuman does, and a score can be restricted to the smallest rectangle
//! around it ([`rectangle`]), as NeuralBody does with SSIM.
//!
//! A pixel belongs to a face if its centre does. (OpenCV's `fillPoly`, behind the published code, rounds
//! corners to integer pixels and draws the outline too; the two masks differ along their border.)
//!
//! # Rounding
//! Corners are projected in f64. A point is inside a quadrangle when the four cross products of an edge with
//! the way from its start to the point are all ≥ 0 or all ≤ 0, and it lies in the quadrangle's own bounding
//! rectangle; a face seen edge-on (area 0) covers nothing.

use crate::num::{order, par};
use crate::scene::camera::{Camera, Model};
use crate::{Error, Result};

/// Corners of a face, as bits of the index of a corner (1: x, 2: y, 4: z), around it.
const FACES: [[usize; 4]; 6] =
    [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];

/// Smallest and largest coordinates of points, widened by `margin`: 0.05 m for ZJU-MoCap, 0.1 m for MonoCap.
///
/// # Errors
/// When there is no point.
pub fn bounds(points: &[[f32; 3]], margin: f32) -> Result<[[f32; 3]; 2]> {
    let Some(&first) = points.first() else {
        return Err(Error::input("bounds").expected("at least one point").got("none"));
    };
    let [mut low, mut high] = [first; 2];
    for p in points {
        for k in 0..3 {
            low[k] = order::min(low[k], p[k]);
            high[k] = order::max(high[k], p[k]);
        }
    }
    Ok([low.map(|x| x - margin), high.map(|x| x + margin)])
}

/// A point of the world in pixels; `None` where it has no place in the image.
pub fn project(camera: &Camera, p: [f64; 3]) -> Option<[f64; 2]> {
    let view: [f64; 3] = std::array::from_fn(|i| {
        let r = camera.rotation[i].map(f64::from);
        ((r[0] * p[0] + r[1] * p[1]) + r[2] * p[2]) + f64::from(camera.translation[i])
    });
    let [x, y, z] = view;
    let plane = match camera.model {
        Model::Orthographic => [x, y],
        Model::Pinhole if z > 0.0 => [x / z, y / z],
        Model::Fisheye if z > 0.0 => {
            let rho = (x * x + y * y).sqrt();
            let ratio = if rho == 0.0 { 1.0 / z } else { libm::atan2(rho, z) / rho };
            [x * ratio, y * ratio]
        }
        _ => return None,
    };
    Some(std::array::from_fn(|k| plane[k] * f64::from(camera.focal_px[k]) + f64::from(camera.center_px[k])))
}

fn covers(face: &[[f64; 2]; 4], p: [f64; 2]) -> bool {
    let (mut left, mut right) = (true, true);
    for i in 0..4 {
        let (a, b) = (face[i], face[(i + 1) % 4]);
        let side = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        left &= side >= 0.0;
        right &= side <= 0.0;
    }
    (left != right) && (0..2).all(|k| face.iter().any(|c| c[k] <= p[k]) && face.iter().any(|c| c[k] >= p[k]))
}

/// The mask (H, W) of the box from `low` to `high` as the camera sees it.
///
/// # Errors
/// When the box is empty or not finite, or a corner lies behind the camera.
pub fn bound_mask(camera: &Camera, [low, high]: [[f32; 3]; 2]) -> Result<Vec<f32>> {
    const WHAT: &str = "bound_mask";
    if !(0..3).all(|k| low[k] <= high[k] && (high[k] - low[k]).is_finite()) {
        return Err(Error::input(WHAT)
            .at("the box")
            .expected("finite corners, the lower one first")
            .got(format!("{low:?} to {high:?}")));
    }
    let mut corners = [[0.0; 2]; 8];
    for (bits, corner) in corners.iter_mut().enumerate() {
        let p: [f32; 3] = std::array::from_fn(|k| if bits >> k & 1 == 1 { high[k] } else { low[k] });
        *corner = project(camera, p.map(f64::from)).ok_or_else(|| {
            Error::input(WHAT)
                .at(format!("corner {p:?}"))
                .expected("a box in front of the camera")
                .got("a corner behind it")
        })?;
    }
    let faces = FACES.map(|face| face.map(|c| corners[c]));
    let mut mask = vec![0.0; camera.height * camera.width];
    if mask.is_empty() {
        return Ok(mask);
    }
    par::chunks_mut(&mut mask, camera.width, |r, row| {
        for (c, m) in row.iter_mut().enumerate() {
            let p = [c as f64 + 0.5, r as f64 + 0.5];
            *m = f32::from(u8::from(faces.iter().any(|face| covers(face, p))));
        }
    });
    Ok(mask)
}

/// The smallest rectangle around the ones of a mask (H, W) of width `width`: `[top, left]` and, one beyond,
/// `[bottom, right]`, as a crop takes them. `None` for a mask without a one.
pub fn rectangle(mask: &[f32], width: usize) -> Option<[[usize; 2]; 2]> {
    let mut found: Option<[[usize; 2]; 2]> = None;
    for i in (0..mask.len()).filter(|&i| mask[i] == 1.0) {
        let (r, c) = (i / width, i % width);
        let [from, to] = found.get_or_insert([[r, c], [r + 1, c + 1]]);
        (from[0], from[1]) = (order::min(from[0], r), order::min(from[1], c));
        (to[0], to[1]) = (order::max(to[0], r + 1), order::max(to[1], c + 1));
    }
    found
}

/// Sets the pixels of an image (H, W, 3) that a mask (H, W) leaves out to one colour.
///
/// # Panics
/// When the sizes do not fit.
pub fn clear_outside(image: &mut [f32], mask: &[f32], background: [f32; 3]) {
    assert_eq!(image.len(), 3 * mask.len(), "three values per pixel of the mask");
    for (pixel, _) in image.chunks_exact_mut(3).zip(mask).filter(|(_, m)| **m == 0.0) {
        pixel.copy_from_slice(&background);
    }
}
