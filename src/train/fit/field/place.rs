//! The box of an object, from its foreground in all images.
//!
//! The centre is the point nearest to the optical axes. The radius is that of the smallest sphere there whose outline covers
//! the foreground of every image: the largest distance of a foreground ray from the centre. Centre and radius become the
//! origin and ½; the box is a twentieth larger. Images of `lirm gen` have this form already and are used as they are.
//!
//! A grid of points in the sphere's cube serves as a check: if every point is background in some image that sees it,
//! cameras and foreground contradict each other.

use super::targets::Picture;
use crate::num::{order, par};
use crate::scene::bound::project;
use crate::scene::field::Placement;
use crate::scene::views::SceneBox;
use crate::{Error, Result};

/// Points of the grid along each axis.
const SIDE: usize = 64;
/// Coverage from which a pixel is foreground here.
const COVERED: f32 = 0.5;
/// Half size of the box as a factor of the radius.
const MARGIN: f64 = 1.05;

/// Distance of a point from the line of a ray.
fn distance(origin: [f32; 3], direction: [f32; 3], point: [f64; 3]) -> f64 {
    let to: [f64; 3] = std::array::from_fn(|k| point[k] - f64::from(origin[k]));
    let along = (0..3).fold(0.0, |sum, k| sum + to[k] * f64::from(direction[k]));
    let square = (0..3).fold(0.0, |sum, k| {
        let d = to[k] - along * f64::from(direction[k]);
        sum + d * d
    });
    square.sqrt()
}

/// Largest distance of a foreground ray from a point.
fn reach(pictures: &[&Picture], center: [f64; 3]) -> f64 {
    let of = |i: usize| {
        let p = pictures[i];
        let width = p.camera.width;
        let far = |most: f64, px: usize| {
            let at = [(px % width) as f32 + 0.5, (px / width) as f32 + 0.5];
            let ray = if p.foreground[px] >= COVERED { p.camera.ray(at) } else { None };
            ray.map_or(most, |(o, d)| order::max(most, distance(o, d, center)))
        };
        (0..p.foreground.len()).fold(0.0, far)
    };
    par::map(pictures.len(), of).into_iter().fold(0.0, order::max)
}

/// Whether an image sees a point as background. A pixel beside the foreground counts as foreground.
fn is_background(p: &Picture, point: [f64; 3]) -> bool {
    let (w, h) = (p.camera.width, p.camera.height);
    let Some([x, y]) = project(&p.camera, point) else { return false };
    if !(x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64) {
        return false;
    }
    let (x, y) = (x as usize, y as usize);
    let rows = y.saturating_sub(1)..Ord::min(y + 2, h);
    !rows
        .into_iter()
        .any(|r| (x.saturating_sub(1)..Ord::min(x + 2, w)).any(|c| p.foreground[r * w + c] >= COVERED))
}

/// Whether there is a point that no image sees as background.
fn has_hull(pictures: &[&Picture], center: [f64; 3], radius: f64) -> bool {
    let at = |i: usize| -> [f64; 3] {
        let index = [i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE];
        std::array::from_fn(|k| center[k] + radius * (2.0 * (index[k] as f64 + 0.5) / SIDE as f64 - 1.0))
    };
    let kept =
        par::map_batched(SIDE * SIDE * SIDE, 1024, |i| !pictures.iter().any(|p| is_background(p, at(i))));
    kept.contains(&true)
}

/// Returns the box around the sphere whose outline covers the foreground of all images.
///
/// # Errors
/// When no image has foreground, or no point is foreground in all images that see it.
pub fn around(pictures: &[&Picture], center: [f64; 3]) -> Result<SceneBox> {
    let radius = reach(pictures, center);
    if !(radius > 0.0) {
        return Err(Error::input("foreground")
            .expected("pixels that show the object")
            .got("none in any training image")
            .hint("masks are 0 where the object is not; --box sets the box by hand"));
    }
    if !has_hull(pictures, center, radius) {
        return Err(Error::input("foreground")
            .expected("a place that no image sees as background")
            .got("none")
            .hint("check the camera poses and the masks, or set the box with --box"));
    }
    Ok(SceneBox { center, half_size: MARGIN * radius })
}

/// Returns the box of an object in the ball of radius ½ around the origin.
pub fn unit_ball() -> SceneBox {
    SceneBox { center: [0.0; 3], half_size: MARGIN * 0.5 }
}

/// Returns the placement of a field that fills a box.
pub fn placement(scene: &SceneBox) -> Placement {
    let half = f64::from(super::state::HALF_SIZE);
    Placement { center: scene.center, scale: half / scene.half_size }
}
