//! Importers of published layouts, each on a miniature with the files, names and keys of that layout: the
//! result is the one layout of persons, with the poses, cameras and pixels of the source. HDF5 files were
//! written by h5py (`tests/samples/hdf5/make.py`); the other files are made here.

mod layouts;
mod snapshot;

use crate::mini_person::{B, K, Mini, PERSON, V, V3, apart, pairs};
use crate::person_layouts::{self, Truth};
use lastlight::io::captures::{self, Layout, Selection};
use lastlight::io::smpl::{self, BodyModel};
use lastlight::last::inspect;
use lastlight::scene::bound::project;
use lastlight::scene::person::{PersonCapture, import};
use lastlight::{Error, Result};
use std::path::Path;
use std::sync::atomic::AtomicBool;

fn convert(
    layout: Layout,
    dir: &Path,
    selection: &Selection,
    model: Option<&BodyModel>,
    out: &Path,
) -> Result<import::Report> {
    let source = captures::read(layout, dir, selection, None)?;
    import::write(&source, model, None, out, &AtomicBool::new(false), &mut |_, _| {})
}

fn error(result: Result<import::Report>) -> String {
    result.map(|r| r.moments).expect_err("it is refused").to_string()
}

/// Imports a miniature and compares it with the truth.
fn check(
    layout: Layout,
    dir: &Path,
    selection: &Selection,
    model: Option<&BodyModel>,
    truth: &Truth,
) -> PersonCapture {
    let out = tempfile::tempdir().expect("a temporary folder");
    let name = layout.name();
    assert_eq!(Layout::detect(dir), Some(layout), "{name} is recognised");
    let report = convert(layout, dir, selection, model, out.path()).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!([report.joints, report.points], truth.body, "{name}: the body");
    assert!(!report.notes.iter().any(|n| n.contains("is this the body model")), "{name}: {:?}", report.notes);
    let c = PersonCapture::open(out.path()).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!(report.shots, [c.train.len(), c.test.len()], "{name}: images");
    let (mut worst_point, mut worst_pixel) = (0.0f64, 0.0f64);
    for (t, number) in c.numbers.iter().enumerate() {
        let expected: Vec<V3> = truth.points[number].iter().map(|&x| (truth.world)(x)).collect();
        let d = apart(&c.posed_points(t), &expected);
        worst_point = if d > worst_point { d } else { worst_point };
    }
    for shot in &c.shots {
        let (cam, points) = (&truth.cameras[&shot.camera_id], &truth.points[&c.numbers[shot.time]]);
        let side = truth.side / truth.scale;
        assert_eq!((shot.camera.width, shot.camera.height), (side, side), "{name}: size");
        let photo = shot.photo().unwrap_or_else(|e| panic!("{name}: {e}"));
        let (mut on, mut inside) = (0, 0);
        for &x in points {
            let got = project(&shot.camera, (truth.world)(x)).expect("before the camera");
            let want = cam.ideal(x).map(|u| u / truth.scale as f64);
            for i in 0..2 {
                let d = (got[i] - want[i]).abs();
                worst_pixel = if d > worst_pixel { d } else { worst_pixel };
            }
            let [u, v] = want.map(|u| u.floor() as isize);
            if (1..side as isize - 1).contains(&u) && (1..side as isize - 1).contains(&v) {
                inside += 1;
                on += usize::from(photo.mask[v as usize * side + u as usize] >= 0.5);
            }
        }
        assert!(
            inside > truth.body[1] / 2 && 20 * on >= 19 * inside,
            "{name}: {}: {on} of {inside} points on the mask",
            shot.name
        );
        let covered = photo.mask.iter().filter(|m| **m >= 0.5).count();
        assert!(covered > 8 && covered < side * side * 4 / 5, "{name}: {covered} pixels of a person");
        let mut bright = 0;
        for (i, px) in photo.rgb.as_chunks::<3>().0.iter().enumerate() {
            // The background is green; the person is not.
            assert!(
                px[1] <= px[0].saturating_add(100),
                "{name}: {}: the background shows at {i}: {px:?}",
                shot.name
            );
            let near = px.iter().zip(PERSON).all(|(a, b)| a.abs_diff(b) < 24);
            bright += usize::from(near);
            if truth.scale == 1 && photo.mask[i] < 0.5 {
                assert_eq!(*px, [0; 3], "{name}: black outside the mask");
            }
        }
        assert!(
            2 * bright > covered,
            "{name}: {}: {bright} of {covered} pixels have the person's colour",
            shot.name
        );
        let bound = c.box_mask(shot);
        assert!(bound.contains(&0.0) || side <= 16, "{name}: the box is not everything");
    }
    println!("{name}: points {worst_point:.1e}, pixels {worst_pixel:.1e}");
    assert!(worst_point < 1e-6, "{name}: points within rounding of f32: {worst_point:e}");
    assert!(worst_pixel < 2e-6, "{name}: pixels within rounding of f32: {worst_pixel:e}");
    let looked = inspect::inspect(out.path(), 4).expect("examined");
    assert!(
        looked.is_usable(),
        "{name}: {:?}",
        looked.problems.iter().map(Error::to_string).collect::<Vec<_>>()
    );
    assert!(looked.images.iter().all(|l| l.on_mask > 0.9), "{name}: poses, cameras and masks agree");
    c
}

