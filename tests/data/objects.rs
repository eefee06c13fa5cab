//! Published captures of one object: miniatures of a sphere, in which cameras, depth, normals and light must agree.

use crate::ball_layouts::{CENTER, Camera, RADIUS, SIDE, Vector, array, dot, dtc, encoded, exr, orb};
use lastlight::io::capture::{Capture, Frame, read_capture};
use lastlight::io::image_file::{self, Encoding};
use lastlight::io::objects::{self, Axes};
use lastlight::scene::environment_file::{Options as EnvOptions, Orientation, read as read_map};
use lastlight::scene::object::{self, Options, Report};
use lastlight::scene::passes::PassImages;
use lastlight::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

fn import(from: &Path, to: &Path, options: &Options) -> Result<Report> {
    std::fs::create_dir_all(to).expect("made");
    object::write(&objects::read(from)?, options, to, &AtomicBool::new(false), &mut |_, _| ())
}

/// Fails unless depth and normals of a frame are those of the sphere, in the camera of the frame.
fn is_sphere(frame: &Frame) -> PassImages {
    let passes = PassImages::read(frame).expect("passes");
    let [fx, fy, cx, cy] = frame.intrinsics(passes.width, passes.height).expect("a size");
    let v = &frame.view_from_world;
    let (z, n) = (passes.depth.as_ref().expect("depth"), passes.normal.as_ref().expect("normals"));
    let mut seen = 0;
    for i in (0..z.len()).filter(|i| z[*i] > 0.0) {
        let d = f64::from(z[i]);
        let x = ((i % passes.width) as f64 + 0.5 - cx) / fx * d;
        let y = ((i / passes.width) as f64 + 0.5 - cy) / fy * d;
        let own = [x - v[0][3], y - v[1][3], d - v[2][3]];
        // R^T (x - t)
        let p: Vector = std::array::from_fn(|k| (0..3).fold(0.0, |s, a| s + v[a][k] * own[a]));
        let r: Vector = std::array::from_fn(|k| p[k] - CENTER[k]);
        assert!((dot(r, r).sqrt() - RADIUS).abs() < 1e-5, "pixel {i} at {p:?}");
        for k in 0..3 {
            assert!((f64::from(n[i][k]) - r[k] / RADIUS).abs() < 1e-5, "normal of pixel {i}");
        }
        seen += 1;
    }
    assert!(seen > 40, "the sphere is seen: {seen} pixels");
    let covered = passes.foreground.as_ref().expect("a foreground").iter().filter(|m| **m == 1.0).count();
    assert_eq!(seen, covered, "depth where the mask is");
    passes
}

fn frame<'a>(capture: &'a Capture, name: &str) -> &'a Frame {
    capture.frames.iter().find(|f| f.name.contains(name)).unwrap_or_else(|| panic!("no frame {name}"))
}

