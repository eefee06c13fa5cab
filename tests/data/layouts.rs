//! Where the images of a capture may be, what its masks do, and cameras without images.

use crate::captures::{NINE, OPENCV, folder, with_images};
use crate::samples;
use lastlight::fit::render::{capture_shots, shots_of};
use lastlight::io::capture::{Reading, read_capture, read_capture_with};
use lastlight::io::image_file;
use lastlight::scene::views::{Masks, Options, Views};

type Files = Vec<(&'static str, Vec<u8>)>;

/// A COLMAP model of nine images, declared as 16×12.
fn colmap() -> Files {
    vec![
        ("sparse/0/cameras.bin", samples::cameras_bin(1, &OPENCV[..4])),
        ("sparse/0/images.bin", samples::images_bin(9)),
    ]
}

#[test]
fn colmap_images_may_be_reduced_ones_or_those_before_undistortion() {
    for (inside, side) in [("images_2", 2), ("images_4", 4), ("images_8", 8), ("input", 1)] {
        let names: Vec<String> = (0..9).map(|i| format!("{inside}/{i:04}.JPG")).collect();
        let (w, h) = (16 / side, (12 / side).max(1));
        let mut files: Vec<(&str, Vec<u8>)> = colmap();
        files.extend(names.iter().map(|n| (n.as_str(), samples::png(w, h, 3))));
        let dir = folder(&files);
        for path in [dir.path().to_path_buf(), dir.path().join("sparse/0")] {
            let v = Views::load(&path, &Options::default()).expect("views");
            let camera = &v.views[2].camera;
            assert_eq!((v.views.len(), camera.width, camera.height), (9, w, h), "{inside}: all of them");
            assert!(
                (camera.focal_px[0] * side as f32 - 20.0).abs() < 1e-5,
                "{inside}: {:?}",
                camera.focal_px
            );
        }
    }
    // Full-size images come first.
    let mut files = with_images(colmap(), &NINE);
    files.push(("images_2/0000.png", samples::png(8, 6, 3)));
    let v = Views::load(folder(&files).path(), &Options::default()).expect("views");
    assert!(v.views.iter().all(|view| view.camera.width == 16), "those of the folder images");
}

#[test]
fn the_folder_of_the_images_can_be_given() {
    let photos = folder(&with_images(Vec::new(), &NINE)); // NINE: images/0000.png, …
    let transforms = vec![("transforms.json", samples::transforms(9))];
    for (files, inside) in [(transforms, ""), (colmap(), "images")] {
        let dir = folder(&files);
        let alone = read_capture(dir.path()).expect("cameras");
        assert_eq!((alone.frames.len(), alone.missing.len()), (0, 9), "no images");
        for place in [photos.path().join(inside), photos.path().join("images")] {
            let reading = Reading { images: Some(place.clone()), ..Reading::default() };
            let c = read_capture_with(dir.path(), &reading).expect("images");
            assert_eq!((c.frames.len(), c.missing.len()), (9, 0), "{}", place.display());
        }
        let reading = Reading { images: Some(photos.path().join("none")), ..Reading::default() };
        let e = read_capture_with(dir.path(), &reading).expect_err("no folder").to_string();
        assert!(e.contains("--images") && e.contains("no such folder"), "{e}");
    }
}

#[test]
fn paths_that_lead_outside_are_an_option() {
    let photos = folder(&with_images(Vec::new(), &NINE));
    let text = String::from_utf8(samples::transforms(9)).expect("text");
    let absolute = text.replace("images/", &format!("{}/images/", photos.path().display()));
    let dir =
        folder(&[("a/transforms.json", absolute.into_bytes()), ("images/0000.png", samples::png(16, 12, 3))]);
    let capture = dir.path().join("a");
    let refused = read_capture(&capture).expect_err("an absolute path").to_string();
    assert!(refused.contains("absolute path") && refused.contains("--allow-outside"), "{refused}");
    let outside = Reading { outside: true, ..Reading::default() };
    assert_eq!(read_capture_with(&capture, &outside).expect("allowed").frames.len(), 9, "absolute");
    std::fs::write(capture.join("transforms.json"), text.replace("images/", "../images/")).expect("written");
    assert!(read_capture(&capture).is_err(), "a parent folder");
    let c = read_capture_with(&capture, &outside).expect("allowed");
    assert_eq!((c.frames.len(), c.missing.len()), (1, 8), "one of nine is there");
}

#[test]
fn masks_ignore_colour_or_are_off() {
    let mask: Vec<u8> = (0..16 * 12).map(|i| if i / 16 == 11 { 0 } else { 255 }).collect();
    let png = |w, h, m: &[u8]| image_file::png_bytes(w, h, 1, m).expect("a mask");
    let mut files = with_images(colmap(), &NINE);
    files.push(("masks/0003.png", png(16, 12, &mask)));
    // A mask of twice the size, as of a photo before it was reduced: its left half is out.
    let large: Vec<u8> = (0..32 * 24).map(|i| if i % 32 < 16 { 0 } else { 255 }).collect();
    files.push(("masks/0004.png", png(32, 24, &large)));
    let dir = folder(&files);
    let load = |masks| {
        let options = Options { masks, background: [1.0, 0.0, 0.5], ..Options::default() };
        Views::load(dir.path(), &options).expect("views")
    };
    let (ignore, background, off) = (load(Masks::Ignore), load(Masks::Background), load(Masks::Off));
    assert_eq!((ignore.masked, background.masked, off.masked), (2, 2, 0), "counted");
    let counted = |v: &Views, i: usize, p: usize| v.views[i].mask.as_ref().map(|m| m[p]);
    assert_eq!(
        (counted(&ignore, 3, 10 * 16), counted(&ignore, 3, 11 * 16)),
        (Some(1), Some(0)),
        "the lowest row"
    );
    assert_eq!((counted(&ignore, 4, 7), counted(&ignore, 4, 8)), (Some(0), Some(1)), "the left half");
    let photo = samples::pixels(16, 12, 3);
    for (v, i, p, expected) in [
        (&background, 3, 11 * 16, [255, 0, 128]),
        (&background, 4, 7, [255, 0, 128]),
        (&background, 3, 0, [photo[0], photo[1], photo[2]]),
        (&off, 3, 11 * 16, std::array::from_fn(|c| photo[3 * 11 * 16 + c])),
    ] {
        assert_eq!(
            (v.views[i].rgb[3 * p..3 * p + 3].to_vec(), counted(v, i, p)),
            (expected.to_vec(), None),
            "{i} {p}"
        );
    }
    // A missing mask of a list is an error, unless masks are off.
    let list = String::from_utf8(samples::transforms(9)).expect("text");
    let list = list.replace(
        "\"file_path\":\"images/0003.png\"",
        "\"file_path\":\"images/0003.png\",\"mask_path\":\"m.png\"",
    );
    let dir = folder(&with_images(vec![("transforms.json", list.into_bytes())], &NINE));
    assert!(Views::load(dir.path(), &Options::default()).is_err(), "no mask there");
    Views::load(dir.path(), &Options { masks: Masks::Off, ..Options::default() }).expect("not needed");
}

#[test]
fn a_camera_path_of_nerfstudio_gives_cameras() {
    let camera = |z: f64| {
        format!("{{\"camera_to_world\":[1,0,0,0.5,0,1,0,0,0,0,1,{z},0,0,0,1],\"fov\":60.0,\"aspect\":1.7}}")
    };
    let text = format!(
        "{{\"camera_type\":\"perspective\",\"render_height\":48,\"render_width\":64,\"fps\":24,\"seconds\":2,\
         \"camera_path\":[{},{}]}}",
        camera(2.0),
        camera(3.0)
    );
    let dir =
        folder(&[("camera_path.json", text.into_bytes()), ("bad.json", b"{\"camera_path\":[]}".to_vec())]);
    let shots = capture_shots(&dir.path().join("camera_path.json"), 2).expect("cameras");
    let c = &shots[1].camera;
    assert_eq!(
        (shots.len(), c.width, c.height, c.center()),
        (2, 32, 24, [0.5, 0.0, 3.0]),
        "as listed, reduced"
    );
    let focal = 12.0 / libm::tan(30f64.to_radians());
    assert!((f64::from(c.focal_px[1]) - focal).abs() < 1e-4, "a vertical field of view: {:?}", c.focal_px);
    let e = shots_of(&dir.path().join("bad.json"), 1, &Reading::default()).expect_err("refused").to_string();
    assert!(e.contains("render_width"), "{e}");
}
