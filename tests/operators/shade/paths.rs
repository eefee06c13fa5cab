//! Paths: furnaces, closed forms, the law of the error, independence of how the work is cut.

use super::{ALBEDO, COSINES, look, object, shoot, sphere, square, uniform};
use lastlight::geometry::bvh::Bvh;
use lastlight::num::par::with_threads;
use lastlight::scene::camera::Model;
use lastlight::scene::light::{Environment, Lamp, Lights};
use lastlight::scene::material::Material;
use lastlight::shade::render::{Brdf, Passes, Scene, Settings, Window, render, render_window};
use std::f32::consts::PI;

fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().fold(0.0, |a, b| a + b) / n;
    let variance = values.iter().fold(0.0, |a, b| a + (b - mean) * (b - mean)) / (n - 1.0);
    (mean, (variance / n).sqrt())
}

fn white() -> Material {
    Material { roughness: 1.0, ..Material::default() }
}

fn constant() -> Lights {
    Lights { environment: Some(Environment::constant([1.0; 3])), lamps: Vec::new() }
}

#[test]
fn a_white_lambert_object_is_invisible_in_a_furnace() {
    let sphere = object(sphere(1.0, 24, false), white());
    let view = look([0.0, -3.0, 1.0], [0.0; 3], 0.8, 48, 48);
    for bounces in [0, 2] {
        let settings = Settings { samples: 64, bounces, seed: 3, brdf: Brdf::Lambert, ..Settings::default() };
        let out = shoot(&sphere, &constant(), &view, &settings);
        let inside: Vec<f64> =
            (0..48 * 48).filter(|&i| out.alpha[i] == 1.0).map(|i| f64::from(out.color[i][1])).collect();
        let (mean, error) = mean_and_error(&inside);
        println!("bounces {bounces}: {mean:.5} ± {error:.5} over {} pixels", inside.len());
        assert!(inside.len() > 800, "the object is in view");
        assert!((mean - 1.0).abs() <= 3.0 * error + 1e-5, "bounces {bounces}: {mean} ± {error}");
        let outside = (0..48 * 48).filter(|&i| out.alpha[i] == 0.0).all(|i| out.color[i] == [1.0; 3]);
        assert!(outside, "the background is the environment");
    }
}

/// A plane seen by parallel rays at a known angle, under a constant map of radiance 1, shows its directional
/// albedo.
#[test]
fn the_full_brdf_in_a_furnace_is_its_directional_albedo() {
    for (metallic, roughness, want) in ALBEDO {
        let plane = object(square(50.0), Material { metallic, roughness, ..Material::default() });
        for (cosine, want) in COSINES.into_iter().zip(want) {
            let sine = (1.0 - cosine * cosine).sqrt();
            let mut view = look([0.0, -4.0 * sine, 4.0 * cosine], [0.0; 3], 0.5, 32, 32);
            view.model = Model::Orthographic;
            view.focal_px = [100.0; 2];
            let settings = Settings { samples: 64, bounces: 0, seed: 4, ..Settings::default() };
            let out = shoot(&plane, &constant(), &view, &settings);
            let values: Vec<f64> = out.color.iter().map(|c| f64::from(c[0])).collect();
            let (mean, error) = mean_and_error(&values);
            println!("m {metallic} r {roughness} n·v {cosine}: {mean:.5} ± {error:.5}, table {want}");
            assert!(
                (mean - want).abs() <= 3.5 * error + 2e-4,
                "m {metallic}, r {roughness}, n·v {cosine}: {mean} ± {error}, want {want}"
            );
        }
    }
}

