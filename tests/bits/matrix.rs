//! `cargo bits`: runs the digests (`tests/bits/main.rs`) in builds with and without optimisation, for every
//! vector width of this processor, against the one file of digests, `tests/bits.toml`.
//!
//! ```text
//! cargo bits            the default cell; LASTLIGHT_REMINT=1 cargo bits writes tests/bits.toml anew
//! cargo bits --gate     the default cell, the debug cell, the control without AVX2 and FMA, and one further cell, chosen by the commit;
//!                       all cells where the last full run was of something else, or git cannot name the commit
//! cargo bits --all      all cells; when all passed and what decides bits is the same, records the run in tests/bits-full.toml
//! cargo bits --list     names of the cells, and which ones --gate would run
//! ```
//!
//! A cell is a build and a width of matrix products (registers of 8 or 16 lanes, chosen at run time). The
//! release build for the default width is that of `cargo test --release --workspace`; builds for other
//! processors go to `target/bits`. The default cell runs 1, 2, 3 and 7 threads, the others 1 and 7.
//!
//! The last full run is one of what is here when the hash of what decides bits (`deciding.rs`) is that of the
//! record, and the record has every cell that this machine can run.

#![expect(clippy::disallowed_types, reason = "seconds of every cell, for people")]

mod deciding;

use deciding::{Head, output};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// The repository, from this package.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The record of the last full run, from the root.
const RECORD: &str = "tests/bits-full.toml";

/// How the tests are built.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Profile {
    Release,
    Debug,
    /// Without any optimisation: digests of operators only.
    Unoptimised,
}

/// One build and one width of matrix products.
struct Cell {
    name: String,
    profile: Profile,
    /// the processor that is compiled for; `None` is the default of `.cargo/config.toml`
    cpu: Option<&'static str>,
    /// what the test program prints
    built: &'static str,
    lanes: u32,
    /// glibc without its variants for AVX2 and FMA
    narrow_libm: bool,
    /// threads to run with
    threads: &'static str,
    /// run by every gate
    always: bool,
}

/// The outcome of a cell.
struct Outcome {
    passed: bool,
    /// digest of the system's libm, as the test program prints it
    libm: Option<String>,
}

/// Whether this processor has an instruction set.
fn has(name: &str) -> bool {
    fs::read_to_string("/proc/cpuinfo").is_ok_and(|text| text.split_whitespace().any(|word| word == name))
}

/// All cells of this machine, and why others are missing.
fn cells() -> (Vec<Cell>, Vec<String>) {
    let (mut cells, mut missing) = (Vec::new(), Vec::new());
    let wide = ["avx512f", "avx512vl", "avx512bw", "avx512dq", "avx512cd"].into_iter().all(has);
    let widths: &[u32] = if wide { &[16, 8] } else { &[8] };
    let mut add = |build: &str, profile, cpu, built, lanes, always| {
        cells.push(Cell {
            name: format!("{build}, {lanes} lanes"),
            profile,
            cpu,
            built,
            lanes,
            narrow_libm: false,
            threads: "1,7",
            always,
        });
    };
    let x86 = cfg!(target_arch = "x86_64");
    let (default, built) = match (x86, has("avx2")) {
        (true, true) => ("x86-64-v3", ["release avx2", "debug avx2"]),
        _ => (std::env::consts::ARCH, ["release narrow", "debug narrow"]),
    };
    for (i, &lanes) in widths.iter().enumerate() {
        add(&format!("release {default}"), Profile::Release, None, built[0], lanes, i == 0);
        add(&format!("debug {default}"), Profile::Debug, None, built[1], lanes, i == 0);
        add(&format!("opt-level 0 {default}"), Profile::Unoptimised, None, built[1], lanes, false);
    }
    if x86 {
        for &lanes in widths {
            add("release x86-64", Profile::Release, Some("x86-64"), "release narrow", lanes, false);
        }
        add("debug x86-64", Profile::Debug, Some("x86-64"), "debug narrow", 8, false);
        if wide {
            for &lanes in widths {
                add(
                    "release x86-64-v4",
                    Profile::Release,
                    Some("x86-64-v4"),
                    "release avx512f",
                    lanes,
                    false,
                );
            }
            add("debug x86-64-v4", Profile::Debug, Some("x86-64-v4"), "debug avx512f", 16, false);
        } else {
            missing.push("release, debug x86-64-v4: this processor has no AVX-512".to_owned());
        }
    } else {
        missing.push(format!("x86-64, x86-64-v3, x86-64-v4: this is {default}"));
    }
    cells[0].threads = "1,2,3,7";
    if !(x86 && has("avx2") && has("fma")) {
        missing.push("without AVX2 and FMA in libm: this processor has neither".to_owned());
    } else if !glibc() {
        missing.push("without AVX2 and FMA in libm: the C library is not glibc".to_owned());
    } else {
        cells.push(Cell {
            name: format!("release {default} without AVX2, FMA in libm"),
            profile: Profile::Release,
            cpu: None,
            built: built[0],
            lanes: 8,
            narrow_libm: true,
            threads: "1,7",
            always: true,
        });
    }
    (cells, missing)
}

