//! Images of a mesh of one million triangles, beside Mitsuba 3 in the same run; and the views of a training
//! object.
//!
//! `cargo bench --workspace --bench shade` prints samples per second and ratios. Mitsuba comes from PyPI and
//! runs as a subprocess of the Python named by LASTLIGHT_PYTHON (else `python3`); if it cannot be imported,
//! the comparison is skipped with a message. SHADE_RUNS sets the repetitions. SHADE_HIGH=1 compares images of
//! 256 samples instead of times.

#![expect(clippy::disallowed_types, reason = "a bench measures time")]

use lastlight::geometry::bvh::Bvh;
use lastlight::num::par;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::light::{Environment, Lamp, Lights};
use lastlight::scene::material::Material;
use lastlight::scene::mesh::{Mesh, Object};
use lastlight::shade::render::{Brdf, Passes, Scene, Settings, render};
use lastlight::shade::vector::{cross, dot, sub, unit};
use std::process::Command;
use std::time::Instant;

const SIDE: usize = 512;
const SAMPLES: u32 = 16;

/// The torus of the record: a wrinkled closed surface of 2·U·V triangles.
fn torus(us: usize, vs: usize) -> Mesh {
    let turn = std::f64::consts::TAU;
    let mut mesh = Mesh::default();
    for i in 0..us {
        for j in 0..vs {
            let (u, v) = (turn * i as f64 / us as f64, turn * j as f64 / vs as f64);
            let d = 0.05 * libm::sin(9.0 * u) * libm::cos(7.0 * v)
                + 0.02 * libm::sin(31.0 * u + 17.0 * v)
                + 0.008 * libm::sin(97.0 * u - 61.0 * v);
            let r = 0.45 + d;
            let ring = 1.0 + r * libm::cos(v);
            let p = [ring * libm::cos(u), ring * libm::sin(u), r * libm::sin(v)];
            mesh.positions.push(p.map(|x| x as f32));
        }
    }
    let at = |i: usize, j: usize| (i % us * vs + j % vs) as u32;
    for i in 0..us {
        for j in 0..vs {
            let [a, b, c, e] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, e]]);
        }
    }
    mesh
}

fn object(mesh: Mesh, material: Material) -> Object {
    Object { material_of: vec![0; mesh.triangles.len()], mesh, materials: vec![material] }
}

/// A camera at `eye` directed at the origin.
fn camera(eye: [f32; 3], fov: f32, side: usize) -> Camera {
    let z = unit(sub([0.0; 3], eye)).0;
    let x = unit(cross(z, [0.0, 0.0, 1.0])).0;
    let y = cross(z, x);
    let f = 0.5 * side as f32 / libm::tanf(0.5 * fov);
    Camera {
        rotation: [x, y, z],
        translation: [-dot(x, eye), -dot(y, eye), -dot(z, eye)],
        focal_px: [f, f],
        center_px: [0.5 * side as f32; 2],
        width: side,
        height: side,
        model: Model::Pinhole,
    }
}

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

