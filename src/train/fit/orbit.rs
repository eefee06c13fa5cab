//! Circles of cameras around a scene: what they turn around, which way is up, how far away they are.
//!
//! Of a scene that was fitted, middle, axis and distance come from the cameras of its images ([`Pivot::of_cameras`]); of any
//! other, from the extents of its Gaussians, weighted by opacity ([`Pivot::of_scene`]).

use super::render::Shot;
use crate::num::{elem, order};
use crate::scene::camera::{Camera, Model};
use crate::scene::gaussians::Gaussians;
use crate::scene::placement;
use crate::{Error, Result};

/// Share of the opacity that an image contains, and that lies between the ends of an extent on one side.
const SHOWN: f64 = 0.995;
/// Share of the image, in either direction, that it fills.
const FILLED: f64 = 0.9;
/// Standard deviations of a Gaussian that belong to it.
const SIGMAS: f64 = 1.5;
/// Gaussians farther from the middle than this many times the median distance are background.
const BACKGROUND: f64 = 3.0;
/// Most Gaussians that are measured; of more, every so many.
const MEASURED: usize = 50_000;
/// Directions from which a scene is measured.
const DIRECTIONS: usize = 8;

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
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
    /// Radius of the ball around the middle that the cameras see; `None` without cameras.
    pub reach: Option<f64>,
}

impl Pivot {
    /// A middle and an axis; the front is −y if z is up, else ±z.
    pub fn upright(center: [f64; 3], up: [f64; 3]) -> Self {
        let toward =
            if up[2].abs() > 0.9 { [0.0, -1.0, 0.0] } else { [0.0, 0.0, if up[1] < 0.0 { -1.0 } else { 1.0 }] };
        let front = horizontal(toward, up).unwrap_or([1.0, 0.0, 0.0]);
        Self { center, up, front, reach: None }
    }

    /// The point nearest to the optical axes; the axis of the cameras' circle; the front is on their side. `None` if there is no such
    /// point, or most cameras look away from it.
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
        let (mut mean, mut far, mut reach) = ([0.0; 3], 0.0, 0.0);
        for (camera, eye) in cameras.iter().zip(&eyes) {
            let from = minus(*eye, center);
            let length = dot(from, from).sqrt();
            let half = (0..2).fold(f64::INFINITY, |least, k| {
                let side = [camera.width, camera.height][k] as f64;
                order::min(least, libm::atan(0.5 * side / f64::from(camera.focal_px[k])))
            });
            for k in 0..3 {
                mean[k] += from[k] / n;
            }
            far += length / n;
            reach += length * libm::sin(half) / n;
        }
        // Cameras all around have no side: the first one is the front.
        let is_sided = dot(mean, mean) > 0.01 * far * far;
        let toward = if is_sided { mean } else { minus(eyes[0], center) };
        let upright = Self::upright(center, up);
        Some(Self { front: horizontal(toward, up).unwrap_or(upright.front), reach: Some(reach), ..upright })
    }

    /// The middle of the Gaussians' extents, weighted by opacity, without the background; `None` for an empty scene.
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
                quantile(content.iter().map(|m| (dot(minus(m.at, first.center), axis), m.weight)).collect(), q)
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
struct Measured {
    at: [f64; 3],
    radius: f64,
    weight: f64,
}

/// All Gaussians, or every so many of more than [`MEASURED`].
fn measured(scene: &Gaussians) -> Vec<Measured> {
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
fn without_background(all: &[Measured], center: [f64; 3]) -> Vec<&Measured> {
    let distance = |m: &Measured| dot(minus(m.at, center), minus(m.at, center)).sqrt();
    let most = BACKGROUND * quantile(all.iter().map(|m| (distance(m), m.weight)).collect(), 0.5);
    all.iter().filter(|m| distance(m) <= most).collect()
}

/// The value below which a share of the weight lies.
fn quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
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

/// A circle of cameras around the scene, looking at its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// how many, evenly spaced, the first in front
    pub count: usize,
    /// what is looked at; `None`: the middle of the pivot
    pub center: Option<[f32; 3]>,
    /// distance; `None`: so that the scene without its background fills the image
    pub radius: Option<f32>,
    /// above the horizon, radians
    pub elevation_rad: f64,
    /// horizontal field of view, radians
    pub fov_x_rad: f64,
    /// image width and height in pixels
    pub size: [usize; 2],
}

impl Orbit {
    /// Half of the narrower field of view.
    fn half_narrow(&self) -> f64 {
        let tall = 2.0 * libm::atan(libm::tan(self.fov_x_rad * 0.5) * self.size[1] as f64 / self.size[0] as f64);
        order::min(self.fov_x_rad, tall) * 0.5
    }