#[test]
fn bodies_from_pickle_archive_and_folder_are_the_same() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mini = Mini::new();
    let at = |n: &str| dir.path().join(n);
    std::fs::write(at("body.pkl"), mini.pickle()).expect("written");
    // Further arrays of SMPL-X files are ignored.
    let mut arrays = mini.arrays();
    arrays.put("lmk_faces_idx", &[3], vec![1i64, 2, 3]);
    lastlight::io::npz::write(&at("body.npz"), &arrays).expect("written");
    mini.misc(&at("misc"));
    let a = smpl::read(&at("body.pkl"), "neutral").expect("a pickle of Python 2");
    assert_eq!(a, smpl::read(&at("body.npz"), "neutral").expect("an archive"), "the same model");
    assert_eq!((a.template.len(), a.joints(), a.shape_count), (V, K, B), "sizes");
    let folder = smpl::read(&at("misc"), "neutral").expect("a folder");
    assert_eq!(
        (&folder.weights, &folder.regressor),
        (&a.weights, &a.regressor),
        "the same weights and joints"
    );
    assert_eq!(folder.parents, a.parents, "SMPL's tree");
    assert!(smpl::read(&at("misc"), "male").is_err(), "a gender that is not there");
    for (change, part) in [
        ("weights", "(V, K)"),
        ("v_template", "[48, 3]"),
        ("J_regressor", "[24, 48]"),
        ("posedirs", "[48, 3, 207]"),
        ("kintree_table", "[2, 24]"),
        ("f", "below 48"),
    ] {
        let mut bad = mini.arrays();
        bad.put(change, &[2, 2, 2], vec![1e6f64; 8]);
        let e = smpl::from_arrays(&bad).expect_err(change).to_string();
        assert!(e.contains(change) && e.contains(part), "{e}");
    }
    let mut cycle = mini.arrays();
    let mut tree = vec![0i64; 2 * K];
    tree[3] = 5;
    cycle.put("kintree_table", &[2, K], tree);
    assert!(
        smpl::from_arrays(&cycle).expect_err("a cycle").to_string().contains("before it"),
        "parents come first"
    );
    std::fs::write(at("evil.pkl"), b"cos\nsystem\n(S'touch evil'\ntR.").expect("written");
    let e = smpl::read(&at("evil.pkl"), "neutral").expect_err("refused").to_string();
    assert!(e.contains("evil.pkl") && e.contains("os.system"), "{e}");
}

