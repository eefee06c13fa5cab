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
    let report = disk::run(&program, 1, 0..8, false, scratch.path()).expect("files and processes");
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
    let report = writers::run(&program, 1, 0..8, scratch.path()).expect("files and processes");
    println!("{report}");
    assert!(report.total(1) > 3, "in most trials both run at the same time");
    assert_eq!(report.faults(), 0, "faults, listed above");
}
