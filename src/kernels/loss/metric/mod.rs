//! Image metrics in f64, without adjoints; every variant has its own name.
//!
//! The first image is the render and is clamped to 0..1 (not quantised); the second is the input image and is
//! used without changes. Images are sRGB-encoded. With a mask, only kept pixels count.
//!
//! | name | file | definition |
//! |---|---|---|
//! | `PSNR-full` | [`psnr`] | −10 log₁₀ MSE over all values |
//! | `PSNR-full-ch` | [`psnr`] | mean over the channels of −10 log₁₀ MSE of a channel |
//! | `PSNR-box` | [`psnr`] on [`Crop`], or with the box as mask | MSE over the pixels of a box only |
//! | `SSIM-g` | [`ssim`] | 11×11 Gaussian, σ = 1.5, zero padding, range 1 |
//! | `SSIM-g-box` | [`ssim`] on [`Crop`] | the same on the cropped images |
//! | `SSIM-sk`, `SSIM-sk-box` | [`ssim_sk`] | default of scikit-image: 7×7 uniform window, range 1 |
//! | `SSIM-sk-range2` | [`ssim_sk`] | the same with range 2, as old versions assumed for floats |
//! | `D-SSIM×1000` | [`ssim`] | 500 (1 − SSIM-g) |
//! | `RFD (not LPIPS)` | [`rfd`] | distance of responses to random filters |
//! | `MAE` | [`mae`] | mean absolute difference |
//! | `PSNR-H`, `PSNR-L`, `PSNR-A`, `PSNR-mask`, `PSNR-eroded`, `SSIM-3` | [`orb`] | scores of Stanford-ORB, of linear values after a scale per channel |
//!
//! [`crate::scene::bound`] computes the projected box of a person; with it as the mask, [`psnr`] returns
//! `PSNR-box` on exactly its pixels. [`person`] computes all of these metrics at once. [`structure`]
//! evaluates learned causal structure. [`orb`] has further scores, of normals and depth.
//! [`mutual`] does not apply to images: it estimates mutual information from samples.

pub mod mae;
pub mod mutual;
pub mod orb;
pub mod person;
pub mod psnr;
pub mod rfd;
pub mod ssim;
pub mod ssim_sk;
pub mod structure;

use super::In;
use crate::{Error, Result};

/// Returns the clamped value of a render in f64.
#[inline(always)]
pub(crate) fn clamped(x: f32) -> f64 {
    crate::num::order::clamp(f64::from(x), 0.0, 1.0)
}

/// A rectangle cropped from two images and their mask.
#[derive(Clone, Debug)]
pub struct Crop {
    x: Vec<f32>,
    y: Vec<f32>,
    mask: Option<Vec<f32>>,
    height: usize,
    width: usize,
}

impl Crop {
    /// Crops rows `top..bottom`, columns `left..right`.
    ///
    /// # Errors
    /// Returns an error if the box is empty or extends beyond the image, or if sizes disagree.
    pub fn new(x: &In<'_>, [top, left]: [usize; 2], [bottom, right]: [usize; 2]) -> Result<Self> {
        x.check("metric on a box")?;
        if !(top < bottom && left < right && bottom <= x.height && right <= x.width) {
            return Err(Error::input("metric on a box")
                .at(format!("rows {top}..{bottom}, columns {left}..{right}"))
                .expected(format!("a box inside {}x{}", x.height, x.width))
                .got("an empty box, or one that extends beyond the image"));
        }
        let cut = |image: &[f32], channels: usize| -> Vec<f32> {
            (top..bottom)
                .flat_map(|r| &image[(r * x.width + left) * channels..(r * x.width + right) * channels])
                .copied()
                .collect()
        };
        Ok(Self {
            x: cut(x.x, 3),
            y: cut(x.y, 3),
            mask: x.mask.map(|m| cut(m, 1)),
            height: bottom - top,
            width: right - left,
        })
    }

    /// Returns the cropped images as an argument of any metric or loss.
    pub fn view(&self) -> In<'_> {
        In { x: &self.x, y: &self.y, mask: self.mask.as_deref(), height: self.height, width: self.width }
    }
}
