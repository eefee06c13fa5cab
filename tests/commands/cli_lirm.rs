//! `lirm gen` on the command line: help, a tiny set, what is refused.

use crate::program;
use serde_json::Value;
use std::path::Path;
use std::process::Output;

fn of_command<'a>(args: &[&'a str]) -> Vec<&'a str> {
    ["lirm", "gen"].iter().chain(args).copied().collect()
}

fn lastlight(args: &[&str], dir: &Path) -> Output {
    program::lastlight(&of_command(args), dir)
}

fn json(args: &[&str], dir: &Path) -> Value {
    program::json(&of_command(args), dir)
}

fn refused(args: &[&str], dir: &Path, parts: &[&str]) {
    program::refused(&of_command(args), dir, 2, parts);
}

const TINY: [&str; 9] = ["--views", "2", "--size", "16", "--samples", "2", "--seed", "5", "--json"];

#[test]
fn help_shows_examples_and_every_option() {
    let dir = tempfile::tempdir().expect("a folder");
    let o = lastlight(&["--help"], dir.path());
    let text = String::from_utf8(o.stdout).expect("text");
    assert_eq!((o.status.code(), o.stderr.len()), (Some(0), 0), "help is printed to stdout");
    assert!(text.contains("Examples:") && text.matches("lastlight lirm gen --out").count() >= 6, "examples");
    for option in [
        "--objects",
        "--first",
        "--mesh",
        "--lighting",
        "--env",
        "--shiny",
        "--cameras",
        "--lens",
        "--views",
        "--size",
        "--samples",
        "--bounces",
        "--passes",
        "--no-truth",
        "--seed",
        "--resume",
        "--force",
        "object.glb",
        "environment.exr",
    ] {
        assert!(text.contains(option), "'{option}' in the help");
    }
}

#[test]
fn a_tiny_set_is_made_continued_and_rendered_anew() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |out: &'static str, more: &[&'static str]| -> Vec<&'static str> {
        [&["--out", out, "--objects", "2", "--lighting", "both"][..], &TINY, more].concat()
    };
    let made = json(&at("set", &[]), dir.path());
    assert_eq!((&made["objects"], &made["rendered"]), (&2.into(), &8.into()), "2 objects, 2 lights, 2 views");
    assert_eq!(made["settings"]["seed"], 5, "settings are printed");
    assert!(made["seconds"].as_f64().is_some_and(|s| s > 0.0), "time is printed");
    let top: Value =
        serde_json::from_slice(&std::fs::read(dir.path().join("set/dataset.json")).expect("written"))
            .expect("JSON");
    assert_eq!(top["digest"], made["digest"], "the digest of the record");
    for file in [
        "object.json",
        "object.glb",
        "environment.exr",
        "uniform/transforms.json",
        "environment/images/0001.png",
        "environment/radiance/0001.exr",
    ] {
        assert!(dir.path().join("set/object_00001").join(file).is_file(), "{file}");
    }
    // One thread, another folder: the same digest. Existing results are neither regenerated nor overwritten
    // without an option.
    let one =
        program::json(&[&["--threads", "1", "lirm", "gen"][..], &at("again", &[])].concat(), dir.path());
    assert_eq!(one["digest"], made["digest"], "one thread");
    let resumed = json(&at("set", &["--resume"]), dir.path());
    assert_eq!((&resumed["rendered"], &resumed["digest"]), (&0.into(), &made["digest"]), "nothing to do");
    // A changed record of an object is refused.
    let record = dir.path().join("set/object_00001/object.json");
    let text = std::fs::read_to_string(&record).expect("written");
    assert!(text.contains("\"vertices\": "), "the entry that is changed");
    std::fs::write(&record, text.replace("\"vertices\": ", "\"vertices\": 1")).expect("written");
    refused(&at("set", &["--resume"]), dir.path(), &["object_00001/object.json", "unchanged record"]);
    std::fs::remove_file(&record).expect("there");
    let resumed = json(&at("set", &["--resume"]), dir.path());
    assert_eq!((&resumed["rendered"], &resumed["digest"]), (&0.into(), &made["digest"]), "written again");
    refused(&at("set", &[]), dir.path(), &["--out", "--force"]);
    assert_eq!(json(&at("set", &["--force"]), dir.path())["digest"], made["digest"], "forced");

    // The truth is what `mesh render` needs.
    let mut relight = vec!["mesh", "render", "set/object_00001/object.glb", "--out", "relit", "--json"];
    relight.extend(["--env", "set/object_00001/environment.exr", "--samples", "2"]);
    relight.extend(["--cameras", "set/object_00001/environment"]);
    let record = program::json(&relight, dir.path());
    assert_eq!(record["images"], 2, "its cameras");

    // Less of everything.
    let bare = json(&[&["--out", "bare", "--passes", "photo", "--no-truth"][..], &TINY].concat(), dir.path());
    assert_eq!(bare["settings"]["truth"], false, "without truth");
    let object = dir.path().join("bare/object_00000");
    assert!(object.join("uniform/images/0000.png").is_file(), "a photo");
    for file in ["object.glb", "environment.exr", "uniform/radiance", "environment"] {
        assert!(!object.join(file).exists(), "no {file}");
    }
}