/// Inside a closed Lambert sphere that emits E: E·(1 + ρ + … + ρ^(bounces+1)). A surface more or less changes
/// the mean by 25 errors or more.
#[test]
fn bounces_count_surfaces() {
    let glowing = Material { base_color: [0.5, 0.5, 0.5, 1.0], emission: [1.0; 3], ..white() };
    let room = object(sphere(1.0, 12, false), glowing);
    let view = look([0.1, 0.0, 0.0], [0.0, 1.0, 0.0], 0.8, 8, 8);
    for bounces in 0..4 {
        let settings =
            Settings { samples: 2048, bounces, seed: 1, brdf: Brdf::Lambert, ..Settings::default() };
        let out = shoot(&room, &Lights::default(), &view, &settings);
        let mut want = 0.0;
        for _ in 0..=bounces + 1 {
            want = 1.0 + 0.5 * want;
        }
        let (mean, error) = mean_and_error(&out.color.iter().map(|c| f64::from(c[0])).collect::<Vec<_>>());
        println!("bounces {bounces}: {mean:.5} ± {error:.5}, want {want}");
        let last = libm::pow(0.5, f64::from(bounces + 2));
        assert!(25.0 * error < last, "bounces {bounces}: an error of {error}");
        assert!((mean - want).abs() <= 4.0 * error, "bounces {bounces}: {mean} ± {error}, want {want}");
    }
}

#[test]
fn lamps_obey_their_closed_forms() {
    let plane = object(square(5.0), Material { base_color: [0.6, 0.3, 0.9, 1.0], ..white() });
    let view = look([0.0, -0.2, 3.0], [0.0; 3], 0.05, 9, 9);
    let settings = Settings { samples: 4, bounces: 0, seed: 2, brdf: Brdf::Lambert, ..Settings::default() };
    let at = 4 * 9 + 4;
    let lamp = Lamp::Point { position: [0.6, 0.0, 0.8], intensity: [2.0, 4.0, 6.0] };
    let out = shoot(&plane, &Lights { environment: None, lamps: vec![lamp] }, &view, &settings);
    for (k, (albedo, intensity)) in [(0.6, 2.0), (0.3, 4.0), (0.9, 6.0)].into_iter().enumerate() {
        let want = albedo / PI * intensity * 0.8; // distance 1, cosine 0.8
        assert!((out.color[at][k] / want - 1.0).abs() < 0.02, "{:?}, want {want}", out.color[at]);
    }
    let sun = Lamp::Distant { towards: [0.6, 0.0, 0.8], irradiance: [1.0; 3] };
    let out = shoot(&plane, &Lights { environment: None, lamps: vec![sun] }, &view, &settings);
    for (k, albedo) in [0.6, 0.3, 0.9].into_iter().enumerate() {
        let want = albedo / PI * 0.8;
        assert!((out.color[at][k] / want - 1.0).abs() < 1e-5, "{:?}, want {want}", out.color[at]);
    }
    // two lamps: one is drawn per sample, their sum is the mean
    let both = Lights { environment: None, lamps: vec![lamp, sun] };
    let many = Settings { samples: 4096, ..settings };
    let out = shoot(&plane, &both, &view, &many);
    let want = 0.6 / PI * (2.0 * 0.8 + 0.8);
    assert!((out.color[at][0] / want - 1.0).abs() < 0.03, "{:?}, want {want}", out.color[at]);
    // behind a wall there is no light
    let mut shadowed = plane.clone();
    let wall = shadowed.mesh.positions.len() as u32;
    shadowed.mesh.positions.extend([[0.2, -1.0, 0.2], [0.2, 1.0, 0.2], [0.4, 1.0, 0.6], [0.4, -1.0, 0.6]]);
    shadowed.mesh.triangles.extend([[wall, wall + 1, wall + 2], [wall, wall + 2, wall + 3]]);
    shadowed.mesh.uvs.clear();
    shadowed.material_of = vec![0; 4];
    let out = shoot(&shadowed, &both, &view, &settings);
    assert_eq!(out.color[at], [0.0; 3], "in the shadow of both");
}

fn uneven() -> Environment {
    let radiance = (0..32 * 16)
        .map(|i| {
            let u = uniform(i, 40);
            [3.0 * u * u * u, u * u, 0.3 + u]
        })
        .collect();
    Environment { width: 32, height: 16, radiance }
}

