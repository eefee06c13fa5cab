//! Images with passes: written, interrupted, continued, and read back.

use crate::common::{assert_same, tree};
use lastlight::fit::passes::{PassSet, Recorder, Shot, Style, Verified};
use lastlight::io::capture::{Split, read_capture};
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::passes::PassImages;
use lastlight::scene::views::{Options, Views};
use lastlight::shade::render::Passes;
use serde_json::{Map, json};
use std::path::Path;

const SIDE: usize = 6;

fn camera(shift: f32) -> Camera {
    let m = [1.0, 0.0, 0.0, shift, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0];
    Camera::from_matrices(&m, &[9.0, 0.0, 3.0, 0.0, 9.0, 3.0, 0.0, 0.0, 1.0], SIDE, SIDE, Model::Pinhole)
}

/// Numbers that tell pixels and channels apart, with a background, a half-covered pixel and bright radiance.
fn passes(seed: usize) -> Passes {
    let n = SIDE * SIDE;
    let value = |i: usize, c: usize| ((7 * i + 13 * c + 5 * seed) % 64) as f32 / 64.0;
    let hit = |i: usize| !i.is_multiple_of(5);
    let only = |i: usize, x: f32| if hit(i) { x } else { 0.0 };
    Passes {
        width: SIDE,
        height: SIDE,
        color: (0..n).map(|i| [0, 1, 2].map(|c| 3.0 * value(i, c))).collect(),
        alpha: (0..n).map(|i| only(i, if i == 7 { 0.5 } else { 1.0 })).collect(),
        depth_z: (0..n).map(|i| only(i, 1.0 + value(i, 3))).collect(),
        normal: (0..n).map(|i| [0.6, 0.0, -0.8].map(|x| only(i, x))).collect(),
        albedo: (0..n).map(|i| [0, 1, 2].map(|c| only(i, value(i, c)))).collect(),
        roughness: (0..n).map(|i| only(i, value(i, 4))).collect(),
        metallic: (0..n).map(|i| only(i, value(i, 5))).collect(),
    }
}

fn shots() -> Vec<Shot> {
    let shot = |i: usize, split| Shot {
        name: format!("{i:03}"),
        camera: camera(0.1 * i as f32),
        shutter_close: (i == 1).then(|| camera(0.3)),
        split,
        extra: [("time".to_owned(), json!(i))].into_iter().collect(),
    };
    vec![shot(0, Split::Train), shot(1, Split::Train), shot(2, Split::Test)]
}

fn style(i: usize) -> Style {
    Style { exposure: 0.5 + 0.25 * i as f32, transparent: i == 2, passes: PassSet::ALL }
}

fn header(seed: u64) -> Map<String, serde_json::Value> {
    [("seed".to_owned(), json!(seed)), ("scale".to_owned(), json!(0.1))].into_iter().collect()
}

fn write_all(dir: &Path) -> u64 {
    let mut r = Recorder::open(dir, header(1), false).expect("a new set");
    for (i, shot) in shots().iter().enumerate() {
        r.put(shot, &passes(i), &style(i)).expect("written");
    }
    r.finish(&shots()).expect("finished")
}

#[test]
fn what_was_written_is_read_back() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_all(dir.path());
    let capture = read_capture(dir.path()).expect("a capture");
    assert_eq!(capture.frames.len(), 3, "every image");
    for (i, frame) in capture.frames.iter().enumerate() {
        let (p, want) = (PassImages::read(frame).expect("its passes"), passes(i));
        assert_eq!(frame.split, shots()[i].split, "image {i}: split");
        assert_eq!(p.radiance.expect("radiance"), want.color, "image {i}: radiance to the bit");
        assert_eq!(p.depth.expect("depth"), want.depth_z, "image {i}: depth to the bit");
        assert_eq!(p.normal.expect("normal"), want.normal, "image {i}: normals to the bit");
        assert_eq!(p.exposure, Some(f64::from(style(i).exposure)), "image {i}: exposure");
        let near = |a: f32, b: f32| (a - b).abs() <= 0.5 / 255.0 + 1e-6;
        for k in 0..SIDE * SIDE {
            assert!(
                near(p.foreground.as_ref().expect("foreground")[k], want.alpha[k]),
                "image {i}, pixel {k}"
            );
            assert!(
                near(p.metallic.as_ref().expect("material")[k], want.metallic[k]),
                "image {i}, pixel {k}"
            );
            assert!(
                near(p.roughness.as_ref().expect("material")[k], want.roughness[k]),
                "image {i}, pixel {k}"
            );
            for c in 0..3 {
                let byte = (255.0 * p.albedo.as_ref().expect("albedo")[k][c]).round() as usize;
                let linear = lastlight::scene::material::linear_of_srgb()[byte];
                assert!((linear - want.albedo[k][c]).abs() < 6e-3, "image {i}, pixel {k}: albedo {linear}");
            }
        }
    }
    // the pose in the file is half-way through the exposure
    let x = capture.frames[1].view_from_world[0][3];
    assert!((x - 0.2).abs() < 1e-6, "a moving camera from 0.1 to 0.3 is at 0.2, not {x}");
    let views = Views::load(dir.path(), &Options::default()).expect("loadable for a fit");
    assert_eq!((views.train.len(), views.test.len()), (2, 1), "the split of the files holds");
}

