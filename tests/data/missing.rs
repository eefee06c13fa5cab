//! Photos that a capture lists and does not have.

use crate::captures::{NINE, OPENCV, folder, with_images};
use crate::{common, samples};
use lastlight::fit::render::capture_shots;
use lastlight::scene::views::{Options, Views};

#[test]
fn listed_photographs_that_are_not_there_are_left_out_and_named() {
    for list in ["transforms.json", "sparse/0"] {
        let with = |images: &[&'static str]| {
            let mut files = with_images(Vec::new(), images);
            if list == "transforms.json" {
                files.push((list, samples::transforms(9)));
            } else {
                files.push(("sparse/0/cameras.bin", samples::cameras_bin(1, &OPENCV[..4])));
                files.push(("sparse/0/images.bin", samples::images_bin(9)));
            }
            folder(&files)
        };
        let some = with(&[NINE[0], NINE[1], NINE[3], NINE[4], NINE[5]]);
        let v = Views::load(some.path(), &Options::default()).expect("five are there");
        let names: Vec<&str> = v.missing.iter().map(|n| n.trim_start_matches("images/")).collect();
        assert_eq!(names, ["0002.png", "0006.png", "0007.png", "0008.png"], "{list}: named");
        assert_eq!(
            (v.views.len(), v.test.clone(), v.train.len()),
            (5, vec![0], 4),
            "{list}: the rest is split"
        );
        let strict = Options { strict: true, ..Options::default() };
        let e = Views::load(some.path(), &strict).expect_err("refused").to_string();
        assert!(e.contains("none for 4 of 9 frames") && e.contains("0002.png"), "{list}: {e}");
        let none = with(&[]);
        let e = Views::load(none.path(), &Options::default()).expect_err("none is there").to_string();
        assert!(e.contains("no file of 9 frames") && e.contains("0000.png"), "{list}: {e}");
        let shots = capture_shots(none.path(), 1).expect("cameras need no photos");
        assert_eq!(
            (shots.len(), shots[0].camera.width),
            (9, 16),
            "{list}: all cameras, of the declared size"
        );
    }
}

/// The fox as published: 67 frames are listed, 17 of them without a file.
#[test]
fn the_fox_as_published_is_the_fox() {
    let Some(fox) = common::real_data("capture/fox") else { return };
    let dir = tempfile::tempdir().expect("a temporary folder");
    let text = std::fs::read_to_string(fox.join("transforms.json")).expect("readable");
    let mut list: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let frames = list["frames"].as_array_mut().expect("frames");
    let first = frames[0].clone();
    for i in 0..17 {
        let mut frame = first.clone();
        frame["file_path"] = format!("images/gone_{i:02}.jpg").into();
        frames.push(frame);
    }
    std::fs::write(dir.path().join("transforms.json"), list.to_string()).expect("written");
    std::fs::create_dir(dir.path().join("images")).expect("made");
    for entry in std::fs::read_dir(fox.join("images")).expect("readable") {
        let from = entry.expect("an entry").path();
        std::fs::copy(&from, dir.path().join("images").join(from.file_name().expect("a name")))
            .expect("copied");
    }
    let published = Views::load(dir.path(), &Options::default()).expect("loads");
    assert_eq!(published.missing.len(), 17, "counted");
    let whole = Views::load(&fox, &Options::default()).expect("loads");
    assert_eq!(Views { missing: Vec::new(), ..published }, whole, "the same views, split and box");
}
