//! Emissive triangles as lights: a Cornell box against a path tracer without light samples, closed forms,
//! extreme scales.

use super::{look, object, shoot, square};
use lastlight::geometry::bvh::{Bvh, MISS, Ray};
use lastlight::num::rng::Rng;
use lastlight::scene::camera::Camera;
use lastlight::scene::light::{Lights, MAX_RADIANCE};
use lastlight::scene::material::{Alpha, Material, Texture, Transfer, Wrap};
use lastlight::scene::mesh::{Mesh, Object};
use lastlight::shade::render::{Brdf, Settings};
use lastlight::shade::vector::frame;
use std::f64::consts::PI;
use std::sync::Arc;

fn matte(color: [f32; 3]) -> Material {
    Material { base_color: [color[0], color[1], color[2], 1.0], roughness: 1.0, ..Material::default() }
}

fn lamp(radiance: [f32; 3]) -> Material {
    Material { emission: radiance, ..matte([0.0; 3]) }
}

/// Appends a parallelogram of one material.
fn add_quad(to: &mut Object, [corner, e, f]: [[f32; 3]; 3], material: Material) {
    let base = to.mesh.positions.len() as u32;
    let at = |a: f32, b: f32| std::array::from_fn(|k| corner[k] + a * e[k] + b * f[k]);
    to.mesh.positions.extend([at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]);
    to.mesh.uvs.extend([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
    to.mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    to.material_of.extend([to.materials.len() as u16; 2]);
    to.materials.push(material);
}

/// A room of side 2 about the origin, open towards −y, with a lamp of side 0.3 in its ceiling and a block.
fn cornell() -> Object {
    let mut room = Object::default();
    let (x, y, z) = ([2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]);
    let white = || matte([0.75; 3]);
    add_quad(&mut room, [[-1.0; 3], x, y], white());
    add_quad(&mut room, [[-1.0, 1.0, -1.0], x, z], white());
    add_quad(&mut room, [[-1.0; 3], y, z], matte([0.65, 0.05, 0.05]));
    add_quad(&mut room, [[1.0, -1.0, -1.0], y, z], matte([0.12, 0.45, 0.15]));
    // The ceiling is a frame around the lamp.
    for (from, side) in [
        ([-1.0, -1.0, 1.0], [0.85, 2.0]),
        ([0.15, -1.0, 1.0], [0.85, 2.0]),
        ([-0.15, -1.0, 1.0], [0.3, 0.85]),
        ([-0.15, 0.15, 1.0], [0.3, 0.85]),
    ] {
        add_quad(&mut room, [from, [side[0], 0.0, 0.0], [0.0, side[1], 0.0]], white());
    }
    add_quad(&mut room, [[-0.15, -0.15, 1.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]], lamp([17.0, 12.0, 4.0]));
    // A block: its top, and the side towards the camera.
    add_quad(&mut room, [[0.0, -0.3, -0.4], [0.6, 0.2, 0.0], [-0.2, 0.6, 0.0]], white());
    add_quad(&mut room, [[0.0, -0.3, -1.0], [0.6, 0.2, 0.0], [0.0, 0.0, 0.6]], white());
    room
}

/// Path tracer of Lambert surfaces without light samples: directions by cosine, and the emission that they
/// meet.
struct Naive<'a> {
    object: &'a Object,
    bvh: &'a Bvh,
    rng: Rng,
}

impl Naive<'_> {
    fn radiance(&self, camera: &Camera, pixel: usize, sample: u32, bounces: u16) -> [f64; 3] {
        let u = |draw: u16| self.rng.uniform_f32(pixel as u64, sample, 0x7001, draw);
        let px = [(pixel % camera.width) as f32 + u(0), (pixel / camera.width) as f32 + u(1)];
        let (mut origin, mut direction) = camera.ray(px).expect("a pinhole camera");
        let (mut through, mut sum) = ([1.0_f64; 3], [0.0; 3]);
        for vertex in 0..=bounces + 1 {
            let hit = self.bvh.closest(&Ray { origin, direction, t_max: f32::INFINITY });
            if hit.triangle == MISS {
                break;
            }
            let material =
                &self.object.materials[usize::from(self.object.material_of[hit.triangle as usize])];
            for c in 0..3 {
                sum[c] += through[c] * f64::from(material.emission[c]);
                through[c] *= f64::from(material.base_color[c]);
            }
            let [a, b, c] = self.object.mesh.corners(hit.triangle as usize);
            let (e, f): ([f32; 3], [f32; 3]) =
                (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
            let n = lastlight::shade::vector::unit(lastlight::shade::vector::cross(e, f)).0;
            let side = if (0..3).fold(0.0, |s, k| s + n[k] * direction[k]) > 0.0 { -1.0 } else { 1.0 };
            let n = n.map(|x| side * x);
            let (radius, turn) =
                (u(2 + 2 * vertex).sqrt(), std::f64::consts::TAU * f64::from(u(3 + 2 * vertex)));
            let z = (1.0 - radius * radius).sqrt();
            let [s, t] = frame(n);
            let (x, y) = (radius * libm::cos(turn) as f32, radius * libm::sin(turn) as f32);
            origin = std::array::from_fn(|k| a[k] + hit.u * e[k] + hit.v * f[k] + 1e-5 * n[k]);
            direction = std::array::from_fn(|k| s[k] * x + t[k] * y + n[k] * z);
        }
        sum
    }
}

/// Mean of one number over some runs, and the variance of a run.
fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().fold(0.0, |a, b| a + b) / n;
    (mean, values.iter().fold(0.0, |a, b| a + (b - mean) * (b - mean)) / (n - 1.0))
}

