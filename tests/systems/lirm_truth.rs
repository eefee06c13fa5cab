//! `lirm gen`: the ground truth of an object is on disk as it was rendered, and every pass fits the pose that
//! is recorded.

use lastlight::fit::passes::{PassSet, Shot};
use lastlight::fit::relight::{self, Exposure, Relight};
use lastlight::fit::render::capture_shots;
use lastlight::geometry::bvh::Bvh;
use lastlight::geometry::nearest::Surface;
use lastlight::io::capture::{Capture, Frame, Lens, Split, read_capture};
use lastlight::io::image_file;
use lastlight::lirm::r#gen::{Lighting, Set, Settings, run};
use lastlight::lirm::subject::{Light, Subject};
use lastlight::lirm::truth;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::environment_file;
use lastlight::scene::light::{Environment, Lights};
use lastlight::scene::material::linear_of_srgb;
use lastlight::scene::mesh::Object;
use lastlight::scene::model;
use lastlight::scene::passes::PassImages;
use lastlight::shade::render::{Scene, Settings as Tracing, render};
use lastlight::shade::sensor::Sensor;
use lastlight::shade::tonemap;
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::atomic::AtomicBool;

fn small() -> Settings {
    Settings {
        objects: 1,
        lighting: Lighting::Environment,
        views: 2,
        size: 48,
        samples: 16,
        texture: 64,
        map_width: 64,
        seed: 7,
        ..Settings::default()
    }
}

fn make(dir: &Path, settings: &Settings, resume: bool) -> usize {
    run(dir, settings, resume, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a set").rendered
}

fn record(object: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(object.join("object.json")).expect("readable")).expect("JSON")
}

/// Positions, normals and texture coordinates of the corners of a triangle, in bits.
fn corners(o: &Object, t: usize) -> Vec<u32> {
    let m = &o.mesh;
    let rows = m.triangles[t].map(|i| i as usize);
    let three = rows.iter().flat_map(|&i| m.positions[i].into_iter().chain(m.normals[i]));
    three.chain(rows.iter().flat_map(|&i| m.uvs[i])).map(f32::to_bits).collect()
}

#[test]
fn shape_materials_and_light_are_read_back_to_the_bit() {
    let dir = tempfile::tempdir().expect("a folder");
    // Of nineteen generators in turn: with one surface and with several.
    let settings = Settings { objects: 6, first: 2, views: 1, size: 8, samples: 1, ..small() };
    make(dir.path(), &settings, false);
    let (mut triangles, mut textures, mut materials) = (0, 0, 0);
    for k in 2..8 {
        let folder = dir.path().join(format!("object_{k:05}"));
        let rendered = Subject::new(&settings, k).expect("the object").object;
        let back = model::read(&folder.join(truth::OBJECT)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(back.mesh.triangles.len(), rendered.mesh.triangles.len(), "object {k}: triangles");
        for t in 0..rendered.mesh.triangles.len() {
            assert_eq!(corners(&back, t), corners(&rendered, t), "object {k}: corners of triangle {t}");
        }
        assert_eq!(back.material_of, rendered.material_of, "object {k}: material of every triangle");
        assert_eq!(back.materials, rendered.materials, "object {k}: factors and texels of its materials");
        triangles += rendered.mesh.triangles.len();
        materials += rendered.materials.len();
        textures += rendered.materials.iter().filter(|m| m.base_color_map.is_some()).count();

        let map = environment_file::read(&folder.join(truth::ENVIRONMENT), &Default::default());
        let map = map.unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(map, Light::new(&settings, k).expect("the map").map, "object {k}: radiance in bits");
        assert_eq!((map.width, map.height), (64, 32), "object {k}: size of the map");

        let digests = &record(&folder)["truth"];
        assert_eq!(digests.as_object().map(Map::len), Some(2), "object {k}: both are recorded: {digests}");
        assert!(truth::is_whole(&folder, digests), "object {k}: with the digests they have");
    }
    assert!(
        triangles > 6000 && materials > 6 && textures > 2,
        "{triangles} triangles, {materials} materials, {textures} textures were compared"
    );
}

#[test]
fn a_lost_truth_is_made_again_and_may_be_left_out() {
    let dir = tempfile::tempdir().expect("a folder");
    let settings = Settings { views: 1, size: 8, samples: 1, lighting: Lighting::Uniform, ..small() };
    make(dir.path(), &settings, false);
    let folder = dir.path().join("object_00000");
    let glb = std::fs::read(folder.join(truth::OBJECT)).expect("there");
    assert!(!folder.join(truth::ENVIRONMENT).exists(), "a white dome needs no map");
    for broken in [&b"half"[..], b""] {
        std::fs::write(folder.join(truth::OBJECT), broken).expect("damaged");
        make(dir.path(), &settings, true);
        assert!(std::fs::read(folder.join(truth::OBJECT)).expect("there") == glb, "the same file again");
    }
    let without = dir.path().join("without");
    make(&without, &Settings { truth: false, ..settings }, false);
    let folder = without.join("object_00000");
    assert!(record(&folder)["truth"].is_null(), "nothing is recorded");
    assert!(!folder.join(truth::OBJECT).exists(), "nothing is written");
}

/// Per pixel, of the images that are compared.
const SAMPLES: u32 = 128;

/// A photo of one camera as `mesh render` takes it, in bytes.
fn relit(dir: &Path, object: &Object, map: &Environment, shot: &Shot, exposure: f64, seed: u64) -> Vec<u8> {
    let lights = Lights { environment: Some(map.clone()), lamps: Vec::new() };
    let job = Relight {
        object,
        lights: &lights,
        settings: Tracing { samples: SAMPLES, bounces: 1, seed, ..Tracing::default() },
        exposure: Exposure::Fixed(exposure as f32),
        transparent: false,
        passes: PassSet::ALL,
    };
    let stop = AtomicBool::new(false);
    job.to_folder(std::slice::from_ref(shot), dir, Map::new(), false, &stop, &mut |_, _| {})
        .expect("rendered");
    bytes(&dir.join(format!("images/{}.png", shot.name)))
}

fn bytes(path: &Path) -> Vec<u8> {
    match image_file::read(path).expect("an image").samples {
        image_file::Samples::U8(v) => v,
        other => panic!("bytes, not {other:?}"),
    }
}

/// Root mean square and mean of the differences.
fn differences(a: &[u8], b: &[u8]) -> [f64; 2] {
    assert_eq!(a.len(), b.len(), "as many bytes");
    let d = a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b));
    let n = a.len() as f64;
    let (square, sum) = d.fold((0.0, 0.0), |(q, s), x| (q + x * x, s + x));
    [(square / n).sqrt(), sum / n]
}

