//! Fits that are resumed: without options, with other options, and after their end.

use crate::cli::workplace;
use crate::program::{code, json, lastlight, refused, stderr, stdout};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Every file of a folder with its contents and the inode, which a file that is replaced has not.
fn files(dir: &Path) -> BTreeMap<PathBuf, (Vec<u8>, u64)> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(dir).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            out.extend(files(&path));
        } else {
            let inode = inode(&path);
            out.insert(path.clone(), (std::fs::read(&path).expect("readable"), inode));
        }
    }
    out
}

#[cfg(unix)]
fn inode(path: &Path) -> u64 {
    use std::os::unix::fs::MetadataExt as _;
    std::fs::metadata(path).expect("a file").ino()
}

#[cfg(not(unix))]
fn inode(_: &Path) -> u64 {
    0
}

#[test]
fn a_finished_fit_is_left_as_it_is() {
    let work = workplace();
    let dir = work.path();
    let start =
        ["splat", "fit", "capture", "--out", "f", "--iterations", "12", "--initial", "80", "--seed", "3"];
    let first = json(&[&start[..], &["--json", "-q"]].concat(), dir);
    let before = files(&dir.join("f"));
    let resume = ["splat", "fit", "--out", "f", "--resume"];
    let o = lastlight(&resume, dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    let text = stdout(&o);
    assert!(text.contains("all 12 iterations are done; no file was changed"), "{text}");
    assert!(
        text.contains(first["digest"].as_str().expect("a digest")) && text.contains("f/report/index.html"),
        "{text}"
    );
    assert_eq!(json(&[&resume[..], &["--json", "-q"]].concat(), dir), first, "the record that is there");
    assert!(files(&dir.join("f")) == before, "no file is written again");

    // What is missing is made again.
    std::fs::remove_file(dir.join("f/report/index.html")).expect("there");
    assert_eq!(json(&[&resume[..], &["--json", "-q"]].concat(), dir)["digest"], first["digest"], "the same");
    assert!(dir.join("f/report/index.html").is_file(), "a report");
}

#[test]
fn a_fit_is_resumed_with_its_own_options() {
    let work = workplace();
    let dir = work.path();
    let start =
        ["splat", "fit", "capture", "--out", "f", "--iterations", "12", "--initial", "80", "--seed", "3"];
    let first = json(&[&start[..], &["--json", "-q"]].concat(), dir);
    // As if it had been interrupted before its record was written.
    std::fs::remove_file(dir.join("f/result.json")).expect("there");
    let resume = |more: &[&'static str]| [&["splat", "fit", "--out", "f", "--resume"][..], more].concat();
    let again = json(&resume(&["--json", "-q"]), dir);
    assert_eq!(
        (&again["digest"], &again["settings"]),
        (&first["digest"], &first["settings"]),
        "the same fit"
    );
    // Typed again, and in another form.
    json(&resume(&["--iterations", "1.2e1", "--seed", "3", "--json", "-q"]), dir);
    assert_eq!(
        json(&[&start[..], &["--resume", "--json", "-q"]].concat(), dir)["digest"],
        first["digest"],
        "all of them"
    );
    // Every difference is listed, and how to start another fit with them.
    refused(
        &resume(&["--iterations", "13", "--strategy", "mcmc", "--strict", "-q"]),
        dir,
        2,
        &[
            "--iterations 13 (there: 12)",
            "--strategy mcmc (there: inria)",
            "--strict (not given there)",
            "lastlight splat fit --like f/command.json --strict --iterations 13 --strategy mcmc --out DIR",
        ],
    );
    let like =
        ["splat", "fit", "--like", "f/command.json", "--out", "g", "--iterations", "5", "--json", "-q"];
    let other = json(&like, dir);
    assert_eq!((&other["iterations"], &other["settings"]["seed"]), (&5.into(), &3.into()), "as listed");
    // A folder without a record needs all arguments.
    refused(&["splat", "fit", "--out", "empty", "--resume"], dir, 2, &["holds no interrupted run", "DIR"]);
}