#[test]
fn a_miniature_of_stanford_orb_has_its_geometry_and_light() {
    let dir = tempfile::tempdir().expect("a folder");
    let (from, to) = (orb(dir.path()), dir.path().join("out"));
    let report = import(&from, &to, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((report.images, report.size, report.scan), ([3, 1, 0, 1], [SIDE; 2], true));
    let capture = read_capture(&to).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(capture.frames.len(), 4, "training and held-out images");
    let held_out = frame(&capture, "test_0003");
    let passes = is_sphere(held_out);
    // A known point projects to its pixel: the point of the sphere that the middle of a pixel sees.
    let c = Camera::at(3);
    let [fx, fy, cx, cy] = held_out.intrinsics(SIDE, SIDE).expect("a size");
    for p in (0..SIDE * SIDE).filter(|p| c.hit(*p).is_some()) {
        let (z, d) = (c.hit(p).expect("seen").0, c.ray(p));
        let x: Vector = std::array::from_fn(|k| c.eye[k] + z * d[k]);
        let v = &held_out.view_from_world;
        let own: Vector =
            std::array::from_fn(|i| ((v[i][0] * x[0] + v[i][1] * x[1]) + v[i][2] * x[2]) + v[i][3]);
        let at = [fx * own[0] / own[2] + cx, fy * own[1] / own[2] + cy];
        let middle = [(p % SIDE) as f64 + 0.5, (p / SIDE) as f64 + 0.5];
        assert!(
            (at[0] - middle[0]).abs() < 1e-9 && (at[1] - middle[1]).abs() < 1e-9,
            "{at:?} and {middle:?}"
        );
        assert!((own[2] - z).abs() < 1e-12, "depth is along the axis");
    }
    let pixel =
        (0..SIDE * SIDE).find(|p| c.hit(*p).is_some_and(|(_, n)| dot(n, c.axes[2]) > 0.9)).expect("in front");
    assert!(passes.depth.as_ref().expect("depth")[pixel] > 0.0);
    let radiance = passes.radiance.as_ref().expect("radiance");
    assert_eq!(radiance[pixel], c.radiance(pixel), "linear values are kept");
    let albedo = passes.albedo.as_ref().expect("albedo")[0];
    assert!((albedo[0] - 0.6).abs() < 3e-3 && (albedo[2] - 0.2).abs() < 3e-3, "{albedo:?}");
    let photo = image_file::read(&held_out.image).expect("a photo");
    assert_eq!(photo.encoding, Encoding::Srgb);
    assert!((photo.value(3 * pixel) - encoded(c.radiance(pixel)[0])).abs() < 3e-3, "LDR photos are taken");
    // Light: in the axes of the world, in our orientation.
    let novel = read_capture(&to.join("transforms_novel.json")).unwrap_or_else(|e| panic!("{e}"));
    for (list, name) in [(&capture, "test_0003"), (&novel, "ball_scene002_0004")] {
        let path = frame(list, name).passes.environment.as_ref().expect("a map");
        let map = read_map(path, &EnvOptions::default()).expect("a map");
        for row in 4..map.height - 4 {
            for column in 0..map.width {
                let u = (column as f64 + 0.5) / map.width as f64;
                let theta = (row as f64 + 0.5) / map.height as f64 * std::f64::consts::PI;
                let phi = (u - 0.5) * 2.0 * std::f64::consts::PI;
                let d =
                    [libm::sin(theta) * libm::sin(phi), libm::sin(theta) * libm::cos(phi), libm::cos(theta)];
                let got = map.radiance[row * map.width + column];
                for k in 0..3 {
                    let off = (f64::from(got[k]) - 2.0 - d[k]).abs();
                    assert!(off < 0.06, "{name}: row {row}, column {column}: {got:?} for {d:?}");
                }
            }
        }
    }
    // The scan keeps the coordinates of the world.
    let scan = lastlight::scene::model::read(&to.join("scan.glb")).expect("a mesh");
    let mut points = scan.mesh.positions.clone();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    assert_eq!(points, [[0.0, 0.0, 1.0], [0.0, 2.0, 1.0], [1.0, 0.0, 1.0]]);
    // Conventions are options: a map of another program is not turned by the camera.
    let other = dir.path().join("other");
    let options = Options { probe: Some(Orientation::Mitsuba), ..Options::default() };
    import(&from, &other, &options).unwrap_or_else(|e| panic!("{e}"));
    let turned = std::fs::read(other.join("environment/test_0003.exr")).expect("a map");
    assert!(turned != std::fs::read(to.join("environment/test_0003.exr")).expect("a map"));
    // Without LDR images the photo is made of the radiance.
    std::fs::remove_dir_all(dir.path().join("blender_LDR")).expect("removed");
    let from = dir.path().join("blender_HDR/ball_scene001");
    let alone = dir.path().join("alone");
    import(&from, &alone, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    let again = image_file::read(&alone.join("images/test_0003.png")).expect("a photo");
    assert!((again.value(3 * pixel) - encoded(c.radiance(pixel)[0])).abs() < 3e-3);
}

#[test]
fn a_miniature_of_dtc_renders_has_its_geometry_and_exposures() {
    let dir = tempfile::tempdir().expect("a folder");
    let (from, to) = (dtc(dir.path()), dir.path().join("out"));
    let report = import(&from, &to, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((report.images, report.size, report.scan), ([0, 0, 4, 0], [SIDE; 2], false));
    let capture = read_capture(&to).unwrap_or_else(|e| panic!("{e}"));
    for (i, f) in capture.frames.iter().enumerate() {
        let passes = is_sphere(f);
        assert_eq!(passes.exposure, Some(0.5 * (i + 1) as f64));
        let (metallic, roughness) =
            (passes.metallic.expect("metallic"), passes.roughness.expect("roughness"));
        assert!((metallic[0] - 0.2).abs() < 3e-3 && (roughness[0] - 0.6).abs() < 3e-3);
    }
    // Reduced by 2: cameras keep their rays, and depth is a mean of neighbours.
    let half = dir.path().join("half");
    let report = import(&from, &half, &Options { downscale: Some(2), ..Options::default() });
    assert_eq!(report.unwrap_or_else(|e| panic!("{e}")).size, [SIDE / 2; 2]);
    let small = read_capture(&half).expect("a capture");
    let (a, b) = (frame(&capture, "0000002"), frame(&small, "0000002"));
    let (ka, kb) =
        (a.intrinsics(SIDE, SIDE).expect("a size"), b.intrinsics(SIDE / 2, SIDE / 2).expect("a size"));
    assert!(ka.iter().zip(kb).all(|(a, b)| (a - 2.0 * b).abs() < 1e-9), "{ka:?} and {kb:?}");
    let (za, zb) = (PassImages::read(a).expect("passes").depth, PassImages::read(b).expect("passes").depth);
    let (za, zb) = (za.expect("depth"), zb.expect("depth"));
    let at = |r: usize, c: usize| za[r * SIDE + c];
    let middle = SIDE / 4;
    let four = [
        at(2 * middle, 2 * middle),
        at(2 * middle, 2 * middle + 1),
        at(2 * middle + 1, 2 * middle),
        at(2 * middle + 1, 2 * middle + 1),
    ];
    let mean = four.iter().fold(0.0, |s, z| s + z) / 4.0;
    assert!(four.iter().all(|z| *z > 0.0) && (zb[middle * SIDE / 2 + middle] - mean).abs() < 1e-6);
    assert!(
        import(&from, &half, &Options { downscale: Some(5), ..Options::default() }).is_err(),
        "24 is no multiple of 5"
    );
}

/// A part of the message, and what is done to the set.
type Damage<'a> = (&'a str, &'a dyn Fn(&Path));

/// Damages a set, and gives the message of its refusal; no file is left.
fn refused(make: fn(&Path) -> PathBuf, damage: &dyn Fn(&Path)) -> String {
    let dir = tempfile::tempdir().expect("a folder");
    let (from, to) = (make(dir.path()), dir.path().join("out"));
    damage(dir.path());
    let e: Error = import(&from, &to, &Options::default()).expect_err("damaged");
    assert_eq!(e.exit_code(), 2, "{e}");
    let left: Vec<_> = std::fs::read_dir(&to).expect("a folder").collect();
    assert!(left.is_empty(), "{e}: {left:?}");
    e.to_string()
}

fn edit(path: &Path, change: impl Fn(&mut Value)) {
    let mut value = serde_json::from_slice(&std::fs::read(path).expect("read")).expect("JSON");
    change(&mut value);
    std::fs::write(path, value.to_string()).expect("written");
}

#[test]
fn what_is_missing_or_does_not_agree_is_named() {
    let rig = |d: &Path| d.join("ball/images/CameraRig.json");
    let rgb = |d: &Path, file: &str| d.join("ball/images/rgb").join(file);
    let gone = |p: PathBuf| std::fs::remove_file(p).expect("removed");
    let bad: [Damage<'_>; 13] = [
        ("mask0000002.png", &|d| gone(rgb(d, "mask0000002.png"))),
        ("rgb0000001.png", &|d| gone(rgb(d, "rgb0000001.png"))),
        ("rgb0000004.png", &|d| drop(std::fs::copy(rgb(d, "rgb0000000.png"), rgb(d, "rgb0000004.png")))),
        ("no number in row 1, column 2", &|d| edit(&rig(d), |v| v["to_world"][1][1][2] = Value::Null)),
        ("to_world[0]: expected a rigid", &|d| edit(&rig(d), |v| v["to_world"][0][0][0] = json!(7.0))),
        ("to_world[3]: expected a rigid", &|d| edit(&rig(d), |v| v["to_world"][3] = json!([[1.0]]))),
        ("a last row", &|d| edit(&rig(d), |v| v["to_world"][2][3][0] = json!(0.5))),
        ("intrinsic.fov", &|d| edit(&rig(d), |v| v["intrinsic"]["fov"] = json!(180.0))),
        ("intrinsic.width", &|d| edit(&rig(d), |v| v["intrinsic"]["width"] = json!(1e9))),
        ("as the list declares", &|d| edit(&rig(d), |v| v["intrinsic"]["height"] = json!(SIDE + 1))),
        ("4 numbers, one per camera", &|d| {
            edit(&d.join("ball/images/image_process_info.json"), |v| {
                v["rgb"]["autoexposure_scale"] = json!([1.0])
            })
        }),
        ("as the mask", &|d| exr(&rgb(d, "depth0000003.exr"), [SIDE, 8], &["Z"], |_| vec![1.0])),
        ("--normals", &|d| {
            let c = Camera::at(1);
            exr(&rgb(d, "normal0000001.exr"), [SIDE; 2], &["R", "G", "B"], |p| {
                c.hit(p).map_or(vec![0.0; 3], |(_, n)| n.map(|x| -x as f32).to_vec())
            });
        }),
    ];
    for (part, damage) in bad {
        let text = refused(dtc, damage);
        assert!(text.contains(part), "'{part}' in {text}");
    }
    let list = |d: &Path, n: &str| d.join("blender_LDR/ball_scene001").join(n);
    let bad: [Damage<'_>; 8] = [
        ("frames[0].scene_name", &|d| {
            edit(&list(d, "transforms_novel.json"), |v| v["frames"][0]["scene_name"] = json!("../../etc"));
        }),
        ("frames[0].scene_name", &|d| {
            edit(&list(d, "transforms_novel.json"), |v| {
                drop(v["frames"][0].as_object_mut().map(|f| f.remove("scene_name")))
            });
        }),
        ("transforms_test.json", &|d| gone(list(d, "transforms_test.json"))),
        ("train/0001.png", &|d| {
            gone(list(d, "train/0001.png"));
            gone(d.join("blender_HDR/ball_scene001/train/0001.exr"));
        }),
        ("transform_matrix", &|d| {
            edit(&list(d, "transforms_train.json"), |v| {
                v["frames"][2]["transform_matrix"][0][3] = Value::Null
            });
        }),
        ("two entries", &|d| {
            edit(&list(d, "transforms_train.json"), |v| v["frames"][1]["file_path"] = json!("train/0000"));
        }),
        ("shape", &|d| {
            array(&d.join("ground_truth/ball_scene001/surface_normal/0003.npy"), 1, |_| vec![1.0])
        }),
        ("a number from -2 to 2", &|d| {
            array(&d.join("ground_truth/ball_scene001/surface_normal/0003.npy"), 3, |_| vec![f32::NAN; 3]);
        }),
    ];
    for (part, damage) in bad {
        let text = refused(orb, damage);
        assert!(text.contains(part), "'{part}' in {text}");
    }
    // Normals of the layout's other axes are refused, and read when they are named.
    let dir = tempfile::tempdir().expect("a folder");
    let from = dtc(dir.path());
    let options = Options { normals: Some(Axes::Camera), ..Options::default() };
    assert!(import(&from, &dir.path().join("out"), &options).is_err(), "they do not face the camera");
    assert!(objects::read(&dir.path().join("nowhere")).is_err() && objects::read(dir.path()).is_err());
}

#[test]
fn a_list_cut_anywhere_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    for path in [dtc(dir.path()).join("images/CameraRig.json"), orb(dir.path()).join("transforms_test.json")]
    {
        let whole = std::fs::read(&path).expect("read");
        let from =
            if path.ends_with("CameraRig.json") { dir.path().join("ball") } else { path.with_file_name("") };
        for end in (0..whole.len()).step_by(7) {
            std::fs::write(&path, &whole[..end]).expect("written");
            let e = objects::read(&from).expect_err("a part of a list");
            assert!(
                e.to_string().contains(path.file_name().and_then(|n| n.to_str()).expect("a name")),
                "{e}"
            );
        }
        std::fs::write(&path, &whole).expect("written");
        objects::read(&from).unwrap_or_else(|e| panic!("{e}"));
    }
}
