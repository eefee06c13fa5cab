//! An object in memory has the pixels of the same object on disk; turning, lighting and shrinking it.

use super::ball;
use lastlight::fit::field::place::Pose;
use lastlight::fit::field::targets::{Picture, Pictures, target};
use lastlight::lirm::r#gen::{self as set, Lighting, Settings, Version};
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::transformer::Input;
use lastlight::lirm::views::{View, Views};
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::field::Placement;
use lastlight::scene::views::{Masks, Options};
use std::path::Path;
use std::sync::atomic::AtomicBool;

fn settings() -> Settings {
    Settings {
        lighting: Lighting::Both,
        shiny: true,
        views: 3,
        size: 32,
        samples: 4,
        texture: 64,
        map_width: 32,
        first: 5,
        ..Settings::default()
    }
}

/// Compares one version of object 5 in memory with the same version on disk.
fn assert_same_in_memory(settings: &Settings, root: &Path, version: Version) {
    let options = Options { background: [1.0; 3], masks: Masks::Ignore, ..Options::default() };
    let made = Views::rendered(settings, 5, version).expect("an object");
    let folder = root.join("object_00005").join(version.name());
    let read = Pictures::load(&folder, &options, None).expect("a capture");
    let placement = Placement::new([0.0; 3], 1.0);
    let read = Views::of_capture(&read, &[0, 1, 2], placement).expect("in range");
    assert_eq!(made.all.len(), read.all.len(), "{version:?}");
    for (a, b) in made.all.iter().zip(&read.all) {
        let (p, q) = (&a.picture, &b.picture);
        assert_eq!(
            (&p.color, &p.foreground, &p.colored),
            (&q.color, &q.foreground, &q.colored),
            "{version:?}"
        );
        assert_eq!((&p.passes, &a.photo), (&q.passes, &b.photo), "{version:?}");
        let poses = p.camera.rotation.iter().flatten().zip(q.camera.rotation.iter().flatten());
        let centers = p.camera.center().into_iter().zip(q.camera.center());
        for (x, y) in poses.map(|(x, y)| (*x, *y)).chain(centers) {
            assert!((x - y).abs() < 2e-6, "poses pass through text: {x} {y}");
        }
    }
}

