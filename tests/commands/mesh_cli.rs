//! `mesh render` and `mesh compare` on the command line: what they write, print, refuse, continue and start over; and the light of
//! `lirm gen` where its options say nothing.

use crate::common::tree;
use crate::program::{self, code, json, lastlight, stderr, stdout};
use crate::samples::gltf;
use lastlight::io::capture::read_capture;
use lastlight::io::image_file;
use lastlight::lirm::exposure::{Photograph, equalise};
use lastlight::num::order;
use lastlight::scene::passes::PassImages;
use serde_json::Value;
use std::path::Path;

/// Runs and expects success; gives stdout.
fn done(args: &[&str], dir: &Path) -> String {
    let o = lastlight(args, dir);
    assert_eq!(code(&o), 0, "{args:?}: {}", stderr(&o));
    stdout(&o)
}

/// Runs and expects exit code 2 and one error line with all of `parts`; what `--out` names is not made.
fn refused(args: &[&str], dir: &Path, parts: &[&str]) {
    let out = args.iter().position(|a| *a == "--out").map(|i| dir.join(args[i + 1]));
    let there = out.as_ref().is_some_and(|o| o.exists());
    program::refused(args, dir, 2, parts);
    assert_eq!(out.is_some_and(|o| o.exists()), there, "{args:?}: a refused command makes no folder");
}

fn write(path: &Path, bytes: impl AsRef<[u8]>) {
    std::fs::write(path, bytes).expect("written");
}

/// A cube of edge 2·`half` about the origin, with a material library and a texture of `red` beside it.
fn write_cube(dir: &Path, half: f64, red: u8) {
    let mut text = String::from("mtllib cube.mtl\nusemtl paint\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n");
    for k in 0..8 {
        let side = |bit: usize| if k >> bit & 1 == 1 { half } else { -half };
        text += &format!("v {} {} {}\n", side(0), side(1), side(2));
    }
    // Counter-clockwise from outside.
    for [a, b, c, d] in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        text += &format!("f {a}/1 {b}/2 {c}/4 {d}/3\n");
    }
    write(&dir.join("cube.obj"), text);
    write(&dir.join("cube.mtl"), "newmtl paint\nmap_Kd paint.png\n");
    write_paint(dir, red);
}

fn write_paint(dir: &Path, red: u8) {
    image_file::write_png(&dir.join("paint.png"), 2, 2, 3, &[red; 12]).expect("a texture");
}

/// A panorama of one row of four colours, as bright as `level`.
fn write_panorama(path: &Path, level: f32) {
    let data: Vec<f32> = (0..24).map(|i| level * (0.2 + 0.1 * i as f32)).collect();
    image_file::write_exr(path, 4, 2, &["R", "G", "B"], &data).expect("a panorama");
}

fn workplace() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    write_cube(dir.path(), 0.5, 200);
    write_panorama(&dir.path().join("sky.exr"), 1.0);
    dir
}

/// A tiny run of the cube under the panorama.
const TINY: [&str; 12] = [
    "mesh",
    "render",
    "cube.obj",
    "--env",
    "sky.exr",
    "--size",
    "20x16",
    "--samples",
    "4",
    "--bounces",
    "1",
    "--quiet",
];

/// [`TINY`] with two views, unless `more` has cameras of its own.
fn tiny<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let cameras: &[&str] = if more.contains(&"--cameras") { &[] } else { &["--cameras", "orbit:2"] };
    TINY.iter().chain(cameras).chain(more).copied().collect()
}

#[test]
fn help_has_examples() {
    let dir = tempfile::tempdir().expect("a folder");
    for command in ["render", "compare"] {
        let o = lastlight(&["mesh", command, "--help"], dir.path());
        let text = String::from_utf8(o.stdout).expect("text");
        assert_eq!(o.status.code(), Some(0), "{command}");
        assert!(text.contains("Examples:") && text.contains(&format!("lastlight mesh {command} ")), "{text}");
        assert!(o.stderr.is_empty(), "{command}: help goes to stdout");
    }
    let text = done(&["mesh", "render", "--help"], dir.path());
    for word in ["--env-axes", "axes", "mitsuba", "--resume", "--force", "orbit:N"] {
        assert!(text.contains(word), "'{word}' in the help");
    }
    assert!(
        !text.contains("orb,") && !text.contains("orb]"),
        "no axes that the command line cannot say: {text}"
    );
}

