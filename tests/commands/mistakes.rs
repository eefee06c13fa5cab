//! What newcomers type by mistake, and what they are told.

use crate::cli::workplace;
use crate::program::{code, json, lastlight, refused, stderr, stdout};
use serde_json::Value;
use std::path::Path;

/// Fails unless the error has all parts and none of the others.
fn refused_without(args: &[&str], dir: &Path, parts: &[&str], others: &[&str]) {
    refused(args, dir, 2, parts);
    let text = stderr(&lastlight(args, dir));
    assert!(others.iter().all(|other| !text.contains(other)), "{args:?}: none of {others:?} in {text}");
}

#[test]
fn what_is_no_capture_is_named() {
    let work = workplace();
    let dir = work.path();
    for (file, what) in [("photo.JPG", "got one image"), ("walk.mp4", "got a video")] {
        std::fs::write(dir.join(file), "x").expect("written");
        let parts = [file, "a folder with images and their camera poses", what, "lastlight help captures"];
        refused(&["splat", "fit", file, "--out", "f"], dir, 2, &parts);
    }
    let orbit = |name: &'static str| ["splat", "render", "ball.ply", "--cameras", name, "--out", "o"];
    refused(&orbit("orbits:6"), dir, 2, &["--cameras", "orbits:6", "orbit:6 gives 6 views"]);
    refused(&orbit("nowhere"), dir, 2, &["nowhere"]);
    std::fs::remove_file(dir.join("capture/color/003.png")).expect("there");
    let strict = ["splat", "fit", "capture", "--out", "f", "--strict"];
    refused_without(
        &strict,
        dir,
        &[
            "error: capture: expected a photo for every frame, got none for 1 of 10",
            "003",
            "without --strict",
        ],
        &["with --strict"],
    );
    assert!(!dir.join("f").exists() && !dir.join("o").exists(), "no folders");
}

#[test]
fn records_that_are_none_are_named() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = dir.path();
    let fit = |file: &'static str| ["splat", "fit", "--like", file, "--out", "f"];
    refused_without(&fit("nope.json"), at, &["nope.json: no such file"], &["os error"]);
    std::fs::write(at.join("page.html"), "<html>").expect("written");
    std::fs::write(at.join("other.json"), "{}").expect("written");
    std::fs::create_dir(at.join("folder")).expect("made");
    let record = "a record with the arguments of its run, such as the result.json of a fit";
    refused_without(&fit("page.html"), at, &[record, "not JSON", "lastlight splat fit"], &["line 1"]);
    refused(&fit("other.json"), at, 2, &["other.json", record]);
    refused(&fit("folder"), at, 2, &["folder", record]);
    // The record of the demo's scene has no photos of its own.
    let demo = serde_json::json!({ "arguments": ["demo", "--seed", "3"] });
    std::fs::write(at.join("demo.json"), demo.to_string()).expect("written");
    refused(
        &fit("demo.json"),
        at,
        2,
        &["a record of splat fit", "demo", "`lastlight demo --like demo.json`"],
    );
}

#[test]
fn numbers_are_refused_for_what_they_are() {
    let work = workplace();
    let dir = work.path();
    let fit =
        |option: &'static str, value: &'static str| ["splat", "fit", "capture", "--out", "f", option, value];
    for (option, value) in [("--iterations", "-5"), ("--iterations", "many"), ("--max-gaussians", "1.5")] {
        refused_without(&fit(option, value), dir, &[option, value, "an integer"], &["unexpected", "digit"]);
    }
    refused_without(&fit("--seed", "-1"), dir, &["--seed", "'-1'", "an integer"], &["unexpected", "digit"]);
    refused_without(&fit("--downscale", "-2"), dir, &["--downscale", "1..=16"], &["unexpected"]);
    refused(
        &["splat", "render", "ball.ply", "--radius", "far", "--cameras", "orbit:1", "--out", "o"],
        dir,
        2,
        &["a number"],
    );
    let size = ["splat", "fit", "capture", "--out", "f", "--size", "64"];
    refused_without(&size, dir, &["--size", "--downscale"], &["use '-- --size'"]);
    let arc = ["splat", "fit", "capture", "--out", "f", "--elevation", "3"];
    refused(&arc, dir, 2, &["--elevation is an option of", "'splat render'"]);
    let rest = ["--initial", "5e1", "--json", "-q"];
    let record = json(&[&fit("--iterations", "2e0")[..], &rest].concat(), dir);
    assert_eq!(record["iterations"], 2, "a power of ten");
}