fn glibc() -> bool {
    Command::new("getconf").arg("GNU_LIBC_VERSION").output().is_ok_and(|o| o.status.success())
}

/// The target triple of the compiler itself: naming it keeps a cell's flags off build scripts and macros.
fn host() -> String {
    compiler().lines().find_map(|line| line.strip_prefix("host: ").map(str::to_owned)).unwrap_or_default()
}

/// What the compiler prints of itself; empty when there is none.
fn compiler() -> String {
    let output = output("rustc", &["-vV"], Path::new(ROOT)).unwrap_or_default();
    String::from_utf8_lossy(&output).trim().to_owned()
}

/// The command of a cell.
fn command(cell: &Cell) -> Command {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(ROOT).arg("test");
    match cell.profile {
        Profile::Release => cargo.arg("--release"),
        Profile::Debug => &mut cargo,
        Profile::Unoptimised => cargo.env("CARGO_PROFILE_DEV_OPT_LEVEL", "0"),
    };
    match cell.cpu {
        // The features of the workspace, so that the build of `cargo test --release --workspace` is reused.
        None if cell.profile == Profile::Release => cargo.arg("--workspace"),
        None => cargo.args(["-p", "lastlight-tests-bits"]),
        Some(cpu) => cargo
            .args(["-p", "lastlight-tests-bits"])
            .env("RUSTFLAGS", format!("-C target-cpu={cpu}"))
            .env("CARGO_BUILD_TARGET", host())
            .env("CARGO_TARGET_DIR", target().join("bits")),
    };
    cargo.args(["--test", "bits", "--", "--test-threads=1", "--nocapture"]);
    if cell.profile == Profile::Unoptimised {
        cargo.arg("operators");
    }
    if cell.narrow_libm {
        // The spelling of glibc since 2.33; it ignores unknown names, so the digest of libm itself has to
        // differ.
        cargo.env("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F");
    }
    cargo.env("LASTLIGHT_LANES", cell.lanes.to_string()).env("LASTLIGHT_BITS_THREADS", cell.threads);
    cargo
}

/// The folder of builds.
fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| Path::new(ROOT).join("target"), PathBuf::from)
}

