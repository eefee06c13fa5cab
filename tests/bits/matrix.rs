//! `cargo bits`: runs the digests (`tests/bits/main.rs`) in builds with and without optimisation, for every vector width of this processor, against the one
//! file of digests, `tests/bits.toml`.
//!
//! ```text
//! cargo bits            the default cell; LASTLIGHT_REMINT=1 cargo bits writes tests/bits.toml anew
//! cargo bits --gate     the default cell, the debug cell, the control without AVX2 and FMA, and one further cell, chosen by the commit;
//!                       all cells where what decides bits differs from the last full run
//! cargo bits --all      all cells; when all passed, records the run in tests/bits-full.toml
//! cargo bits --list     names of the cells, and which ones --gate would run
//! ```
//!
//! A cell is a build and a width of matrix products (registers of 8 or 16 lanes, chosen at run time). The release build for the default width is that of
//! `cargo test --release --workspace`; builds for other processors go to `target/bits`. The default cell runs 1, 2, 3 and 7 threads, the others 1 and 7.
//!
//! What decides bits: the members `num` and `kernels`, the lock file, the toolchain, flags and profiles. Their hash is in `tests/bits-full.toml`, with the commit
//! of the last full run.

#![expect(clippy::disallowed_types, reason = "seconds of every cell, for people")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// The repository, from this package.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The record of the last full run, from the root.
const RECORD: &str = "tests/bits-full.toml";

/// What decides bits beside the code of an operator's own file, from the root: folders with everything in them, or files.
const DECIDING: [&str; 5] =
    ["src/num", "src/kernels", "Cargo.lock", "rust-toolchain.toml", ".cargo/config.toml"];

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
    /// what the test program must say of itself
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
    printed("rustc", &["-vV"])
        .lines()
        .find_map(|line| line.strip_prefix("host: ").map(str::to_owned))
        .unwrap_or_default()
}

/// Standard output of a program, trimmed; empty when it fails.
fn printed(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).current_dir(ROOT).output();
    output.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned()).unwrap_or_default()
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
        // The features of the whole workspace: what `cargo test --release --workspace` compiled serves.
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
        // The spelling of glibc since 2.33; it ignores names it does not know, so the digest of libm itself has to differ.
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
            println!("    the test program does not say '{wanted}'");
        }
    }
    let libm = text.lines().find_map(|line| line.split_once("system libm: ")).map(|(_, x)| x.to_owned());
    Outcome { passed, libm }
}

/// FNV-1a over names and bytes of everything that decides bits, in the order of names.
fn deciding() -> String {
    let mut files = Vec::new();
    for place in DECIDING {
        walk(&Path::new(ROOT).join(place), place, &mut files);
    }
    files.sort();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut take = |bytes: &[u8]| {
        for byte in bytes.iter().chain(&(bytes.len() as u64).to_le_bytes()) {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
        }
    };
    for (name, path) in &files {
        take(name.as_bytes());
        take(&fs::read(path).unwrap_or_default());
    }
    // Of the root manifest the profiles.
    let manifest = fs::read_to_string(Path::new(ROOT).join("Cargo.toml")).unwrap_or_default();
    for section in manifest.split("\n[").filter(|section| section.starts_with("profile.")) {
        take(section.trim_end().as_bytes());
    }
    format!("{hash:016x}")
}

fn walk(path: &Path, name: &str, files: &mut Vec<(String, PathBuf)>) {
    let Ok(entries) = fs::read_dir(path) else {
        files.push((name.to_owned(), path.to_owned()));
        return;
    };
    for entry in entries.flatten() {
        let inner = format!("{name}/{}", entry.file_name().to_string_lossy());
        walk(&entry.path(), &inner, files);
    }
}

