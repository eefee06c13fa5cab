//! `last study` at the command line: a tiny study with a tiny model runs, continues after an interruption,
//! and lists experiments that cannot run.

use crate::lpips_weights::torchvision;
use crate::program::{json, lastlight, refused};
use lastlight::io::safetensors;
use lastlight::loss::lpips::Weights;
use std::collections::BTreeMap;
use std::path::Path;

/// A model of a few steps, in `model/model.safetensors`.
fn model(dir: &Path) {
    let gen_ = "last gen --scale smoke --out data --quiet --observational 24 --groups 8 --appearances 1 --body-points 128 \
                --render-as points --split all --frames 3 --test-cameras 1";
    let pretrain = "last pretrain data --out model --quiet --iterations 43 --batch-images 12 --batch-groups 4 --batch-points 32 --factor-dim 2";
    for line in [gen_, pretrain] {
        let words: Vec<&str> = line.split_whitespace().collect();
        let o = lastlight(&words, dir);
        assert!(o.status.success(), "{line}: {}", String::from_utf8_lossy(&o.stderr));
    }
}

/// Files of a folder by name, but for what a clock has touched and the subjects' videos.
fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    fn walk(dir: &Path, prefix: &str, out: &mut BTreeMap<String, Vec<u8>>) {
        for entry in std::fs::read_dir(dir).expect("a folder") {
            let entry = entry.expect("an entry");
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                walk(&entry.path(), &format!("{name}/"), out);
            } else {
                out.insert(name, std::fs::read(entry.path()).expect("readable"));
            }
        }
    }
    let mut out = BTreeMap::new();
    walk(dir, "", &mut out);
    out.retain(|name, _| name.ends_with(".csv") && name != "seconds.csv" || name.starts_with("cells/"));
    out
}

#[test]
fn a_small_study_runs_and_continues_after_an_interruption() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    model(at);
    let ids = ["E1", "E2", "E9", "E13"];
    let study = |out: &'static str, more: &[&'static str]| -> Vec<&'static str> {
        let mut words = vec!["last", "study"];
        words.extend(ids);
        words.extend([
            "--scale",
            "smoke",
            "--graph-model",
            "FORK=model/model.safetensors",
            "--json",
            "--out",
            out,
        ]);
        words.extend(more);
        words
    };
    let made = json(&study("whole", &[]), at);
    let experiments = made["experiments"].as_array().expect("a list");
    let names: Vec<&str> = experiments.iter().filter_map(|e| e["id"].as_str()).collect();
    assert_eq!(names, ["calibration", "search", "E1", "E2", "E9", "E13"], "dependencies run first");
    let row = |id: &str, name: &str| -> Vec<String> {
        let e = experiments.iter().find(|e| e["id"] == id).expect("an experiment");
        let rows: Vec<Vec<String>> = serde_json::from_value(e["rows"].clone()).expect("rows of text");
        rows.into_iter().find(|r| r[0] == name).expect("a row").split_off(1)
    };
    // Without a graph there is one level: the update of all at once.
    let same = |a: &str, b: &str| assert_eq!(row("E2", a)[0], row("E2", b)[0], "{a} is {b}");
    same("density + progressive", "density");
    same("progressive", "all off");
    same("structure", "all off");
    assert!(at.join("whole/report/index.html").is_file(), "a report");

    // What an interruption leaves: some cells are not there, one is half a file.
    let cells = |out: &str| files(&at.join(out));
    let whole = cells("whole");
    assert!(whole.len() > 20, "a file for each cell and table: {}", whole.len());
    std::fs::create_dir_all(at.join("part/cells/persons")).expect("a folder");
    let persons: Vec<(&String, &Vec<u8>)> =
        whole.iter().filter(|(name, _)| name.starts_with("cells/persons/")).collect();
    for (i, (name, bytes)) in persons.iter().enumerate().filter(|(i, _)| i % 3 != 1) {
        let bytes = if i == 0 { &bytes[..bytes.len() / 2] } else { &bytes[..] };
        std::fs::write(at.join("part").join(name), bytes).expect("written");
    }
    refused(&study("part", &[]), at, 2, &["new or empty folder"]);
    let stored = json(&study("part", &["--resume", "--report-only"]), at);
    let outcome = |i: usize| stored["experiments"][i]["outcome"].as_str().unwrap_or("").to_owned();
    assert_eq!([outcome(0), outcome(1)], ["not run"; 2], "E1 needs the calibration");
    assert!(!at.join("part/seconds.csv").is_file(), "nothing was run");
    json(&study("part", &["--resume", "--threads", "1"]), at);
    let part = cells("part");
    assert_eq!(part.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>(), "the same files");
    for (name, bytes) in &whole {
        assert_eq!(part[name], *bytes, "{name}");
    }
    let ran = std::fs::read_to_string(at.join("part/seconds.csv")).expect("times").lines().count();
    assert!(ran < persons.len(), "cells that were there did not run again: {ran} of {}", persons.len());
}

