//! The bit contract: digests of every operator, forward and adjoint, and of every system, against
//! `tests/bits.toml`.
//!
//! One process checks any number of threads; `cargo bits` (`matrix.rs`) runs this file in builds for other
//! processors, with and without optimisation. The file of digests is the same in all of them. `cargo bits`
//! runs this one; `LASTLIGHT_REMINT=1 cargo bits` writes the file anew.

#[path = "../common/ball.rs"]
mod ball;
mod ledger;
mod lirm;
mod object;
mod person;
mod runs;

use lastlight::num::bits::Digest;
use lastlight::num::{env, par};
use lastlight::ops;
use ledger::Line;
use runs::Entry;

/// Numbers of threads, `LASTLIGHT_BITS_THREADS` separated by commas or all four; the results of the first are
/// compared first.
fn threads() -> Vec<usize> {
    let listed = std::env::var("LASTLIGHT_BITS_THREADS").unwrap_or_else(|_| "1,2,3,7".to_owned());
    listed.split(',').map(|n| n.trim().parse().expect("numbers of threads, separated by commas")).collect()
}

fn reminting() -> bool {
    std::env::var_os("LASTLIGHT_REMINT").is_some_and(|v| v == "1")
}

/// How this binary was built, as `cargo bits` expects it to have been.
fn cell() -> String {
    let vectors = if cfg!(target_feature = "avx512f") {
        "avx512f"
    } else if cfg!(target_feature = "avx2") {
        "avx2"
    } else {
        "narrow"
    };
    let build = if cfg!(debug_assertions) { "debug" } else { "release" };
    format!("{build} {vectors}, products of {} lanes", lastlight::num::gemm::product_lanes())
}

fn in_threads<T: Send>(n: usize, f: impl FnOnce() -> T + Send) -> T {
    par::with_threads(n, f).unwrap_or_else(|e| panic!("{e}"))
}

/// Holds entries to the lines of the file. Stops at the first that differs: what follows rests on it.
fn compare(lines: &[Line], entries: &[Entry], threads: usize) {
    for entry in entries {
        let (digest, shape) = (entry.digest(), entry.shape());
        let line = lines.iter().find(|l| l.name == entry.name);
        let line =
            line.unwrap_or_else(|| panic!("'{}' has no line in tests/bits.toml, ours: {digest}", entry.name));
        assert_eq!(line.shape, shape, "'{}' with {threads} threads: names or shapes of arrays", entry.name);
        assert!(
            line.digest == digest,
            "'{}' is the first to differ, with {threads} threads: expected {}, ours {digest}, of which{}",
            entry.name,
            line.digest,
            entry.details()
        );
    }
}

fn all() -> Vec<Entry> {
    let operators = ops::LIST.iter().flat_map(|op| runs::operator(op));
    let twins = ops::LIST.iter().flat_map(|op| runs::twin(op));
    runs::foundations().into_iter().chain(operators).chain(twins).chain(runs::systems()).collect()
}

/// Compares, or writes with LASTLIGHT_REMINT=1; the other tests then have nothing to compare with.
#[test]
fn operators() {
    env::probe().expect("the floating-point environment is the default one");
    if reminting() {
        assert!(std::env::var_os("CI").is_none(), "digests are minted by people, not by CI");
        let new = in_threads(1, all);
        let new = new.iter().map(|e| Line {
            name: e.name.clone(),
            digest: e.digest(),
            shape: e.shape(),
            why: String::new(),
        });
        let lines = ledger::merge(&ledger::load(), new.collect());
        let changed = lines.iter().filter(|l| l.why.is_empty()).count();
        std::fs::write(ledger::path(), ledger::print(&lines)).expect("tests/bits.toml can be written");
        println!("{} digests written, {changed} of them changed and waiting for a reason", lines.len());
        return;
    }
    println!("built as: {}", cell());
    let lines = ledger::load();
    for n in threads() {
        compare(&lines, &in_threads(n, runs::foundations), n);
        for op in ops::LIST {
            compare(&lines, &in_threads(n, || runs::operator(op)), n);
        }
    }
}

/// The twin has one thread, and golden files are minted from it, the same on every machine.
#[test]
fn twins() {
    if reminting() {
        return;
    }
    let lines = ledger::load();
    for op in ops::LIST {
        compare(&lines, &runs::twin(op), 1);
    }
}