#[test]
fn an_object_in_memory_has_the_pixels_of_its_files() {
    let dir = tempfile::tempdir().expect("a folder");
    set::run(dir.path(), &settings(), false, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a set");
    for version in Version::ALL {
        assert_same_in_memory(&settings(), dir.path(), version);
    }
}

#[test]
fn a_moving_head_camera_has_the_same_noise_and_poses_in_memory() {
    let dir = tempfile::tempdir().expect("a folder");
    let head =
        Settings { set: set::Set::Egocentric, lighting: Lighting::Uniform, shiny: false, ..settings() };
    set::run(dir.path(), &head, false, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a set");
    assert_same_in_memory(&head, dir.path(), Version::Uniform);
}

#[test]
fn a_turned_object_looks_the_same_from_turned_cameras() {
    let made = Views::rendered(&settings(), 5, Version::Uniform).expect("an object");
    let turned = made.clone().turned(0.7);
    let (sin, cos) = (libm::sin(0.7) as f32, libm::cos(0.7) as f32);
    let turn = |[x, y, z]: [f32; 3]| [cos * x - sin * y, sin * x + cos * y, z];
    for (a, b) in made.all.iter().zip(&turned.all) {
        assert_eq!(a.picture.color, b.picture.color, "the image is the same");
        let near = |x: [f32; 3], y: [f32; 3]| x.iter().zip(y).all(|(x, y)| (x - y).abs() < 1e-5);
        assert!(near(turn(a.picture.camera.center()), b.picture.camera.center()), "the camera goes around");
        let at = [3.5, 20.5];
        let ray = |v: &lastlight::lirm::views::View| v.picture.camera.ray(at).expect("a pinhole").1;
        assert!(near(turn(ray(a)), ray(b)), "and looks the same way at the object");
        let normals = |v: &lastlight::lirm::views::View| v.picture.passes.normal.clone().expect("a pass");
        assert!(normals(a).iter().zip(normals(b)).all(|(m, n)| near(turn(*m), n)), "normals too");
    }
}

#[test]
fn factors_of_colours_leave_the_background_and_small_images_are_means() {
    let made = Views::rendered(&settings(), 5, Version::Uniform).expect("an object");
    let factors = [0.5, 0.25, 0.125];
    let dark = made.clone().lit(factors);
    for (a, b) in made.all.iter().zip(&dark.all) {
        let pixels = a.picture.color.as_chunks::<3>().0.iter().zip(b.picture.color.as_chunks::<3>().0);
        for ((x, y), m) in pixels.zip(&a.picture.foreground) {
            for c in 0..3 {
                let expected = factors[c] * (x[c] - (1.0 - m)) + (1.0 - m);
                assert!((y[c] - expected).abs() < 1e-6, "{x:?} {y:?} {m}");
            }
        }
        let albedo = |v: &lastlight::lirm::views::View| v.picture.passes.albedo.clone().expect("a pass");
        let is_tinted = |(x, y): (&[f32; 3], [f32; 3])| {
            (0..3).all(|c| (y[c] - x[c] * factors[c] / factors[0]).abs() < 1e-6)
        };
        assert!(albedo(a).iter().zip(albedo(b)).all(is_tinted), "albedo has the tint but not the brightness");
    }
    let small = made.small(4).expect("32 is a multiple of 4");
    let p = &small.all[1].picture;
    assert_eq!((p.camera.width, p.color.len(), p.passes.width), (8, 8 * 8 * 3, 8));
    let block = (0..16).map(|i| made.all[1].picture.foreground[(4 + i / 4) * 32 + 8 + i % 4]);
    assert_eq!(p.foreground[8 + 2], block.fold(0.0, |s, x| s + x) / 16.0, "a mean over a block");
    let ray = |v: &Views, at: [f32; 2]| v.all[1].picture.camera.ray(at).expect("a pinhole");
    let (coarse, fine) = (ray(&small, [2.0, 5.0]), ray(&made, [8.0, 20.0]));
    assert!(coarse.1.iter().zip(fine.1).all(|(a, b)| (a - b).abs() < 1e-6), "the same ray");
    assert!(made.small(5).is_err(), "not a whole number of blocks");
}

#[test]
fn turned_axes_of_a_field_are_those_of_a_turned_object() {
    let made = Views::rendered(&settings(), 5, Version::Uniform).expect("an object");
    let turned = made.clone().turned(0.7);
    let (sin, cos) = (libm::sin(0.7), libm::cos(0.7));
    let rotation = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]];
    let at = Placement { rotation, ..made.placement };
    let whole = Config { is_whole: true, ..Config::SMALL };
    for (i, view) in made.all.iter().enumerate() {
        let (a, b) = (Input::of(view, &at, &whole), Input::of(&turned.all[i], &made.placement, &whole));
        assert_eq!((&a.image, &a.photo), (&b.image, &b.photo));
        assert!(a.rays.iter().zip(&b.rays).all(|(x, y)| (x - y).abs() < 2e-6), "rays");
        let (a, b) = (target(&view.picture, &at), turned.target(i));
        let near = |a: &Option<Vec<f32>>, b: &Option<Vec<f32>>| {
            let (a, b) = (a.as_ref().expect("a pass"), b.as_ref().expect("a pass"));
            a.iter().zip(b).all(|(x, y)| (x - y).abs() < 2e-6)
        };
        assert!(near(&a.normal, &b.normal) && a.solid == b.solid && a.depth == b.depth, "passes");
    }
}

#[test]
fn axes_by_the_first_camera_do_not_depend_on_those_of_the_world() {
    let made = Views::rendered(&settings(), 5, Version::Uniform).expect("an object");
    let turned = made.clone().turned(2.3);
    for (config, pose) in [
        (Config::PAPER, Pose::Azimuth),
        (Config::SMALL, Pose::Azimuth),
        (Config::SMALL, Pose::Upright),
        (Config::SMALL, Pose::FirstCamera),
    ] {
        let [a, b] = [&made, &turned].map(|v| v.posed(pose, &[1, 0, 2]).expect("they agree"));
        for (x, y) in made.all.iter().zip(&turned.all) {
            let (x, y) = (Input::of(x, &a, &config), Input::of(y, &b, &config));
            assert!(x.rays.iter().zip(&y.rays).all(|(x, y)| (x - y).abs() < 5e-6), "{}", pose.name());
        }
        let eye = a.to_field(made.all[1].picture.camera.center().map(f64::from));
        let is_above_x = eye[0] > 0.0 && eye[1].abs() < 1e-5;
        assert_eq!(is_above_x, pose != Pose::FirstCamera, "{}: {eye:?}", pose.name());
    }
    let same = made.posed(Pose::World, &[0]).expect("nothing to find");
    assert_eq!(same, made.placement);
}

