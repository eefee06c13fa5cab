//! Runs that are continued and runs that are started over.

use super::{done, refused, tiny, workplace, write, write_cube, write_paint, write_panorama};
use crate::common::tree;
use crate::program::{self, json, stderr};
use serde_json::Value;

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
    // A folder that another program wrote is not continued.
    std::fs::create_dir(dir.join("mine")).expect("made");
    write(&dir.join("mine/letter.txt"), "dear");
    refused(&tiny(&["--out", "mine", "--resume"]), dir, &["--resume", "files without the record of a run"]);
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
                "no record of the previous run remains beside new images"
            );
            assert!(!dir.join("a/depth/001.exr").exists(), "nor its images");
        }
        is_there
    };
    let o = program::signalled(&long(&["--out", "a", "--force"]), dir, "-INT", &first_picture);
    assert_eq!(o.status.code(), Some(130), "interrupted: {}", stderr(&o));
    assert!(stderr(&o).contains("--resume"), "it prints how to continue: {}", stderr(&o));
    assert!(!dir.join("a/transforms.json").exists(), "it was not finished");
    refused(&tiny(&["--out", "a", "--resume"]), dir, &["same settings"]);
    done(&long(&["--out", "a", "--resume"]), dir);
    assert_eq!(tree(&dir.join("a")), tree(&dir.join("whole")), "as if it had not been interrupted");
}
