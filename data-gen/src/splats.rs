//! Gaussian scenes for demonstration, benchmarks and tests.

use reference::num::elem::{cos, exp, ln, sigmoid, sin};
use reference::num::rng::{Key, normal_f64, uniform_f64};

/// Purpose numbers of random draws. The item is the index of the Gaussian, the draw its component.
pub mod purpose {
    /// Centres of [`super::bench_scene`].
    pub const BENCH_MEAN: u16 = 0x0100;
    /// Logarithms of scales of [`super::bench_scene`].
    pub const BENCH_SCALE: u16 = 0x0101;
    /// Quaternions of [`super::bench_scene`].
    pub const BENCH_QUAT: u16 = 0x0102;
    /// Opacity logits of [`super::bench_scene`].
    pub const BENCH_OPACITY: u16 = 0x0103;
    /// Spherical-harmonics coefficients of [`super::bench_scene`].
    pub const BENCH_SH: u16 = 0x0104;
    /// Centres of [`super::small_random`].
    pub const SMALL_MEAN: u16 = 0x0110;
    /// Scales of [`super::small_random`].
    pub const SMALL_SCALE: u16 = 0x0111;
    /// Quaternions of [`super::small_random`].
    pub const SMALL_QUAT: u16 = 0x0112;
    /// Opacities of [`super::small_random`].
    pub const SMALL_OPACITY: u16 = 0x0113;
    /// Spherical-harmonics coefficients of [`super::small_random`].
    pub const SMALL_SH: u16 = 0x0114;
}

/// A set of Gaussians.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// Centres, shape (N, 3), scene units.
    pub means: Vec<[f64; 3]>,
    /// Quaternions w x y z of length 1 up to rounding, shape (N, 4).
    pub quats: Vec<[f64; 4]>,
    /// Standard deviations, shape (N, 3), scene units.
    pub scales: Vec<[f64; 3]>,
    /// Opacities 0..1, shape (N).
    pub opacities: Vec<f64>,
    /// SH coefficients of the sRGB-encoded colour, shape (N, K, 3) row-major, K = (degree+1)².
    pub sh: Vec<f64>,
    /// SH degree, 0 to 3.
    pub sh_degree: usize,
}

/// A pinhole view.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// World-to-camera matrix 4×4, row-major; camera x right, y down, z forward.
    pub view_from_world: [f64; 16],
    /// Intrinsic matrix 3×3, row-major, pixels.
    pub intrinsics: [f64; 9],
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

/// Gaussians and views of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The Gaussians.
    pub gaussians: Gaussians,
    /// The views, all of the same size.
    pub views: Vec<View>,
}

/// First constant of the spherical harmonics, 1/√(4π).
const C0: f64 = 0.282_094_791_773_878_14;
/// Second constant of the spherical harmonics, √(3/4π).
const C1: f64 = 0.488_602_511_902_919_9;

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|a| a / length)
}

/// A view from `eye` towards `target`; the world's z axis points up in the image. The two must not be above
/// each other.
pub fn look_at(eye: [f64; 3], target: [f64; 3], focal_px: [f64; 2], width: usize, height: usize) -> View {
    let forward = unit([target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]]);
    let right = unit(cross(forward, [0.0, 0.0, 1.0]));
    let down = cross(forward, right);
    let row = |a: [f64; 3]| [a[0], a[1], a[2], -dot(a, eye)];
    let mut view_from_world = [0.0; 16];
    for (i, row) in [row(right), row(down), row(forward), [0.0, 0.0, 0.0, 1.0]].into_iter().enumerate() {
        view_from_world[4 * i..4 * i + 4].copy_from_slice(&row);
    }
    let center = [0.5 * width as f64, 0.5 * height as f64];
    let intrinsics = [focal_px[0], 0.0, center[0], 0.0, focal_px[1], center[1], 0.0, 0.0, 1.0];
    View { view_from_world, intrinsics, width, height }
}

/// The shortest rotation that maps the z axis to a unit vector, as a unit quaternion.
fn from_z_to(n: [f64; 3]) -> [f64; 4] {
    if n[2] < -1.0 + 1e-12 {
        return [0.0, 1.0, 0.0, 0.0];
    }
    let q = [1.0 + n[2], -n[1], n[0], 0.0];
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt();
    q.map(|q| q / length)
}

/// Direction towards the lamp of the demo.
const LAMP: [f64; 3] = [0.48, -0.36, 0.8];

