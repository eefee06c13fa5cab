//! Positions of cameras: training and test views of an object at the origin, rings, and a head-mounted camera
//! of a person who walks around the object.
//!
//! Objects are inside a ball of radius ½. Azimuths increase counter-clockwise seen from above, with 0 at +x;
//! elevations increase towards +z.

use crate::draws::Draws;
use crate::space::{V3, add, cross, dot, larger, rotated, rotation, scaled, sub, unit};
use crate::splats::View;
use reference::num::elem::{cos, exp, sin};
use std::f64::consts::{PI, TAU};

/// Purpose numbers of random draws. The item is the number of the object, the step that of the view.
pub mod purpose {
    /// Field of view and framing of a training set.
    pub const TRAIN: u16 = 0x0410;
    /// One training view.
    pub const TRAIN_VIEW: u16 = 0x0411;
    /// Choice and order of test views.
    pub const TEST: u16 = 0x0412;
    /// The path of a head.
    pub const HEAD: u16 = 0x0413;
}

/// Radius of the ball around an object.
pub const OBJECT_RADIUS: f64 = 0.5;

fn radians(degrees: f64) -> f64 {
    degrees * PI / 180.0
}

/// Tangent of half an angle of view given in degrees.
fn half_tangent(fov: f64) -> f64 {
    let half = radians(0.5 * fov);
    sin(half) / cos(half)
}

/// A point on a sphere around the origin; angles in degrees.
pub fn on_sphere(azimuth: f64, elevation: f64, distance: f64) -> V3 {
    let (a, e) = (radians(azimuth), radians(elevation));
    [distance * cos(e) * cos(a), distance * cos(e) * sin(a), distance * sin(e)]
}

/// A square pinhole view with the given angle of view (degrees) from `eye`, with the optical axis along
/// `forward` (unit); the z axis points up in the image, or the y axis if `forward` is vertical.
fn view(eye: V3, forward: V3, fov: f64, size: usize) -> View {
    let helper = if forward[0] * forward[0] + forward[1] * forward[1] > 1e-12 {
        [0.0, 0.0, 1.0]
    } else {
        [0.0, 1.0, 0.0]
    };
    let right = unit(cross(forward, helper));
    posed(eye, right, cross(forward, right), forward, 0.5 * size as f64 / half_tangent(fov), size)
}

fn posed(eye: V3, right: V3, down: V3, forward: V3, focal_px: f64, size: usize) -> View {
    let mut view_from_world = [0.0; 16];
    for (i, axis) in [right, down, forward].into_iter().enumerate() {
        view_from_world[4 * i..4 * i + 4].copy_from_slice(&[axis[0], axis[1], axis[2], -dot(axis, eye)]);
    }
    view_from_world[15] = 1.0;
    let center = 0.5 * size as f64;
    let intrinsics = [focal_px, 0.0, center, 0.0, focal_px, center, 0.0, 0.0, 1.0];
    View { view_from_world, intrinsics, width: size, height: size }
}

/// One view and the parameters from which it was constructed.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraView {
    /// The pinhole view.
    pub view: View,
    /// Angle of view, degrees.
    pub fov: f64,
    /// Azimuth, degrees.
    pub azimuth: f64,
    /// Elevation, degrees.
    pub elevation: f64,
    /// Distance from the origin.
    pub distance: f64,
    /// Angle between the optical axis and the direction to the origin, degrees.
    pub off_axis: f64,
}

/// How training views frame the object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// The whole ball is inside every image, and the optical axis passes through the origin.
    Whole,
    /// As in the published sample: the axis is 2 to 18 degrees off the origin, and some images crop the ball.
    Loose,
}

impl Framing {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Whole, Self::Loose];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whole => "whole",
            Self::Loose => "loose",
        }
    }

    /// Returns the framing of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|framing| framing.name() == name)
    }
}

/// Training views of object k: a common angle of view U[15, 85]°, each view with elevation U[−5, 70]° and
/// azimuth U[0, 360]°.
///
/// The ball exactly fits the angle of view at the distance r/sin(fov/2). The distance of a view is U[1, 1.25]
/// times that under [`Framing::Whole`] and U[0.8, 1.3] times that under [`Framing::Loose`], but at least 1.25
/// r. The axes of loose views are off the origin by U[2, 18]° in any direction, but by at most 0.3 of the
/// angle of view.
pub fn training(seed: u64, k: u64, count: usize, size: usize, framing: Framing) -> Vec<CameraView> {
    let fov = Draws::new(seed, k, 0, purpose::TRAIN).range(15.0, 85.0);
    let fit = OBJECT_RADIUS / sin(radians(0.5 * fov));
    (0..count)
        .map(|i| {
            let mut draws = Draws::new(seed, k, i as u32, purpose::TRAIN_VIEW);
            let elevation = draws.range(-5.0, 70.0);
            let azimuth = draws.range(0.0, 360.0);
            let near = 1.25 * OBJECT_RADIUS;
            let (distance, off_axis) = match framing {
                Framing::Whole => (larger(fit * draws.range(1.0, 1.25), near), 0.0),
                Framing::Loose => {
                    let d = larger(fit * draws.range(0.8, 1.3), near);
                    (d, crate::space::smaller(draws.range(2.0, 18.0), 0.3 * fov))
                }
            };
            let turn = draws.range(0.0, TAU);
            let eye = on_sphere(azimuth, elevation, distance);
            let forward = unit(scaled(eye, -1.0));
            let placed = view(eye, off(forward, radians(off_axis), turn), fov, size);
            CameraView { view: placed, fov, azimuth, elevation, distance, off_axis }
        })
        .collect()
}