#[test]
fn an_egocentric_set_takes_either_camera() {
    let dir = tempfile::tempdir().expect("a folder");
    for (camera, model) in [("fisheye", "OPENCV_FISHEYE"), ("pinhole", "PINHOLE")] {
        let args = [&["--out", camera, "--cameras", "egocentric", "--lens", camera][..], &TINY].concat();
        assert_eq!(json(&args, dir.path())["settings"]["camera"], camera, "{camera}: said");
        let file = dir.path().join(camera).join("object_00000/uniform/transforms_train.json");
        let top: Value = serde_json::from_slice(&std::fs::read(file).expect("written")).expect("JSON");
        assert_eq!(top["camera_model"], model, "{camera}: written");
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let cases: [(&[&str], &[&str]); 12] = [
        (&[], &["required arguments"]),
        (&["--out", "x", "--views", "0"], &["views"]),
        (&["--out", "x", "--size", "4"], &["size"]),
        (&["--out", "x", "--samples", "many"], &["--samples"]),
        (&["--out", "x", "--lighting", "moon"], &["--lighting"]),
        (&["--out", "x", "--cameras", "some"], &["--cameras"]),
        (&["--out", "x", "--shiny"], &["shiny", "environment"]),
        (&["--out", "x", "--lens", "pinhole"], &["--lens", "egocentric", "train"]),
        (&["--out", "x", "--every", "4"], &["--every", "egocentric", "train"]),
        (&["--out", "x", "--cameras", "egocentric", "--lens", "orthographic"], &["--lens"]),
        (&["--out", "x", "--resume", "--force"], &["--resume"]),
        (&["--out", "x", "--lighting", "environment", "--env-axes", "up"], &["--env-axes"]),
    ];
    for (args, parts) in cases {
        refused(args, dir.path(), parts);
        assert!(!dir.path().join("x").exists(), "{args:?}: a refused command makes no folder");
    }
    refused(&["--out", "y", "--mesh", "none.obj"], dir.path(), &["none.obj"]);
    std::fs::write(dir.path().join("map.exr"), "no image").expect("written");
    refused(&["--out", "y", "--lighting", "environment", "--env", "map.exr"], dir.path(), &["map.exr"]);
}

/// Files count by name and bytes: the set does not depend on where they lie, and is not continued with
/// others.
#[test]
fn inputs_are_known_by_name_and_bytes() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::create_dir(at("deep")).expect("a folder");
    for place in ["t.obj", "deep/t.obj"] {
        std::fs::write(at(place), tetrahedron).expect("written");
    }
    let with = |mesh: &'static str, out: &'static str| {
        let mut args = vec!["--out", out, "--mesh", mesh];
        args.extend(TINY);
        args
    };
    let here = json(&with("t.obj", "a"), dir.path());
    let there = json(&with("deep/t.obj", "b"), dir.path());
    assert_eq!(here["digest"], there["digest"], "the folder of a file is no part of what is made");
    std::fs::write(at("t.obj"), tetrahedron.replace("v 0 0 1", "v 0 0 2")).expect("written");
    let mut again = with("t.obj", "a");
    again.push("--resume");
    refused(&again, dir.path(), &["--resume", "as in the set"]);
}