/// Adds a flat disc on a surface, lit by the lamp and slightly brighter when seen along its normal (degree
/// 1).
fn add_disc(to: &mut Gaussians, mean: [f64; 3], normal: [f64; 3], radius: f64, opacity: f64, rgb: [f64; 3]) {
    let cosine = dot(normal, LAMP);
    let light = 0.55 + 0.45 * if cosine > 0.0 { cosine } else { 0.0 };
    to.means.push(mean);
    to.quats.push(from_z_to(normal));
    to.scales.push([radius, radius, 0.15 * radius]);
    to.opacities.push(opacity);
    let sheen = 0.10;
    for c in rgb {
        to.sh.push((light * c - 0.05 - 0.5) / C0);
    }
    // The basis is −C1 y, C1 z, −C1 x at the direction d from the eye; −n·d is 1 for a view along the normal.
    for along in [normal[1], -normal[2], normal[0]] {
        to.sh.extend([sheen * along / C1; 3]);
    }
}

/// A colour of the colour wheel, turn 0..1: red, yellow, green, cyan, blue, magenta.
fn wheel(turn: f64) -> [f64; 3] {
    let channel = |offset: f64| {
        let x = 0.5 + 0.5 * cos(std::f64::consts::TAU * (turn - offset));
        0.12 + 0.85 * x
    };
    [channel(0.0), channel(1.0 / 3.0), channel(2.0 / 3.0)]
}

/// The scene of the demo: a tilted ring in the colours of the wheel around a white ball, above a
/// checkerboard, viewed from 24 positions on a circle. It has 1 884 Gaussians of SH degree 1; z is up;
/// nothing is random.
///
/// * ball: radius 0.42 around (0, 0, 0.85), 300 discs on a Fibonacci spiral;
/// * ring: radii 0.95 and 0.2, tilted by 0.45 about the x axis, 72 × 14 discs, colour by the angle;
/// * board: 24 × 24 discs of half-width 0.075 over 3.6 × 3.6, fields of 3 × 3 discs, z = 0;
/// * views: 160 × 120 pixels, f = 1.1·160 px, distance 4.2 from the axis at height 2.1, aimed at (0, 0,
///   0.55).
pub fn demo() -> Scene {
    let mut gaussians = Gaussians { sh_degree: 1, ..Gaussians::default() };
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let ball = 300;
    for i in 0..ball {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(ball);
        let (r, angle) = ((1.0 - z * z).sqrt(), golden_angle * f64::from(i));
        let normal = [r * cos(angle), r * sin(angle), z];
        let mean = [0.42 * normal[0], 0.42 * normal[1], 0.85 + 0.42 * normal[2]];
        add_disc(&mut gaussians, mean, normal, 0.042, 0.95, [0.97, 0.95, 0.9]);
    }
    let (around, across) = (72, 14);
    let (tilt_sin, tilt_cos) = (sin(0.45), cos(0.45));
    let tilt = |p: [f64; 3]| [p[0], tilt_cos * p[1] - tilt_sin * p[2], tilt_sin * p[1] + tilt_cos * p[2]];
    for i in 0..around {
        let turn = f64::from(i) / f64::from(around);
        let (u_sin, u_cos) = (sin(std::f64::consts::TAU * turn), cos(std::f64::consts::TAU * turn));
        for j in 0..across {
            // Every other row is shifted by half a step.
            let v = std::f64::consts::TAU * (f64::from(j) + 0.5 * f64::from(i % 2)) / f64::from(across);
            let (v_sin, v_cos) = (sin(v), cos(v));
            let normal = tilt([u_cos * v_cos, u_sin * v_cos, v_sin]);
            let reach = 0.95 + 0.2 * v_cos;
            let mean = tilt([reach * u_cos, reach * u_sin, 0.2 * v_sin]);
            add_disc(&mut gaussians, [mean[0], mean[1], 0.85 + mean[2]], normal, 0.042, 0.95, wheel(turn));
        }
    }
    for i in 0..24 {
        for j in 0..24 {
            let [x, y] = [i, j].map(|k| 0.15 * (f64::from(k) - 11.5));
            let dark = (i / 3 + j / 3) % 2 == 0;
            let rgb = if dark { [0.2, 0.24, 0.32] } else { [0.88, 0.86, 0.8] };
            add_disc(&mut gaussians, [x, y, 0.0], [0.0, 0.0, 1.0], 0.075, 0.97, rgb);
        }
    }
    let (width, height) = (160, 120);
    let focal = 1.1 * width as f64;
    let views = (0..24)
        .map(|k| {
            let angle = std::f64::consts::TAU * f64::from(k) / 24.0;
            let eye = [4.2 * cos(angle), 4.2 * sin(angle), 2.1];
            look_at(eye, [0.0, 0.0, 0.55], [focal, focal], width, height)
        })
        .collect();
    Scene { gaussians, views }
}

