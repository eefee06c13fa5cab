//! One input image as used by the fit: the loss in the box of the person and its gradient with respect to the
//! render.
//!
//! L = mean_box |x − y| + w_α · mean_box (α − m)² + w_s · (1 − SSIM of the bounding rectangle of the box)
//!
//! | symbol | shape | meaning |
//! |---|---|---|
//! | x, α | (H, W, 3), (H, W) | render and its alpha |
//! | y, m | (H, W, 3), (H, W) | input image, mask 0..1; y is composited over the background of the render: y + (1 − m) b |
//!
//! # Rounding
//! L1, squared error and SSIM as in [`crate::loss`]; their weighted sum is computed in f64.

use super::guide::Square;
use super::settings::Settings;
use crate::loss::metric::ssim_sk;
use crate::loss::{self, In};
use crate::scene::bound;
use crate::scene::camera::Camera;
use crate::scene::person::{PersonCapture, Shot};
use crate::splat::blend::Out;
use crate::{Error, Result};
use std::borrow::Cow;

/// An input image prepared for comparison.
#[derive(Clone, Debug)]
pub struct Target {
    /// The camera of the image.
    pub camera: Camera,
    /// Index of the pose.
    pub time: usize,
    /// The person over black, already weighted by the mask, shape (H, W, 3).
    pub photo: Vec<f32>,
    /// The mask 0..1, shape (H, W).
    pub mask: Vec<f32>,
    /// The square around the projected points of the body.
    pub person: Option<Square>,
    /// Mask (H, W) with 1 for pixels inside the person's box that are evaluated.
    pub inside: Vec<f32>,
    /// Bounding rectangle of the ones of `inside`: `[top, left]`, `[bottom, right]`.
    pub rectangle: [[usize; 2]; 2],
    /// Mask with 1 for pixels of the rectangle that are evaluated; absent if all are.
    crop_mask: Option<Vec<f32>>,
}

/// Value and gradients of the loss.
#[derive(Clone, Debug)]
pub struct LossAndGradients {
    /// The loss L.
    pub loss: f32,
    /// Gradient with respect to the image, shape (H, W, 3).
    pub image_bar: Vec<f32>,
    /// Gradient with respect to alpha, shape (H, W).
    pub alpha_bar: Vec<f32>,
}

/// The rows of a rectangle of an array (H, W, C).
fn cut(
    image: &[f32],
    width: usize,
    channels: usize,
    [[top, left], [bottom, right]]: [[usize; 2]; 2],
) -> Vec<f32> {
    (top..bottom)
        .flat_map(|r| &image[(r * width + left) * channels..(r * width + right) * channels])
        .copied()
        .collect()
}

/// Refuses a shot whose box around the person contains fewer pixels than the windows of the scores need.
///
/// # Errors
/// If the person is outside the image, or smaller than a window.
pub fn check(capture: &PersonCapture, shot: &Shot) -> Result<()> {
    let [[top, left], [bottom, right]] =
        bound::rectangle(&capture.box_mask(shot), shot.camera.width).ok_or_else(|| outside(shot))?;
    let least = ssim_sk::SIDE;
    if bottom - top >= least && right - left >= least {
        return Ok(());
    }
    Err(Error::input(shot.name.clone())
        .expected(format!("a person of at least {least}×{least} pixels"))
        .got(format!("a box of {}×{}", right - left, bottom - top))
        .hint("check that camera and pose belong to this image"))
}

fn outside(shot: &Shot) -> Error {
    Error::input(shot.name.clone())
        .expected("a person inside the image")
        .got("a box that contains no pixel")
        .hint("check that camera and pose belong to this image")
}

impl Target {
    /// Reads the pixels of a shot.
    ///
    /// # Errors
    /// If they cannot be read, or the person is outside the image.
    pub fn read(capture: &PersonCapture, shot: &Shot) -> Result<Self> {
        let pixels = shot.photo()?;
        let camera = shot.camera.clone();
        let width = camera.width;
        let photo: Vec<f32> = pixels.rgb.iter().map(|&b| f32::from(b) / 255.0).collect();
        let mut inside = capture.box_mask(shot);
        if let Some(valid) = &pixels.valid {
            for (x, &v) in inside.iter_mut().zip(valid) {
                *x *= f32::from(v);
            }
        }
        let Some(rectangle) = bound::rectangle(&inside, width) else {
            return Err(outside(shot));
        };
        let crop_mask = pixels.valid.as_ref().map(|v| {
            let all: Vec<f32> = v.iter().map(|&v| f32::from(v)).collect();
            cut(&all, width, 1, rectangle)
        });
        Ok(Self {
            crop_mask,
            person: Square::around(&camera, &capture.posed_points(shot.time)),
            camera,
            time: shot.time,
            photo,
            mask: pixels.mask,
            inside,
            rectangle,
        })
    }

    /// The input image over a background colour, y + (1 − m) b, shape (H, W, 3).
    pub fn before(&self, background: [f32; 3]) -> Cow<'_, [f32]> {
        if background == [0.0; 3] {
            return Cow::Borrowed(&self.photo);
        }
        let mut photo = self.photo.clone();
        for (rgb, m) in photo.chunks_exact_mut(3).zip(&self.mask) {
            for k in 0..3 {
                rgb[k] += (1.0 - m) * background[k];
            }
        }
        Cow::Owned(photo)
    }

    /// Compares a render with the input image over a background colour.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn compare(&self, out: &Out, background: [f32; 3], settings: &Settings) -> Result<LossAndGradients> {
        let (height, width) = (self.camera.height, self.camera.width);
        let photo = self.before(background);
        let pair = In { x: &out.image, y: &photo, mask: Some(&self.inside), height, width };
        let (l1, saved) = loss::l1::forward(&pair)?;
        let mut image_bar = vec![0.0; out.image.len()];
        loss::l1::adjoint(&pair, &saved, 1.0, &mut image_bar, None);
        let mut total = f64::from(l1);
        let mut alpha_bar = vec![0.0; out.alpha.len()];
        if settings.alpha_weight > 0.0 {
            let pair = In { x: &out.alpha, y: &self.mask, ..pair };
            let (coverage, saved) = loss::mse::forward(&pair)?;
            loss::mse::adjoint(&pair, &saved, settings.alpha_weight, &mut alpha_bar, None);
            total += f64::from(settings.alpha_weight) * f64::from(coverage);
        }
        if settings.ssim_weight > 0.0 {
            let [[top, left], [bottom, right]] = self.rectangle;
            let [x, y] = [&out.image[..], &photo[..]].map(|i| cut(i, width, 3, self.rectangle));
            let (h, w) = (bottom - top, right - left);
            let pair = In { x: &x, y: &y, mask: self.crop_mask.as_deref(), height: h, width: w };
            let (ssim, saved) = loss::ssim::forward(&pair)?;
            total += f64::from(settings.ssim_weight) * (1.0 - f64::from(ssim));
            let mut bar = vec![0.0; x.len()];
            loss::ssim::adjoint(&pair, &saved, -settings.ssim_weight, &mut bar, None);
            for (r, row) in bar.chunks_exact(3 * w).enumerate() {
                let at = 3 * ((top + r) * width + left);
                for (to, from) in image_bar[at..at + 3 * w].iter_mut().zip(row) {
                    *to += *from;
                }
            }
        }
        let loss = total as f32;
        if !loss.is_finite() {
            return Err(Error::check("person fit")
                .at("loss")
                .expected("a finite number")
                .got(loss.to_string()));
        }
        Ok(LossAndGradients { loss, image_bar, alpha_bar })
    }
}