#[test]
fn systems() {
    if reminting() {
        return;
    }
    let lines = ledger::load();
    for n in threads() {
        compare(&lines, &in_threads(n, runs::systems), n);
    }
}

#[test]
fn nothing_is_missing_from_the_file_and_nothing_is_left_over() {
    if reminting() {
        return;
    }
    let in_file: Vec<String> = ledger::load().into_iter().map(|l| l.name).collect();
    let foundations = runs::FOUNDATIONS.map(str::to_owned);
    let names = [runs::operator_names(), runs::twin_names(), runs::system_names()];
    let expected: Vec<String> = foundations.into_iter().chain(names.into_iter().flatten()).collect();
    let without =
        |a: &[String], b: &[String]| a.iter().filter(|n| !b.contains(n)).cloned().collect::<Vec<_>>();
    let (missing, left_over) = (without(&expected, &in_file), without(&in_file, &expected));
    assert!(missing.is_empty(), "tests/bits.toml lacks {missing:?}");
    assert!(left_over.is_empty(), "tests/bits.toml has {left_over:?}, which nothing runs");
    assert!(in_file == expected, "tests/bits.toml is not in the order in which things are run");
}

#[test]
fn every_digest_says_why_it_is_what_it_is() {
    if reminting() {
        return;
    }
    for l in ledger::load() {
        assert!(!l.why.trim().is_empty(), "'{}': state in tests/bits.toml why this digest changed", l.name);
        assert_eq!(l.digest.len(), 16, "'{}': 16 hexadecimal digits", l.name);
    }
}

#[test]
fn the_file_survives_reading_and_writing_and_a_changed_digest_loses_its_reason() {
    let line = |name: &str, digest: &str, why: &str| Line {
        name: name.to_owned(),
        digest: digest.to_owned(),
        shape: "y 2x3, scalar".to_owned(),
        why: why.to_owned(),
    };
    let old = vec![line("a/0 forward", "00", "because"), line("b/0 forward", "11", "since")];
    assert_eq!(ledger::parse(&ledger::print(&old)).expect("our own format"), old, "what was written is read");
    assert!(ledger::parse("\"a\" = { digest = \"00\" }").is_err(), "a line without its columns");
    let new =
        vec![line("a/0 forward", "00", ""), line("b/0 forward", "12", ""), line("c/0 forward", "22", "")];
    let whys: Vec<String> = ledger::merge(&old, new).into_iter().map(|l| l.why).collect();
    assert_eq!(whys, ["because", "", ledger::FIRST], "kept, emptied, new");
}

#[test]
fn a_nan_is_a_failure_and_a_changed_bit_another_digest() {
    let entry = |x: f32| Entry {
        name: "x".to_owned(),
        arrays: lastlight::num::array::Arrays::new().with("y", &[1], vec![x]),
    };
    assert_ne!(entry(0.0).digest(), entry(-0.0).digest(), "the sign of a zero counts");
    assert_ne!(entry(1.0).digest(), entry(1.0 + f32::EPSILON).digest(), "and so does the last place");
    let nan = entry(f32::NAN).try_digest().expect_err("a NaN has no digest").to_string();
    assert!(nan.contains("array 'y'") && nan.contains("NaN"), "{nan}");
}

/// What the library must not use, as a control: its digest is printed and compared with that of a run under
/// `GLIBC_TUNABLES` by `cargo bits`. If it moves, a use of it in an operator would have moved a digest above.
#[test]
#[expect(clippy::disallowed_methods, reason = "the system's libm is what is observed here")]
fn system_libm_control() {
    let mut digest = Digest::new();
    for i in 0..4096_u32 {
        let x = std::hint::black_box(f64::from(i) * 0.003_7 + 0.001);
        for y in [x.sin(), x.cos(), x.exp(), x.ln(), x.powf(1.3), x.atan()] {
            digest.u64(y.to_bits());
        }
        let x = x as f32;
        for y in [x.sin(), x.cos(), x.exp(), x.ln(), x.powf(1.3)] {
            digest.u64(u64::from(y.to_bits()));
        }
    }
    println!("system libm: {:016x}", digest.value());
}
