//! What a reconstruction from a few images has to beat.
//!
//! | baseline | an image of it |
//! |---|---|
//! | nearest view | the input image whose camera is in the direction nearest to that of the wanted one, unchanged |
//! | hull | the visual hull of the inputs (a point is in it if no input shows it as background), coloured with the mean of the inputs that show the point |
//! | blurred hull | the image of the hull, blurred ([`blurred`]): what a sharp edge in the wrong place costs |
//!
//! A point of the hull's surface is seen by an input if the hull does not begin more than [`SLACK`] in front
//! of it. A pixel that the object covers in part shows the object's share, not the white behind it. Images of
//! the hull are means over 2×2 rays per pixel. Both are given the true foreground. A model that reads marked
//! backgrounds (`small`) gets it too, one that reads colours over white (`paper`) does not.

use super::views::View;
use crate::fit::field::targets::share;
use crate::num::elem::f64 as elem;
use crate::num::{order, par};
use crate::scene::bound::project;
use crate::scene::camera::Camera;

/// Points along a ray through the ball.
const STEPS: usize = 192;
/// Radius of the ball of the object.
const RADIUS: f64 = 0.5;
/// Rays of a pixel along each side.
const RAYS: usize = 2;
/// Standard deviation of [`blurred`], in pixels: of ½, 1, 1½, 2, 2½ and 3 the one with the most decibels
/// after four images and after eight together, on six objects of seed 1.
const SIGMA: f64 = 1.0;
/// How far in front of a point the hull may begin for an input that sees it.
pub const SLACK: f64 = 0.02;

/// An image (H, W, 3) blurred by a Gaussian whose standard deviation is a pixel, cut off at three; beyond the
/// border it is white.
///
/// A mean squared error prefers a blurred edge to a sharp one in the wrong place: an image of the hull has
/// more decibels when it is blurred, and a model that is unsure of its edges has those too.
pub fn blurred(image: &[f32], [height, width]: [usize; 2]) -> Vec<f32> {
    let reach = (3.0 * SIGMA) as isize;
    let bell = |k: isize| elem::exp(-0.5 * (k as f64 / SIGMA) * (k as f64 / SIGMA));
    let total = (-reach..=reach).fold(0.0, |sum, k| sum + bell(k));
    let weights: Vec<f64> = (-reach..=reach).map(|k| bell(k) / total).collect();
    // Along rows, then along columns: the value at a distance of `k` pixels.
    let along = |from: &[f32], at: &dyn Fn(usize, isize) -> Option<usize>| -> Vec<f32> {
        let one = |i: usize| {
            let sum = (-reach..=reach)
                .zip(&weights)
                .fold(0.0, |sum, (k, w)| sum + w * at(i, k).map_or(1.0, |i| f64::from(from[i])));
            sum as f32
        };
        (0..from.len()).map(one).collect()
    };
    let inside = |x: usize, k: isize, size: usize| x.checked_add_signed(k).filter(|x| *x < size);
    let rows = along(image, &|i, k| {
        let x = inside(i / 3 % width, k, width)?;
        Some((i / 3 / width * width + x) * 3 + i % 3)
    });
    along(&rows, &|i, k| {
        let y = inside(i / 3 / width, k, height)?;
        Some((y * width + i / 3 % width) * 3 + i % 3)
    })
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// The direction from the origin to a camera.
fn towards(camera: &Camera) -> [f64; 3] {
    let c = camera.center().map(f64::from);
    let length = dot(c, c).sqrt();
    if length > 0.0 { c.map(|x| x / length) } else { c }
}

/// The input nearest to a camera; the first of several.
///
/// # Panics
/// Panics without inputs.
pub fn nearest<'a>(inputs: &[&'a View], camera: &Camera) -> &'a View {
    let wanted = towards(camera);
    let cosine = |view: &View| dot(towards(&view.picture.camera), wanted);
    let best =
        (1..inputs.len()).fold(0, |best, i| if cosine(inputs[i]) > cosine(inputs[best]) { i } else { best });
    inputs[best]
}

/// The pixel of a point, if it is in the image.
fn pixel(camera: &Camera, p: [f64; 3]) -> Option<usize> {
    let [x, y] = project(camera, p)?;
    let is_inside = x >= 0.0 && y >= 0.0 && x < camera.width as f64 && y < camera.height as f64;
    is_inside.then(|| y as usize * camera.width + x as usize)
}

/// The visual hull of some images.
#[derive(Debug)]
pub struct Hull<'a> {
    inputs: &'a [&'a View],
}

