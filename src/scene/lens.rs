//! Removing the distortion of a lens: ideal position → position in the photo.
//!
//! A photo is resampled once, on load, into the image an ideal camera with the same focal lengths, principal
//! point and size would have taken: a pinhole for OpenCV's radial-tangential model, an equidistant fisheye
//! for its fisheye model. For every ideal pixel the forward model gives the place to read, so nothing is
//! inverted.
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | x, y | ideal position: (u − c_x)/f_x, (v − c_y)/f_y | 1 (fisheye: radians) |
//! | r | √(x² + y²); the angle θ from the axis for a fisheye | 1, radians |
//! | d | radial factor of [`Lens`] | 1 |
//!
//! Beyond the radius where r·d(r) stops growing, the model folds back and two ideal positions map to one
//! position in the photo; such pixels are masked out, as are those that map outside the photo.

use crate::io::capture::Lens;

/// Steps in which the growth of r·d(r) is checked.
const STEPS: usize = 4096;

/// A lens with the radius up to which its model is invertible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undistort {
    lens: Lens,
    limit: f64,
}

impl Undistort {
    /// Checks radii up to `largest`, the largest ideal radius of the image.
    pub fn new(lens: Lens, largest: f64) -> Self {
        // A fisheye's angle is at most π.
        let end = match lens {
            Lens::Fisheye { .. } => crate::num::order::min(largest, std::f64::consts::PI),
            Lens::Perspective { .. } => largest,
        };
        let mut limit = end;
        let mut last = 0.0;
        for i in 1..=STEPS {
            let r = end * i as f64 / STEPS as f64;
            let grown = r * radial(&lens, r * r);
            if grown > last {
                last = grown;
            } else {
                limit = end * (i - 1) as f64 / STEPS as f64;
                break;
            }
        }
        Self { lens, limit }
    }

    /// Where an ideal position lies in the photo, in the same units; `None` beyond that radius.
    ///
    /// # Rounding
    /// f64, written association; no elementary functions but √.
    pub fn place(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let r2 = x * x + y * y;
        if !(0.0..=self.limit).contains(&r2.sqrt()) {
            return None;
        }
        let d = radial(&self.lens, r2);
        Some(match self.lens {
            Lens::Perspective { tangential: [p1, p2], .. } => [
                x * d + (2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)),
                y * d + (2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y)),
            ],
            Lens::Fisheye { .. } => [x * d, y * d],
        })
    }
}

/// The radial factor at r².
fn radial(lens: &Lens, r2: f64) -> f64 {
    match lens {
        Lens::Perspective { numerator: [k1, k2, k3, k4], denominator: [n1, n2, n3], .. } => {
            let top = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
            let bottom = 1.0 + r2 * (n1 + r2 * (n2 + r2 * n3));
            // At a pole the model ends: the values behind it fail the test of growth.
            if bottom > 0.0 { top / bottom } else { f64::NEG_INFINITY }
        }
        Lens::Fisheye { k: [k1, k2, k3, k4] } => 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4))),
    }
}

/// A resampled image.
#[derive(Clone, Debug, PartialEq)]
pub struct Resampled {
    /// (H, W, 3) row-major, 0 where the mask is 0
    pub rgb: Vec<f32>,
    /// (H, W): 1 where the pixel has a place in the photo
    pub mask: Vec<u8>,
}

/// Resamples a photo (H, W, 3) to the ideal camera, bilinearly between pixel centres. A pixel is kept where
/// all four neighbours lie in the photo and are kept by `mask`.
pub fn undistort(
    rgb: &[f32],
    mask: Option<&[u8]>,
    width: usize,
    height: usize,
    [fx, fy, cx, cy]: [f64; 4],
    lens: Lens,
) -> Resampled {
    let ideal = |u: f64, v: f64| [(u - cx) / fx, (v - cy) / fy];
    let (w, h) = (width as f64, height as f64);
    let mut largest = 0.0;
    for [x, y] in [ideal(0.0, 0.0), ideal(w, 0.0), ideal(0.0, h), ideal(w, h)] {
        largest = crate::num::order::max(largest, (x * x + y * y).sqrt());
    }
    let u = Undistort::new(lens, largest);
    let mut out = Resampled { rgb: vec![0.0; width * height * 3], mask: vec![0; width * height] };
    for row in 0..height {
        for column in 0..width {
            let [x, y] = ideal(column as f64 + 0.5, row as f64 + 0.5);
            let Some([xd, yd]) = u.place(x, y) else { continue };
            let (sx, sy) = (xd * fx + cx - 0.5, yd * fy + cy - 0.5);
            if !(sx >= 0.0 && sy >= 0.0 && sx <= w - 1.0 && sy <= h - 1.0) {
                continue;
            }
            let (x0, y0) = (sx as usize, sy as usize);
            let (x1, y1) =
                (crate::num::order::min(x0 + 1, width - 1), crate::num::order::min(y0 + 1, height - 1));
            let corners = [y0 * width + x0, y0 * width + x1, y1 * width + x0, y1 * width + x1];
            if mask.is_some_and(|m| corners.iter().any(|&i| m[i] == 0)) {
                continue;
            }
            let (a, b) = ((sx - x0 as f64) as f32, (sy - y0 as f64) as f32);
            let at = row * width + column;
            out.mask[at] = 1;
            for c in 0..3 {
                let p = corners.map(|i| rgb[3 * i + c]);
                let top = p[0] + a * (p[1] - p[0]);
                let bottom = p[2] + a * (p[3] - p[2]);
                out.rgb[3 * at + c] = top + b * (bottom - top);
            }
        }
    }
    out
}
