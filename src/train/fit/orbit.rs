//! Circles of cameras around a scene: their distance and the point at which they are directed.
//!
//! Of a scene that was fitted, middle, axis and distance come from the cameras of its images
//! ([`Pivot::of_cameras`]); of any other, from the extents of its Gaussians, weighted by opacity
//! ([`Pivot::of_scene`]).

pub use super::pivot::{Arc, Pivot, Up};
use super::pivot::{SHOWN, cross, dot, measured, minus, quantile, without_background};
use super::render::Shot;
use crate::num::order;
use crate::scene::camera::{Camera, Model};
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result};
use core::f64::consts::TAU;

/// Share of the image, in either direction, that a scene fills.
const FILLED: f64 = 0.9;
/// Directions from which a scene is measured.
const DIRECTIONS: usize = 8;

/// A circle of cameras around the scene, directed at its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// how many, evenly spaced: on a full turn the first is in front, on an arc they go from end to end
    pub count: usize,
    /// extent of the arc around the front, or around the middle of what was filmed; `None`: as far as the given cameras go, a full turn if
    /// they cover at least 300 degrees or there are none
    pub arc_rad: Option<f64>,
    /// the point in the centre of the image; `None`: the middle of the pivot
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
        let tall =
            2.0 * libm::atan(libm::tan(self.fov_x_rad * 0.5) * self.size[1] as f64 / self.size[0] as f64);
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

    /// The cameras, around the point at which the given ones are directed.
    ///
    /// # Errors
    /// When the scene is empty and neither cameras nor centre and radius are given, or a number is out of
    /// range.
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
        let arc = self.arc(&pivot);
        let digits = (self.count - 1).to_string().len().max(3);
        let focal = (0.5 * self.size[0] as f64 / libm::tan(self.fov_x_rad * 0.5)) as f32;
        (0..self.count)
            .map(|i| {
                let out = self.direction(&pivot, self.turn(arc, i));
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
        if let Some(arc) = self.arc_rad.filter(|arc| !(*arc > 0.0 && *arc <= TAU * (1.0 + 1e-9))) {
            return Err(Error::input("orbit")
                .at("arc")
                .expected("more than 0 and at most 360 degrees")
                .got(format!("{:.3}", arc.to_degrees())));
        }
        Ok(())
    }

    /// The arc on which the cameras are, if it is not a full turn.
    fn arc(&self, pivot: &Pivot) -> Option<Arc> {
        let middle = pivot.arc.map_or(0.0, |arc| arc.middle);
        match self.arc_rad {
            Some(extent) if extent >= TAU * (1.0 - 1e-9) => None,
            Some(extent) => Some(Arc { middle, extent }),
            None => pivot.arc,
        }
    }

    /// Extent of the arc in radians to which the orbit is limited because the given cameras cover no more; `None` if it is not.
    pub fn limited(&self, cameras: &[Camera], up: Up) -> Option<f64> {
        let filmed = Pivot::of_cameras(cameras, up)?.arc?;
        self.arc_rad.is_none().then_some(filmed.extent)
    }

    /// Angle of camera `i` from the front.
    fn turn(&self, arc: Option<Arc>, i: usize) -> f64 {
        match arc {
            None => TAU * i as f64 / self.count as f64,
            Some(arc) if self.count == 1 => arc.middle,
            Some(arc) => arc.middle + arc.extent * (i as f64 / (self.count - 1) as f64 - 0.5),
        }
    }

    /// Unit vector from the middle to a camera at that angle from the front.
    fn direction(&self, pivot: &Pivot, turn: f64) -> [f64; 3] {
        let (se, ce) = (libm::sin(self.elevation_rad), libm::cos(self.elevation_rad));
        let side = cross(pivot.up, pivot.front);
        let (s, c) = (libm::sin(turn), libm::cos(turn));
        std::array::from_fn(|k| ce * (side[k] * s + pivot.front[k] * c) + se * pivot.up[k])
    }

    /// Distance from which the scene without its background fills the image from all sides, and of what has
    /// been filmed not farther than where this lens shows the width and the height that the cameras saw.
    fn fitting(&self, scene: &Gaussians, pivot: &Pivot) -> f64 {
        let all = measured(scene);
        let content =
            if pivot.reach.is_some() { all.iter().collect() } else { without_background(&all, pivot.center) };
        let slope = [1.0, self.size[1] as f64 / self.size[0] as f64]
            .map(|share| share * libm::tan(self.fov_x_rad * 0.5));
        let half = slope.map(|x| FILLED * x);
        let mut needed = Vec::with_capacity(content.len() * DIRECTIONS);
        for i in 0..DIRECTIONS {
            let out = self.direction(pivot, TAU * i as f64 / DIRECTIONS as f64);
            let [right, down, forward] = axes(out.map(|x| -x), pivot.up);
            for m in &content {
                let p = minus(m.at, pivot.center);
                let aside = |axis, half| (dot(p, axis).abs() + m.radius) / half;
                let from = order::max(aside(right, half[0]), aside(down, half[1])) - dot(p, forward);
                needed.push((from, m.weight));
            }
        }
        let fits = order::max(quantile(needed, SHOWN), 1e-3);
        let filmed = |[w, h]: [f64; 2]| order::max(w / slope[0], h / slope[1]);
        pivot.reach.map_or(fits, |reach| order::min(fits, filmed(reach)))
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
        arc_rad: None,
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
    fn an_orbit_stays_where_cameras_were() {
        let scene = cloud(vec![[1.0, 2.0, 3.0]; 5]);
        let ring = Orbit { count: 36, ..ORBIT }.shots(&scene).expect("a full turn");
        let filmed: Vec<Camera> = ring.iter().map(|s| s.camera.clone()).collect();
        let eyes = |shots: &[Shot]| shots.iter().map(|s| s.camera.center()).collect::<Vec<_>>();
        let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 5e-2);
        let shots =
            |orbit: Orbit, cameras: &[Camera]| orbit.shots_from(&scene, cameras, Up::Auto).expect("valid");

        // From cameras 5 to 15, ten steps of ten degrees and half of one at both ends.
        let some = &filmed[5..16];
        let arc = ORBIT.limited(some, Up::Auto).expect("limited").to_degrees();
        assert!((arc - 110.0).abs() < 1.0, "{arc}");
        let around = eyes(&shots(Orbit { count: 12, ..ORBIT }, some));
        let full = eyes(&Orbit { count: 72, ..ORBIT }.shots(&scene).expect("half steps"));
        let (one, other) = ((full[9], full[31]), (full[31], full[9]));
        let ends = (around[0], around[11]);
        let is = |x: ([f32; 3], [f32; 3])| near(ends.0, x.0) && near(ends.1, x.1);
        assert!(is(one) || is(other), "from end to end: {ends:?} and {one:?}");
        assert!(near(eyes(&shots(Orbit { count: 1, ..ORBIT }, some))[0], full[20]), "one is in the middle");

        assert_eq!(ORBIT.limited(&filmed, Up::Auto), None, "all sides were filmed");
        assert_eq!(ORBIT.limited(&filmed[..31], Up::Auto), None, "nearly all");
        let whole = Orbit { arc_rad: Some(TAU), count: 4, ..ORBIT };
        assert_eq!(whole.limited(some, Up::Auto), None, "as given");
        let opposite = eyes(&shots(whole, some));
        let across = (0..3).fold(0.0, |far, k| order::max(far, (opposite[0][k] - opposite[2][k]).abs()));
        assert!(across > 2.5, "a full turn: {across}");
        assert!(Orbit { arc_rad: Some(0.0), ..ORBIT }.shots(&scene).is_err(), "no arc");
        assert!(Orbit { arc_rad: Some(7.0), ..ORBIT }.shots(&scene).is_err(), "more than a turn");
    }

    #[test]
    fn a_background_does_not_move_the_cameras_away() {
        let object: Vec<[f32; 3]> = (0..1000)
            .map(|i| [(i % 10) as f32 * 0.1, (i / 10 % 10) as f32 * 0.1, (i / 100) as f32 * 0.2])
            .collect();
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
        // Cameras determine the distance.
        let filmed: Vec<Camera> =
            ORBIT.shots(&cloud(object.clone())).expect("valid").into_iter().map(|s| s.camera).collect();
        let both = near([object, wall.collect()].concat(), &filmed);
        assert!((both - 2.0).abs() < 0.1, "as far as the cameras, and the same lens: {both}");
    }
}