/// A unit direction rotated by `angle` about a perpendicular axis, which is itself rotated by `turn` around
/// the direction.
fn off(forward: V3, angle: f64, turn: f64) -> V3 {
    let helper = if forward[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let right = unit(cross(forward, helper));
    let down = cross(forward, right);
    let aside = add(scaled(right, cos(turn)), scaled(down, sin(turn)));
    add(scaled(forward, cos(angle)), scaled(aside, sin(angle)))
}

/// The test views of an object: 48 images, the order of the input views, and the output views to be
/// predicted.
#[derive(Clone, Debug, PartialEq)]
pub struct Test {
    /// Elevations 0, 20, 40 degrees, 16 azimuths each, in this order: index = 16·ring + azimuth.
    pub views: Vec<CameraView>,
    /// The 16 input views in random order, four sets of four.
    pub inputs: [usize; 16],
    /// The same views ordered by azimuth, then by elevation.
    pub sequential: [usize; 16],
    /// The 12 output views, in ascending order.
    pub outputs: [usize; 12],
}

/// Images of a set of the test inputs.
pub const SET: usize = 4;

/// Angle of view of test images, degrees.
pub const TEST_FOV: f64 = 50.0;

/// Test views of object k: the camera is aimed at the origin from r/sin(fov/2), so that the ball touches the
/// borders. Inputs are 8 of the 16 views at 20° and 8 of the 16 at 40°; outputs are 12 of the other 32.
pub fn test(seed: u64, k: u64, size: usize) -> Test {
    let distance = OBJECT_RADIUS / sin(radians(0.5 * TEST_FOV));
    let views = (0..48)
        .map(|i| {
            let elevation = 20.0 * (i / 16) as f64;
            let azimuth = 22.5 * (i % 16) as f64;
            let eye = on_sphere(azimuth, elevation, distance);
            let view = view(eye, unit(scaled(eye, -1.0)), TEST_FOV, size);
            CameraView { view, fov: TEST_FOV, azimuth, elevation, distance, off_axis: 0.0 }
        })
        .collect();
    let mut draws = Draws::new(seed, k, 0, purpose::TEST);
    let mut shuffled = |mut list: Vec<usize>| {
        for i in (1..list.len()).rev() {
            let j = draws.whole(0, i + 1);
            list.swap(i, j);
        }
        list
    };
    let (low, high) = (shuffled((16..32).collect()), shuffled((32..48).collect()));
    let given = [&low[..8], &high[..8]].concat();
    let mixed = shuffled(given.clone());
    let rest = shuffled((0..48).filter(|i| !given.contains(i)).collect());
    let mut sequential = given;
    sequential.sort_by_key(|&i| (i % 16, i / 16));
    let mut outputs: [usize; 12] = std::array::from_fn(|i| rest[i]);
    outputs.sort_unstable();
    Test {
        views,
        inputs: std::array::from_fn(|i| mixed[i]),
        sequential: std::array::from_fn(|i| sequential[i]),
        outputs,
    }
}

/// `count` views on a ring at one elevation, aimed at the origin, with the ball touching the borders.
pub fn ring(count: usize, elevation: f64, fov: f64, size: usize) -> Vec<CameraView> {
    let distance = OBJECT_RADIUS / sin(radians(0.5 * fov));
    (0..count)
        .map(|i| {
            let azimuth = 360.0 * i as f64 / count as f64;
            let eye = on_sphere(azimuth, elevation, distance);
            let view = view(eye, unit(scaled(eye, -1.0)), fov, size);
            CameraView { view, fov, azimuth, elevation, distance, off_axis: 0.0 }
        })
        .collect()
}

/// A frame of a camera that moves while its shutter is open.
#[derive(Clone, Debug, PartialEq)]
pub struct Moving {
    /// The view when the shutter opens; the focal length is that of an equidistant fisheye, or of a pinhole
    /// ([`Moving::through_pinhole`]).
    pub open: View,
    /// The view when the shutter closes.
    pub close: View,
    /// Time at which the shutter opens, seconds.
    pub time: f64,
    /// Angle between the object's direction and the optical axis when the shutter opens, degrees.
    pub off_axis: f64,
}

impl Moving {
    /// The same motion with a pinhole camera of [`HEAD_PINHOLE_FOV`].
    #[must_use]
    pub fn through_pinhole(mut self) -> Self {
        for view in [&mut self.open, &mut self.close] {
            let focal = 0.5 * view.width as f64 / half_tangent(HEAD_PINHOLE_FOV);
            (view.intrinsics[0], view.intrinsics[4]) = (focal, focal);
        }
        self
    }
}

/// Images per second of the head-mounted camera.
pub const HEAD_RATE: f64 = 10.0;
/// Exposure time of the head-mounted camera, seconds.
pub const HEAD_SHUTTER: f64 = 0.02;
/// Angle of view of the head-mounted camera from border to border, degrees.
pub const HEAD_FOV: f64 = 130.0;
/// Angle of view of the pinhole variant, degrees: that of a phone's wide lens.
pub const HEAD_PINHOLE_FOV: f64 = 70.0;

/// A smooth path in time: a sum of sine waves of given maximum height, with several frequencies around a low
/// one.
struct Sway {
    waves: Vec<[f64; 3]>,
}

impl Sway {
    fn new(draws: &mut Draws, height: f64, frequency: f64) -> Self {
        let wave = |k: usize| {
            let f = frequency * (1.0 + 0.9 * k as f64) * draws.range(0.8, 1.25);
            [height * draws.range(0.5, 1.0) / (1.0 + k as f64), TAU * f, draws.range(0.0, TAU)]
        };
        Self { waves: (0..4).map(wave).collect() }
    }

    fn at(&self, t: f64) -> f64 {
        self.waves.iter().fold(0.0, |s, w| s + w[0] * sin(w[1] * t + w[2]))
    }
}

/// Frames of a wide fisheye camera on the head of a person who walks around the object and mostly faces it:
/// 0.8 to 1.5 from the object, 5 to 50 degrees above it, with the vertical motion of steps and small
/// rotations of the head.
pub fn head(seed: u64, k: u64, count: usize, size: usize) -> Vec<Moving> {
    let mut draws = Draws::new(seed, k, 0, purpose::HEAD);
    let start = draws.range(0.0, TAU);
    let speed = draws.range(0.35, 0.7) * if draws.chance(0.5) { 1.0 } else { -1.0 };
    let far = draws.range(0.95, 1.25);
    let high = draws.range(20.0, 35.0);
    let around = Sway::new(&mut draws, 0.12, 0.25);
    let radial = Sway::new(&mut draws, 0.1, 0.2);
    let rise = Sway::new(&mut draws, 7.0, 0.15);
    let bob = Sway::new(&mut draws, 0.012, 1.8);
    let gaze = [Sway::new(&mut draws, 0.12, 0.3), Sway::new(&mut draws, 0.1, 0.35)];
    let shake = [Sway::new(&mut draws, 0.012, 3.0), Sway::new(&mut draws, 0.012, 3.3)];
    let roll = Sway::new(&mut draws, 0.06, 0.4);
    // Equidistant: the border is at half the angle of view times the focal length.
    let focal = 0.5 * size as f64 / radians(0.5 * HEAD_FOV);
    let pose = |t: f64| -> (View, f64) {
        let azimuth = start + speed * t + around.at(t);
        let elevation = radians(high + rise.at(t));
        // The distance is bounded below, whatever the sum of the waves.
        let distance = 0.8 + 0.7 / (1.0 + exp(-(far + radial.at(t) - 1.15) / 0.12));
        let mut eye = [
            distance * cos(elevation) * cos(azimuth),
            distance * cos(elevation) * sin(azimuth),
            distance * sin(elevation),
        ];
        eye[2] += bob.at(t);
        let to_object = unit(scaled(eye, -1.0));
        let right = unit(cross(to_object, [0.0, 0.0, 1.0]));
        let down = cross(to_object, right);
        let (x, y) = (gaze[0].at(t) + shake[0].at(t), gaze[1].at(t) + shake[1].at(t));
        let forward = unit(add(to_object, add(scaled(right, x), scaled(down, y))));
        let level = unit(cross(forward, [0.0, 0.0, 1.0]));
        let turn = rotation(forward, roll.at(t));
        let right = rotated(&turn, level);
        let right = unit(sub(right, scaled(forward, dot(right, forward))));
        let angle = {
            let c = cross(forward, to_object);
            // Below 45°, the series of the arc sine to fifth order has an error of about a thousandth.
            let s = dot(c, c).sqrt();
            s + s * s * s / 6.0 + 3.0 * s * s * s * s * s / 40.0
        };
        (posed(eye, right, cross(forward, right), forward, focal, size), angle * 180.0 / PI)
    };
    (0..count)
        .map(|i| {
            let time = i as f64 / HEAD_RATE;
            let (open, off_axis) = pose(time);
            Moving { open, close: pose(time + HEAD_SHUTTER).0, time, off_axis }
        })
        .collect()
}