/// The record as text: what decides bits, and what this machine ran.
fn record(cells: &[Cell]) -> String {
    let names: Vec<String> = cells.iter().map(|cell| format!("    \"{}\",\n", cell.name)).collect();
    let processor = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let processor = processor.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or("unknown");
    format!(
        "# The last run of all cells of the bit matrix, written by `cargo bits --all`. The gate runs all of them again when `hash` (of {}, and the \
         profiles) has changed.\ncommit = \"{}\"\ntoolchain = \"{}\"\nflags = \"{}\"\nprocessor = \"{}\"\nhash = \"{}\"\ncells = [\n{}]\n",
        DECIDING.join(", "),
        printed("git", &["rev-parse", "HEAD"]),
        printed("rustc", &["--version"]),
        "-C target-cpu=x86-64-v3 (default), x86-64, x86-64-v4",
        processor.trim_start_matches([' ', '\t', ':']),
        deciding(),
        names.concat()
    )
}

/// The further cell of a commit: the first eight hexadecimal digits of its name, modulo the number of cells that no gate runs anyway.
fn chosen<'a>(cells: &'a [Cell], commit: &str) -> Option<&'a Cell> {
    let others: Vec<&Cell> = cells.iter().filter(|cell| !cell.always).collect();
    let number = commit.get(..8).and_then(|digits| usize::from_str_radix(digits, 16).ok())?;
    others.get(number.checked_rem(others.len())?).copied()
}

/// Whether the last full run was of what is here now.
fn recorded() -> bool {
    let line = format!("hash = \"{}\"", deciding());
    fs::read_to_string(Path::new(ROOT).join(RECORD)).is_ok_and(|text| text.lines().any(|l| l == line))
}

/// Runs cells, prints a summary; whether all passed.
fn run_all(cells: &[&Cell], missing: &[String]) -> bool {
    let mut failed = 0;
    let mut libms: [Option<String>; 2] = [None, None];
    for cell in cells {
        let outcome = run(cell);
        failed += usize::from(!outcome.passed);
        let libm = &mut libms[usize::from(cell.narrow_libm)];
        *libm = libm.take().or(outcome.libm);
    }
    if cells.iter().any(|cell| cell.narrow_libm) && libms[0].is_some() && libms[0] == libms[1] {
        println!("FAIL  GLIBC_TUNABLES has no effect here: the control proves nothing");
        failed += 1;
    }
    for why in missing {
        println!("skip  {why}");
    }
    println!(
        "bits: {} cells passed, {failed} failed, {} skipped",
        cells.len().saturating_sub(failed),
        missing.len()
    );
    failed == 0
}

fn main() -> ExitCode {
    for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS"] {
        if std::env::var_os(name).is_some() {
            eprintln!("cargo bits: unset {name}; every cell sets its own flags");
            return ExitCode::from(2);
        }
    }
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (cells, missing) = cells();
    let commit = printed("git", &["rev-parse", "HEAD"]);
    let gate: Vec<&Cell> = {
        let further = chosen(&cells, &commit).map(|cell| &*cell.name);
        cells.iter().filter(|cell| cell.always || Some(&*cell.name) == further).collect()
    };
    let every: Vec<&Cell> = cells.iter().collect();
    let good = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        // The program's own output, for people.
        [] => command(&cells[0]).status().is_ok_and(|status| status.success()),
        ["--list"] => {
            for cell in &cells {
                let mark = if gate.iter().any(|g| g.name == cell.name) { "gate" } else { "" };
                println!("{mark:<5} {}", cell.name);
            }
            println!(
                "{RECORD} is {}",
                if recorded() { "of what is here" } else { "of something else: --gate runs all" }
            );
            true
        }
        ["--gate"] if recorded() => run_all(&gate, &missing),
        ["--gate"] => {
            println!("what decides bits has changed since the run in {RECORD}: all cells");
            run_all(&every, &missing)
        }
        ["--all"] => {
            let good = run_all(&every, &missing);
            if good {
                fs::write(Path::new(ROOT).join(RECORD), record(&cells))
                    .expect("tests/bits-full.toml can be written");
                println!("recorded in {RECORD}");
            }
            good
        }
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
    fn the_hash_is_of_names_and_bytes() {
        let here = deciding();
        assert_eq!(here.len(), 16, "64 bits");
        assert_eq!(here, deciding(), "the same twice");
    }
}