impl<'a> Hull<'a> {
    /// The hull of the ball's points that no image shows as background.
    pub fn new(inputs: &'a [&'a View]) -> Self {
        Self { inputs }
    }

    fn has(&self, p: [f64; 3]) -> bool {
        let is_background =
            |v: &View| pixel(&v.picture.camera, p).is_some_and(|i| v.picture.foreground[i] < 0.5);
        dot(p, p) <= RADIUS * RADIUS && !self.inputs.iter().any(|v| is_background(v))
    }

    /// The distance along a ray at which the hull begins.
    fn first(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let (b, c) = (dot(origin, direction), dot(origin, origin) - RADIUS * RADIUS);
        let square = b * b - c;
        if square <= 0.0 {
            return None;
        }
        let half = square.sqrt();
        let start = order::max(-b - half, 0.0);
        let step = (half - b - start) / STEPS as f64;
        (0..STEPS).map(|i| start + (i as f64 + 0.5) * step).find(|t| self.has(along(origin, direction, *t)))
    }

    /// The mean colour of the images that show a point; `None` if none does.
    fn color(&self, p: [f64; 3]) -> Option<[f32; 3]> {
        let (mut sum, mut n) = ([0.0; 3], 0.0);
        for view in self.inputs {
            let camera = &view.picture.camera;
            let Some(i) = pixel(camera, p) else { continue };
            let eye = camera.center().map(f64::from);
            let to: [f64; 3] = std::array::from_fn(|k| p[k] - eye[k]);
            let distance = dot(to, to).sqrt();
            let begins = self.first(eye, to.map(|x| x / distance));
            if begins.is_some_and(|t| t >= distance - SLACK) && view.picture.foreground[i] >= 0.5 {
                let color = share(view.picture.color.as_chunks().0[i], view.picture.foreground[i]);
                (0..3).for_each(|k| sum[k] += color[k]);
                n += 1.0;
            }
        }
        (n > 0.0).then(|| sum.map(|x| x / n))
    }

    /// An image over white, (H, W, 3), and the part of every pixel that the hull covers, (H, W).
    pub fn image(&self, camera: &Camera) -> (Vec<f32>, Vec<f32>) {
        let mean = self.mean();
        let row = |y: usize| {
            let at = |pixel: usize, i: usize| pixel as f32 + (i as f32 + 0.5) / RAYS as f32;
            let ray = |x: f32, y: f32| {
                let hit = camera.ray([x, y]).and_then(|(o, d)| {
                    let (o, d) = (o.map(f64::from), d.map(f64::from));
                    self.first(o, d).map(|t| along(o, d, t))
                });
                hit.map_or(([1.0; 3], 0.0), |p| (self.color(p).unwrap_or(mean), 1.0))
            };
            let one = |x: usize| {
                let (mut color, mut covered) = ([0.0; 3], 0.0);
                for i in 0..RAYS * RAYS {
                    let (c, m) = ray(at(x, i % RAYS), at(y, i / RAYS));
                    (0..3).for_each(|k| color[k] += c[k]);
                    covered += m;
                }
                let n = (RAYS * RAYS) as f32;
                (color.map(|x| x / n), covered / n)
            };
            (0..camera.width).map(one).collect::<Vec<([f32; 3], f32)>>()
        };
        let (color, covered): (Vec<[f32; 3]>, _) = par::map(camera.height, row).concat().into_iter().unzip();
        (color.into_flattened(), covered)
    }

    /// The mean colour of the object, for points that no image shows.
    fn mean(&self) -> [f32; 3] {
        let (mut sum, mut n) = ([0.0_f64; 3], 0.0);
        for v in self.inputs {
            let pixels = v.picture.color.as_chunks::<3>().0.iter().zip(&v.picture.foreground);
            for (x, m) in pixels.filter(|(_, m)| **m >= 0.5) {
                let x = share(*x, *m);
                (0..3).for_each(|k| sum[k] += f64::from(x[k]));
                n += 1.0;
            }
        }
        if n > 0.0 { sum.map(|x| (x / n) as f32) } else { [1.0; 3] }
    }
}

fn along(o: [f64; 3], d: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|k| o[k] + t * d[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blurred_image_is_a_mean_around_every_pixel_and_white_beyond_the_border() {
        let size = [9, 11];
        let at = |y: usize, x: usize, c: usize| (y * size[1] + x) * 3 + c;
        let white = vec![1.0; size[0] * size[1] * 3];
        assert!(blurred(&white, size).iter().all(|x| (x - 1.0).abs() < 1e-6));
        let mut dot = white;
        dot[at(4, 5, 1)] = 0.0;
        let soft = blurred(&dot, size);
        let gone = |y, x, c| f64::from(1.0 - soft[at(y, x, c)]);
        let all = soft.iter().fold(0.0, |sum, x| sum + f64::from(1.0 - x));
        assert!((all - 1.0).abs() < 1e-5, "nothing is lost: {all}");
        // 1 / (1 + 2e^(−1/2) + 2e^(−2) + 2e^(−9/2)) = 0.399050, squared.
        assert!((gone(4, 5, 1) - 0.159241).abs() < 1e-6, "{}", gone(4, 5, 1));
        let next = gone(4, 5, 1) * elem::exp(-0.5);
        assert!((gone(4, 6, 1) - next).abs() < 1e-6 && (gone(3, 5, 1) - next).abs() < 1e-6);
        assert!(gone(4, 9, 1) == 0.0 && gone(4, 5, 0).abs() < 1e-6, "cut off; other channels stay");
        let black = blurred(&vec![0.0; size[0] * size[1] * 3], size);
        assert!(black[at(0, 0, 0)] > 0.3 && black[at(4, 5, 0)].abs() < 1e-6, "white comes in at the border");
    }
}
