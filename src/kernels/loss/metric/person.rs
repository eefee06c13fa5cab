//! All image metrics of one view of a person, each with its name.
//!
//! The box is the projected box of the person ([`crate::scene::bound`]). `PSNR-box` uses its pixels;
//! `SSIM-g-box`, `SSIM-sk-box` and `RFD-box` use the smallest rectangle around it. If there are weights,
//! LPIPS is computed for that rectangle and for the complete image. All others use the complete image. The
//! caller decides, as part of the protocol, whether pixels outside the box were replaced by the background
//! beforehand ([`crate::scene::bound::clear_outside`]).

use super::{Crop, psnr, rfd, ssim, ssim_sk};
use crate::loss::{In, lpips};
use crate::num::{order, sum};
use crate::scene::bound;
use crate::{Error, Result};

/// Metrics of one view, or their means over views.
#[derive(Clone, Debug, PartialEq)]
pub struct Scores {
    /// Mean squared error over all values; its decibel value is `PSNR-full`.
    pub full: psnr::Psnr,
    /// PSNR averaged over channels, `PSNR-full-ch`.
    pub full_ch: psnr::Psnr,
    /// PSNR of the box, `PSNR-box`.
    pub boxed: psnr::Psnr,
    /// SSIM with a Gaussian window, `SSIM-g`.
    pub ssim_g: f64,
    /// The same on the box, `SSIM-g-box`.
    pub ssim_g_box: f64,
    /// SSIM of scikit-image, `SSIM-sk`.
    pub ssim_sk: f64,
    /// The same on the box, `SSIM-sk-box`.
    pub ssim_sk_box: f64,
    /// SSIM of scikit-image with range 2, `SSIM-sk-range2`.
    pub ssim_sk_range_2: f64,
    /// Random-filter distance, `RFD (not LPIPS)`.
    pub rfd: f64,
    /// The same on the box, `RFD-box (not LPIPS)`.
    pub rfd_box: f64,
    /// LPIPS with the user's weights: name and value for the complete image, and for the box if its rectangle
    /// is large enough.
    pub lpips: Vec<(&'static str, f64)>,
}

/// Returns the metrics of one view; `mask` (H, W) is the person's box, `perception` the weights and settings
/// of LPIPS.
///
/// # Errors
/// Returns an error under the conditions of the metrics; the rectangle around the box must have at least 7×7
/// pixels.
pub fn forward(x: &In<'_>, mask: &[f32], perception: Option<&lpips::Metric>) -> Result<Scores> {
    let inside = In { mask: Some(mask), ..*x };
    inside.check("metrics of a person")?;
    let Some([from, to]) = bound::rectangle(mask, x.width) else {
        return Err(Error::input("metrics of a person").expected("a box that covers a pixel").got("none"));
    };
    let crop = Crop::new(x, from, to)?;
    let mut perceived = Vec::new();
    if let Some(metric) = perception {
        let [whole, boxed] = metric.names();
        perceived.push((whole, metric.score(x)?));
        let rectangle = In { mask: None, ..crop.view() };
        if order::min(rectangle.height, rectangle.width) >= lpips::SMALLEST {
            perceived.push((boxed, metric.score(&rectangle)?));
        }
    }
    Ok(Scores {
        full: psnr::forward(x)?,
        full_ch: psnr::per_channel(x)?,
        boxed: psnr::forward(&inside)?,
        ssim_g: ssim::forward(x)?,
        ssim_g_box: ssim::forward(&crop.view())?,
        ssim_sk: ssim_sk::forward(x, 1.0)?,
        ssim_sk_box: ssim_sk::forward(&crop.view(), 1.0)?,
        ssim_sk_range_2: ssim_sk::forward(x, 2.0)?,
        rfd: rfd::forward(x)?,
        rfd_box: rfd::forward(&crop.view())?,
        lpips: perceived,
    })
}

impl Scores {
    /// Returns names and values in the order of a table. A PSNR is infinite for identical images.
    pub fn named(&self) -> Vec<(&'static str, f64)> {
        let level = |p: &psnr::Psnr| p.db.finite().unwrap_or(f64::INFINITY);
        let mut all = vec![
            (psnr::NAME, level(&self.full)),
            (psnr::NAME_CHANNELS, level(&self.full_ch)),
            (psnr::NAME_BOX, level(&self.boxed)),
            (ssim::NAME, self.ssim_g),
            (ssim::NAME_BOX, self.ssim_g_box),
            ("D-SSIM×1000", ssim::d_ssim_1000(self.ssim_g)),
            ("D-SSIM×1000-box", ssim::d_ssim_1000(self.ssim_g_box)),
            (ssim_sk::NAME, self.ssim_sk),
            (ssim_sk::NAME_BOX, self.ssim_sk_box),
            (ssim_sk::NAME_RANGE_2, self.ssim_sk_range_2),
            (rfd::NAME, self.rfd),
            ("RFD-box (not LPIPS)", self.rfd_box),
        ];
        all.extend(&self.lpips);
        all
    }
}

/// Returns means over views: of decibels for PSNR (infinite if one is), of values for all others. Returns
/// `None` if there are no views.
pub fn mean(views: &[Scores]) -> Option<Scores> {
    let of = |value: &dyn Fn(&Scores) -> f64| {
        let values: Vec<f64> = views.iter().map(value).collect();
        sum::tree_f64(&values) / values.len() as f64
    };
    let level = |value: &dyn Fn(&Scores) -> psnr::Psnr| {
        let all: Vec<psnr::Psnr> = views.iter().map(value).collect();
        psnr::mean_of_psnr(&all).map(|db| psnr::Psnr { mse: of(&|s| value(s).mse), db })
    };
    Some(Scores {
        full: level(&|s| s.full)?,
        full_ch: level(&|s| s.full_ch)?,
        boxed: level(&|s| s.boxed)?,
        ssim_g: of(&|s| s.ssim_g),
        ssim_g_box: of(&|s| s.ssim_g_box),
        ssim_sk: of(&|s| s.ssim_sk),
        ssim_sk_box: of(&|s| s.ssim_sk_box),
        ssim_sk_range_2: of(&|s| s.ssim_sk_range_2),
        rfd: of(&|s| s.rfd),
        rfd_box: of(&|s| s.rfd_box),
        lpips: lpips_means(views),
    })
}

/// Returns the means of the LPIPS variants that all views have.
fn lpips_means(views: &[Scores]) -> Vec<(&'static str, f64)> {
    let of = |view: &Scores, name: &str| view.lpips.iter().find(|(n, _)| *n == name).map(|(_, x)| *x);
    let mean = |name: &'static str| {
        let values: Vec<f64> = views.iter().map(|view| of(view, name)).collect::<Option<_>>()?;
        Some((name, sum::tree_f64(&values) / values.len() as f64))
    };
    views.first().map_or_else(Vec::new, |v| v.lpips.iter().filter_map(|(name, _)| mean(name)).collect())
}
