//! Scores of an avatar on the images of a capture.

use super::person::Avatar;
use super::view::Target;
use crate::fit::training::Preview;
use crate::loss::metric::person::{self, Scores};
use crate::loss::metric::psnr;
use crate::loss::{In, lpips};
use crate::num::order;
use crate::scene::person::{PersonCapture, Pose, Shot};
use crate::{Error, Result};
use serde_json::{Map, Value, json};

/// One scored image.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Name of the shot.
    pub name: String,
    /// Number of its camera.
    pub camera: usize,
    /// Index of its moment.
    pub time: usize,
    /// The values of the metrics.
    pub scores: Scores,
    /// The input image, composited over the background, shape (H, W, 3).
    pub photo: Vec<f32>,
    /// The rendered image, clamped to 0..1, shape (H, W, 3).
    pub image: Vec<f32>,
    /// Mean of the absolute difference over the channels, shape (H, W).
    pub error: Vec<f32>,
    /// Width and height, pixels.
    pub size: [usize; 2],
}

/// The inputs of an evaluation.
#[derive(Clone, Copy, Debug)]
pub struct Evaluation<'a> {
    /// The avatar to be evaluated.
    pub avatar: &'a Avatar,
    /// The capture with the reference images.
    pub capture: &'a PersonCapture,
    /// Poses of the capture used for the fit, if it may be a different one. The light learned for a moment of
    /// the fit is used for a moment of this capture only if its index and its pose are the same.
    pub learned_at: Option<&'a [Pose]>,
    /// The LPIPS metric, if it is to be computed.
    pub perception: Option<&'a lpips::Metric>,
}

impl<'a> Evaluation<'a> {
    /// The evaluation of an avatar on the capture that it was fitted to.
    pub fn of(avatar: &'a Avatar, capture: &'a PersonCapture) -> Self {
        Self { avatar, capture, learned_at: None, perception: None }
    }

    /// The moment of the fit that corresponds to a moment of the capture.
    pub(super) fn moment(&self, time: usize) -> Option<usize> {
        let pose = &self.capture.poses[time];
        // An avatar file does not store the global rotation separately.
        let same = |x: &Pose| x.transforms == pose.transforms && x.axis_angles == pose.axis_angles;
        self.learned_at.is_none_or(|poses| poses.get(time).is_some_and(same)).then_some(time)
    }

    /// Scores the shot of the capture with the given index.
    ///
    /// # Errors
    /// If the shot cannot be read, or the render is not finite.
    pub fn score(&self, shot: usize) -> Result<Scored> {
        let shot = &self.capture.shots[shot];
        let target = Target::read(self.capture, shot)?;
        let photo = target.before(self.avatar.background);
        let pose = &self.capture.poses[shot.time];
        let out = self.avatar.picture(pose, self.moment(shot.time), &shot.camera)?;
        let (height, width) = (shot.camera.height, shot.camera.width);
        let x = In { x: &out.image, y: &photo, mask: None, height, width };
        let scores = person::forward(&x, &target.inside, self.perception);
        let scores = scores.map_err(|e| e.at(shot.name.clone()))?;
        Ok(scored(shot, scores, photo.into_owned(), &out.image))
    }
}

impl Evaluation<'_> {
    /// Renders the shot of the capture with the given index, with PSNR-box alone.
    ///
    /// # Errors
    /// If the shot cannot be read, or the render is not finite.
    pub fn preview(&self, shot: usize) -> Result<Preview> {
        let shot = &self.capture.shots[shot];
        let target = Target::read(self.capture, shot)?;
        let photo = target.before(self.avatar.background);
        let out =
            self.avatar.picture(&self.capture.poses[shot.time], self.moment(shot.time), &shot.camera)?;
        let (height, width) = (shot.camera.height, shot.camera.width);
        let x = In { x: &out.image, y: &photo, mask: Some(&target.inside), height, width };
        let psnr_db = psnr::forward(&x)?.db.finite().unwrap_or(f64::INFINITY);
        let image = out.image.iter().map(|&v| order::clamp(v, 0.0, 1.0)).collect();
        Ok(Preview { name: shot.name.clone(), image, size: [width, height], psnr_db, metric: psnr::NAME_BOX })
    }
}

fn scored(shot: &Shot, scores: Scores, photo: Vec<f32>, image: &[f32]) -> Scored {
    let image: Vec<f32> = image.iter().map(|&v| order::clamp(v, 0.0, 1.0)).collect();
    let pairs = image.chunks_exact(3).zip(photo.chunks_exact(3));
    let error = pairs
        .map(|(a, b)| (((a[0] - b[0]).abs() + (a[1] - b[1]).abs()) + (a[2] - b[2]).abs()) / 3.0)
        .collect();
    Scored {
        name: shot.name.clone(),
        camera: shot.camera_id,
        time: shot.time,
        scores,
        photo,
        image,
        error,
        size: [shot.camera.width, shot.camera.height],
    }
}

/// Mean scores per camera, in ascending order of the camera number, and over all images.
///
/// # Errors
/// If there are no images.
pub fn means(scored: &[Scored]) -> Result<(Vec<(usize, Scores)>, Scores)> {
    let of =
        |which: Vec<&Scored>| person::mean(&which.into_iter().map(|s| s.scores.clone()).collect::<Vec<_>>());
    let mut numbers: Vec<usize> = scored.iter().map(|s| s.camera).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let cameras = numbers
        .into_iter()
        .filter_map(|c| of(scored.iter().filter(|s| s.camera == c).collect()).map(|m| (c, m)))
        .collect();
    let all = of(scored.iter().collect())
        .ok_or_else(|| Error::input("evaluation").expected("at least one image").got("none"))?;
    Ok((cameras, all))
}

/// Scores as a JSON object; an infinite value is written as `null`.
pub fn json(scores: &Scores) -> Value {
    let entries = scores.named().into_iter().map(|(name, x)| (name.to_owned(), json!(x)));
    Value::Object(Map::from_iter(entries))
}
