//! A short campaign of each kind, with the other tests.
#![cfg(unix)]

use lastlight_tests_campaigns::{bases, disk, kill, mutation, pipes, program::Program, writers};
use std::path::Path;

/// A folder in memory where there is one: thousands of small files are written.
fn folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }
        .expect("a temporary folder")
}

fn program() -> Program {
    Program::new(Path::new(env!("CARGO_BIN_EXE_lastlight")))
}

#[test]
fn damaged_files_are_refused_or_read() {
    let (program, scratch) = (program(), folder());
    let shop = scratch.path().join("shop");
    std::fs::create_dir(&shop).expect("made");
    let mut all = bases::all(&program, &shop);
    let settings = mutation::Settings { seed: 1, first: 0, runs: 2000, jobs: 2 };
    let report =
        mutation::run(&program, &mut all, &settings, scratch.path(), &|_| {}).expect("files and processes");
    println!("{report}");
    assert_eq!(report.total(0), 2000, "all executions");
    assert!(report.total(1) > 100 && report.total(2) > 1000, "some are accepted, most are refused");
    assert_eq!(report.faults(), 0, "faults, listed above");
}

/// A program that reads its valid file and is wrong about every other one, in a way that depends on the size of the file.
const WRONG: &str = r#"#!/bin/sh
[ "$(cat "$1" 2>/dev/null)" = "valid 1" ] && exit 0
size=$(wc -c 2>/dev/null <"$1" || echo 0)
case $((size % 6)) in
0) exit 101 ;;
1) kill -9 $$ ;;
2) printf 'error: %s: \033[31mred\n' "$1" >&2; exit 2 ;;
3) echo 'error: bad' >&2; exit 2 ;;
4) touch out; echo "error: $1: bad" >&2; exit 2 ;;
5) echo 'memory allocation of 9 bytes failed' >&2; kill -6 $$ ;;
esac
"#;

#[test]
fn a_wrong_program_is_found_out() {
    use std::os::unix::fs::PermissionsExt;
    let scratch = folder();
    let path = scratch.path().join("wrong.sh");
    std::fs::write(&path, WRONG).expect("written");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("made executable");
    let base = bases::Base {
        format: "text",
        files: [("a.txt".to_owned(), b"valid 1".to_vec())].into(),
        damaged: vec!["a.txt".into()],
        commands: vec!["{file}"],
        share: 1,
        same_digest: false,
        optional: false,
    };
    let settings = |jobs| mutation::Settings { seed: 3, first: 0, runs: 60, jobs };
    let run = |jobs| {
        let report = mutation::run(
            &Program::new(&path),
            &mut vec![base.clone()],
            &settings(jobs),
            scratch.path(),
            &|_| {},
        );
        report.expect("files and processes")
    };
    let report = run(2);
    println!("{report}");
    for (column, name) in mutation::COLUMNS.iter().enumerate().skip(mutation::FAULTS) {
        // It always ends, and prints no digest.
        let never = ["time", "digest"].contains(name);
        assert_eq!(report.total(column) > 0, !never, "faults of the column '{name}'");
    }
    assert_eq!(report.faults(), report.findings.len() as u64, "every fault is listed with its case");
    assert_eq!(run(1).to_string(), report.to_string(), "the same cases on any number of workers");
}

#[test]
fn an_interrupted_command_goes_on_to_the_same_result() {
    let (program, scratch) = (program(), folder());
    let report = kill::run(&program, 1, 0..12, false, scratch.path()).expect("files and processes");
    println!("{report}");
    assert_eq!(report.total(0), 12, "all trials");
    assert!(report.total(2) + report.total(3) > 4, "some are ended before they are done");
    assert_eq!(report.faults(), 0, "faults, listed above");
}

/// Only limits of file size: a small file system needs the right to mount it.
#[test]
fn a_full_disk_leaves_no_half_file() {
    let (program, scratch) = (program(), folder());
    let report = disk::run(&program, 1, 0..9, false, scratch.path()).expect("files and processes");
    println!("{report}");
    assert!(report.total(3) > 2, "some have no room");
    assert_eq!(report.faults(), 0, "faults, listed above");
}

#[test]
fn closed_and_full_streams_change_nothing() {
    let (program, scratch) = (program(), folder());
    let report = pipes::run(&program, 5, scratch.path()).expect("files and processes");
    println!("{report}");
    assert!(report.total(0) > 30, "every fifth run of all commands");
    assert_eq!(report.faults(), 0, "faults, listed above");
}

#[test]
fn one_of_two_writers_is_refused() {
    let (program, scratch) = (program(), folder());
    let report = writers::run(&program, 1, 0..9, scratch.path()).expect("files and processes");
    println!("{report}");
    assert!(report.total(1) > 3, "in most trials both run at the same time");
    assert_eq!(report.faults(), 0, "faults, listed above");
}