/// The files suffice to make the image again: the written one differs from a new one as two new ones differ
/// from each other.
#[test]
fn the_written_picture_is_rendered_anew_from_the_files() {
    let dir = tempfile::tempdir().expect("a folder");
    let settings = Settings { first: 5, size: 64, samples: SAMPLES, ..small() };
    make(dir.path(), &settings, false);
    let folder = dir.path().join("object_00005");
    let object = model::read(&folder.join(truth::OBJECT)).expect("a model");
    let map = environment_file::read(&folder.join(truth::ENVIRONMENT), &Default::default()).expect("a map");
    let capture = read_capture(&folder.join("environment")).expect("a capture");
    let frame = &capture.frames[1];
    let camera = capture_shots(&folder.join("environment"), 1).expect("cameras").swap_remove(1).camera;
    let shot = relight::still("view".into(), camera);
    let written = PassImages::read(frame).expect("passes");
    let exposure = written.exposure.expect("an exposure");
    let picture = |name: &str, map: &Environment, seed| {
        relit(&dir.path().join(name), &object, map, &shot, exposure, seed)
    };
    let (first, second) = (picture("first", &map, 1), picture("second", &map, 2));
    let photograph = bytes(&frame.image);
    let [noise, _] = differences(&first, &second);
    let [error, bias] = differences(&photograph, &first);
    let bound = 4.0 * noise / (photograph.len() as f64).sqrt();
    println!("written − new: rms {error:.3}, mean {bias:.4} ± {bound:.4}; new − new: rms {noise:.3}");
    assert!(noise > 0.2, "{SAMPLES} samples leave noise: {noise}");
    assert!((error / noise - 1.0).abs() < 0.15, "rms {error}, noise {noise}");
    assert!(bias.abs() < bound, "mean difference {bias}, four standard errors are {bound}");
    // Another light does not pass for this one.
    let turned = environment_file::Options { rotate: 90.0, ..Default::default() };
    let [other, _] = differences(&photograph, &picture("turned", &environment_file::orient(map, &turned), 1));
    assert!(other > 2.0 * noise, "light from elsewhere: rms {other}");
    // Depth has no noise: the mesh has not moved.
    let again = read_capture(&dir.path().join("first")).expect("a capture");
    let again = PassImages::read(&again.frames[0]).expect("passes").depth.expect("depth");
    let depth = written.depth.expect("depth");
    let both: Vec<(f32, f32)> = depth.into_iter().zip(again).filter(|(a, b)| *a > 0.0 && *b > 0.0).collect();
    let worst = both.iter().fold(0.0_f32, |m, (a, b)| if (a - b).abs() > m { (a - b).abs() } else { m });
    println!("depth of {} pixels: worst difference {worst:e}", both.len());
    assert!(both.len() > 300 && worst < 2e-5, "{} pixels, {worst}", both.len());
}