/// Root mean square error against many samples, for 4 to 256 of them.
#[test]
fn the_error_falls_with_the_root_of_the_samples() {
    let glossy =
        Material { roughness: 0.35, metallic: 0.4, base_color: [0.9, 0.6, 0.4, 1.0], ..Material::default() };
    let ball = object(sphere(1.0, 16, true), glossy);
    let lights = Lights {
        environment: Some(uneven()),
        lamps: vec![Lamp::Point { position: [2.0, -2.0, 3.0], intensity: [6.0; 3] }],
    };
    let view = look([0.0, -3.0, 1.0], [0.0; 3], 0.5, 16, 16);
    let run = |samples, seed| {
        shoot(&ball, &lights, &view, &Settings { samples, bounces: 1, seed, ..Settings::default() })
    };
    let truth = run(16_384, 99);
    let mut points = Vec::new();
    for k in 2..=8 {
        let out = run(1 << k, k);
        let mut square = 0.0;
        for (a, b) in out.color.iter().zip(&truth.color) {
            for c in 0..3 {
                square += f64::from(a[c] - b[c]) * f64::from(a[c] - b[c]);
            }
        }
        points.push((k as f64 * libm::log(2.0), 0.5 * libm::log(square / (3.0 * 256.0))));
    }
    let n = points.len() as f64;
    let (mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0);
    for (x, y) in points {
        sx += x;
        sy += y;
        sxx += x * x;
        sxy += x * y;
    }
    let slope = (n * sxy - sx * sy) / (n * sxx - sx * sx);
    println!("slope {slope:.4}");
    assert!((slope + 0.5).abs() <= 0.1, "slope {slope}");
}

#[test]
fn neither_threads_nor_windows_change_a_bit() {
    let ball = object(sphere(1.0, 12, true), Material { roughness: 0.3, ..Material::default() });
    let lights = Lights {
        environment: Some(uneven()),
        lamps: vec![Lamp::Distant { towards: [0.0, 0.0, 1.0], irradiance: [1.0; 3] }],
    };
    let view = look([0.0, -3.0, 1.0], [0.0; 3], 0.7, 45, 37);
    let moved = look([0.1, -3.0, 1.0], [0.0; 3], 0.7, 45, 37);
    let bvh = Bvh::build(&ball.mesh.positions, &ball.mesh.triangles);
    let scene = Scene::new(&ball, &bvh, &lights).expect("a good scene");
    let settings = Settings { samples: 5, bounces: 2, seed: 8, ..Settings::default() };
    let whole = render(&scene, &view, Some(&moved), &settings).expect("good cameras");
    for threads in [1, 3] {
        let again = with_threads(threads, || render(&scene, &view, Some(&moved), &settings))
            .expect("a pool")
            .expect("good cameras");
        assert!(same(&again, &whole), "{threads} threads");
    }
    let window = Window { origin: [11, 7], size: [21, 19] };
    let part = render_window(&scene, &view, Some(&moved), &settings, window).expect("a good window");
    for y in 0..19 {
        for x in 0..21 {
            let (a, b) = (y * 21 + x, (y + 7) * 45 + x + 11);
            assert_eq!(part.color[a].map(f32::to_bits), whole.color[b].map(f32::to_bits), "pixel {x}, {y}");
            assert_eq!(part.normal[a], whole.normal[b], "normal of pixel {x}, {y}");
            assert_eq!(
                (part.alpha[a], part.depth_z[a]),
                (whole.alpha[b], whole.depth_z[b]),
                "pixel {x}, {y}"
            );
        }
    }
    let bad = Window { origin: [30, 0], size: [16, 4] };
    let e = render_window(&scene, &view, None, &settings, bad).expect_err("it leaves the image");
    assert!(e.to_string().contains("window"), "{e}");
}