/// A white image of 40x24 pixels with a dark rectangle, seen by a camera.
fn rectangle(camera: Model, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> View {
    let (width, height) = (40, 24);
    let camera = Camera {
        focal_px: [30.0, 31.0],
        center_px: [19.0, 12.5],
        width,
        height,
        model: camera,
        translation: [0.1, -0.2, 2.0],
        ..ball::camera(0, 8)
    };
    let is_inside = |i: usize| columns.contains(&(i % width)) && rows.contains(&(i / width));
    let foreground: Vec<f32> = (0..width * height).map(|i| f32::from(u8::from(is_inside(i)))).collect();
    let color: Vec<f32> = foreground.iter().flat_map(|m| [1.0 - 0.75 * m, 1.0 - 0.5 * m, 1.0]).collect();
    let picture = Picture { camera, color: color.clone(), foreground, ..ball::picture(0, 8) };
    View { picture, photo: color.iter().map(|x| 0.5 * x).collect() }
}

#[test]
fn a_crop_is_the_square_around_the_object_with_the_rays_of_its_pixels() {
    for model in [Model::Pinhole, Model::Fisheye] {
        // 12 columns and 6 rows, a window of 12x12 whose corner is (10, 5).
        let view = rectangle(model, 10..22, 8..14);
        let whole = Views { all: vec![view.clone()], placement: Placement::default() };
        for side in [8, 12, 24] {
            let cropped = &whole.cropped(side).all[0];
            let camera = &cropped.picture.camera;
            assert_eq!((camera.width, camera.height), (side, side));
            let factor = 12.0 / side as f32;
            for at in [[0.0, 0.0], [3.5, 7.25], [side as f32, 1.0]] {
                let before = [10.0 + factor * at[0], 5.0 + factor * at[1]];
                let [(o, d), (p, e)] =
                    [camera.ray(at), view.picture.camera.ray(before)].map(|ray| ray.expect("a ray"));
                let near = o.iter().zip(p).chain(d.iter().zip(e)).all(|(x, y)| (x - y).abs() < 1e-5);
                assert!(near, "{model:?} {side} {at:?}: {o:?} {d:?} {p:?} {e:?}");
            }
            let total = |x: &[f32]| x.iter().fold(0.0, |sum, x| sum + f64::from(*x));
            let area = f64::from(factor * factor) * total(&cropped.picture.foreground);
            assert!((area - 72.0).abs() < 1e-3, "{side}: the foreground has 12x6 pixels, {area}");
        }
        let same = &whole.cropped(12).all[0];
        let row = |x: &[f32]| x[3 * (6 * 12 + 4)..][..3].to_vec();
        assert_eq!(row(&same.picture.color), [0.25, 0.5, 1.0], "a pixel of the object");
        assert_eq!(row(&same.photo), [0.125, 0.25, 0.5], "and of the photo");
    }
    // Higher than the image is wide apart: 30 columns are more than the 24 rows, so white is above and below.
    let view = rectangle(Model::Pinhole, 5..35, 2..20);
    let cropped = Views { all: vec![view], placement: Placement::default() }.cropped(30);
    let picture = &cropped.all[0].picture;
    let center = [19.0 - 5.0, 12.5 + 4.0];
    assert_eq!(picture.camera.center_px, center, "rows −4 to 25");
    assert!(picture.color[..3 * 30 * 4].iter().all(|x| *x == 1.0), "rows outside of the image are white");
    // An object at the edge: the window is moved into the image.
    let view = rectangle(Model::Pinhole, 36..40, 0..10);
    let cropped = Views { all: vec![view], placement: Placement::default() }.cropped(10);
    assert_eq!(cropped.all[0].picture.camera.center_px, [19.0 - 30.0, 12.5]);
}
