//! What `mesh render` makes.

use super::{done, refused, tiny, workplace, write};
use crate::common::tree;
use crate::program::{json, lastlight, stderr};
use crate::samples::gltf;
use lastlight::fit::exposure::{Photograph, equalise};
use lastlight::io::capture::read_capture;
use lastlight::io::image_file;
use lastlight::num::order;
use lastlight::scene::passes::PassImages;
use serde_json::Value;

#[test]
fn a_run_is_a_capture_with_passes() {
    let work = workplace();
    let dir = work.path();
    let one = json(&tiny(&["--out", "one", "--json", "--threads", "1"]), dir);
    let keys: Vec<&str> = one.as_object().expect("an object").keys().map(String::as_str).collect();
    let want = ["file", "out", "images", "vertices", "triangles", "materials", "notes", "digest", "seconds"];
    assert_eq!(keys, want, "keys");
    assert_eq!((&one["images"], &one["triangles"]), (&Value::from(2), &Value::from(12)), "{one}");
    let two = json(&tiny(&["--out", "two", "--json", "--threads", "3"]), dir);
    assert_eq!(one["digest"], two["digest"], "threads change no bit");
    assert_eq!(tree(&dir.join("one")), tree(&dir.join("two")), "nor a byte");
    let capture = read_capture(&dir.join("one")).expect("a capture");
    assert_eq!(capture.frames.len(), 2, "two views");
    for frame in &capture.frames {
        let p = PassImages::read(frame).expect("passes");
        assert_eq!([p.width, p.height], [20, 16], "size");
        let (alpha, depth) = (p.foreground.expect("foreground"), p.depth.expect("depth"));
        assert!(alpha[0] == 0.0 && alpha[8 * 20 + 10] == 1.0, "the cube is in the middle");
        assert!(depth[8 * 20 + 10] > 0.0 && depth[0] == 0.0, "so is its depth");
        let albedo = p.albedo.expect("albedo")[8 * 20 + 10];
        assert!((albedo[0] - 200.0 / 255.0).abs() < 2.0 / 255.0, "the paint: {albedo:?}");
        assert!(p.normal.is_some() && p.roughness.is_some() && p.radiance.is_some(), "all passes");
    }
    let text = done(&tiny(&["--out", "photo", "--passes", "photo", "--transparent"]), dir);
    assert!(text.starts_with("2 images of 12 triangles: ") && text.contains("digest "), "{text}");
    let mut folders: Vec<_> = std::fs::read_dir(dir.join("photo"))
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name().into_string().expect("text"))
        .collect();
    folders.sort();
    assert_eq!(folders, ["foreground", "images", "transforms.json"], "photos alone");
    let photo = image_file::read(&dir.join("photo/images/000.png")).expect("a photo");
    assert_eq!((photo.channels.len(), photo.value(3)), (4, 0.0), "with an alpha channel");
    // Cameras of a capture, at half the size: the image equals that of an orbit.
    let again = tiny(&["--cameras", "one", "--downscale", "2", "--out", "half", "--json"]);
    assert_eq!(json(&again, dir)["images"], 2, "the capture's cameras");
    let half = read_capture(&dir.join("half")).expect("a capture");
    assert_eq!(half.frames[0].size, Some([10, 8]), "half the size");
    let poses = [&half, &capture].map(|c| c.frames[1].view_from_world);
    let off = poses[0].iter().flatten().zip(poses[1].iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(off, "the same pose: {poses:?}");
}

#[test]
fn the_place_of_files_is_no_part_of_a_result() {
    let work = workplace();
    let dir = work.path();
    let plain = json(&tiny(&["--out", "plain", "--json"]), dir);
    std::fs::create_dir_all(dir.join("far/away")).expect("made");
    for file in ["cube.obj", "cube.mtl", "paint.png", "sky.exr"] {
        std::fs::copy(dir.join(file), dir.join("far/away").join(file)).expect("copied");
    }
    let there = |args: &[&str]| -> Vec<String> {
        let moved = |a: &&str| match *a {
            "cube.obj" | "sky.exr" => format!("./far/../far/away/{a}"),
            other => other.to_owned(),
        };
        args.iter().map(moved).collect()
    };
    let args = there(&tiny(&["--out", "moved", "--json"]));
    let moved = json(&args.iter().map(String::as_str).collect::<Vec<_>>(), dir);
    assert_eq!(plain["digest"], moved["digest"], "the digest");
    assert_eq!(tree(&dir.join("plain")), tree(&dir.join("moved")), "the same bytes");
    let args = there(&tiny(&["--out", "plain", "--resume", "--json"]));
    let resumed = json(&args.iter().map(String::as_str).collect::<Vec<_>>(), dir);
    assert_eq!(plain["digest"], resumed["digest"], "continued from elsewhere");
}