#[test]
fn words_lead_to_commands_and_topics() {
    let dir = tempfile::tempdir().expect("a folder");
    refused(&["help", "photos"], dir.path(), 2, &["photos", "`lastlight help captures`", "splat fit"]);
    refused(&["help", "splt"], dir.path(), 2, &["`lastlight help splat`"]);
    refused(&["fit"], dir.path(), 2, &["'lastlight splat fit', 'lastlight last fit'"]);
    refused_without(&["render"], dir.path(), &["'lastlight splat render'"], &["generate"]);
    let text = stdout(&lastlight(&["help", "profiles"], dir.path()));
    assert!(
        ["exact", "gsplat", "inria", "unlimited"].iter().all(|p| text.contains(&format!("\n  {p} "))),
        "{text}"
    );
    let o = lastlight(&["--version", "--verbose"], dir.path());
    assert!(stdout(&o).contains("bit table") && stderr(&o).is_empty(), "no time: {}", stderr(&o));
}

#[test]
fn a_single_photo_is_warned_of_and_counted() {
    let work = workplace();
    let dir = work.path();
    let path = dir.join("capture/transforms.json");
    let mut list: Value =
        serde_json::from_str(&std::fs::read_to_string(&path).expect("readable")).expect("JSON");
    list["frames"].as_array_mut().expect("frames").truncate(1);
    std::fs::write(path, list.to_string()).expect("writes");
    let fit = ["splat", "fit", "capture", "--iterations", "1", "--initial", "50", "--out"];
    let text = stderr(&lastlight(&[&fit[..], &["f"]].concat(), dir));
    assert!(
        text.contains("1 training photo, 0 held out") && text.contains("warning: a single photo"),
        "{text}"
    );
    let ply = std::fs::read_to_string(dir.join("f/transforms.json")).expect("cameras");
    assert!(ply.contains("scene.ply"), "{ply}");
}

#[test]
fn quiet_fits_print_means_and_no_table() {
    let work = workplace();
    let dir = work.path();
    let fit = ["splat", "fit", "capture", "--iterations", "2", "--initial", "50", "--out"];
    let loud = lastlight(&[&fit[..], &["a"]].concat(), dir);
    let quiet = lastlight(&[&fit[..], &["b", "-q"]].concat(), dir);
    assert!(stdout(&loud).lines().any(|l| l.starts_with("view ")), "{}", stdout(&loud));
    let text = stdout(&quiet);
    assert!(text.starts_with("mean ") && !text.contains("view "), "{text}");
    assert_eq!(stderr(&quiet), "", "no notes");
    let demo = lastlight(&["demo", "--only", "splat", "--iterations", "2", "-q"], dir);
    assert!(code(&demo) == 0 && !stdout(&demo).contains("Next:"), "{}", stdout(&demo));
}

#[test]
fn conversions_report_the_degree_that_is_lost() {
    let work = workplace();
    let dir = work.path();
    let fit = [
        "splat",
        "fit",
        "capture",
        "--iterations",
        "1",
        "--initial",
        "50",
        "--sh-degree",
        "2",
        "--out",
        "f",
        "-q",
    ];
    assert_eq!(code(&lastlight(&fit, dir)), 0, "a scene of degree 2");
    let convert = |out: &'static str| lastlight(&["convert", "f/scene.ply", out], dir);
    let o = convert("a.splat");
    assert!(stderr(&o).contains("SH degree 2 is reduced to 0"), "{}", stderr(&o));
    assert!(stdout(&o).contains("SH degree 0"), "{}", stdout(&o));
    let o = convert("a.npz");
    assert!(stderr(&o).is_empty() && stdout(&o).contains("SH degree 2"), "{}{}", stderr(&o), stdout(&o));
    let record = json(&["convert", "f/scene.ply", "b.splat", "--json"], dir);
    assert_eq!((&record["sh_degree"], &record["sh_degree_written"]), (&2.into(), &0.into()), "{record}");
}
