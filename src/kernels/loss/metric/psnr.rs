//! Peak signal-to-noise ratio in decibels for peak 1: −10 log₁₀ MSE, in f64.
//!
//! Identical images have no finite value, which the type [`Decibel`] represents; the MSE is always returned
//! as well. A mean over images may be computed from the decibels ([`mean_of_psnr`]) or from the MSE before
//! the logarithm ([`psnr_of_mean`]); reports name the one they use.

use crate::Result;
use crate::loss::{CHANNELS, In, finite, image_sum, metric::clamped, row_sum};
use crate::num::{par, sum};

/// Name of the variant over all values (on a [`super::Crop`]: [`NAME_BOX`]).
pub const NAME: &str = "PSNR-full";
/// Name of the variant that averages the decibels of the three channels.
pub const NAME_CHANNELS: &str = "PSNR-full-ch";
/// Name of [`forward`] on a [`super::Crop`].
pub const NAME_BOX: &str = "PSNR-box";

/// A value in decibels, or infinite for identical images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decibel {
    /// −10 log₁₀ MSE.
    Finite(f64),
    /// MSE = 0.
    Infinite,
}

impl Decibel {
    /// Returns −10 log₁₀ of a mean squared error ≥ 0.
    pub fn from_mse(mse: f64) -> Self {
        if mse == 0.0 { Self::Infinite } else { Self::Finite(-10.0 * libm::log10(mse)) }
    }

    /// Returns the number if it is finite.
    pub fn finite(self) -> Option<f64> {
        match self {
            Self::Finite(db) => Some(db),
            Self::Infinite => None,
        }
    }
}

impl std::fmt::Display for Decibel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Finite(db) => write!(f, "{db:.3} dB"),
            Self::Infinite => f.write_str("∞ dB (identical)"),
        }
    }
}

/// Mean squared error and its value in decibels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Psnr {
    /// Mean squared error.
    pub mse: f64,
    /// The value in decibels.
    pub db: Decibel,
}

#[inline(always)]
fn squared(a: f32, b: f32) -> f64 {
    let d = clamped(a) - f64::from(b);
    d * d
}

/// Returns `PSNR-full`, or `PSNR-box` on a crop.
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, a mask that keeps no pixel, or images
/// that are not finite.
pub fn forward(x: &In<'_>) -> Result<Psnr> {
    let count = CHANNELS * x.check("metric.psnr")?;
    let mse = finite("metric.psnr", image_sum(x, squared))? / count as f64;
    Ok(Psnr { mse, db: Decibel::from_mse(mse) })
}

/// Returns `PSNR-full-ch`: the mean of the decibels of the three channels; infinite if any channel is
/// identical. `mse` is the mean of the three channels' mean squared errors.
///
/// # Errors
/// Returns an error under the conditions of [`forward`].
pub fn per_channel(x: &In<'_>) -> Result<Psnr> {
    let count = x.check("metric.psnr")? as f64;
    let width = x.width;
    let mse: [f64; CHANNELS] = std::array::from_fn(|channel| {
        let rows = par::map_batched(x.height, 8, |r| {
            let at = |i: usize| (r * width + i) * CHANNELS + channel;
            row_sum(width, |i| match x.mask {
                Some(mask) if mask[r * width + i] == 0.0 => 0.0,
                _ => squared(x.x[at(i)], x.y[at(i)]),
            })
        });
        sum::tree_f64(&rows) / count
    });
    let levels = mse.map(|m| Decibel::from_mse(m).finite());
    let db = match levels {
        [Some(r), Some(g), Some(b)] => Decibel::Finite(((r + g) + b) / 3.0),
        _ => Decibel::Infinite,
    };
    Ok(Psnr { mse: finite("metric.psnr", ((mse[0] + mse[1]) + mse[2]) / 3.0)?, db })
}

/// Returns the mean of the decibels of several images, `None` for no image; it is infinite if one of them is.
pub fn mean_of_psnr(images: &[Psnr]) -> Option<Decibel> {
    let levels: Option<Vec<f64>> = images.iter().map(|p| p.db.finite()).collect();
    (!images.is_empty())
        .then(|| levels.map_or(Decibel::Infinite, |l| Decibel::Finite(sum::tree_f64(&l) / l.len() as f64)))
}

/// Returns the decibels of the mean of the mean squared errors of several images; `None` for no image.
pub fn psnr_of_mean(images: &[Psnr]) -> Option<Psnr> {
    let errors: Vec<f64> = images.iter().map(|p| p.mse).collect();
    (!images.is_empty()).then(|| {
        let mse = sum::tree_f64(&errors) / errors.len() as f64;
        Psnr { mse, db: Decibel::from_mse(mse) }
    })
}
