//! What an orbit turns around, which way is up, and what is background.
//!
//! Of a scene that was fitted, middle, axis and distance come from the cameras of its images
//! ([`Pivot::of_cameras`]); of any other, from the extents of its Gaussians, weighted by opacity
//! ([`Pivot::of_scene`]).

use crate::num::{elem, order};
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::scene::placement;
use crate::{Error, Result};

/// Share of the opacity that an image contains, and that lies between the ends of an extent on one side.
pub(super) const SHOWN: f64 = 0.995;
/// Standard deviations of a Gaussian that belong to it.
const SIGMAS: f64 = 1.5;
/// Gaussians farther from the middle than this many times the median distance are background.
const BACKGROUND: f64 = 3.0;
/// Most Gaussians that are measured; of more, every so many.
const MEASURED: usize = 50_000;

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// Which way is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Up {
    /// As in the images of the cameras; +z without cameras.
    Auto,
    /// A unit vector.
    Axis([f64; 3]),
}

impl Up {
    /// `auto`, or an axis: `x`, `y`, `z`, `-x`, `-y`, `-z`.
    ///
    /// # Errors
    /// When it is none of these.
    pub fn parse(text: &str) -> Result<Self> {
        let (name, sign) = text.strip_prefix('-').map_or((text, 1.0), |name| (name, -1.0));
        let axis = ["x", "y", "z"].iter().position(|a| *a == name);
        match axis {
            Some(k) => Ok(Self::Axis(std::array::from_fn(|i| if i == k { sign } else { 0.0 }))),
            None if text == "auto" => Ok(Self::Auto),
            None => Err(Error::input("--up").expected("x, y, z, -x, -y, -z or auto").got(text)),
        }
    }
}

/// What an orbit turns around.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pivot {
    /// The middle.
    pub center: [f64; 3],
    /// The axis, a unit vector.
    pub up: [f64; 3],
    /// Where the first camera is, seen from the middle; a unit vector at right angles to the axis.
    pub front: [f64; 3],
    /// Half of the width and of the height that the cameras see at the distance of the middle, on average;
    /// `None` without cameras.
    pub reach: Option<[f64; 2]>,
    /// The part of a full turn around the axis that the cameras cover, where they do not cover nearly all of it.
    pub arc: Option<Arc>,
}

/// A part of a full turn, counted from the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// Its middle in radians, positive toward up × front.
    pub middle: f64,
    /// Its extent in radians.
    pub extent: f64,
}

/// Cameras that cover at least this part of a full turn, 300 degrees, have filmed all sides.
const ALL_SIDES: f64 = core::f64::consts::TAU * 5.0 / 6.0;
/// Smallest arc, 20 degrees.
const SMALLEST_ARC: f64 = core::f64::consts::TAU / 18.0;
/// A camera above or below the middle has no side: sine of the angle between its direction and the axis.
const NO_SIDE: f64 = 0.1;

impl Arc {
    /// What the cameras at `eyes` cover: the turn without the largest gap between neighbours, and one usual gap more. `None` if they cover
    /// nearly all of it, or none of them has a side.
    fn of(eyes: &[[f64; 3]], pivot: &Pivot) -> Option<Self> {
        let side = cross(pivot.up, pivot.front);
        let turn = |eye: &[f64; 3]| {
            let from = minus(*eye, pivot.center);
            let (x, y) = (dot(from, pivot.front), dot(from, side));
            let is_aside = x * x + y * y > NO_SIDE * NO_SIDE * dot(from, from);
            is_aside.then(|| libm::atan2(y, x))
        };
        let mut turns: Vec<f64> = eyes.iter().filter_map(turn).collect();
        turns.sort_by(f64::total_cmp);
        let (first, n) = (*turns.first()?, turns.len());
        let next = |i: usize| if i + 1 < n { turns[i + 1] } else { first + core::f64::consts::TAU };
        let widest = (0..n).max_by(|&i, &j| (next(i) - turns[i]).total_cmp(&(next(j) - turns[j])))?;
        let between = core::f64::consts::TAU - (next(widest) - turns[widest]);
        let usual = if n > 1 { between / (n - 1) as f64 } else { 0.0 };
        let extent = order::max(between + usual, SMALLEST_ARC);
        (extent < ALL_SIDES).then(|| Self { middle: next(widest) + 0.5 * between, extent })
    }
}

impl Pivot {
    /// A middle and an axis; the front is −y if z is up, else ±z.
    pub fn upright(center: [f64; 3], up: [f64; 3]) -> Self {
        let toward = if up[2].abs() > 0.9 {
            [0.0, -1.0, 0.0]
        } else {
            [0.0, 0.0, if up[1] < 0.0 { -1.0 } else { 1.0 }]
        };
        let front = horizontal(toward, up).unwrap_or([1.0, 0.0, 0.0]);
        Self { center, up, front, reach: None, arc: None }
    }