#[test]
fn an_interrupted_set_continues_to_the_same_bytes() {
    let (whole, parts) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let digest = write_all(whole.path());
    let list = shots();
    let mut r = Recorder::open(parts.path(), header(1), false).expect("begun");
    r.put(&list[0], &passes(0), &style(0)).expect("one image");
    r.put(&list[1], &passes(1), &style(1)).expect("another");
    drop(r);
    // a damaged file is noticed, an image without record too
    std::fs::write(parts.path().join("depth/001.exr"), b"half").expect("damaged");
    // and the temporary file of a killed write is removed
    std::fs::write(parts.path().join("depth/.lastlight-x1Y2z3.part"), b"half").expect("left over");
    assert!(Recorder::open(parts.path(), header(2), true).is_err(), "other settings are refused");
    let mut r = Recorder::open(parts.path(), header(1), true).expect("continued");
    let missing: Vec<bool> = list.iter().map(|s| !r.has(s).expect("readable")).collect();
    assert_eq!(missing, [false, true, true], "complete files are kept");
    for i in [1, 2] {
        r.put(&list[i], &passes(i), &style(i)).expect("written");
    }
    assert_eq!(r.finish(&list).expect("finished"), digest, "digest of the set");
    assert_same(&tree(whole.path()), &tree(parts.path()), "continued");
    // A finished set is looked through.
    let look = |header| Recorder::verify(parts.path(), header, &list);
    assert_eq!(look(header(1)).expect("readable"), Some(Verified { digest, is_whole: true }), "whole");
    assert!(look(header(2)).is_err(), "other settings are refused");
    let picture = parts.path().join("images/002.png");
    let bytes = std::fs::read(&picture).expect("readable");
    std::fs::write(&picture, &bytes[..9]).expect("cut");
    assert_eq!(look(header(1)).expect("readable"), Some(Verified { digest, is_whole: false }), "a cut file");
    std::fs::write(&picture, bytes).expect("restored");
    let nowhere = Recorder::verify(&parts.path().join("nowhere"), header(1), &list);
    assert_eq!(nowhere.expect("readable"), None, "nothing there");
    let r = Recorder::open(parts.path(), header(1), true).expect("a finished set");
    assert!(list.iter().all(|s| r.has(s).expect("readable")), "nothing is left to do");
    assert_eq!(r.finish(&list).expect("finished again"), digest, "and finishing again changes nothing");
    assert_same(&tree(whole.path()), &tree(parts.path()), "continued");
}

#[test]
fn records_that_the_power_failed_on_count_as_none() {
    let (whole, parts) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let digest = write_all(whole.path());
    let list = shots();
    let mut r = Recorder::open(parts.path(), header(1), false).expect("begun");
    for (i, shot) in list.iter().enumerate() {
        r.put(shot, &passes(i), &style(i)).expect("written");
    }
    for (name, bytes) in [("000", &b""[..]), ("001", b"{\"file_path\": \"ima"), ("002", b"[1]")] {
        std::fs::write(parts.path().join(format!(".shots/{name}.json")), bytes).expect("damaged");
    }
    let mut r = Recorder::open(parts.path(), header(1), true).expect("continued");
    for (i, shot) in list.iter().enumerate() {
        assert!(!r.has(shot).expect("readable"), "image {i} has no record");
        r.put(shot, &passes(i), &style(i)).expect("written");
    }
    assert_eq!(r.finish(&list).expect("finished"), digest, "digest of the set");
    assert_same(&tree(whole.path()), &tree(parts.path()), "continued");
}

#[test]
fn bad_names_and_sizes_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut r = Recorder::open(dir.path(), Map::new(), false).expect("begun");
    for name in ["", ".x", "a/b", "../a", "a\\b"] {
        let shot = Shot { name: name.to_owned(), ..shots()[0].clone() };
        assert!(r.put(&shot, &passes(0), &style(0)).is_err(), "'{name}' is no file name");
    }
    let mut small = passes(0);
    small.width = 3;
    assert!(r.put(&shots()[0], &small, &style(0)).is_err(), "sizes differ");
    assert!(r.finish(&shots()).is_err(), "a set with missing images is not finished");
}