/// A point of the world from a pixel's depth, by the formulas of the two camera models in f64.
fn unprojected(frame: &Frame, pose: &[[f64; 4]], px: [f64; 2], z: f64) -> [f64; 3] {
    let [w, h] = frame.size.expect("a size");
    let [fx, fy, cx, cy] = frame.intrinsics(w, h).expect("intrinsics");
    let m = [(px[0] - cx) / fx, (px[1] - cy) / fy];
    let local = match frame.lens {
        Lens::Fisheye { .. } => {
            let theta = libm::hypot(m[0], m[1]);
            // z = r cos θ, and x² + y² = r² sin² θ
            let ratio = if theta > 0.0 { libm::tan(theta) / theta } else { 1.0 };
            [m[0] * ratio * z, m[1] * ratio * z, z]
        }
        _ => [m[0] * z, m[1] * z, z],
    };
    let d: [f64; 3] = std::array::from_fn(|i| local[i] - pose[i][3]);
    std::array::from_fn(|k| pose[0][k] * d[0] + pose[1][k] * d[1] + pose[2][k] * d[2])
}

/// View-from-world of the OpenGL matrix under a key of `transforms*.json`.
fn recorded(frame: &Value, key: &str) -> [[f64; 4]; 3] {
    let m = |i: usize, j: usize| frame[key][i][j].as_f64().expect("a matrix");
    std::array::from_fn(|i| {
        let sign = if i == 0 { 1.0 } else { -1.0 };
        let row: [f64; 3] = std::array::from_fn(|k| sign * m(k, i));
        [row[0], row[1], row[2], -(row[0] * m(0, 3) + row[1] * m(1, 3) + row[2] * m(2, 3))]
    })
}

/// The egocentric set of one camera model, with its object.
fn egocentric(dir: &Path, camera: Model, size: usize) -> (Settings, Capture, Subject) {
    let settings = Settings { set: Set::Egocentric, camera, views: 9, size, ..small() };
    make(dir, &settings, false);
    let capture = read_capture(&dir.join("object_00000/environment")).expect("a capture");
    let subject = Subject::new(&settings, 0).expect("the object");
    (settings, capture, subject)
}