#[test]
fn the_model_that_comes_with_the_program_serves() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    let made =
        json(&["last", "study", "E6", "E11", "--scale", "smoke", "--no-search", "--json", "--out", "s"], at);
    assert_eq!(made["models"][0]["graph"], "FORK");
    let outcomes: Vec<(&str, &str)> = made["experiments"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|e| Some((e["id"].as_str()?, e["outcome"].as_str()?)))
        .collect();
    let ids: Vec<&str> = outcomes.iter().map(|(id, _)| *id).collect();
    assert_eq!(ids, ["calibration", "E6", "E11"]);
    assert!(outcomes.iter().all(|(_, outcome)| *outcome != "not run"), "{outcomes:?}");
    refused(&["last", "study", "E99", "--out", "t"], at, 2, &["E1, E2, E3, E4", "E99"]);
    refused(&["last", "study", "--out", "t", "--graph-model", "model.safetensors"], at, 2, &["GRAPH=FILE"]);
    refused(&["last", "study", "--out", "t", "--graph-model", "FORK=none"], at, 2, &["none"]);
}

#[test]
fn weights_of_lpips_add_columns_and_cells_of_their_own() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    let file = at.join("vgg.safetensors");
    safetensors::write(&file, &torchvision(&Weights::by_formula()), &BTreeMap::new()).expect("written");
    let study = |more: &[&str]| -> (Vec<String>, Vec<Vec<String>>, usize) {
        let words =
            [&["last", "study", "E6", "--scale", "smoke", "--no-search", "--json", "--out", "s"], more];
        let made = json(&words.concat(), at);
        let e6 = made["experiments"].as_array().expect("a list").last().expect("E6").clone();
        let rows: Vec<Vec<String>> = serde_json::from_value(e6["rows"].clone()).expect("rows of text");
        let head: Vec<String> = serde_json::from_value(e6["head"].clone()).expect("names of columns");
        let columns = head.iter().zip(&rows[0]).filter(|(name, _)| name.starts_with(">LPIPS"));
        for (name, value) in columns.clone() {
            assert!(value.parse::<f64>().is_ok_and(|x| x > 0.0), "{name} is {value}");
        }
        (columns.map(|(name, _)| name.clone()).collect(), rows, files(&at.join("s")).len())
    };
    let (without, plain, few) = study(&[]);
    assert_eq!(without, [""; 0], "none without weights");
    let (with, _, more) = study(&["--resume", "--lpips", "vgg.safetensors"]);
    assert_eq!(with, [">LPIPS-vgg", ">LPIPS-vgg-box"]);
    let (raw, _, most) = study(&["--resume", "--lpips", "vgg.safetensors", "--lpips-raw"]);
    assert_eq!(raw, [">LPIPS-vgg-raw", ">LPIPS-vgg-raw-box"]);
    assert!(few < more && more < most, "cells of their own: {few}, {more}, {most}");
    assert_eq!(study(&["--resume", "--report-only"]).1, plain, "those without are as they were");
    refused(&["last", "study", "E6", "--out", "t", "--lpips", "none"], at, 2, &["none"]);
}

#[test]
fn structure_from_images_is_measured() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    let study = |more: &[&str]| {
        let words = [&["last", "study", "E10p", "--scale", "smoke", "--json", "--out", "s"], more].concat();
        json(&words, at)["experiments"][0].clone()
    };
    let made = study(&[]);
    assert_eq!(made["id"], "E10p");
    let rows: Vec<Vec<String>> = serde_json::from_value(made["rows"].clone()).expect("rows of text");
    let names: Vec<&str> = rows.iter().map(|r| r[0].as_str()).collect();
    let wanted = ["FORK NL groups", "FORK NL pairs", "FULL NL groups", "FULL NL pairs"];
    assert_eq!(names, wanted.map(|name| format!("{name} images")), "two graphs, two kinds of supervision");
    assert_ne!(made["outcome"], "holds", "four steps find nothing");
    let sets = std::fs::read_dir(at.join("s/sets")).expect("a folder").count();
    assert_eq!(sets, 2, "one set per graph for all kinds of supervision");
    assert_eq!(
        study(&["--resume", "--report-only"])["rows"],
        made["rows"],
        "the report is made from the files"
    );
}
