//! Scores of an avatar on the pictures of a capture, every metric under its name.

use super::avatar::Avatar;
use super::view::Target;
use crate::loss::In;
use crate::loss::metric::person::{self, Scores};
use crate::num::order;
use crate::scene::person::PersonCapture;
use crate::{Error, Result};
use serde_json::{Map, Value, json};

/// One scored picture.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Name of the shot.
    pub name: String,
    /// Number of its camera.
    pub camera: usize,
    /// Moment.
    pub time: usize,
    /// The numbers.
    pub scores: Scores,
    /// (H, W, 3) the photograph over the background
    pub photo: Vec<f32>,
    /// (H, W, 3) the render, limited to 0..1
    pub image: Vec<f32>,
    /// (H, W) mean over the channels of the absolute difference
    pub error: Vec<f32>,
    /// W, H
    pub size: [usize; 2],
}

/// Scores a shot of the capture, by its index.
///
/// # Errors
/// When it cannot be read, or the render is not finite.
pub fn score(avatar: &Avatar, capture: &PersonCapture, shot: usize) -> Result<Scored> {
    let shot = &capture.shots[shot];
    let target = Target::read(capture, shot)?;
    let photo = target.before(avatar.background);
    let out = avatar.picture(&capture.poses[shot.time], Some(shot.time), &shot.camera)?;
    let (height, width) = (shot.camera.height, shot.camera.width);
    let x = In { x: &out.image, y: &photo, mask: None, height, width };
    let scores = person::forward(&x, &target.inside).map_err(|e| e.at(shot.name.clone()))?;
    let image: Vec<f32> = out.image.iter().map(|&v| order::clamp(v, 0.0, 1.0)).collect();
    let pairs = image.chunks_exact(3).zip(photo.chunks_exact(3));
    let error = pairs
        .map(|(a, b)| (((a[0] - b[0]).abs() + (a[1] - b[1]).abs()) + (a[2] - b[2]).abs()) / 3.0)
        .collect();
    Ok(Scored {
        name: shot.name.clone(),
        camera: shot.camera_id,
        time: shot.time,
        scores,
        photo: photo.into_owned(),
        image,
        error,
        size: [width, height],
    })
}

/// Means over pictures, per camera in ascending order, and over all.
///
/// # Errors
/// When there is no picture.
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
        .ok_or_else(|| Error::input("evaluation").expected("at least one picture").got("none"))?;
    Ok((cameras, all))
}

/// Scores as a JSON object; an infinite level is `null`.
pub fn json(scores: &Scores) -> Value {
    let entries = scores.named().map(|(name, x)| (name.to_owned(), json!(x)));
    Value::Object(Map::from_iter(entries))
}