    /// Distance from which a ball of that radius, at least 1e-3, just fits into the image.
    pub fn distance(&self, reach: f32) -> f32 {
        order::max(reach, 1e-3) / libm::sin(self.half_narrow()) as f32
    }

    /// The cameras, with z up, around the scene itself.
    ///
    /// # Errors
    /// See [`Self::shots_from`].
    pub fn shots(&self, scene: &Gaussians) -> Result<Vec<Shot>> {
        self.shots_from(scene, &[], Up::Auto)
    }

    /// The cameras, around what the given ones look at.
    ///
    /// # Errors
    /// When the scene is empty and nothing says where it is, or a number is out of range.
    pub fn shots_from(&self, scene: &Gaussians, cameras: &[Camera], up: Up) -> Result<Vec<Shot>> {
        self.check()?;
        let given = self.center.filter(|_| self.radius.is_some()).map(|c| {
            let axis = if let Up::Axis(axis) = up { axis } else { [0.0, 0.0, 1.0] };
            Pivot::upright(c.map(f64::from), axis)
        });
        let pivot = Pivot::of_cameras(cameras, up).or(given).or_else(|| Pivot::of_scene(scene, up));
        let Some(mut pivot) = pivot else {
            return Err(Error::input("orbit").expected("Gaussians to look at").got("an empty scene"));
        };
        if let Some(center) = self.center {
            pivot.center = center.map(f64::from);
        }
        let radius = self.radius.unwrap_or_else(|| self.fitting(scene, &pivot) as f32);
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(Error::input("orbit")
                .at("radius")
                .expected("a positive number")
                .got(radius.to_string()));
        }
        let digits = (self.count - 1).to_string().len().max(3);
        let focal = (0.5 * self.size[0] as f64 / libm::tan(self.fov_x_rad * 0.5)) as f32;
        (0..self.count)
            .map(|i| {
                let out = self.direction(&pivot, i, self.count);
                let eye: [f64; 3] = std::array::from_fn(|k| pivot.center[k] + f64::from(radius) * out[k]);
                let camera = look_at(eye, out.map(|x| -x), pivot.up, [focal, focal], self.size);
                camera.validate()?;
                Ok(Shot { name: format!("{i:0digits$}"), camera })
            })
            .collect()
    }

    fn check(&self) -> Result<()> {
        if !(self.count >= 1 && self.count <= 100_000) {
            return Err(Error::input("orbit").expected("1 to 100000 cameras").got(self.count.to_string()));
        }
        if !(self.fov_x_rad > 0.01 && self.fov_x_rad < 3.0) {
            return Err(Error::input("orbit")
                .at("field of view")
                .expected("more than 0.6 and less than 171 degrees")
                .got(format!("{:.3}", self.fov_x_rad.to_degrees())));
        }
        if !(-1.55..=1.55).contains(&self.elevation_rad) {
            return Err(Error::input("orbit")
                .at("elevation")
                .expected("less than 88 degrees")
                .got(format!("{:.3}", self.elevation_rad.to_degrees())));
        }
        Ok(())
    }

    /// Unit vector from the middle to camera `i` of `count`.
    fn direction(&self, pivot: &Pivot, i: usize, count: usize) -> [f64; 3] {
        let turn = core::f64::consts::TAU * i as f64 / count as f64;
        let (se, ce) = (libm::sin(self.elevation_rad), libm::cos(self.elevation_rad));
        let side = cross(pivot.up, pivot.front);
        let (s, c) = (libm::sin(turn), libm::cos(turn));
        std::array::from_fn(|k| ce * (side[k] * s + pivot.front[k] * c) + se * pivot.up[k])
    }

    /// Distance from which the scene without its background fills the image from all sides, and of what has been filmed not farther
    /// than where the cameras would have been with this lens.
    fn fitting(&self, scene: &Gaussians, pivot: &Pivot) -> f64 {
        let all = measured(scene);
        let content =
            if pivot.reach.is_some() { all.iter().collect() } else { without_background(&all, pivot.center) };
        let half = [1.0, self.size[1] as f64 / self.size[0] as f64]
            .map(|share| FILLED * share * libm::tan(self.fov_x_rad * 0.5));
        let mut needed = Vec::with_capacity(content.len() * DIRECTIONS);
        for i in 0..DIRECTIONS {
            let out = self.direction(pivot, i, DIRECTIONS);
            let [right, down, forward] = axes(out.map(|x| -x), pivot.up);
            for m in &content {
                let p = minus(m.at, pivot.center);
                let aside = |axis, half| (dot(p, axis).abs() + m.radius) / half;
                let from = order::max(aside(right, half[0]), aside(down, half[1])) - dot(p, forward);
                needed.push((from, m.weight));
            }
        }
        let fits = order::max(quantile(needed, SHOWN), 1e-3);
        pivot.reach.map_or(fits, |reach| order::min(fits, reach / libm::sin(self.half_narrow())))
    }
}

