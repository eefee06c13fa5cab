//! A simple renderer of point clouds as discs with a depth buffer, independent of the Gaussian renderer.
//!
//! Disc p is the set of image positions (x, y) with (x − c_x)²/r_x² + (y − c_y)²/r_y² ≤ 1, where (c_x, c_y)
//! is the projected centre and r_x = f_x r/z, r_y = f_y r/z. Every pixel has 4 × 4 samples at
//! ((i + ½)/4, (j + ½)/4); each takes the nearest disc that covers it, ordered by (z, index), or the background. A pixel is
//! the mean of its samples.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | – | `points` | (P, 3) | scene units |
//! | r | `radii` | (P) | scene units, ≥ 0 |
//! | – | `rgb` | (P, 3) | sRGB-encoded; averaged in this encoding |
//! | – | `background` | (3) | sRGB-encoded |
//! | → | `image`, `alpha` | (H, W, 3), (H, W) | alpha = covered samples / 16 |
//!
//! # Rounding
//! All values are f32: x_view = ((R₀x + R₁y) + R₂z) + t; the sum over a pixel's samples is a left fold in row
//! order, followed by one product with 1/16.
//!
//! # Kinks and domain
//! Discs without extent, or with z outside [`RANGE`], are not drawn. The image is not differentiable; there
//! is no adjoint. Only pinhole cameras are supported.

use crate::num::order;
use crate::scene::camera::{Camera, Model};
use crate::{Error, Result};

/// Samples per pixel and axis.
pub const SUPERSAMPLING: usize = 4;

/// Smallest and largest z at which discs are drawn, scene units.
pub const RANGE: [f32; 2] = [0.01, 1e10];

/// An image of discs.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Image, shape (H, W, 3), sRGB-encoded.
    pub image: Vec<[f32; 3]>,
    /// Fraction of each pixel that discs cover, shape (H, W).
    pub alpha: Vec<f32>,
}

/// Renders discs on one thread; callers render many small images in parallel.
///
/// # Errors
/// Returns an error if the camera is not valid or not a pinhole camera, if the lengths differ, or if a number
/// is not finite.
pub fn render(
    points: &[[f32; 3]],
    radii: &[f32],
    rgb: &[[f32; 3]],
    camera: &Camera,
    background: [f32; 3],
) -> Result<Picture> {
    camera.validate()?;
    if camera.model != Model::Pinhole {
        return Err(Error::input("discs").at("camera").expected("pinhole").got(camera.model.name()));
    }
    if radii.len() != points.len() || rgb.len() != points.len() {
        let got = format!("{} points, {} radii, {} colours", points.len(), radii.len(), rgb.len());
        return Err(Error::input("discs").expected("as many radii and colours as points").got(got));
    }
    check_finite("points", points.as_flattened())?;
    check_finite("radii", radii)?;
    check_finite("rgb", rgb.as_flattened())?;
    check_finite("background", &background)?;
    let nearest = nearest(points, radii, camera);
    Ok(average(&nearest, rgb, camera, background))
}

/// Refuses an array with a number that is not finite.
fn check_finite(name: &str, x: &[f32]) -> Result<()> {
    match x.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(i) => {
            let e = Error::input("discs").at(format!("{name}, number {i}"));
            Err(e.expected("finite").got(x[i].to_string()))
        }
    }
}

