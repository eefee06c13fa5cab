//! Scores of renders against input images: PSNR, SSIM, mean absolute error, error maps.
//!
//! The protocol is stored with the numbers ([`PROTOCOL`]): sRGB-encoded values in 0..1, renders limited to
//! 0..1 and not quantised, every mean over counted pixels only. [`crate::scene::views`] decides which views
//! are held out.

use super::render::Scene;
use super::training::Preview;
use crate::Result;
use crate::loss::metric::psnr::Decibel;
use crate::loss::{In, metric};
use crate::num::{order, par, sum};
use crate::scene::views::View;
use serde_json::{Value, json};

/// The definition of the scores, in one sentence.
pub const PROTOCOL: &str = "sRGB-encoded values in 0..1, renders limited to 0..1 and not quantised; PSNR-full and mean \
    absolute error over the counted pixels; SSIM-g (11×11 Gaussian window, σ 1.5, zero padding) of both images times the mask, \
    mean over the counted pixels; means over views of the values per view";

/// Scores of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewScore {
    /// name of the input image
    pub name: String,
    /// in pixels
    pub width: usize,
    /// in pixels
    pub height: usize,
    /// number of pixels that count
    pub kept: usize,
    /// PSNR in decibels; +∞ if no value differs
    pub psnr_db: f64,
    /// structural similarity
    pub ssim: f64,
    /// mean absolute error
    pub mae: f64,
}

/// A scored view with its images, sRGB-encoded.
#[derive(Clone, Debug)]
pub struct Scored {
    /// the scores
    pub score: ViewScore,
    /// (H, W, 3) the input image, 0 at pixels that do not count
    pub photo: Vec<f32>,
    /// (H, W, 3) the render, limited to 0..1
    pub image: Vec<f32>,
    /// (H, W) mean over the channels of the absolute difference, 0 at pixels that do not count
    pub error: Vec<f32>,
}

/// Scores of a set of views.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// see [`PROTOCOL`]
    pub protocol: &'static str,
    /// in the order of the file names
    pub views: Vec<ViewScore>,
    /// mean PSNR in decibels; +∞ if that of a view is
    pub mean_psnr_db: f64,
    /// mean over views
    pub mean_ssim: f64,
    /// mean over views
    pub mean_mae: f64,
}

impl Evaluation {
    /// Computes means over views, as pairwise sums in view order; NaN without a view.
    pub fn of(views: Vec<ViewScore>) -> Self {
        let mean = |f: fn(&ViewScore) -> f64| {
            let values: Vec<f64> = views.iter().map(f).collect();
            if values.is_empty() { f64::NAN } else { sum::tree_f64(&values) / values.len() as f64 }
        };
        let (mean_psnr_db, mean_ssim, mean_mae) = (mean(|v| v.psnr_db), mean(|v| v.ssim), mean(|v| v.mae));
        Self { protocol: PROTOCOL, views, mean_psnr_db, mean_ssim, mean_mae }
    }

    /// As a JSON record; an infinite PSNR and the means of no views are `null`.
    pub fn json(&self) -> Value {
        let views: Vec<Value> = self
            .views
            .iter()
            .map(|v| {
                json!({"name": v.name, "width": v.width, "height": v.height, "kept": v.kept,
                       "psnr_db": v.psnr_db, "ssim": v.ssim, "mae": v.mae})
            })
            .collect();
        json!({"protocol": self.protocol, "mean_psnr_db": self.mean_psnr_db, "mean_ssim": self.mean_ssim,
               "mean_mae": self.mean_mae, "views": views})
    }
}

/// Renders a scene from the camera of a view and compares it with the input image.
///
/// # Errors
/// When no pixel of the view counts, or the render has a value that is not finite.
pub fn score(scene: &Scene<'_>, view: &View) -> Result<Scored> {
    let out = scene.render(&view.camera)?;
    let (photo, mask) =
        (view.image(), view.mask.as_ref().map(|m| m.iter().map(|&b| f32::from(b)).collect::<Vec<f32>>()));
    compare(&view.name, &out.image, &photo, mask.as_deref(), [view.camera.height, view.camera.width])
}

/// Renders a scene from the camera of a view, with the PSNR alone.
///
/// # Errors
/// See [`score`].
pub fn preview(scene: &Scene<'_>, view: &View) -> Result<Preview> {
    let out = scene.render(&view.camera)?;
    let photo = view.image();
    let mask = view.mask.as_ref().map(|m| m.iter().map(|&b| f32::from(b)).collect::<Vec<f32>>());
    let [height, width] = [view.camera.height, view.camera.width];
    let x = In { x: &out.image, y: &photo, mask: mask.as_deref(), height, width };
    let psnr_db = metric::psnr::forward(&x)?.db.finite().unwrap_or(f64::INFINITY);
    let image = out.image.iter().map(|&v| order::clamp(v, 0.0, 1.0)).collect();
    Ok(Preview { name: view.name.clone(), image, size: [width, height], psnr_db, metric: "PSNR" })
}

/// Compares an image, of any renderer, with an input image.
///
/// # Errors
/// See [`score`].
pub fn compare(
    name: &str,
    render: &[f32],
    photo: &[f32],
    mask: Option<&[f32]>,
    [height, width]: [usize; 2],
) -> Result<Scored> {
    let x = In { x: render, y: photo, mask, height, width };
    let psnr_db = match metric::psnr::forward(&x)?.db {
        Decibel::Finite(db) => db,
        Decibel::Infinite => f64::INFINITY,
    };
    let ssim = metric::ssim::forward(&x)?;
    let mae = metric::mae::forward(&x)?;
    let counts = |p: usize| mask.is_none_or(|m| m[p] != 0.0);
    let kept = (0..height * width).filter(|&p| counts(p)).count();
    let image: Vec<f32> = render.iter().map(|&v| order::clamp(v, 0.0, 1.0)).collect();
    let photo: Vec<f32> =
        photo.iter().enumerate().map(|(i, &v)| if counts(i / 3) { v } else { 0.0 }).collect();
    let error = par::map_batched(height * width, 4096, |p| {
        if !counts(p) {
            return 0.0;
        }
        let d = |c: usize| (image[3 * p + c] - photo[3 * p + c]).abs();
        (d(0) + d(1) + d(2)) / 3.0
    });
    let score = ViewScore { name: name.to_owned(), width, height, kept, psnr_db, ssim, mae };
    Ok(Scored { score, photo, image, error })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_masked_does_not_count() {
        let photo = vec![0.5; 16 * 16 * 3];
        let mut image = photo.clone();
        image[0] = 0.9; // pixel 0, red
        let mut mask = vec![1.0; 256];
        let hit = compare("a", &image, &photo, Some(&mask), [16, 16]).expect("compares");
        assert!((hit.score.mae - f64::from(0.9_f32 - 0.5) / 768.0).abs() < 1e-12, "{}", hit.score.mae);
        assert!((hit.error[0] - 0.4 / 3.0).abs() < 1e-6 && hit.error[1] == 0.0, "the map shows where");
        mask[0] = 0.0;
        let miss = compare("a", &image, &photo, Some(&mask), [16, 16]).expect("compares");
        assert_eq!(
            (miss.score.psnr_db, miss.score.mae, miss.score.kept),
            (f64::INFINITY, 0.0, 255),
            "all the rest agrees"
        );
        assert_eq!((miss.error[0], miss.photo[0]), (0.0, 0.0), "black in the images");
        let e = Evaluation::of(vec![hit.score, miss.score]);
        assert!(e.mean_psnr_db.is_infinite() && e.json()["mean_psnr_db"].is_null(), "no finite mean");
    }
}