#[test]
fn a_run_is_a_capture_with_passes() {
    let work = workplace();
    let dir = work.path();
    let one = json(&tiny(&["--out", "one", "--json", "--threads", "1"]), dir);
    let keys: Vec<&str> = one.as_object().expect("an object").keys().map(String::as_str).collect();
    let want =
        ["file", "out", "pictures", "vertices", "triangles", "materials", "notes", "digest", "seconds"];
    assert_eq!(keys, want, "keys");
    assert_eq!((&one["pictures"], &one["triangles"]), (&Value::from(2), &Value::from(12)), "{one}");
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
    assert!(text.starts_with("2 pictures of 12 triangles: ") && text.contains("digest "), "{text}");
    let mut folders: Vec<_> = std::fs::read_dir(dir.join("photo"))
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name().into_string().expect("text"))
        .collect();
    folders.sort();
    assert_eq!(folders, ["foreground", "images", "transforms.json"], "photographs alone");
    let photo = image_file::read(&dir.join("photo/images/000.png")).expect("a photograph");
    assert_eq!((photo.channels.len(), photo.value(3)), (4, 0.0), "with an alpha channel");
    // Cameras of a capture, at half the size: the picture is the one an orbit gives.
    let again = tiny(&["--cameras", "one", "--downscale", "2", "--out", "half", "--json"]);
    assert_eq!(json(&again, dir)["pictures"], 2, "the capture's cameras");
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
fn a_run_is_continued_where_everything_is_what_it_was() {
    let work = workplace();
    let dir = work.path();
    let made = json(&tiny(&["--out", "a", "--json"]), dir);
    let whole = tree(&dir.join("a"));
    refused(&tiny(&["--out", "a"]), dir, &["new or empty folder", "--force"]);
    let again = json(&tiny(&["--out", "a", "--resume", "--json"]), dir);
    assert_eq!(again["digest"], made["digest"], "nothing to do");
    // A lost and a damaged file are made again.
    std::fs::remove_file(dir.join("a/images/001.png")).expect("removed");
    write(&dir.join("a/depth/000.exr"), "half");
    let again = json(&tiny(&["--out", "a", "--resume", "--json"]), dir);
    assert_eq!((&again["digest"], tree(&dir.join("a"))), (&made["digest"], whole.clone()), "mended");
    // Settings, model, what the model refers to, light, cameras: each of them refuses.
    let resume = tiny(&["--out", "a", "--resume"]);
    let other = |change: &dyn Fn()| {
        change();
        refused(&resume, dir, &["--resume", "same settings"]);
        write_cube(dir, 0.5, 200);
        write_panorama(&dir.join("sky.exr"), 1.0);
    };
    refused(&tiny(&["--out", "a", "--resume", "--seed", "1"]), dir, &["same settings"]);
    refused(&tiny(&["--out", "a", "--resume", "--env-rotate", "90"]), dir, &["same settings"]);
    other(&|| write_cube(dir, 0.6, 200));
    other(&|| write_paint(dir, 90));
    other(&|| write_panorama(&dir.join("sky.exr"), 2.0));
    done(&tiny(&["--out", "c"]), dir);
    let args = |more: &[&'static str]| tiny(&[&["--cameras", "c", "--out", "b"][..], more].concat());
    done(&args(&[]), dir);
    done(&args(&["--resume"]), dir);
    let cameras = dir.join("c/transforms.json");
    let text = std::fs::read_to_string(&cameras).expect("cameras");
    let mut changed: Value = serde_json::from_str(&text).expect("JSON");
    let x = changed["frames"][1]["transform_matrix"][0][3].as_f64().expect("a number");
    changed["frames"][1]["transform_matrix"][0][3] = (x + 0.1).into();
    write(&cameras, changed.to_string());
    refused(&args(&["--resume"]), dir, &["same settings"]);
    assert_eq!(tree(&dir.join("a")), whole, "what is refused changes nothing");
    // A folder of somebody else's is not continued.
    std::fs::create_dir(dir.join("mine")).expect("made");
    write(&dir.join("mine/letter.txt"), "dear");
    refused(&tiny(&["--out", "mine", "--resume"]), dir, &["--resume", "files without its record"]);
    assert_eq!(std::fs::read_dir(dir.join("mine")).expect("a folder").count(), 1, "untouched");
}

#[test]
fn force_starts_over_and_leaves_nothing_of_the_run_before() {
    let work = workplace();
    let dir = work.path();
    done(&tiny(&["--out", "a"]), dir);
    write(&dir.join("a/letter.txt"), "dear");
    write(&dir.join("a/images/mine.png"), "mine");
    let other = ["--passes", "photo", "--seed", "5", "--cameras", "orbit:1"];
    done(&tiny(&[&other[..], &["--out", "fresh"]].concat()), dir);
    done(&tiny(&[&other[..], &["--out", "a", "--force"]].concat()), dir);
    for kept in ["a/letter.txt", "a/images/mine.png"] {
        std::fs::remove_file(dir.join(kept)).unwrap_or_else(|e| panic!("{kept} is no part of a run: {e}"));
    }
    assert_eq!(tree(&dir.join("a")), tree(&dir.join("fresh")), "as if nothing had been there");
    // A capture that another program made is not taken.
    std::fs::create_dir(dir.join("photos")).expect("made");
    write(&dir.join("photos/transforms.json"), r#"{"camera_model": "PINHOLE", "frames": []}"#);
    refused(&tiny(&["--out", "photos", "--force"]), dir, &["transforms.json", "another"]);
    refused(&tiny(&["--out", "a", "--force", "--resume"]), dir, &["--resume"]);
}

/// Starts over on a finished run, is stopped, and is continued.
#[cfg(unix)]
#[test]
fn a_forced_run_that_was_stopped_continues() {
    let work = workplace();
    let dir = work.path();
    done(&tiny(&["--out", "a"]), dir);
    let long = |more: &[&'static str]| {
        let base = [
            "mesh",
            "render",
            "cube.obj",
            "--env",
            "sky.exr",
            "--cameras",
            "orbit:30",
            "--size",
            "48x48",
            "--samples",
            "64",
            "--quiet",
            "--passes",
            "photo",
        ];
        base.iter().chain(more).copied().collect::<Vec<_>>()
    };
    done(&long(&["--out", "whole"]), dir);
    let first_picture = || {
        let is_there = dir.join("a/.shots/000.json").exists();
        if is_there {
            assert!(
                !dir.join("a/transforms.json").exists(),
                "no record of the run before stands beside new pictures"
            );
            assert!(!dir.join("a/depth/001.exr").exists(), "nor its pictures");
        }
        is_there
    };
    let o = program::signalled(&long(&["--out", "a", "--force"]), dir, "-INT", &first_picture);
    assert_eq!(o.status.code(), Some(130), "interrupted: {}", stderr(&o));
    assert!(stderr(&o).contains("--resume"), "it says how to go on: {}", stderr(&o));
    assert!(!dir.join("a/transforms.json").exists(), "it was not finished");
    refused(&tiny(&["--out", "a", "--resume"]), dir, &["same settings"]);
    done(&long(&["--out", "a", "--resume"]), dir);
    assert_eq!(tree(&dir.join("a")), tree(&dir.join("whole")), "as if it had not been interrupted");
}

#[test]
fn what_makes_no_sense_is_refused_and_makes_no_folder() {
    let work = workplace();
    let dir = work.path();
    let with = |more: &[&'static str]| {
        let base = ["mesh", "render", "cube.obj", "--out", "new", "--quiet"];
        base.iter().chain(more).copied().collect::<Vec<_>>()
    };
    let cases: [(&[&'static str], &[&str]); 20] = [
        (&["--env", "none.hdr"], &["none.hdr", "studio", "axes"]),
        (&["--env-axes", "mitsuba"], &["--env-axes", "uniform"]),
        (&["--env", "sky", "--env-axes", "blender"], &["--env-axes", "'sky'"]),
        (&["--env", "studio", "--env-mirror"], &["--env-mirror", "studio"]),
        (&["--env", "axes", "--env-linear"], &["--env-linear", "axes"]),
        (&["--env-scale", "nan"], &["scale", "NaN"]),
        (&["--env-scale", "-1"], &["scale", "-1"]),
        (&["--env-scale", "1e30"], &["environment", "--env-scale"]),
        (&["--env", "sky", "--env-rotate", "1e30"], &["rotation"]),
        (&["--env", "cube.obj"], &["cube.obj"]),
        (&["--cameras", "orbit:0"], &["orbit"]),
        (&["--cameras", "orbit:x"], &["--cameras"]),
        (&["--cameras", "nowhere"], &["nowhere"]),
        (&["--size", "0x4"], &["--size"]),
        (&["--elevation", "95"], &["elevation", "88 degrees", "got 95"]),
        (&["--fov", "0"], &["field of view", "got 0"]),
        (&["--exposure=-1"], &["--exposure"]),
        (&["--hide", "lid"], &["--hide", "no parts"]),
        (&["--animation", "walk"], &["--animation", "no parts, joints or animations"]),
        (&["--exposure", "nan"], &["--exposure"]),
    ];
    for (more, parts) in cases {
        refused(&with(more), dir, parts);
    }
    for name in ["orb", "unity"] {
        let o = lastlight(&with(&["--env", "sky.exr", "--env-axes", name]), dir);
        let text = stderr(&o);
        assert!(
            o.status.code() == Some(2) && text.contains("mitsuba") && text.contains(name),
            "{name}: {text}"
        );
    }
    assert_eq!(lastlight(&with(&["--time", "1"]), dir).status.code(), Some(2), "a time of what");
    refused(&["mesh", "render", "none.obj", "--out", "new"], dir, &["none.obj"]);
    write(&dir.join("broken.glb"), "glTF");
    refused(&["mesh", "render", "broken.glb", "--out", "new"], dir, &["broken.glb"]);
    // Far apart, and yet a place to look from: the square of a coordinate need not fit.
    write(&dir.join("far.obj"), "v 0 0 0\nv 1e30 0 0\nv 0 1e30 0\nf 1 2 3\n");
    let far =
        ["mesh", "render", "far.obj", "--out", "far", "--size", "8x8", "--samples", "1", "--json", "--quiet"];
    assert_eq!(json(&far, dir)["pictures"], 1, "one picture");
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

/// The first camera of an orbit at elevation 0 looks to +y; what lies around there has the colour of the axis that the options put there.
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
        let photo = image_file::read(&dir.join(name).join("images/000.png")).expect("a photograph");
        // Off the middle, where the negative axes are dark and the cube is a dot: ten degrees to the left.
        let at = 3 * (8 * 16 + 2);
        let got = [0, 1, 2].map(|c| (255.0 * photo.value(at + c)).round() as i32);
        assert!((0..3).all(|c| (got[c] - want[c]).abs() <= 2), "{name}: {got:?}, want {want:?}");
    }
}

#[test]
fn distances_are_those_of_closed_forms() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    // y up: squares at heights 0 and ¼, the second turned over.
    write(&dir.join("a.obj"), "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nf 1 2 3 4\n");
    write(&dir.join("b.obj"), "v 0 0.25 0\nv 1 0.25 0\nv 1 0.25 1\nv 0 0.25 1\nf 4 3 2 1\n");
    let compare = |a: &'static str, b: &'static str, more: &[&'static str]| {
        let base = ["mesh", "compare", a, b, "--samples", "2000", "--json"];
        json(&base.iter().chain(more).copied().collect::<Vec<_>>(), dir)
    };
    let c = compare("a.obj", "b.obj", &["--tau", "0.3"]);
    for way in ["a_to_b", "b_to_a"] {
        for what in ["mean", "rms", "max"] {
            assert!((c[way][what].as_f64().expect("a number") - 0.25).abs() < 1e-6, "{way} {what}: {c}");
        }
        assert_eq!(c[way]["within"], 1.0, "{way}: all within tau");
    }
    assert_eq!((&c["f_score"], &c["tau"], &c["samples"]), (&1.0.into(), &0.3.into(), &2000.into()), "{c}");
    assert!((c["normal_consistency"].as_f64().expect("a number") - 1.0).abs() < 1e-6, "parallel: {c}");
    assert!((c["area"][0].as_f64().expect("a number") - 1.0).abs() < 1e-6, "area: {c}");
    let chamfer = c["chamfer_mean"].as_f64().expect("a number");
    assert!((0.25..0.27).contains(&chamfer), "samples lie at most a little aside: {chamfer}");
    let sum = c["chamfer_sum"].as_f64().expect("a number");
    assert!((sum - 2.0 * chamfer).abs() < 1e-12, "sum {sum} and mean {chamfer}");
    let none = compare("a.obj", "b.obj", &["--tau", "0.2"]);
    assert_eq!((&none["f_score"], &none["a_to_b"]["within"]), (&0.0.into(), &0.0.into()), "{none}");
    let same = compare("a.obj", "a.obj", &[]);
    assert!(same["a_to_b"]["max"].as_f64().expect("a number") < 1e-9 && same["f_score"] == 1.0, "{same}");
    assert_ne!(
        compare("a.obj", "b.obj", &["--seed", "1"])["chamfer_mean"],
        c["chamfer_mean"],
        "other samples"
    );
    let base = ["mesh", "compare", "a.obj", "b.obj"];
    let text = done(&base, dir);
    for word in ["Chamfer, mean (L1)", "normal consistency", "F-score", "A to B", "area 1.000000"] {
        assert!(text.contains(word), "'{word}' in {text}");
    }
    for tau in ["nan", "-1", "inf"] {
        refused(&[&base[..], &[&*format!("--tau={tau}").leak()]].concat(), dir, &["--tau"]);
    }
    assert_eq!(
        lastlight(&[&base[..], &["--samples", "0"]].concat(), dir).status.code(),
        Some(2),
        "no samples"
    );
    refused(&["mesh", "compare", "a.obj", "none.obj"], dir, &["none.obj"]);
    write(&dir.join("flat.obj"), "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    refused(&["mesh", "compare", "a.obj", "flat.obj"], dir, &["area"]);
}

/// Photographs that were exposed one by one become one object's again.
#[test]
fn exposures_are_undone_by_the_rule_of_training() {
    let work = workplace();
    let dir = work.path();
    done(&tiny(&["--cameras", "orbit:3", "--out", "a"]), dir);
    let capture = read_capture(&dir.join("a")).expect("a capture");
    let (mut views, mut radiance) = (Vec::new(), Vec::new());
    for frame in &capture.frames {
        let p = PassImages::read(frame).expect("passes");
        let photo = image_file::read(&frame.image).expect("a photograph");
        let color = (0..p.width * p.height).map(|i| [0, 1, 2].map(|c| photo.value(3 * i + c))).collect();
        let exposure = p.exposure.expect("an exposure");
        views.push(Photograph { color, foreground: p.foreground.expect("foreground"), exposure });
        radiance.push(p.radiance.expect("radiance"));
    }
    let exposures: Vec<f64> = views.iter().map(|v| v.exposure).collect();
    let mean = exposures.iter().fold(0.0, |s, e| s + e) / 3.0;
    assert!(exposures.iter().any(|e| (e - mean).abs() > 0.01), "they differ: {exposures:?}");
    let gains = equalise(&mut views).expect("photographs");
    let decode = |x: f64| if x <= 0.040_45 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) };
    let mut compared = 0;
    for (v, (view, radiance)) in views.iter().zip(&radiance).enumerate() {
        for (c, r) in view.color.as_flattened().iter().zip(radiance.as_flattened()) {
            let (got, want) = (decode(f64::from(*c)), f64::from(*r) * mean * gains.lift);
            // Eight bits of the photograph, and what had been cut in it.
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

#[test]
fn lirm_gen_refuses_light_that_would_not_be_used() {
    let work = workplace();
    let dir = work.path();
    let with = |more: &[&'static str]| {
        let base = [
            "lirm",
            "gen",
            "--out",
            "new",
            "--views",
            "2",
            "--size",
            "16",
            "--samples",
            "1",
            "--texture",
            "32",
            "--quiet",
        ];
        base.iter().chain(more).copied().collect::<Vec<_>>()
    };
    refused(&with(&["--env", "none.hdr"]), dir, &["env", "--lighting environment or both"]);
    refused(&with(&["--env", "axes"]), dir, &["--lighting environment or both"]);
    refused(&with(&["--env-width", "64"]), dir, &["--env-width"]);
    for alone in [&["--env-axes", "mitsuba"][..], &["--env", "sky.exr", "--env-width", "64"]] {
        assert_eq!(lastlight(&with(alone), dir).status.code(), Some(2), "{alone:?}: says nothing");
    }
    refused(&with(&["--lighting", "environment", "--env", "axes", "sky.exr"]), dir, &["axes"]);
    assert!(!dir.join("new").exists(), "no folder");
    let lit = ["--lighting", "environment", "--env", "axes", "--env-axes", "mitsuba", "--json"];
    let record = json(&with(&lit), dir);
    assert_eq!(record["settings"]["axes"], true, "recorded: {record}");
    let object = std::fs::read_to_string(dir.join("new/object_00000/object.json")).expect("a record");
    let object: Value = serde_json::from_str(&object).expect("JSON");
    assert_eq!(object["environment"]["kind"], "axes", "described: {object}");
}

/// The lines of the README on meshes, as they stand there.
#[test]
fn the_lines_of_the_readme_run() {
    let work = workplace();
    let dir = work.path();
    let glb = gltf::triangle().glb();
    write(&dir.join("model.glb"), &glb);
    write(&dir.join("ours.glb"), &glb);
    write(&dir.join("theirs.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let mut probe = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
    probe.extend([128, 120, 90, 129].repeat(8));
    write(&dir.join("probe.hdr"), probe);
    let mut ran = 0;
    for line in include_str!("../../README.md").lines().filter(|l| l.starts_with("lastlight mesh ")) {
        let command = line.split("  ").next().expect("a line").split_whitespace().skip(1);
        done(&command.collect::<Vec<_>>(), dir);
        ran += 1;
    }
    assert_eq!(ran, 2, "both commands stand in the README");
    assert!(dir.join("relit/transforms.json").is_file(), "a relit picture");
}