#[test]
fn splits_of_the_pictures_are_those_of_the_protocols() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    // Six cameras, eleven frames: every fifth of camera 4 trains, every thirtieth of the others tests.
    let truth = person_layouts::zju(dir.path(), true, 6, 11);
    let c =
        check(Layout::ZjuRefine, dir.path(), &Selection::default(), Some(&person_layouts::model()), &truth);
    assert_eq!(pairs(&c, &c.train), [(4, 0), (4, 5), (4, 10)], "training");
    assert_eq!(pairs(&c, &c.test), [(0, 0), (1, 0), (2, 0), (3, 0), (5, 0)], "held out");
    assert_eq!(c.box_margin, 0.05, "the margin of the box in metres");
    let frames = |text: &str| captures::Range::parse(text);
    assert!(
        frames("0:0:3").is_err() && frames("1:2").is_err() && frames("a:1:1").is_err(),
        "ranges are checked"
    );
    assert_eq!(frames("1:3:2").expect("a range").frames(10), [1, 4], "start, step, count");
    assert_eq!(frames("1:3:99").expect("a range").frames(8), [1, 4, 7], "as far as there are frames");
}

#[test]
fn wrong_and_missing_files_are_named() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let model = person_layouts::model();
    let none = Selection::default();
    let both = layouts::both();
    person_layouts::zju(dir.path(), false, 2, 3);
    let out = tempfile::tempdir().expect("a temporary folder");
    let go = |selection: &Selection, model| convert(Layout::Zju, dir.path(), selection, model, out.path());
    let e = error(go(&both, None));
    assert!(e.contains("body model") && e.contains("--body"), "{e}");
    let mut small = model.clone();
    small.parents.truncate(23);
    let e = error(go(&both, Some(&small)));
    assert!(e.contains("24 joints") && e.contains("23"), "{e}");
    let e = error(go(&Selection { train_cameras: Some(vec![7]), ..none.clone() }, Some(&model)));
    assert!(e.contains("camera 7") && e.contains("2 cameras"), "{e}");
    let at = |n: &str| dir.path().join(n);
    let spoil = |file: &str, bytes: &[u8], parts: &[&str]| {
        let kept = std::fs::read(at(file)).expect("there");
        std::fs::write(at(file), bytes).expect("written");
        let e = error(go(&both, Some(&model)));
        parts.iter().for_each(|p| assert!(e.contains(p), "{file}: '{p}' in '{e}'"));
        let left = crate::common::tree(out.path()).into_keys().collect::<Vec<_>>();
        assert!(left.is_empty(), "{file}: a refused data set leaves no files: {left:?}");
        std::fs::write(at(file), kept).expect("written");
    };
    let png = |side: usize| {
        lastlight::io::image_file::png_bytes(side, side, 1, &vec![1; side * side]).expect("made")
    };
    spoil("mask_cihp/Camera_B1/000001.png", &png(16), &["mask size", "32x32", "16x16"]);
    spoil("annots.npy", b"\x93NUMPY\x01\x00\x0a\x00{'descr'", &["annots.npy"]);
    spoil(
        "new_params/1.npy",
        &person_layouts::params(&[0.0; 72], [0.0; 3], [f64::NAN; 3]),
        &["1.npy", "Th", "NaN"],
    );
    spoil(
        "new_params/1.npy",
        &person_layouts::params(&[0.0; 70], [0.0; 3], [0.0; 3]),
        &["1.npy", "three numbers per joint"],
    );
    spoil("Camera_B1/000001.jpg", b"\xff\xd8\xffnothing", &["000001.jpg"]);
    let mut evil = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    evil.extend(format!("{:<117}\n", "{'descr': '|O', 'fortran_order': False, 'shape': (), }").bytes());
    evil.extend(b"cposix\nsystem\n(S'touch evil'\ntR.");
    spoil("new_params/1.npy", &evil, &["1.npy", "posix.system"]);
    std::fs::remove_file(at("Camera_B1/000002.jpg")).expect("removed");
    let e = error(go(&both, Some(&model)));
    assert!(e.contains("Camera_B1/000002.jpg") && e.contains("not there"), "{e}");
    let e = error(convert(Layout::Arah, dir.path(), &none, None, out.path()));
    assert!(e.contains("cam_params.json"), "{e}");
    let e = error(convert(Layout::Dna, &at("nothing"), &none, None, out.path()));
    assert!(e.contains("no such folder"), "{e}");
    assert_eq!(Layout::detect(&at("Camera_B1")), None, "images alone are no layout");
}