#[test]
fn passes_of_a_moving_camera_fit_the_recorded_pose() {
    for camera in [Model::Fisheye, Model::Pinhole] {
        let dir = tempfile::tempdir().expect("a folder");
        let (_, capture, subject) = egocentric(dir.path(), camera, 96);
        let name = camera.name();
        assert_eq!(record(&dir.path().join("object_00000"))["settings"]["camera"], name, "{name}: recorded");
        let fov: f64 = if camera == Model::Fisheye { 130.0 } else { 70.0 };
        let half = 0.5 * fov.to_radians();
        let focal = 48.0 / if camera == Model::Fisheye { half } else { libm::tan(half) };
        let surface = Surface::new(&subject.object.mesh.positions, &subject.object.mesh.triangles);
        let mut poses = Vec::new();
        for file in ["transforms_train.json", "transforms_test.json"] {
            let text = std::fs::read(dir.path().join("object_00000/environment").join(file)).expect("there");
            let top: Value = serde_json::from_slice(&text).expect("JSON");
            poses.extend(top["frames"].as_array().expect("frames").iter().cloned());
        }
        let (mut worst, mut count, mut opening) = (0.0_f64, 0, 0.0);
        for frame in &capture.frames {
            assert_eq!(
                matches!(frame.lens, Lens::Fisheye { .. }),
                camera == Model::Fisheye,
                "{name}: the lens of {}",
                frame.name
            );
            let [fx, fy, cx, cy] = frame.intrinsics(96, 96).expect("intrinsics");
            let off = (fx - focal).abs() + (fy - focal).abs() + (cx - 48.0).abs() + (cy - 48.0).abs();
            assert!(off < 1e-4, "{name}: {fov} degrees are a focal length of {focal}, not {fx}, {fy}");
            let said = poses.iter().find(|p| p["file_path"].as_str() == Some(&frame.name));
            let open = recorded(said.expect("a frame of that name"), "transform_matrix_open");
            let p = PassImages::read(frame).expect("passes");
            let (depth, normal) = (p.depth.expect("depth"), p.normal.expect("normals"));
            let mut lone = 0;
            for (i, z) in depth.iter().enumerate() {
                // A normal is a mean over the pixel, depth belongs to its middle: they differ at borders.
                lone += usize::from((*z > 0.0) != (normal[i] != [0.0; 3]));
                if *z > 0.0 {
                    let px = [(i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5];
                    let away = |pose: &[[f64; 4]]| {
                        surface.nearest(unprojected(frame, pose, px, f64::from(*z))).0.sqrt()
                    };
                    let d = away(&frame.view_from_world);
                    worst = if d > worst { d } else { worst };
                    opening += away(&open);
                    count += 1;
                }
            }
            assert!(lone < 200, "{name}, {}: {lone} pixels have a normal or a depth alone", frame.name);
        }
        let opening = opening / f64::from(count);
        println!(
            "{name}: {count} pixels, at most {worst:.1e} off the mesh; from the opening pose {opening:.1e}"
        );
        assert!(count > 2000, "{name}: the object is seen in {count} pixels");
        assert!(worst < 2e-5, "{name}: a point lies {worst} off the mesh");
        assert!(opening > 1e-3, "{name}: the camera moved, so another pose does not fit: {opening}");
    }
}

#[test]
fn the_photograph_is_blurred_and_noisy_and_the_radiance_is_clean() {
    let dir = tempfile::tempdir().expect("a folder");
    let (settings, capture, subject) = egocentric(dir.path(), Model::Pinhole, 192);
    let bvh = Bvh::build(&subject.object.mesh.positions, &subject.object.mesh.triangles);
    let lights = Lights::default();
    let scene = Scene::new(&subject.object, &bvh, &lights).expect("a scene");
    let shots = capture_shots(&dir.path().join("object_00000/environment"), 1).expect("cameras");
    let (mut between, mut between_still) = (0, 0);
    let (mut sum, mut square, mut count, mut steps, mut values) = (0.0, 0.0, 0.0, 0, 0);
    let fraction = |a: &[f32]| a.iter().filter(|a| **a > 0.0 && **a < 1.0).count();
    for frame in &capture.frames {
        let p = PassImages::read(frame).expect("passes");
        let (radiance, exposure) = (p.radiance.expect("radiance"), p.exposure.expect("an exposure") as f32);
        let photograph = bytes(&frame.image);
        assert_ne!(photograph, tonemap::srgb_u8(&radiance, exposure), "{}: the sensor is seen", frame.name);
        // What the sensor adds has the variance of photons and electronics, where it neither saturates nor
        // clips.
        let full_well = f64::from(Sensor::default().full_well);
        let read = f64::from(Sensor::default().read_noise);
        for (x, byte) in radiance.as_flattened().iter().zip(&photograph) {
            let x = f64::from(x * exposure);
            values += 1;
            steps += usize::from((x * 1023.0 - (x * 1023.0).round()).abs() < 1e-3);
            if (0.1..0.85).contains(&x) {
                let level = |b: u8| f64::from(linear_of_srgb()[usize::from(b)]);
                let seen = level(*byte);
                let step = level(byte + 1) - seen;
                let variance = (x * full_well + read * read) / (full_well * full_well)
                    + step * step / 12.0
                    + 1.0 / (12.0 * 1023.0 * 1023.0);
                let z = (seen - x) / variance.sqrt();
                (sum, square, count) = (sum + z, square + z * z, count + 1.0);
            }
        }
        between += fraction(&p.foreground.expect("foreground"));
        // The same camera at rest.
        let stem = Path::new(&frame.name).file_stem().expect("a name").to_string_lossy().into_owned();
        let camera: &Camera = &shots.iter().find(|s| s.name.ends_with(&stem)).expect("its camera").camera;
        let tracing = Tracing { samples: settings.samples, bounces: 0, seed: 1, ..Tracing::default() };
        between_still += fraction(&render(&scene, camera, None, &tracing).expect("rendered").alpha);
    }
    let (mean, variance) = (sum / count, square / count);
    println!("{count} values: noise has mean {mean:.3}, variance {variance:.3} of what a sensor's is");
    println!("{between} pixels partly covered, {between_still} of a camera at rest");
    assert!(count > 5000.0, "{count} values were compared");
    assert!(mean.abs() < 0.1 && (variance - 1.0).abs() < 0.1, "mean {mean}, variance {variance}");
    assert!((steps as f64) < 0.05 * f64::from(values), "{steps} of {values} values are levels of the sensor");
    assert!(between as f64 > 1.15 * between_still as f64, "{between} pixels partly covered, {between_still}");
    let held = capture.frames.iter().filter(|f| f.split == Split::Test).count();
    assert_eq!((capture.frames.len(), held), (9, 1), "every eighth is held out");
}

#[test]
fn a_projection_without_rays_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let settings = Settings { set: Set::Egocentric, camera: Model::Orthographic, ..small() };
    let e = run(&dir.path().join("x"), &settings, false, &AtomicBool::new(false), &mut |_, _, _| {});
    let text = e.expect_err("no such camera").to_string();
    assert!(text.contains("fisheye or pinhole"), "{text}");
    assert!(!dir.path().join("x").exists(), "nothing was made");
    // Other sets are pinhole images, whatever a head would carry.
    let record =
        Settings { set: Set::Train, camera: Model::Fisheye, ..small() }.record().expect("no files to read");
    assert_eq!(record["camera"], json!("pinhole"), "as it states");
}