/// Runs a cell and prints its line.
fn run(cell: &Cell) -> Outcome {
    let start = Instant::now();
    let output = command(cell).output();
    let (ended, text) = match &output {
        Ok(o) => (o.status.success(), [&o.stdout[..], &o.stderr[..]].concat()),
        Err(e) => (false, e.to_string().into_bytes()),
    };
    let text = String::from_utf8_lossy(&text).into_owned();
    let wanted = format!("built as: {}, products of {} lanes", cell.built, cell.lanes);
    let named = text.lines().any(|line| line.ends_with(&wanted));
    let passed = ended && named;
    let counted = text.lines().find_map(|line| line.strip_prefix("test result: ok. ")).unwrap_or("");
    let counted = counted.split(';').next().unwrap_or("");
    println!(
        "{:<5} {:<46} {:>5} s  {counted}",
        if passed { "ok" } else { "FAIL" },
        cell.name,
        start.elapsed().as_secs()
    );
    if !passed {
        let lines: Vec<&str> = text.lines().collect();
        for line in &lines[lines.len().saturating_sub(40)..] {
            println!("    {line}");
        }
        if ended {
            println!("    the test program does not print '{wanted}'");
        }
    }
    let libm = text.lines().find_map(|line| line.split_once("system libm: ")).map(|(_, x)| x.to_owned());
    Outcome { passed, libm }
}

/// What a record of this tree and this machine names.
fn head(cells: &[Cell]) -> Result<Head, String> {
    let root = Path::new(ROOT);
    let processor = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let processor = processor.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or("unknown");
    let mut flags = vec!["those of .cargo/config.toml".to_owned()];
    for cpu in cells.iter().filter_map(|cell| cell.cpu) {
        let flag = format!("-C target-cpu={cpu}");
        if !flags.contains(&flag) {
            flags.push(flag);
        }
    }
    let compiler = compiler();
    Ok(Head {
        commit: deciding::commit(root, RECORD)?,
        toolchain: compiler.lines().next().unwrap_or_default().to_owned(),
        flags: flags.join(", "),
        processor: processor.trim_start_matches([' ', '\t', ':']).to_owned(),
        hash: deciding::deciding(root, &compiler)?,
    })
}

/// The further cell of a commit: the first eight hexadecimal digits of its name, modulo the number of cells
/// that no gate runs anyway.
fn chosen<'a>(cells: &'a [Cell], commit: &str) -> Option<&'a Cell> {
    let others: Vec<&Cell> = cells.iter().filter(|cell| !cell.always).collect();
    let number = commit.get(..8).and_then(|digits| usize::from_str_radix(digits, 16).ok())?;
    others.get(number.checked_rem(others.len())?).copied()
}

/// Why the last full run does not count.
fn stale(head: &Result<Head, String>, cells: &[Cell], record: Option<&str>) -> Option<String> {
    let names: Vec<&str> = cells.iter().map(|cell| &*cell.name).collect();
    match (head, record) {
        (Err(e), _) => Some(format!("the inputs that decide bits cannot be hashed: {e}")),
        (Ok(_), None) => Some(format!("there is no {RECORD}")),
        (Ok(head), Some(text)) if !deciding::is_of(text, &head.hash, &names) => {
            Some(format!("{RECORD} is of something else, or lacks a cell of this machine"))
        }
        _ => None,
    }
}

/// The cells that the gate runs; with the reason where these are all.
fn gate<'a>(cells: &'a [Cell], commit: &str, stale: Option<String>) -> (Vec<&'a Cell>, Option<String>) {
    let further = chosen(cells, commit);
    let why = stale.or_else(|| further.is_none().then(|| "git names no commit".to_owned()));
    let is_run = |cell: &&Cell| why.is_some() || cell.always || further.is_some_and(|f| f.name == cell.name);
    (cells.iter().filter(is_run).collect(), why)
}

/// Whether the control proves that the C library is not used: it ran with another libm than the other cells,
/// as both digests show.
fn is_proven(libms: &[Option<String>; 2]) -> bool {
    matches!(libms, [Some(wide), Some(narrow)] if wide != narrow)
}

/// Variables that change how cells are built.
fn is_refused(name: &str) -> bool {
    ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_RUSTFLAGS"].contains(&name)
        || name.starts_with("CARGO_PROFILE_")
        || name.starts_with("CARGO_TARGET_") && name.ends_with("_RUSTFLAGS")
}