#[test]
fn characters_are_posed_and_hidden() {
    let work = workplace();
    let dir = work.path();
    write(&dir.join("arm.glb"), gltf::arm().glb());
    let with = |out: &'static str, more: &[&'static str]| {
        let base =
            ["mesh", "render", "arm.glb", "--size", "12x12", "--samples", "1", "--quiet", "--out", out];
        base.iter().chain(more).copied().collect::<Vec<_>>()
    };
    let json_of = |out, more: &[&'static str]| json(&[with(out, more), vec!["--json"]].concat(), dir);
    let start = json_of("start", &["--animation", "bend"]);
    let later = json_of("later", &["--animation", "bend", "--time", "1.5"]);
    assert_ne!(start["digest"], later["digest"], "it moves");
    for time in ["nan", "inf", "-inf"] {
        let o = lastlight(&with("new", &["--animation", "bend", &*format!("--time={time}").leak()]), dir);
        let text = stderr(&o);
        assert!(o.status.code() == Some(2) && text.contains("--time"), "{time}: {text}");
    }
    refused(&with("new", &["--animation", "fly"]), dir, &["fly", "bend"]);
    refused(&with("new", &["--hide", "hat"]), dir, &["hat", "arm"]);
    refused(&with("new", &["--hide", "arm"]), dir, &["something left"]);
    refused(&with("later", &["--animation", "bend", "--time", "0.5", "--resume"]), dir, &["same settings"]);
}

/// The first camera of an orbit at elevation 0 looks to +y; what lies around there has the colour of the axis
/// that the options put there.
#[test]
fn the_axes_map_shows_which_way_a_picture_is_read() {
    let work = workplace();
    let dir = work.path();
    let [red, green, magenta, cyan] = [[255, 63, 63], [63, 255, 63], [255, 63, 255], [63, 255, 255]];
    let cases: [(&str, &[&str], [i32; 3]); 8] = [
        ("ours", &[], green),
        ("nvdiffrec", &["--env-axes", "nvdiffrec"], green),
        ("mitsuba", &["--env-axes", "mitsuba"], magenta),
        ("blender", &["--env-axes", "blender"], cyan),
        ("turned", &["--env-rotate", "90"], red),
        ("back", &["--env-rotate", "-90"], cyan),
        ("mirrored", &["--env-mirror"], green),
        ("both", &["--env-rotate", "90", "--env-mirror"], cyan),
    ];
    for (name, more, want) in cases {
        let base = [
            "mesh",
            "render",
            "cube.obj",
            "--env",
            "axes",
            "--size",
            "16x16",
            "--fov",
            "30",
            "--elevation",
            "0",
            "--radius",
            "100",
            "--samples",
            "1",
            "--exposure",
            "1",
            "--passes",
            "photo",
            "--quiet",
            "--out",
            name,
        ];
        done(&[&base[..], more].concat(), dir);
        let photo = image_file::read(&dir.join(name).join("images/000.png")).expect("a photo");
        // Off the middle, where the negative axes are dark and the cube is a dot: ten degrees to the left.
        let at = 3 * (8 * 16 + 2);
        let got = [0, 1, 2].map(|c| (255.0 * photo.value(at + c)).round() as i32);
        assert!((0..3).all(|c| (got[c] - want[c]).abs() <= 2), "{name}: {got:?}, want {want:?}");
    }
}

/// Photos that were exposed one by one become one object's again.
#[test]
fn exposures_are_undone_by_the_rule_of_training() {
    let work = workplace();
    let dir = work.path();
    done(&tiny(&["--cameras", "orbit:3", "--out", "a"]), dir);
    let capture = read_capture(&dir.join("a")).expect("a capture");
    let (mut views, mut radiance) = (Vec::new(), Vec::new());
    for frame in &capture.frames {
        let p = PassImages::read(frame).expect("passes");
        let photo = image_file::read(&frame.image).expect("a photo");
        let color = (0..p.width * p.height).map(|i| [0, 1, 2].map(|c| photo.value(3 * i + c))).collect();
        let exposure = p.exposure.expect("an exposure");
        views.push(Photograph { color, foreground: p.foreground.expect("foreground"), exposure });
        radiance.push(p.radiance.expect("radiance"));
    }
    let exposures: Vec<f64> = views.iter().map(|v| v.exposure).collect();
    let mean = exposures.iter().fold(0.0, |s, e| s + e) / 3.0;
    assert!(exposures.iter().any(|e| (e - mean).abs() > 0.01), "they differ: {exposures:?}");
    let gains = equalise(&mut views).expect("photos");
    let decode = |x: f64| if x <= 0.040_45 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) };
    let mut compared = 0;
    for (v, (view, radiance)) in views.iter().zip(&radiance).enumerate() {
        for (c, r) in view.color.as_flattened().iter().zip(radiance.as_flattened()) {
            let (got, want) = (decode(f64::from(*c)), f64::from(*r) * mean * gains.common.lift);
            // Eight bits of the photo, and what had been cut in it.
            if want < 0.9 && f64::from(*r) * exposures[v] < 0.99 {
                assert!(
                    (got - want).abs() < 0.012 * order::max(gains.views[v], 1.0),
                    "view {v}: {got}, want {want}"
                );
                compared += 1;
            }
        }
    }
    assert!(compared > 500, "{compared} values were compared");
}