fn same(a: &Passes, b: &Passes) -> bool {
    let bits = |p: &Passes| -> Vec<u32> {
        let colors = p.color.iter().chain(&p.normal).chain(&p.albedo).flatten();
        let numbers = p.alpha.iter().chain(&p.depth_z).chain(&p.roughness).chain(&p.metallic);
        colors.chain(numbers).map(|x| x.to_bits()).collect()
    };
    bits(a) == bits(b)
}

/// On a Lambert plane: emission + ρ·L + ρ/π·E·cos, from a map, a lamp and the surface itself at once.
#[test]
fn lamp_map_and_emission_add_up() {
    let (albedo, radiance, irradiance, glow) = ([0.6, 0.3, 0.9], 0.5, 2.0, [0.1, 0.0, 0.7]);
    let [r, g, b] = albedo;
    let plane = object(square(5.0), Material { base_color: [r, g, b, 1.0], emission: glow, ..white() });
    let view = look([0.0, -0.2, 3.0], [0.0; 3], 0.3, 24, 24);
    let lights = Lights {
        environment: Some(Environment::constant([radiance; 3])),
        lamps: vec![Lamp::Distant { towards: [0.6, 0.0, 0.8], irradiance: [irradiance; 3] }],
    };
    for bounces in [0, 2] {
        let settings = Settings { samples: 64, bounces, seed: 5, brdf: Brdf::Lambert, ..Settings::default() };
        let out = shoot(&plane, &lights, &view, &settings);
        for k in 0..3 {
            let want = f64::from(glow[k] + albedo[k] * radiance + albedo[k] / PI * irradiance * 0.8);
            let values: Vec<f64> = out.color.iter().map(|c| f64::from(c[k])).collect();
            let (mean, error) = mean_and_error(&values);
            println!("bounces {bounces}, channel {k}: {mean:.5} ± {error:.5}, want {want:.5}");
            assert!((mean - want).abs() <= 4.0 * error + 1e-5, "bounces {bounces}: {mean} ± {error}, {want}");
        }
    }
}

/// A glossy ball under a constant map, where lights and directions share the work, and within a sphere that
/// glows alike, of which triangles are drawn instead.
#[test]
fn both_ways_of_finding_light_have_the_mean_of_one() {
    let glossy = Material { roughness: 0.4, metallic: 0.6, base_color: [0.9, 0.6, 0.4, 1.0], ..white() };
    let ball = object(sphere(1.0, 16, true), glossy);
    let mut within = ball.clone();
    let room = sphere(20.0, 8, false);
    let base = within.mesh.positions.len() as u32;
    within.mesh.normals.extend(room.positions.iter().map(|_| [0.0; 3]));
    within.mesh.positions.extend(room.positions);
    within.mesh.uvs.extend(room.uvs);
    within.material_of.extend(room.triangles.iter().map(|_| 1));
    within.mesh.triangles.extend(room.triangles.iter().map(|t| t.map(|i| i + base)));
    let black = Material { base_color: [0.0, 0.0, 0.0, 1.0], emission: [1.0; 3], ..white() };
    within.materials.push(black);
    let view = look([0.0, -3.0, 1.0], [0.0; 3], 0.8, 40, 40);
    let settings = Settings { samples: 64, bounces: 0, seed: 6, ..Settings::default() };
    let both = shoot(&ball, &constant(), &view, &settings);
    let one = shoot(&within, &Lights::default(), &view, &Settings { seed: 7, ..settings });
    for k in 0..3 {
        let gap = |i: usize| f64::from(both.color[i][k]) - f64::from(one.color[i][k]);
        let gaps: Vec<f64> = (0..1600).filter(|&i| both.alpha[i] == 1.0).map(gap).collect();
        let (mean, error) = mean_and_error(&gaps);
        println!("channel {k}: {mean:.6} ± {error:.6} over {} pixels", gaps.len());
        assert!(gaps.len() > 500, "the ball is in view");
        assert!(mean.abs() <= 4.0 * error, "channel {k}: {mean} ± {error}");
    }
}