/// Runs cells, prints a summary; whether all passed.
fn run_all(cells: &[&Cell], missing: &[String]) -> bool {
    let mut passed = 0;
    let mut libms: [Option<String>; 2] = [None, None];
    let mut control = None;
    for cell in cells {
        let outcome = run(cell);
        passed += usize::from(outcome.passed);
        if cell.narrow_libm {
            control = Some(outcome.passed);
        }
        let libm = &mut libms[usize::from(cell.narrow_libm)];
        *libm = libm.take().or(outcome.libm);
    }
    if let Some(has_passed) = control
        && !is_proven(&libms)
    {
        println!(
            "FAIL  the control proves nothing: GLIBC_TUNABLES has no effect here, or no digest of libm was printed"
        );
        passed -= usize::from(has_passed);
    }
    let failed = cells.len() - passed;
    for why in missing {
        println!("skip  {why}");
    }
    println!("bits: {passed} cells passed, {failed} failed, {} skipped", missing.len());
    failed == 0
}

/// Runs all cells and records the run, if they pass and nothing that decides bits has changed meanwhile.
fn run_and_record(cells: &[Cell], missing: &[String], before: Result<Head, String>) -> bool {
    let before = match before {
        Ok(before) => before,
        Err(e) => {
            eprintln!("cargo bits: the run could not be recorded: {e}");
            return false;
        }
    };
    let every: Vec<&Cell> = cells.iter().collect();
    if !run_all(&every, missing) {
        return false;
    }
    let Some(head) = head(cells).ok().and_then(|after| before.until(&after)) else {
        println!("FAIL  not recorded: what decides bits changed while the cells ran");
        return false;
    };
    let names: Vec<&str> = cells.iter().map(|cell| &*cell.name).collect();
    fs::write(Path::new(ROOT).join(RECORD), deciding::print(&head, &names))
        .expect("tests/bits-full.toml can be written");
    println!("recorded in {RECORD}");
    true
}