fn unit_quat(normal: impl Fn(u16) -> f64) -> [f64; 4] {
    let q: [f64; 4] = std::array::from_fn(|k| normal(k as u16));
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    q.map(|q| q / length)
}

/// The scene of the benchmarks: means uniform in [−1, 1]³, log scales normal(ln 0.02, 0.4), random
/// quaternions, opacities sigmoid(normal(0, 1.5)), SH of degree 3 with standard deviation 0.1.
pub fn bench_scene(n: usize, seed: u64) -> Gaussians {
    let mut gaussians = Gaussians { sh_degree: 3, ..Gaussians::default() };
    for item in 0..n as u64 {
        let key = |purpose: u16, draw: u16| Key { seed, item, step: 0, purpose, draw };
        let mean = |k: usize| 2.0 * uniform_f64(key(purpose::BENCH_MEAN, k as u16)) - 1.0;
        let scale = |k: usize| exp(ln(0.02) + 0.4 * normal_f64(key(purpose::BENCH_SCALE, k as u16)));
        gaussians.means.push(std::array::from_fn(mean));
        gaussians.scales.push(std::array::from_fn(scale));
        gaussians.quats.push(unit_quat(|k| normal_f64(key(purpose::BENCH_QUAT, k))));
        gaussians.opacities.push(sigmoid(1.5 * normal_f64(key(purpose::BENCH_OPACITY, 0))));
        gaussians.sh.extend((0..48).map(|k| 0.1 * normal_f64(key(purpose::BENCH_SH, k))));
    }
    gaussians
}

/// The view of the benchmarks: camera at (0, 0, −4), viewing direction +z, f_x = f_y = 1.1·W, principal point
/// in the middle.
pub fn bench_view(width: usize, height: usize) -> View {
    let (w, h) = (width as f64, height as f64);
    View {
        view_from_world: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 4.0, 0.0, 0.0, 0.0, 1.0],
        intrinsics: [1.1 * w, 0.0, 0.5 * w, 0.0, 1.1 * w, 0.5 * h, 0.0, 0.0, 1.0],
        width,
        height,
    }
}

/// A well-conditioned scene for tests: `n` Gaussians in [−1, 1]³ with an aspect ratio of at most 6, opacities
/// 0.1 to 0.9, SH of degree 3 with standard deviation 0.2, seen by two cameras with unequal focal lengths
/// (f_x = 1.1·W, f_y = 1.3·W) and an off-centre principal point.
pub fn small_random(n: usize, seed: u64, width: usize, height: usize) -> Scene {
    let mut gaussians = Gaussians { sh_degree: 3, ..Gaussians::default() };
    for item in 0..n as u64 {
        let key = |purpose: u16, draw: u16| Key { seed, item, step: 0, purpose, draw };
        let between = |low: f64, high: f64, key: Key| low + (high - low) * uniform_f64(key);
        let mean = |k: usize| between(-1.0, 1.0, key(purpose::SMALL_MEAN, k as u16));
        let scale = |k: usize| between(0.05, 0.3, key(purpose::SMALL_SCALE, k as u16));
        gaussians.means.push(std::array::from_fn(mean));
        gaussians.scales.push(std::array::from_fn(scale));
        gaussians.quats.push(unit_quat(|k| normal_f64(key(purpose::SMALL_QUAT, k))));
        gaussians.opacities.push(between(0.1, 0.9, key(purpose::SMALL_OPACITY, 0)));
        gaussians.sh.extend((0..48).map(|k| 0.2 * normal_f64(key(purpose::SMALL_SH, k))));
    }
    let focal = [1.1 * width as f64, 1.3 * width as f64];
    let views = [([0.4, -4.0, 0.7], [0.05, 0.0, -0.1]), ([3.3, 1.9, -0.6], [0.0, 0.1, 0.0])]
        .into_iter()
        .map(|(eye, target)| {
            let mut view = look_at(eye, target, focal, width, height);
            view.intrinsics[2] = 0.48 * width as f64;
            view.intrinsics[5] = 0.53 * height as f64;
            view
        })
        .collect();
    Scene { gaussians, views }
}