/// The same expected value as without light samples, and a fraction of the variance at equal samples.
#[test]
fn emitters_of_a_cornell_box_are_sampled() {
    const RUNS: usize = 24;
    const SAMPLES: u32 = 16;
    // The other tracer has more samples per run, so that its mean is known well enough.
    const NAIVE: u32 = 8 * SAMPLES;
    let room = cornell();
    let bvh = Bvh::build(&room.mesh.positions, &room.mesh.triangles);
    // Below the lamp: where it is seen directly, the noise of its edges is the same for both.
    let view = look([0.0, -3.0, 0.4], [0.0, 0.0, -0.5], 0.5, 16, 16);
    for bounces in [0, 2] {
        let ours: Vec<Vec<[f32; 3]>> = (0..RUNS as u64)
            .map(|seed| {
                let settings =
                    Settings { samples: SAMPLES, bounces, seed, brdf: Brdf::Lambert, ..Settings::default() };
                shoot(&room, &Lights::default(), &view, &settings).color
            })
            .collect();
        let naive: Vec<Vec<[f64; 3]>> = (0..RUNS as u64)
            .map(|seed| {
                let tracer = Naive { object: &room, bvh: &bvh, rng: Rng::new(1000 + seed) };
                let pixel = |i: usize| {
                    let mut mean = [0.0; 3];
                    for s in 0..NAIVE {
                        let r = tracer.radiance(&view, i, s, bounces as u16);
                        mean = std::array::from_fn(|c| mean[c] + r[c] / f64::from(NAIVE));
                    }
                    mean
                };
                (0..16 * 16).map(pixel).collect()
            })
            .collect();
        for c in 0..3 {
            let (mut means, mut variances) = ([0.0; 2], [0.0; 2]);
            for i in 0..16 * 16 {
                let of = [
                    mean_and_variance(&ours.iter().map(|run| f64::from(run[i][c])).collect::<Vec<_>>()),
                    mean_and_variance(&naive.iter().map(|run| run[i][c]).collect::<Vec<_>>()),
                ];
                for k in 0..2 {
                    means[k] += of[k].0 / 256.0;
                    variances[k] += of[k].1 / 256.0;
                }
            }
            let error = ((variances[0] + variances[1]) / (RUNS as f64 * 256.0)).sqrt();
            let factor = variances[1] / variances[0] * f64::from(NAIVE / SAMPLES);
            println!("bounces {bounces}, channel {c}: {means:.4?} ± {error:.4}, variance / {factor:.1}");
            assert!((means[0] - means[1]).abs() <= 4.0 * error, "bounces {bounces}: {means:?} ± {error}");
            assert!(means[0] > 40.0 * error, "bounces {bounces}: {means:?} ± {error}, too noisy to compare");
            assert!(factor > 200.0, "bounces {bounces}, channel {c}: the variance falls by {factor} only");
        }
    }
}

/// Irradiance at (0, 0, 0) of a parallel square of half-size `half` at height 1 with radiance 1.
fn irradiance_of_square(half: f64) -> f64 {
    let root = (1.0 + half * half).sqrt();
    4.0 * half / root * libm::atan(half / root)
}

