//! Captures: every layout leads to the same cameras, lenses are undone, and a real capture loads.

use crate::{common, samples};
use lastlight::io::capture::{Dialect, Focal, Lens, Split, read_capture};
use lastlight::io::{colmap, colmap_text, image_file, transforms};
use lastlight::scene::camera::Model;
use lastlight::scene::lens::{Undistort, undistort};
use lastlight::scene::views::{Options, Views};

/// Writes files into a new folder; names may have folders.
pub(crate) fn folder(files: &[(&str, Vec<u8>)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        let path = dir.path().join(name);
        std::fs::create_dir_all(path.parent().expect("inside")).expect("a folder");
        std::fs::write(path, bytes).expect("a file");
    }
    dir
}

pub(crate) fn with_images<'a>(
    mut files: Vec<(&'a str, Vec<u8>)>,
    names: &[&'a str],
) -> Vec<(&'a str, Vec<u8>)> {
    files.extend(names.iter().map(|n| (*n, samples::png(16, 12, 3))));
    files
}

pub(crate) const NINE: [&str; 9] = [
    "images/0000.png",
    "images/0001.png",
    "images/0002.png",
    "images/0003.png",
    "images/0004.png",
    "images/0005.png",
    "images/0006.png",
    "images/0007.png",
    "images/0008.png",
];

pub(crate) const OPENCV: [f64; 8] = [20.0, 21.0, 8.0, 6.0, 0.01, 0.02, 0.003, 0.004];

fn orthonormal(m: &[[f64; 4]; 4]) -> f64 {
    let mut worst = 0.0;
    for i in 0..3 {
        for j in 0..3 {
            let dot = m[i][0] * m[j][0] + m[i][1] * m[j][1] + m[i][2] * m[j][2];
            let off = (dot - f64::from(u8::from(i == j))).abs();
            if off > worst {
                worst = off;
            }
        }
    }
    worst
}

#[test]
fn colmap_binary_and_text_agree() {
    let binary = with_images(
        vec![
            ("sparse/0/cameras.bin", samples::cameras_bin(4, &OPENCV)),
            ("sparse/0/images.bin", samples::images_bin(9)),
            ("sparse/0/points3D.bin", samples::points_bin()),
        ],
        &NINE,
    );
    let text = with_images(
        vec![
            ("sparse/cameras.txt", samples::cameras_txt("OPENCV", "20 21 8 6 0.01 0.02 0.003 0.004")),
            ("sparse/images.txt", samples::images_txt(9)),
            ("sparse/points3D.txt", samples::points_txt()),
        ],
        &NINE,
    );
    let (a, b) = (folder(&binary), folder(&text));
    let (x, y) = (read_capture(a.path()).expect("binary"), read_capture(b.path()).expect("text"));
    assert_eq!((x.dialect, y.dialect), (Dialect::ColmapBinary, Dialect::ColmapText), "dialects");
    assert_eq!(x.points, y.points, "points");
    assert_eq!(x.points.as_ref().map(|p| p.rgb[1]), Some([11, 20, 30]), "colour");
    assert_eq!(x.frames.len(), 9, "frames");
    for (f, g) in x.frames.iter().zip(&y.frames) {
        assert_eq!((&f.name, f.view_from_world, f.lens), (&g.name, g.view_from_world, g.lens), "frame");
        assert_eq!((f.focal, f.center, f.size), (g.focal, g.center, g.size), "camera");
    }
    assert_eq!(x.frames[3].view_from_world[2], [0.0, 0.0, 1.0, 3.0], "the quaternion is normalised");
    // The model folder itself is a capture too.
    assert_eq!(
        read_capture(&a.path().join("sparse/0")).expect("the model").frames.len(),
        9,
        "images two levels up"
    );
}

#[test]
fn colmap_models_by_id_and_name() {
    let k = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
    let perspective =
        |numerator, denominator, tangential| Lens::Perspective { numerator, denominator, tangential };
    let cases: [(i32, &str, Vec<f64>, Lens); 9] = [
        (0, "SIMPLE_PINHOLE", vec![20.0, 8.0, 6.0], Lens::PINHOLE),
        (1, "PINHOLE", vec![20.0, 21.0, 8.0, 6.0], Lens::PINHOLE),
        (
            2,
            "SIMPLE_RADIAL",
            vec![20.0, 8.0, 6.0, 0.1],
            perspective([0.1, 0.0, 0.0, 0.0], [0.0; 3], [0.0; 2]),
        ),
        (3, "RADIAL", vec![20.0, 8.0, 6.0, 0.1, 0.2], perspective([0.1, 0.2, 0.0, 0.0], [0.0; 3], [0.0; 2])),
        (
            4,
            "OPENCV",
            [&[20.0, 21.0, 8.0, 6.0], &k[..4]].concat(),
            perspective([0.1, 0.2, 0.0, 0.0], [0.0; 3], [0.3, 0.4]),
        ),
        (
            5,
            "OPENCV_FISHEYE",
            [&[20.0, 21.0, 8.0, 6.0], &k[..4]].concat(),
            Lens::Fisheye { k: [0.1, 0.2, 0.3, 0.4] },
        ),
        (
            6,
            "FULL_OPENCV",
            [&[20.0, 21.0, 8.0, 6.0], &k[..]].concat(),
            perspective([0.1, 0.2, 0.5, 0.0], [0.6, 0.7, 0.8], [0.3, 0.4]),
        ),
        (8, "SIMPLE_RADIAL_FISHEYE", vec![20.0, 8.0, 6.0, 0.1], Lens::Fisheye { k: [0.1, 0.0, 0.0, 0.0] }),
        (9, "RADIAL_FISHEYE", vec![20.0, 8.0, 6.0, 0.1, 0.2], Lens::Fisheye { k: [0.1, 0.2, 0.0, 0.0] }),
    ];
    for (id, name, params, lens) in cases {
        let a = colmap::parse_cameras(&samples::cameras_bin(id, &params), "cameras.bin").expect(name);
        let words: Vec<String> = params.iter().map(f64::to_string).collect();
        let b = colmap_text::parse_cameras(&samples::cameras_txt(name, &words.join(" ")), "cameras.txt")
            .expect(name);
        assert_eq!(a, b, "{name}");
        assert_eq!((a[&7].lens, a[&7].center), (lens, [8.0, 6.0]), "{name}");
    }
    for (id, count) in [(7, 5), (10, 12), (11, 16), (12, 4), (-1, 4)] {
        let e = colmap::parse_cameras(&samples::cameras_bin(id, &vec![1.0; count]), "cameras.bin")
            .expect_err("unsupported");
        assert!(e.to_string().starts_with("cameras.bin: camera 0"), "{e}");
    }
}

#[test]
fn transforms_dialects() {
    let pose = samples::pose(0);
    // NeRF-synthetic: a folder of three files, no extensions, one angle of view.
    let file = |split: &str, n: usize| {
        let frames: Vec<String> = (0..n)
            .map(|i| format!(r#"{{"file_path":"./{split}/r_{i}","transform_matrix":{pose}}}"#))
            .collect();
        format!(r#"{{"camera_angle_x":1.0,"frames":[{}]}}"#, frames.join(",")).into_bytes()
    };
    let dir = folder(&with_images(
        vec![
            ("transforms_train.json", file("train", 2)),
            ("transforms_val.json", file("val", 1)),
            ("transforms_test.json", file("test", 1)),
        ],
        &["train/r_0.png", "train/r_1.png", "val/r_0.png", "test/r_0.png"],
    ));
    let c = read_capture(dir.path()).expect("three files");
    assert_eq!(c.dialect, Dialect::NerfSynthetic, "dialect");
    let splits: Vec<_> = c.frames.iter().map(|f| (f.name.as_str(), f.split)).collect();
    let expected = [
        ("test/r_0", Split::Test),
        ("train/r_0", Split::Train),
        ("train/r_1", Split::Train),
        ("val/r_0", Split::Val),
    ];
    assert_eq!(splits, expected, "ordered by name");
    let [fx, fy, cx, cy] = c.frames[0].intrinsics(16, 12).expect("no size declared");
    assert!(
        (fx - 8.0 / libm::tan(0.5)).abs() < 1e-12 && fx == fy && (cx, cy) == (8.0, 6.0),
        "from the angle"
    );
    let v = Views::load(dir.path(), &Options::default()).expect("views");
    assert_eq!((v.train, v.test, v.views.len()), (vec![1, 2], vec![0], 3), "the split of the files");

    // nerfstudio: per-frame cameras, mask, points, Windows paths in another case.
    let json = format!(
        r#"{{"camera_model":"OPENCV_FISHEYE","w":16,"h":12,"k1":0.5,"ply_file_path":"sparse_pc.ply","applied_transform":[[1,0,0,0]],
        "frames":[{{"file_path":".\\Images\\A.PNG","mask_path":"masks\\a.png","fl_x":9,"fl_y":10,"cx":7,"cy":5,"k1":0.25,
        "transform_matrix":{pose}}},{{"file_path":"images/b","fl_x":11,"transform_matrix":{pose}}}]}}"#
    );
    let dir = folder(&with_images(
        vec![("transforms.json", json.into_bytes()), ("sparse_pc.ply", samples::ply_ascii())],
        &["images/a.png", "masks/a.png", "images/b.jpeg"],
    ));
    let c = read_capture(&dir.path().join("transforms.json")).expect("nerfstudio");
    assert_eq!(c.dialect, Dialect::Nerfstudio, "dialect");
    let f = &c.frames[0];
    assert_eq!((f.focal, f.center), (Focal::Pixels([9.0, 10.0]), Some([7.0, 5.0])), "the frame wins");
    assert_eq!(f.lens, Lens::Fisheye { k: [0.25, 0.0, 0.0, 0.0] }, "its own lens");
    assert!(
        f.image.ends_with("images/a.png") && f.mask.as_ref().is_some_and(|m| m.ends_with("masks/a.png")),
        "found"
    );
    assert_eq!(c.frames[1].focal, Focal::Pixels([11.0, 11.0]), "one focal length");
    assert_eq!(c.points.expect("points").xyz.len(), 2, "points");

    // Axes: OpenGL looks along −z with y up, ours along +z with y down.
    let t = transforms::parse(&samples::transforms(3), "t.json").expect("valid");
    assert_eq!(t.dialect, Dialect::InstantNgp, "dialect");
    let m = t.frames[2].view_from_world;
    assert_eq!(m[1][1], -1.0, "y");
    assert_eq!(m[2], [0.0, 0.0, -1.0, 2.0], "z");
}

#[test]
fn transforms_refuse_what_they_cannot_do() {
    let pose = samples::pose(0);
    let frame = |extra: &str| format!(r#"{{"fl_x":20,"w":16,"h":12{extra}"#);
    let plain = format!(r#""frames":[{{"file_path":"a.png","transform_matrix":{pose}}}]}}"#);
    let scaled = pose.replace('1', "2");
    let cases = [
        (format!("{},{plain}", frame(r#","camera_model":"EQUIRECTANGULAR""#)), "camera_model"),
        (format!("{},{plain}", frame(r#","latlong":true"#)), "latlong"),
        (format!("{},{plain}", frame(r#","ftheta_p1":0.1"#)), "ftheta_p1"),
        (format!("{},{plain}", frame(r#","rolling_shutter":[0,0,0.1]"#)), "rolling_shutter"),
        (format!("{},{plain}", frame(r#","camera_model":"PINHOLE","k1":0.1"#)), "camera_model"),
        (format!("{},{plain}", frame(r#","cx":3"#)), "cx"),
        (format!("{},{plain}", frame(r#","fl_y":-1"#)), "fl_y"),
        (format!("{},{}", frame(""), plain.replace("a.png", "../a.png")), "frames[0].file_path"),
        (format!("{},{}", frame(""), plain.replace("a.png", "/etc/passwd")), "frames[0].file_path"),
        (format!("{},{}", frame(""), plain.replace(&pose, &scaled)), "frames[0].transform_matrix"),
        (format!("{},{}", frame(""), plain.replace("[0,1,0,0]", "[0,1,0]")), "transform_matrix[1]"),
        (format!("{},{}", frame(""), plain.replace("[0,1,0,0]", "[0,null,0,0]")), "transform_matrix[1][1]"),
        (r#"{"w":16,"h":12,"frames":3}"#.to_owned(), "frames"),
        (format!(r#"{{"w":16,{plain}"#), "fl_x"),
        ("{\n\"fl_x\": 1e999}".to_owned(), "line 2"),
    ];
    for (json, place) in cases {
        let e = transforms::parse(json.as_bytes(), "t.json").expect_err(place).to_string();
        assert!(e.starts_with("t.json: ") && e.contains(place), "{place}: {e}");
    }
    // Deep nesting is an error, not the end of the stack.
    let deep = "[".repeat(1_000_000);
    assert!(transforms::parse(deep.as_bytes(), "t.json").is_err(), "bounded depth");
}

#[test]
fn views_split_mask_scale_and_composite() {
    // Two transparent columns at the left; a mask that removes the lowest row.
    let mut rgba = samples::pixels(16, 12, 4);
    for (i, p) in rgba.chunks_exact_mut(4).enumerate() {
        p[3] = if i % 16 < 2 { 0 } else { 255 };
    }
    let mask: Vec<u8> = (0..16 * 12).map(|i| if i / 16 == 11 { 0 } else { 255 }).collect();
    let mut files = vec![
        ("sparse/0/cameras.bin", samples::cameras_bin(1, &OPENCV[..4])),
        ("sparse/0/images.bin", samples::images_bin(9)),
        ("masks/0003.png", image_file::png_bytes(16, 12, 1, &mask).expect("a mask")),
    ];
    files.extend(NINE.iter().map(|n| (*n, image_file::png_bytes(16, 12, 4, &rgba).expect("an image"))));
    let dir = folder(&files);
    let v = Views::load(dir.path(), &Options { background: [1.0, 0.0, 0.5], ..Options::default() })
        .expect("views");
    assert_eq!((v.test.clone(), v.train.len()), (vec![0, 8], 7), "index mod 8");
    assert_eq!(v.views[0].rgb[..3], [255, 0, 128], "background behind the transparent");
    assert_eq!(v.views[0].rgb[6..9], rgba[8..11], "the rest as it was");
    assert!(v.views[0].mask.is_none(), "nothing masked");
    let m = v.views[3].mask.as_ref().expect("a mask");
    assert_eq!((m[10 * 16], m[11 * 16]), (1, 0), "the lowest row");
    // Training cameras at z = −1 … −7, mean −4: extent 1.1 · 3. Axes are parallel.
    assert!((v.extent - 3.3).abs() < 1e-12, "{}", v.extent);
    assert_eq!(v.scene_box.center[..2], [0.0, 0.0], "in front of the mean centre");

    let half = Views::load(dir.path(), &Options { downscale: 2, ..Options::default() }).expect("views");
    let camera = &half.views[3].camera;
    assert_eq!(
        (camera.width, camera.height, camera.focal_px, camera.center_px),
        (8, 6, [10.0, 10.5], [4.0, 3.0]),
        "scaled"
    );
    let sum = |x: usize, y: usize| u32::from(rgba[4 * (y * 16 + x)]);
    let mean = (sum(4, 2) + sum(5, 2) + sum(4, 3) + sum(5, 3)) as f32 / 4.0;
    assert!((f32::from(half.views[3].rgb[3 * (8 + 2)]) - mean).abs() <= 0.5, "mean of four pixels");
    assert_eq!(
        half.views[3].mask.as_ref().map(|m| (m[4 * 8], m[5 * 8])),
        Some((1, 0)),
        "all of the block must count"
    );
    // Threads decide who loads, not what.
    let one =
        lastlight::num::par::with_threads(1, || Views::load(dir.path(), &Options::default()).expect("views"));
    let three =
        lastlight::num::par::with_threads(3, || Views::load(dir.path(), &Options::default()).expect("views"));
    assert_eq!(one.expect("a pool"), three.expect("a pool"), "any number of threads");
}

#[test]
fn the_box_is_where_the_axes_meet() {
    // Four cameras around (1, 2, 3) at distance 5, looking at it.
    let frames: Vec<String> = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]
        .iter()
        .enumerate()
        .map(|(i, &(x, y))| {
            // OpenGL: the backward axis points from the target to the camera.
            format!(
                r#"{{"file_path":"images/000{i}.png","transform_matrix":[[{},0,{x},{}],[{x},0,{y},{}],[0,1,0,3],[0,0,0,1]]}}"#,
                -y,
                1.0 + 5.0 * x,
                2.0 + 5.0 * y
            )
        })
        .collect();
    let json = format!(r#"{{"fl_x":20,"frames":[{}]}}"#, frames.join(","));
    let dir = folder(&with_images(vec![("transforms.json", json.into_bytes())], &NINE[..4]));
    let v = Views::load(dir.path(), &Options::default()).expect("views");
    for (got, want) in v.scene_box.center.iter().zip([1.0, 2.0, 3.0]) {
        assert!((got - want).abs() < 1e-12, "{:?}", v.scene_box);
    }
    assert!((v.scene_box.half_size - 5.0).abs() < 1e-12, "{:?}", v.scene_box);
    assert_eq!(v.test, [0], "the first is held out");
}

/// A smooth pattern at a distorted position, so that bilinear interpolation is the only error.
fn pattern(x: f64, y: f64) -> f64 {
    0.5 + 0.25 * libm::sin(9.0 * x) + 0.2 * libm::cos(7.0 * y + 2.0 * x)
}

/// Solves place(x, y) = target by fixed-point iteration: a distorted photo of a pattern on the ideal plane.
fn invert(u: &Undistort, tx: f64, ty: f64) -> Option<[f64; 2]> {
    let (mut x, mut y) = (tx, ty);
    for _ in 0..200 {
        let [a, b] = u.place(x, y)?;
        x += tx - a;
        y += ty - b;
    }
    let [a, b] = u.place(x, y)?;
    ((a - tx).abs() + (b - ty).abs() < 1e-12).then_some([x, y])
}

#[test]
fn undistortion_matches_the_closed_form() {
    let (w, h) = (160usize, 120usize);
    let k = [140.0, 150.0, 83.0, 57.5];
    let lenses = [
        Lens::Perspective {
            numerator: [0.08, -0.05, 0.0, 0.0],
            denominator: [0.0; 3],
            tangential: [-1e-3, 2e-3],
        },
        Lens::Perspective {
            numerator: [-0.25, 0.05, 0.01, 0.002],
            denominator: [0.02, 0.01, 0.0],
            tangential: [1e-3, 1e-3],
        },
        Lens::Fisheye { k: [0.05, -0.02, 0.004, -0.001] },
        Lens::Fisheye { k: [-0.06, 0.01, 0.0, 0.0] },
    ];
    for lens in lenses {
        let u = Undistort::new(lens, 2.0);
        // The photo: the pattern of the ideal position seen at every distorted pixel.
        let mut photo = vec![0.0f32; w * h * 3];
        for i in 0..w * h {
            let (x, y) = (((i % w) as f64 + 0.5 - k[2]) / k[0], ((i / w) as f64 + 0.5 - k[3]) / k[1]);
            let [x, y] = invert(&u, x, y).expect("a mild lens");
            photo[3 * i..3 * i + 3].fill(pattern(x, y) as f32);
        }
        let r = undistort(&photo, None, w, h, k, lens);
        let (mut worst, mut kept) = (0.0, 0);
        for i in (0..w * h).filter(|&i| r.mask[i] == 1) {
            let (x, y) = (((i % w) as f64 + 0.5 - k[2]) / k[0], ((i / w) as f64 + 0.5 - k[3]) / k[1]);
            let off = (f64::from(r.rgb[3 * i]) - pattern(x, y)).abs();
            worst = if off > worst { off } else { worst };
            kept += 1;
            let [xd, yd] = u.place(x, y).expect("kept");
            let (sx, sy) = (xd * k[0] + k[2], yd * k[1] + k[3]);
            assert!(
                sx >= 0.5 && sy >= 0.5 && sx <= w as f64 - 0.5 && sy <= h as f64 - 0.5,
                "inside the photo"
            );
        }
        println!("{lens:?}: worst {worst:.2e}, kept {kept} of {}", w * h);
        // Bilinear interpolation of a pattern with second derivatives up to 25/140² per pixel².
        assert!(worst < 4e-4, "{lens:?}: {worst}");
        assert!(kept > w * h * 8 / 10, "{lens:?}: kept {kept}");
        assert!(
            r.rgb.chunks(3).zip(&r.mask).all(|(p, &m)| m == 1 || p == [0.0; 3]),
            "nothing where nothing is"
        );
    }
}

#[test]
fn undistorting_with_a_user_mask_or_past_the_fold() {
    let (w, h) = (20, 10);
    let lens =
        Lens::Perspective { numerator: [-0.5, 0.0, 0.0, 0.0], denominator: [0.0; 3], tangential: [0.0; 2] };
    // r(1 − r²/2) stops growing at r = √(2/3).
    let u = Undistort::new(lens, 2.0);
    assert!(u.place(0.8, 0.0).is_some() && u.place(0.83, 0.0).is_none(), "the fold");
    let photo = vec![0.5f32; w * h * 3];
    let mask: Vec<u8> = (0..w * h).map(|i| u8::from(i % w != 10)).collect();
    let r = undistort(&photo, Some(&mask), w, h, [10.0, 10.0, 10.0, 5.0], lens);
    assert!(r.mask.iter().enumerate().all(|(i, &m)| i % w != 10 || m == 0), "masked pixels stay out");
    assert!(r.mask.contains(&1), "others stay");
}

#[test]
fn a_fisheye_view_stays_a_fisheye() {
    let dir = folder(&with_images(
        vec![
            ("sparse/0/cameras.bin", samples::cameras_bin(5, &[20.0, 21.0, 8.0, 6.0, 0.1, 0.0, 0.0, 0.0])),
            ("sparse/0/images.bin", samples::images_bin(1)),
        ],
        &NINE[..1],
    ));
    let v = Views::load(dir.path(), &Options::default()).expect("views");
    assert_eq!(v.views[0].camera.model, Model::Fisheye, "equidistant");
    assert_eq!((v.train, v.test), (vec![0], vec![]), "a single view is fitted and not held out");
}

#[test]
fn broken_captures_name_the_file() {
    let empty = folder(&[]);
    let e = read_capture(empty.path()).expect_err("nothing").to_string();
    assert!(e.contains("transforms.json") && e.contains("cameras.bin"), "{e}");
    let mut files = with_images(vec![("transforms.json", samples::transforms(3))], &NINE[..2]);
    files.push(("images/0002.png", samples::png(16, 16, 3)));
    let e = Views::load(folder(&files).path(), &Options::default()).expect_err("another size").to_string();
    assert!(e.contains("0002.png") && e.contains("16x12") && e.contains("16x16"), "{e}");
    let camera = with_images(
        vec![
            ("cameras.txt", samples::cameras_txt("PINHOLE", "20 21 8 6")),
            ("images.txt", b"1 1 0 0 0 0 0 0 9 0000.png\n\n".to_vec()),
        ],
        &NINE[..1],
    );
    let e = read_capture(folder(&camera).path()).expect_err("no such camera").to_string();
    assert!(e.contains("images.txt: image 1") && e.contains("9"), "{e}");
}

#[test]
fn the_fox_loads() {
    let Some(fox) = common::real_data("capture/fox") else { return };
    let c = read_capture(&fox).expect("readable");
    assert_eq!((c.frames.len(), c.dialect), (50, Dialect::InstantNgp), "frames");
    let worst =
        c.frames.iter().map(|f| orthonormal(&f.view_from_world)).fold(0.0, |a, b| if b > a { b } else { a });
    assert!(worst < 1e-14, "orthonormal to {worst:e}");
    let v = Views::load(&fox, &Options::default()).expect("views");
    assert_eq!((v.views.len(), v.test.len(), v.train.len()), (50, 7, 43), "split");
    let mut least = 1.0;
    for view in &v.views {
        assert_eq!(
            (view.camera.width, view.camera.height, view.rgb.len()),
            (270, 480, 270 * 480 * 3),
            "size"
        );
        let m = view.mask.as_ref().expect("the lens moves some pixels outside");
        let share = m.iter().filter(|&&x| x == 1).count() as f64 / m.len() as f64;
        least = if share < least { share } else { least };
    }
    println!(
        "fox: rotations orthonormal to {worst:.1e}, at least {:.2} % of every view kept, extent {:.4}, box {:?}",
        100.0 * least,
        v.extent,
        v.scene_box
    );
    assert!(least > 0.95, "{least}");
    assert_eq!(v.views[8].name, "images/0012.png", "ordered by name");
    assert!(v.points.is_none(), "no points in this capture");
}