/// Returns depth and index (4H, 4W) of the nearest disc at each sample; ∞ and `u32::MAX` if there is none.
fn nearest(points: &[[f32; 3]], radii: &[f32], camera: &Camera) -> Vec<(f32, u32)> {
    let (w, h) = (SUPERSAMPLING * camera.width, SUPERSAMPLING * camera.height);
    let mut buffer = vec![(f32::INFINITY, u32::MAX); w * h];
    for (p, (x, &radius)) in points.iter().zip(radii).enumerate() {
        let [vx, vy, z]: [f32; 3] = std::array::from_fn(|i| {
            let r = camera.rotation[i];
            ((r[0] * x[0] + r[1] * x[1]) + r[2] * x[2]) + camera.translation[i]
        });
        let is_drawn = (RANGE[0]..=RANGE[1]).contains(&z) && radius > 0.0;
        if !is_drawn {
            continue;
        }
        let scale = SUPERSAMPLING as f32;
        // In units of samples, sample i is at i + ½.
        let axis = |v: f32, k: usize| {
            let focal = scale * camera.focal_px[k];
            (focal * (v / z) + scale * camera.center_px[k], focal * (radius / z))
        };
        let ((cx, rx), (cy, ry)) = (axis(vx, 0), axis(vy, 1));
        let span = |c: f32, r: f32, n: usize| {
            let low = order::clamp((c - r - 0.5).ceil(), 0.0, n as f32);
            let high = order::clamp((c + r - 0.5).floor() + 1.0, 0.0, n as f32);
            low as usize..high as usize
        };
        for row in span(cy, ry, h) {
            let dy = (row as f32 + 0.5 - cy) / ry;
            for column in span(cx, rx, w) {
                let dx = (column as f32 + 0.5 - cx) / rx;
                let slot = &mut buffer[row * w + column];
                // Points are processed in index order, so an equal depth keeps the lower index.
                if dx * dx + dy * dy <= 1.0 && z < slot.0 {
                    *slot = (z, p as u32);
                }
            }
        }
    }
    buffer
}

/// Returns the mean of each pixel's samples.
fn average(nearest: &[(f32, u32)], rgb: &[[f32; 3]], camera: &Camera, background: [f32; 3]) -> Picture {
    let (w, pixels) = (SUPERSAMPLING * camera.width, camera.width * camera.height);
    let mut picture = Picture { image: Vec::with_capacity(pixels), alpha: Vec::with_capacity(pixels) };
    for row in 0..camera.height {
        for column in 0..camera.width {
            let (mut sum, mut covered) = ([0.0f32; 3], 0u8);
            for i in 0..SUPERSAMPLING {
                for j in 0..SUPERSAMPLING {
                    let (_, p) = nearest[(SUPERSAMPLING * row + i) * w + SUPERSAMPLING * column + j];
                    let color = if p == u32::MAX { background } else { rgb[p as usize] };
                    covered += u8::from(p != u32::MAX);
                    sum = std::array::from_fn(|c| sum[c] + color[c]);
                }
            }
            let places = (SUPERSAMPLING * SUPERSAMPLING) as f32;
            picture.image.push(sum.map(|s| s * (1.0 / places)));
            picture.alpha.push(f32::from(covered) * (1.0 / places));
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let eye = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
        Camera::from_matrices(&eye, &[8., 0., 4., 0., 8., 4., 0., 0., 1.], 8, 8, Model::Pinhole)
    }

    #[test]
    fn the_nearest_disc_wins_and_borders_are_shares() {
        // A red disc of radius 4 px behind two of 1 px, which lie at equal depth around (4, 4).
        let points = [[0.0, 0.0, 4.0], [0.0, 0.0, 2.0], [0.0, 0.0, 2.0]];
        let rgb = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let p = render(&points, &[2.0, 0.25, 0.25], &rgb, &camera(), [0.0; 3]).expect("an image");
        // Of the samples (i + ½)/4 of a pixel, 13 of 16 are within 1 px of its corner: all but those with i +
        // j > 4.
        assert_eq!(
            p.image[3 * 8 + 3],
            [3.0 / 16.0, 13.0 / 16.0, 0.0],
            "green before red, the lower index before blue"
        );
        assert_eq!((p.alpha[3 * 8 + 3], p.alpha[0]), (1.0, 0.0), "inside and far outside");
        let none = render(&points, &[0.0; 3], &rgb, &camera(), [0.5; 3]).expect("an image");
        assert!(none.image.iter().all(|c| *c == [0.5; 3]), "discs without extent are not drawn");
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        for bad in [f32::NAN, f32::INFINITY] {
            for place in 0..10 {
                let (mut points, mut radii) = ([[0.1, 0.2, 4.0], [0.0, 0.0, 2.0]], [0.5, 0.25]);
                let (mut rgb, mut background) = ([[0.2; 3]; 2], [0.0; 3]);
                match place {
                    0..3 => points[1][place] = bad,
                    3 => radii[1] = bad,
                    4..7 => rgb[1][place - 4] = bad,
                    _ => background[place - 7] = bad,
                }
                let e = render(&points, &radii, &rgb, &camera(), background).expect_err("refused");
                assert!(e.to_string().contains("finite"), "place {place}: {e}");
            }
        }
    }
}