/// Mitsuba's samples per second by name, and the folder with its images.
fn mitsuba(high: bool) -> Option<(Vec<(String, f64)>, tempfile::TempDir)> {
    let python = std::env::var("LASTLIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let found = Command::new(&python).args(["-c", "import mitsuba, numpy"]).output();
    if !found.is_ok_and(|o| o.status.success()) {
        println!("  skipped: {python} cannot import mitsuba and numpy");
        return None;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/shade/peer.py");
    let mut command = Command::new(&python);
    command.arg(script).arg(folder.path()).arg(par::threads().to_string());
    if high {
        command.arg("high");
    }
    let output = command.output().expect("python was there a moment ago");
    if !output.status.success() {
        println!("  skipped: {}", String::from_utf8_lossy(&output.stderr).trim());
        return None;
    }
    let rates = String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter_map(|l| {
            let (name, rate) = l.split_once(' ')?;
            Some((name.to_owned(), rate.parse().ok()?))
        })
        .collect();
    Some((rates, folder))
}

/// Mean value, mean relative difference of 8×8 blocks, and mean difference over the mean.
fn differ(ours: &[[f32; 3]], folder: &std::path::Path, name: &str) -> (f64, f64, f64) {
    let bytes = std::fs::read(folder.join(format!("{name}.f32"))).expect("an image");
    let theirs: Vec<f64> =
        bytes.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect();
    let block = |f: &dyn Fn(usize) -> f64, x: usize, y: usize| {
        let mut sum = 0.0;
        for i in 0..64 {
            sum += f(((8 * y + i / 8) * SIDE + 8 * x + i % 8) * 3 + 1);
        }
        sum / 64.0
    };
    let (mut relative, mut a_sum, mut b_sum) = (0.0, 0.0, 0.0);
    let flat = ours.as_flattened();
    for y in 0..SIDE / 8 {
        for x in 0..SIDE / 8 {
            let a = block(&|i| f64::from(flat[i]), x, y);
            let b = block(&|i| theirs[i], x, y);
            relative += (a - b).abs() / b;
            a_sum += a;
            b_sum += b;
        }
    }
    let blocks = (SIDE / 8 * (SIDE / 8)) as f64;
    (a_sum / blocks, relative / blocks, (a_sum - b_sum) / b_sum)
}

fn million() -> Object {
    let material = Material { base_color: [0.7, 0.7, 0.7, 1.0], roughness: 1.0, ..Material::default() };
    object(torus(1000, 500), material)
}

fn million_lights() -> Lights {
    let lamps = vec![Lamp::Point { position: [2.0, -3.0, 4.0], intensity: [20.0; 3] }];
    Lights { environment: Some(Environment::constant([1.0; 3])), lamps }
}

fn picture(runs: usize, high: bool) {
    let object = million();
    let start = Instant::now();
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    println!(
        "1M triangles, tree in {:.0} ms, {} threads",
        1e3 * start.elapsed().as_secs_f64(),
        par::threads()
    );
    let lights = million_lights();
    let scene = Scene::new(&object, &bvh, &lights).expect("a good scene");
    let view = camera([0.0, -2.8, 1.9], 45.0_f32.to_radians(), SIDE);
    let run = |bounces: u32, brdf: Brdf, samples: u32, seed: u64| -> (f64, Passes) {
        let settings = Settings { samples, bounces, brdf, seed, ..Settings::default() };
        let start = Instant::now();
        let passes = render(&scene, &view, None, &settings).expect("a good camera");
        (start.elapsed().as_secs_f64(), passes)
    };
    if high {
        let Some((_, folder)) = mitsuba(true) else { return };
        for (name, bounces) in [("direct", 0), ("path", 2)] {
            let (_, ours) = run(bounces, Brdf::Lambert, 256, 1);
            let (_, other) = run(bounces, Brdf::Lambert, 256, 2);
            let (mean, relative, bias) = differ(&ours.color, folder.path(), name);
            let (_, again, bias_again) = differ(&other.color, folder.path(), name);
            println!(
                "  {name}: mean {mean:.5}; against Mitsuba, blocks of 8×8: {relative:.2e}, {again:.2e}; whole: {bias:.2e}, {bias_again:.2e}"
            );
        }
        return;
    }
    let total = (SIDE * SIDE) as f64 * f64::from(SAMPLES);
    let mut ours = Vec::new();
    for (name, bounces) in [("direct", 0), ("path", 2)] {
        for brdf in [Brdf::Lambert, Brdf::MetallicRoughness] {
            let mut times = Vec::new();
            let mut last = None;
            for seed in 0..runs as u64 {
                let (t, passes) = run(bounces, brdf, SAMPLES, seed);
                times.push(t);
                last = Some(passes);
            }
            let rate = total / median(times);
            println!("  {name:6} {brdf:?}: {:.2} Msamples/s", 1e-6 * rate);
            if brdf == Brdf::Lambert {
                ours.push((name, rate, last.expect("at least one run")));
            }
        }
    }
    let Some((rates, folder)) = mitsuba(false) else { return };
    for (name, rate, passes) in &ours {
        for (_, theirs) in rates.iter().filter(|(n, _)| n == name) {
            let (_, relative, bias) = differ(&passes.color, folder.path(), name);
            println!(
                "  {name:6} Mitsuba LLVM: {:.2} Msamples/s, ours (Lambert) is {:.2}x; images differ by {relative:.1e} in blocks, {bias:.1e} in the mean",
                1e-6 * theirs,
                rate / theirs
            );
        }
    }
}

/// An environment of 1024×512 with a sun.
fn sky() -> Environment {
    let (w, h) = (1024, 512);
    let radiance = (0..w * h)
        .map(|i| {
            let (x, y) = ((i % w) as f32 / w as f32, (i / w) as f32 / h as f32);
            let sun = (x - 0.3) * (x - 0.3) + (y - 0.2) * (y - 0.2) < 1e-4;
            let base = if y < 0.5 { 1.2 - y } else { 0.2 + 0.05 * ((i / 7) % 3) as f32 };
            if sun { [800.0, 780.0, 700.0] } else { [base, base, 1.1 * base] }
        })
        .collect();
    Environment { width: w, height: h, radiance }
}

/// 32 views of 256², 64 samples, direct light and one bounce.
fn training_views() {
    let mesh = torus(160, 80);
    let triangles = mesh.triangles.len();
    let material =
        Material { base_color: [0.8, 0.4, 0.3, 1.0], roughness: 0.4, metallic: 0.3, ..Material::default() };
    let object = object(mesh, material);
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    let lights = Lights { environment: Some(sky()), lamps: Vec::new() };
    let start = Instant::now();
    let scene = Scene::new(&object, &bvh, &lights).expect("a good scene");
    for k in 0..32 {
        let angle = std::f32::consts::TAU * k as f32 / 32.0;
        let eye = [3.2 * libm::sinf(angle), 3.2 * libm::cosf(angle), 1.5];
        let view = camera(eye, 50.0_f32.to_radians(), 256);
        render(&scene, &view, None, &Settings::default()).expect("a good camera");
    }
    println!(
        "{triangles} triangles under 1024×512, 32 views of 256², 64 samples, one bounce: {:.2} s",
        start.elapsed().as_secs_f64()
    );
}

/// For profilers: SHADE_PROFILE=direct|path|views does that and nothing else.
fn profile(name: &str) {
    if name == "views" {
        return training_views();
    }
    let lights = million_lights();
    let object = million();
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    let scene = Scene::new(&object, &bvh, &lights).expect("a good scene");
    let view = camera([0.0, -2.8, 1.9], 45.0_f32.to_radians(), SIDE);
    let bounces = if name == "path" { 2 } else { 0 };
    let settings =
        Settings { samples: SAMPLES, bounces, brdf: Brdf::Lambert, seed: 0, ..Settings::default() };
    for _ in 0..4 {
        let start = Instant::now();
        render(&scene, &view, None, &settings).expect("a good camera");
        println!("{name}: {:.3} s", start.elapsed().as_secs_f64());
    }
}

fn main() {
    if std::env::args().any(|a| a == "--test") {
        return;
    }
    if let Ok(name) = std::env::var("SHADE_PROFILE") {
        return profile(&name);
    }
    let runs = std::env::var("SHADE_RUNS").ok().and_then(|r| r.parse().ok()).unwrap_or(5);
    let high = std::env::var("SHADE_HIGH").is_ok();
    picture(runs, high);
    if !high {
        training_views();
    }
}