    /// The point nearest to the optical axes; the axis of the cameras' circle; the front is on their side.
    /// `None` if there is no such point, or most cameras look away from it.
    pub fn of_cameras(cameras: &[Camera], up: Up) -> Option<Self> {
        let row = |c: &Camera, k: usize| c.rotation[k].map(f64::from);
        let eyes: Vec<[f64; 3]> = cameras.iter().map(|c| c.center().map(f64::from)).collect();
        let axes: Vec<_> = cameras.iter().zip(&eyes).map(|(c, eye)| (*eye, row(c, 2))).collect();
        let center = placement::nearest_to_axes(&axes)?;
        let inward = axes.iter().filter(|(eye, d)| dot(minus(center, *eye), *d) > 0.0).count();
        if 2 * inward <= cameras.len() {
            return None;
        }
        let up = match up {
            Up::Axis(axis) => axis,
            Up::Auto => {
                let directions = cameras.iter().map(|c| (row(c, 0), row(c, 1).map(|x| -x)));
                placement::up(&directions.collect::<Vec<_>>())?
            }
        };
        let n = cameras.len() as f64;
        let (mut mean, mut far, mut reach) = ([0.0; 3], 0.0, [0.0; 2]);
        for (camera, eye) in cameras.iter().zip(&eyes) {
            let from = minus(*eye, center);
            let length = dot(from, from).sqrt();
            for k in 0..3 {
                mean[k] += from[k] / n;
            }
            far += length / n;
            for (k, side) in [camera.width, camera.height].into_iter().enumerate() {
                reach[k] += length * 0.5 * side as f64 / f64::from(camera.focal_px[k]) / n;
            }
        }
        // Cameras all around have no side: the first one is the front.
        let is_sided = dot(mean, mean) > 0.01 * far * far;
        let toward = if is_sided { mean } else { minus(eyes[0], center) };
        let upright = Self::upright(center, up);
        let front = horizontal(toward, up).unwrap_or(upright.front);
        let pivot = Self { front, reach: Some(reach), ..upright };
        Some(Self { arc: Arc::of(&eyes, &pivot), ..pivot })
    }

    /// The middle of the Gaussians' extents, weighted by opacity, without the background; `None` for an empty
    /// scene.
    pub fn of_scene(scene: &Gaussians, up: Up) -> Option<Self> {
        let up = if let Up::Axis(axis) = up { axis } else { [0.0, 0.0, 1.0] };
        let all = measured(scene);
        if all.is_empty() {
            return None;
        }
        let median = |k: usize| quantile(all.iter().map(|m| (m.at[k], m.weight)).collect(), 0.5);
        let first = Self::upright([median(0), median(1), median(2)], up);
        let axes = [first.front, cross(up, first.front), up];
        let content = without_background(&all, first.center);
        let mut center = first.center;
        for axis in axes {
            let along = |q: f64| {
                quantile(
                    content.iter().map(|m| (dot(minus(m.at, first.center), axis), m.weight)).collect(),
                    q,
                )
            };
            let shift = 0.5 * (along(1.0 - SHOWN) + along(SHOWN));
            for k in 0..3 {
                center[k] += shift * axis[k];
            }
        }
        Some(Self { center, ..first })
    }
}

/// The part of a vector at right angles to a unit vector, normalised; `None` if nothing is left.
fn horizontal(v: [f64; 3], up: [f64; 3]) -> Option<[f64; 3]> {
    let h = minus(v, up.map(|x| x * dot(v, up)));
    let length = dot(h, h).sqrt();
    (length > 1e-6 * dot(v, v).sqrt()).then(|| h.map(|x| x / length))
}

/// A Gaussian as extents see it.
pub(super) struct Measured {
    pub(super) at: [f64; 3],
    pub(super) radius: f64,
    pub(super) weight: f64,
}

/// All Gaussians, or every so many of more than [`MEASURED`].
pub(super) fn measured(scene: &Gaussians) -> Vec<Measured> {
    let one = |i: usize| {
        let s = scene.scales_log[i];
        Measured {
            at: scene.means[i].map(f64::from),
            radius: SIGMAS * f64::from(elem::exp(order::max(order::max(s[0], s[1]), s[2]))),
            weight: f64::from(elem::sigmoid(scene.opacity_logits[i])),
        }
    };
    (0..scene.len()).step_by(scene.len().div_ceil(MEASURED).max(1)).map(one).collect()
}

/// Those within [`BACKGROUND`] median distances of the middle.
pub(super) fn without_background(all: &[Measured], center: [f64; 3]) -> Vec<&Measured> {
    let distance = |m: &Measured| dot(minus(m.at, center), minus(m.at, center)).sqrt();
    let most = BACKGROUND * quantile(all.iter().map(|m| (distance(m), m.weight)).collect(), 0.5);
    all.iter().filter(|m| distance(m) <= most).collect()
}

/// The value below which a share of the weight lies.
pub(super) fn quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total = values.iter().fold(0.0, |s, v| s + v.1);
    let mut sum = 0.0;
    for (value, weight) in &values {
        sum += weight;
        if sum >= share * total {
            return *value;
        }
    }
    values.last().map_or(0.0, |v| v.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_named() {
        assert_eq!(Up::parse("-y").ok(), Some(Up::Axis([0.0, -1.0, 0.0])), "an axis");
        assert_eq!(Up::parse("auto").ok(), Some(Up::Auto), "by the cameras");
        for bad in ["", "-", "-auto", "w", "xy"] {
            assert!(Up::parse(bad).is_err(), "'{bad}' is refused");
        }
    }
}
