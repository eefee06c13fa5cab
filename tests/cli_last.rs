//! `last pretrain`, `tune`, `intervene` at the command line: a small model from pictures, continued, tuned, looked at, refused.

mod common;

use common::program::{json, lastlight, refused};
use lastlight::io::safetensors;
use std::path::Path;

/// Pictures, groups and a video of the figure.
fn data(dir: &Path) {
    let made = json(
        &[
            "last",
            "gen",
            "--profile",
            "smoke",
            "--out",
            "data",
            "--json",
            "--count",
            "24",
            "--groups",
            "8",
            "--appearances",
            "1",
            "--points",
            "128",
            "--frames",
            "3",
            "--test-cameras",
            "1",
            "--look",
            "points",
        ],
        dir,
    );
    assert_eq!(made["complete"], true, "finished");
}

/// The short training of these tests, with more arguments.
fn pretrain<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let base = [
        "last",
        "pretrain",
        "data",
        "--steps",
        "4",
        "--observed",
        "12",
        "--groups",
        "4",
        "--points",
        "32",
        "--width",
        "2",
    ];
    base.iter().chain(more).copied().collect()
}

#[test]
fn a_model_is_trained_continued_tuned_and_looked_at() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    data(at);
    let made = json(&pretrain(&["--out", "model", "--json"]), at);
    assert_eq!(made["kind"], "last pretrain", "what it is");
    assert!(made["verdict"]["probabilities"].as_array().is_some_and(|p| p.len() == 16), "every edge");
    for file in ["model.safetensors", "checkpoint.safetensors", "result.json", "report/index.html"] {
        assert!(at.join("model").join(file).is_file(), "{file} is there");
    }
    // A run that is finished already changes nothing.
    let again = json(&pretrain(&["--out", "model", "--json", "--resume"]), at);
    assert_eq!(again["digest"], made["digest"], "continued: the same model");
    refused(&pretrain(&["--out", "model"]), at, 2, &["new or empty folder"]);
    refused(&pretrain(&["--out", "model", "--resume", "--seed", "1"]), at, 2, &["seed"]);
    let threads = json(&pretrain(&["--out", "one", "--json", "--threads", "1"]), at);
    assert_eq!(threads["digest"], made["digest"], "one thread: the same model");

    let tuned = json(
        &[
            "last",
            "tune",
            "model/model.safetensors",
            "data/video",
            "--out",
            "tuned.safetensors",
            "--steps",
            "3",
            "--json",
        ],
        at,
    );
    assert_eq!(tuned["pictures"], 3, "every training picture");
    assert_eq!(tuned["after"].as_array().map(Vec::len), Some(16), "every edge");
    let done = json(
        &[
            "last",
            "intervene",
            "tuned.safetensors",
            "data/video",
            "--out",
            "do",
            "--json",
            "--factor",
            "0",
            "2",
        ],
        at,
    );
    let moved = done["moved"].as_array().expect("rows");
    assert_eq!(moved.len(), 2, "one row per factor");
    let edges: Vec<(u64, u64)> = serde_json::from_value(done["edges"].clone()).expect("pairs");
    let row = &moved[0]["most"];
    for j in [1_u64, 2, 3] {
        let reached = edges.iter().any(|&(_, to)| to == j);
        assert!(reached || row[j as usize] == 0.0, "factor {j} has no parent and cannot move");
    }
    assert!(at.join("do/grid.png").is_file() && at.join("do/moved.csv").is_file(), "pictures and numbers");
}

#[test]
fn bad_input_is_refused() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    refused(&pretrain(&["--out", "m"]), at, 2, &["data"]);
    data(at);
    refused(&pretrain(&["--out", "m", "--reading", "free"]), at, 2, &["reference, literal"]);
    refused(&pretrain(&["--out", "m", "--supervision", "all"]), at, 2, &["none, pairs, groups, labels"]);
    refused(&pretrain(&["--out", "m", "--weight", "kl"]), at, 2, &["NAME=VALUE"]);
    refused(&pretrain(&["--out", "m", "--weight", "kl=-1"]), at, 2, &["NAME=VALUE"]);
    std::fs::remove_dir_all(at.join("data/interventions")).expect("removed");
    refused(&pretrain(&["--out", "m"]), at, 2, &["interventions"]);
    let o = lastlight(&pretrain(&["--out", "m", "--supervision", "none", "--quiet"]), at);
    assert!(o.status.success(), "without interventions nothing of them is needed");
    refused(
        &["last", "tune", "m/checkpoint.safetensors", "data/video", "--out", "t"],
        at,
        2,
        &["kind", "image-to-point"],
    );
    refused(&["last", "intervene", "m/model.safetensors", "none", "--out", "d"], at, 2, &["none"]);
    refused(
        &["last", "intervene", "m/model.safetensors", "data/video", "--out", "d", "--factor", "4"],
        at,
        2,
        &["0 to 3"],
    );
    // A graph with a cycle.
    let path = at.join("m/model.safetensors");
    let mut file = safetensors::read(&path).expect("a model");
    let mut graph = vec![0.0; 16];
    (graph[1], graph[6], graph[8]) = (1.0, 1.0, 1.0);
    file.arrays.put("graph", &[4, 4], graph);
    safetensors::write(&at.join("ring.safetensors"), &file.arrays, &file.metadata).expect("written");
    refused(
        &["last", "tune", "ring.safetensors", "data/video", "--out", "t"],
        at,
        2,
        &["ring.safetensors", "without cycles", "0, 1, 2"],
    );
    file.arrays.put("graph", &[4, 4], vec![0.5; 16]);
    safetensors::write(&at.join("half.safetensors"), &file.arrays, &file.metadata).expect("written");
    refused(&["last", "tune", "half.safetensors", "data/video", "--out", "t"], at, 2, &["0 or 1", "0.5"]);
}