fn main() -> ExitCode {
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy();
        if is_refused(&name) {
            eprintln!("cargo bits: unset {name}; every cell sets its own flags");
            return ExitCode::from(2);
        }
    }
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if !arguments.is_empty() && std::env::var_os("LASTLIGHT_REMINT").is_some_and(|v| v == "1") {
        eprintln!(
            "cargo bits: LASTLIGHT_REMINT=1 writes the digests of the default cell; use it without arguments"
        );
        return ExitCode::from(2);
    }
    let (cells, missing) = cells();
    let plan = || {
        let head = head(&cells);
        let record = fs::read_to_string(Path::new(ROOT).join(RECORD)).ok();
        let stale = stale(&head, &cells, record.as_deref());
        let commit = output("git", &["rev-parse", "HEAD"], Path::new(ROOT)).unwrap_or_default();
        gate(&cells, &String::from_utf8_lossy(&commit), stale)
    };
    let good = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        // The program's own output, for people.
        [] => command(&cells[0]).status().is_ok_and(|status| status.success()),
        ["--list"] => {
            let (chosen, why) = plan();
            for cell in &cells {
                let mark = if chosen.iter().any(|g| g.name == cell.name) { "gate" } else { "" };
                println!("{mark:<5} {}", cell.name);
            }
            match why {
                None => println!("{RECORD} is of what is here"),
                Some(why) => println!("--gate runs all cells: {why}"),
            }
            true
        }
        ["--gate"] => {
            let (chosen, why) = plan();
            if let Some(why) = why {
                println!("all cells: {why}");
            }
            run_all(&chosen, &missing)
        }
        ["--all"] => run_and_record(&cells, &missing, head(&cells)),
        _ => {
            eprintln!("usage: cargo bits [--gate | --all | --list]");
            return ExitCode::from(2);
        }
    };
    if good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_cell_is_first_and_every_gate_runs_three() {
        let (cells, _) = cells();
        assert_eq!(cells[0].threads, "1,2,3,7", "the default cell runs every number of threads");
        assert!(cells[0].always && cells[0].cpu.is_none(), "and is of every gate");
        assert!((2..=3).contains(&cells.iter().filter(|cell| cell.always).count()), "debug and control, too");
        let mut names: Vec<&str> = cells.iter().map(|cell| &*cell.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), cells.len(), "names are unique");
    }

    #[test]
    fn every_further_cell_is_some_commits() {
        let (cells, _) = cells();
        let others = cells.iter().filter(|cell| !cell.always).count();
        let mut seen: Vec<String> = (0..others)
            .map(|i| chosen(&cells, &format!("{i:08x}00")).expect("a cell").name.clone())
            .collect();
        seen.sort();
        seen.dedup();
        assert_eq!(seen.len(), others, "the remainders are all cells");
        assert!(chosen(&cells, "").is_none(), "no commit, no further cell");
    }

    #[test]
    fn the_gate_runs_all_cells_where_it_cannot_choose() {
        let (cells, _) = cells();
        let always = cells.iter().filter(|cell| cell.always).count();
        let (some, why) = gate(&cells, "0123456789", None);
        assert_eq!((some.len(), why), (always + 1, None), "one further cell");
        let (all, why) = gate(&cells, "", None);
        assert!(all.len() == cells.len() && why.is_some_and(|w| w.contains("git")), "no commit");
        let (all, why) = gate(&cells, "0123456789", Some("changed".to_owned()));
        assert_eq!((all.len(), why.as_deref()), (cells.len(), Some("changed")), "another record");
    }

    #[test]
    fn a_record_counts_with_its_hash_and_all_cells_of_this_machine() {
        let (cells, _) = cells();
        let names: Vec<&str> = cells.iter().map(|cell| &*cell.name).collect();
        let head = |hash: &str| Head {
            commit: "c".to_owned(),
            toolchain: "t".to_owned(),
            flags: "f".to_owned(),
            processor: "p".to_owned(),
            hash: hash.to_owned(),
        };
        let record = deciding::print(&head("aa"), &names);
        assert_eq!(stale(&Ok(head("aa")), &cells, Some(&record)), None, "it is of this");
        assert!(stale(&Ok(head("ab")), &cells, Some(&record)).is_some(), "another hash");
        assert!(stale(&Ok(head("aa")), &cells, None).is_some(), "no record");
        assert!(stale(&Err("no git".to_owned()), &cells, Some(&record)).is_some(), "no hash");
        let fewer = deciding::print(&head("aa"), &names[1..]);
        assert!(stale(&Ok(head("aa")), &cells, Some(&fewer)).is_some(), "a cell was not run");
    }

    #[test]
    fn the_hash_of_this_repository_is_known() {
        let here = deciding::deciding(Path::new(ROOT), "rustc").expect("every place has files");
        assert_eq!(here, deciding::deciding(Path::new(ROOT), "rustc").expect("again"), "the same twice");
    }

    #[test]
    fn the_control_needs_two_digests_that_differ() {
        let some = |text: &str| Some(text.to_owned());
        assert!(is_proven(&[some("a"), some("b")]), "another libm");
        for libms in [[some("a"), some("a")], [some("a"), None], [None, some("b")], [None, None]] {
            assert!(!is_proven(&libms), "{libms:?}");
        }
    }

    #[test]
    fn flags_and_profiles_of_the_environment_are_refused() {
        for name in [
            "RUSTFLAGS",
            "CARGO_ENCODED_RUSTFLAGS",
            "CARGO_BUILD_RUSTFLAGS",
            "CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUSTFLAGS",
            "CARGO_PROFILE_RELEASE_OPT_LEVEL",
            "CARGO_PROFILE_DEV_DEBUG",
        ] {
            assert!(is_refused(name), "{name}");
        }
        for name in ["CARGO_TARGET_DIR", "CARGO_INCREMENTAL", "CARGO_BUILD_JOBS", "RUSTDOCFLAGS", "CARGO"] {
            assert!(!is_refused(name), "{name}");
        }
    }
}