/// Radiance of a Lambert floor of albedo ½ below a square of half-size 0.25 at height 1, seen past it;
/// `scale` is the unit of length.
fn below_square(lamp: Material, pane: Option<f32>, scale: f32) -> (f64, f64) {
    let mut scene = object(square(4.0), matte([0.5; 3]));
    let flat = |half: f32, z: f32| [[-half, -half, z], [2.0 * half, 0.0, 0.0], [0.0, 2.0 * half, 0.0]];
    add_quad(&mut scene, flat(0.25, 1.0), lamp);
    if let Some(alpha) = pane {
        let glass =
            Material { base_color: [0.0, 0.0, 0.0, alpha], alpha: Alpha::Blend, ..Material::default() };
        add_quad(&mut scene, flat(0.4, 0.5), glass);
    }
    scene.mesh.positions.iter_mut().flatten().for_each(|x| *x *= scale);
    let mut view = look([2.0, 0.0, 0.6], [0.0; 3], 0.01, 4, 4);
    view.translation = view.translation.map(|x| x * scale);
    let settings =
        Settings { samples: 2048, bounces: 0, seed: 12, brdf: Brdf::Lambert, ..Settings::default() };
    let out = shoot(&scene, &Lights::default(), &view, &settings);
    let (mean, variance) = mean_and_variance(&out.color.iter().map(|c| f64::from(c[1])).collect::<Vec<_>>());
    (mean, (variance / 16.0).sqrt())
}

#[test]
fn square_lamps_have_their_closed_form() {
    let want = 0.5 / PI * irradiance_of_square(0.25);
    // The right half of the map is bright, the left half dark: by symmetry, half of the light.
    let map = Texture {
        width: 2,
        height: 1,
        texels: vec![[0, 0, 0, 255], [255; 4]],
        transfer: Transfer::Linear,
        wrap: [Wrap::Clamp; 2],
    };
    let one = lamp([1.0; 3]);
    let half_lit = Material { emission_map: Some(Arc::new(map)), ..one.clone() };
    let thin = Material { base_color: [0.0, 0.0, 0.0, 0.25], alpha: Alpha::Blend, ..one.clone() };
    for (what, lamp, pane, share) in [
        ("plain", one.clone(), None, 1.0),
        ("half of it lit", half_lit, None, 0.5),
        ("a quarter opaque", thin, None, 0.25),
        ("behind a pane", one, Some(0.25), 0.75),
    ] {
        let (mean, error) = below_square(lamp, pane, 1.0);
        println!("{what}: {mean:.6} ± {error:.6}, closed form {:.6}", share * want);
        assert!(error < 0.01 * want, "{what}: an error of {error}");
        assert!((mean - share * want).abs() <= 4.0 * error, "{what}: {mean} ± {error}, {}", share * want);
    }
}

/// Areas from 2⁻¹²⁰ to 2²⁰⁰ units: the same image, and nothing leaves the range.
#[test]
fn the_unit_of_length_does_not_matter() {
    let (want, _) = below_square(lamp([1.0; 3]), None, 1.0);
    for power in [-60, -20, 40, 100] {
        let scale = libm::exp2(f64::from(power)) as f32;
        let (mean, _) = below_square(lamp([1.0; 3]), None, scale);
        assert!((mean / want - 1.0).abs() < 1e-4, "2^{power}: {mean}, want {want}");
    }
}

/// A mirror between two lamps of the largest radiance, and triangles without area: finite everywhere.
#[test]
fn the_brightest_emitters_stay_finite() {
    let mirror = Material { roughness: 0.0, metallic: 1.0, ..Material::default() };
    let mut scene = object(square(1.0), Material { emission: [MAX_RADIANCE; 3], ..mirror });
    add_quad(&mut scene, [[-1.0, -1.0, 1e-6], [2.0, 0.0, 0.0], [0.0, 2.0, 1e-6]], lamp([MAX_RADIANCE; 3]));
    add_quad(&mut scene, [[0.0; 3], [1e-30, 0.0, 0.0], [0.0, 1e-30, 0.0]], lamp([MAX_RADIANCE; 3]));
    add_quad(&mut scene, [[0.5; 3], [1.0, 1.0, 0.0], [1.0, 1.0, 0.0]], lamp([1.0; 3]));
    let view = look([0.0, -3.0, 2.0], [0.0; 3], 0.8, 16, 16);
    let settings = Settings { samples: 16, bounces: 8, seed: 3, ..Settings::default() };
    let out = shoot(&scene, &Lights::default(), &view, &settings);
    assert!(out.color.iter().flatten().all(|x| x.is_finite()), "finite");
    // Without area there is no light, and no table.
    let flat = Mesh { positions: vec![[0.0; 3]; 4], ..square(1.0) };
    let none = shoot(&object(flat, lamp([1.0; 3])), &Lights::default(), &view, &settings);
    assert!(none.color.iter().all(|c| *c == [0.0; 3]), "nothing is hit");
}