/// Right, down and forward of a camera that looks along the unit vector `forward`.
fn axes(forward: [f64; 3], up: [f64; 3]) -> [[f64; 3]; 3] {
    // right = forward × up, of length cos(elevation) > 0; down = forward × right
    let across = cross(forward, up);
    let length = dot(across, across).sqrt();
    let right = across.map(|x| x / length);
    [right, cross(forward, right), forward]
}

/// A pinhole camera at `eye`, principal point in the middle.
fn look_at(
    eye: [f64; 3],
    forward: [f64; 3],
    up: [f64; 3],
    focal_px: [f32; 2],
    [width, height]: [usize; 2],
) -> Camera {
    let rows = axes(forward, up);
    Camera {
        rotation: rows.map(|r| r.map(|x| x as f32)),
        translation: rows.map(|r| -dot(r, eye) as f32),
        focal_px,
        center_px: [width as f32 * 0.5, height as f32 * 0.5],
        width,
        height,
        model: Model::Pinhole,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(means: Vec<[f32; 3]>) -> Gaussians {
        let n = means.len();
        Gaussians {
            means,
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            scales_log: vec![[-3.0; 3]; n],
            opacity_logits: vec![1.0; n],
            sh: vec![0.0; 3 * n],
            sh_degree: 0,
        }
    }

    const ORBIT: Orbit = Orbit {
        count: 8,
        center: None,
        radius: Some(2.0),
        elevation_rad: 0.3,
        fov_x_rad: 1.0,
        size: [40, 30],
    };

    #[test]
    fn an_orbit_looks_at_the_middle() {
        let scene = cloud(vec![[1.0, 2.0, 3.0]; 5]);
        let shots = ORBIT.shots(&scene).expect("a valid orbit");
        for shot in &shots {
            let c = &shot.camera;
            let p: [f32; 3] = std::array::from_fn(|i| {
                c.rotation[i][0] * 1.0 + c.rotation[i][1] * 2.0 + c.rotation[i][2] * 3.0 + c.translation[i]
            });
            assert!(
                p[0].abs() < 1e-5 && p[1].abs() < 1e-5 && (p[2] - 2.0).abs() < 1e-5,
                "the middle is straight ahead: {p:?}"
            );
            assert!(c.rotation[1][2] < -0.9, "z is up, the camera's y is down");
        }
        assert_eq!(shots[7].name, "007", "names sort");
        assert!(Orbit { count: 0, ..ORBIT }.shots(&scene).is_err(), "no camera");
        assert!(Orbit { radius: None, ..ORBIT }.shots(&Gaussians::default()).is_err(), "nothing to look at");
    }

    #[test]
    fn a_background_does_not_move_the_cameras_away() {
        let object: Vec<[f32; 3]> =
            (0..1000).map(|i| [(i % 10) as f32 * 0.1, (i / 10 % 10) as f32 * 0.1, (i / 100) as f32 * 0.2]).collect();
        let wall = (0..200).map(|i| [i as f32 - 100.0, 60.0, 40.0]);
        let orbit = Orbit { radius: None, ..ORBIT };
        let near = |scene: Vec<[f32; 3]>, cameras: &[Camera]| {
            let shots = orbit.shots_from(&cloud(scene), cameras, Up::Auto).expect("valid");
            let eye = shots[0].camera.center();
            let from: [f32; 3] = std::array::from_fn(|k| eye[k] - [0.45, 0.45, 0.9][k]);
            (from[0] * from[0] + from[1] * from[1] + from[2] * from[2]).sqrt()
        };
        let alone = near(object.clone(), &[]);
        let both = near([object.clone(), wall.clone().collect()].concat(), &[]);
        assert!(alone > 2.0 && alone < 8.0 && (both / alone - 1.0).abs() < 0.2, "{alone} and {both}");
        // Cameras say how far away it was seen from.
        let filmed: Vec<Camera> =
            ORBIT.shots(&cloud(object.clone())).expect("valid").into_iter().map(|s| s.camera).collect();
        let both = near([object, wall.collect()].concat(), &filmed);
        assert!((both - 2.0).abs() < 0.1, "as far as the cameras, and the same lens: {both}");
    }

    #[test]
    fn axes_are_named() {
        assert_eq!(Up::parse("-y").ok(), Some(Up::Axis([0.0, -1.0, 0.0])), "an axis");
        assert_eq!(Up::parse("auto").ok(), Some(Up::Auto), "by the cameras");
        for bad in ["", "-", "-auto", "w", "xy"] {
            assert!(Up::parse(bad).is_err(), "'{bad}' is refused");
        }
    }
}
