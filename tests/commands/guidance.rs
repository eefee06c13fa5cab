//! What a newcomer is told: the next step after a fit of few photos, what is missing, where a path comes from.

use crate::cli::workplace;
use crate::program::{code, json, lastlight, refused, stderr, stdout};
use std::path::Path;

const FIT: [&str; 7] = ["splat", "fit", "capture", "--iterations", "2", "--initial", "50"];

fn run(args: &[&str], dir: &Path) -> (String, String) {
    let o = lastlight(args, dir);
    assert_eq!(code(&o), 0, "{args:?}: {}", stderr(&o));
    (stdout(&o), stderr(&o))
}

#[test]
fn few_photos_and_missing_ones_are_in_the_report() {
    let work = workplace();
    let dir = work.path();
    std::fs::remove_file(dir.join("capture/color/003.png")).expect("there");
    let (text, _) = run(&[&FIT[..], &["--out", "f"]].concat(), dir);
    assert!(text.contains("low score   below 20 dB: see \"What to try\" in the report"), "{text}");
    let html = std::fs::read_to_string(dir.join("f/report/index.html")).expect("a report");
    assert!(html.contains("<ul class=\"hints\"><li>More photos: this fit had 7 training photos"), "first");
    assert!(
        html.contains("2 held out · 1 of 10 listed frames have no photo and were left out"),
        "missing photos"
    );
    let (_, _) = run(&["splat", "eval", "f", "capture", "--out", "e"], dir);
    let html = std::fs::read_to_string(dir.join("e/report/index.html")).expect("a report");
    assert!(html.contains("1 of 10 listed frames have no photo"), "in the report of scores");
}

#[test]
fn photos_without_poses_have_one_recipe() {
    const README: &str = include_str!("../../README.md");
    let work = workplace();
    let dir = work.path();
    let recipe = [
        "mkdir -p scene",
        "colmap automatic_reconstructor --workspace_path scene --image_path photos --dense 0",
        "lastlight splat fit scene --images photos --out fit",
    ];
    std::fs::create_dir(dir.join("photos")).expect("made");
    std::fs::copy(dir.join("capture/color/000.png"), dir.join("photos/a.png")).expect("copied");
    refused(&["splat", "fit", "photos", "--out", "f"], dir, 2, &recipe);
    let help = stdout(&lastlight(&["help", "captures"], dir));
    for line in recipe {
        assert!(help.contains(line) && README.contains(line), "{line}");
    }
    std::fs::rename(dir.join("capture/color"), dir.join("elsewhere")).expect("moved");
    let fit = [&FIT[..], &["--out", "f"]].concat();
    refused(&fit, dir, 2, &["no file of 10 frames", "--images DIR"]);
}

#[test]
fn folders_without_a_run_are_not_resumed() {
    let work = workplace();
    let dir = work.path();
    std::fs::create_dir(dir.join("empty")).expect("made");
    let resume = |out: &'static str| ["splat", "fit", "--out", out, "--resume"];
    refused(
        &resume("nothing"),
        dir,
        2,
        &["nothing holds no interrupted run: no such folder", "help splat fit"],
    );
    refused(&resume("empty"), dir, 2, &["empty holds no interrupted run: the folder is empty"]);
    refused(
        &resume("capture"),
        dir,
        2,
        &["capture holds no interrupted run: there is no command.json in it"],
    );
    assert!(!dir.join("nothing").exists(), "nothing is made");
}

#[test]
fn recorded_paths_are_relative_to_the_current_folder() {
    let work = workplace();
    let dir = work.path();
    let first = json(&[&FIT[..], &["--out", "f", "--json", "-q"]].concat(), dir);
    let like = ["splat", "fit", "--like", "f", "--out", "g", "--json", "-q"];
    assert_eq!(json(&like, dir)["digest"], first["digest"], "the record in the folder");
    std::fs::create_dir(dir.join("below")).expect("made");
    let below = dir.join("below");
    let like = ["splat", "fit", "--like", "../f", "--out", "g"];
    let parts =
        ["capture: no such file", "comes from the record ../f/result.json", "relative to the current folder"];
    refused(&like, &below, 2, &parts);
    let typed = ["splat", "fit", "../capture", "--like", "../f/result.json", "--out", "g", "--json", "-q"];
    assert_eq!(json(&typed, &below)["digest"], first["digest"], "a path beside it");
}

#[test]
fn folders_of_fits_are_scenes_and_sizes_are_compared() {
    let work = workplace();
    let dir = work.path();
    run(&[&FIT[..], &["--out", "f", "--downscale", "2", "-q"]].concat(), dir);
    let (text, _) = run(&["convert", "f", "f.npz"], dir);
    assert!(text.contains("50 Gaussians"), "{text}");
    refused(&["convert", "f", "no/such/f.npz"], dir, 2, &["no folder no/such", "mkdir -p no/such"]);
    std::fs::create_dir(dir.join("person")).expect("made");
    std::fs::write(dir.join("person/avatar.safetensors"), "").expect("written");
    refused(&["convert", "person", "p.ply"], dir, 2, &["a person of `last fit`", "last render"]);
    let note =
        "the scene was fitted to images of 24x20 pixels, and is scored at 48x40; --downscale 2 scores it";
    let (_, text) = run(&["splat", "eval", "f", "capture"], dir);
    assert!(text.contains(note), "{text}");
    let (_, text) = run(&["splat", "eval", "f", "capture", "--downscale", "2"], dir);
    assert!(!text.contains("was fitted to images of"), "the same size: {text}");
}

/// Placing that many random Gaussians takes longer than the signal.
#[cfg(unix)]
#[test]
fn an_interruption_before_the_first_file_states_that_nothing_was_saved() {
    use crate::program::signalled;
    let work = workplace();
    let dir = work.path();
    let many = ["--initial", "1000000", "--max-gaussians", "1000000", "--sh-degree", "0"];
    let fit = [&["splat", "fit", "capture", "--out", "f", "--init", "random"][..], &many].concat();
    let o = signalled(&fit, dir, "-INT", &|| dir.join("f").exists());
    assert_eq!(code(&o), 130, "{}", stderr(&o));
    assert!(stderr(&o).contains("error: interrupted before anything was saved"), "{}", stderr(&o));
    assert!(!dir.join("f").exists(), "no folder is left");
}
