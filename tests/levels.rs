//! The levels of the library: a file may use its own folder and any folder of a smaller number, never another of its own
//! level or above. Read off the paths `crate::…` (and `super::super::…` is not a way around).

use std::fs;
use std::path::{Path, PathBuf};

/// Folders and files directly under `src/` with their levels.
const LEVELS: &[(&str, u32)] = &[
    ("error", 0),
    ("num", 0),
    ("math", 1),
    ("io", 2),
    ("scene", 3),
    ("nn", 4),
    ("geometry", 4),
    ("splat", 5),
    ("field", 5),
    ("shade", 5),
    ("causal", 5),
    ("body", 5),
    ("loss", 6),
    ("tape", 7),
    ("optim", 8),
    ("ops", 9),
    ("fit", 9),
    ("last", 10),
    ("lirm", 10),
    ("oracle", 11),
    ("study", 12),
    ("cli", 13),
];

/// Outside the levels: the roots and the book.
const FREE: &[&str] = &["lib", "main", "book"];

fn level(name: &str) -> Option<u32> {
    LEVELS.iter().find(|(n, _)| *n == name).map(|(_, l)| *l)
}

fn rust_files(dir: &Path, into: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> =
        fs::read_dir(dir).expect("src is readable").map(|e| e.expect("an entry").path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            rust_files(&path, into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
}

/// First segments of every `crate::a` and `crate::{a::…, b}` in a source text, comments and tests included: a test
/// module may not reach up either.
fn arrows(text: &str) -> Vec<String> {
    let mut out = Vec::new();
    let word = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    for (at, _) in text.match_indices("crate::") {
        // `$crate::` in a macro is the library itself; `other_crate::` is another path
        let before = text[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = &text[at + "crate::".len()..];
        let Some(group) = rest.strip_prefix('{') else {
            out.push(word(rest));
            continue;
        };
        let mut depth = 0;
        let mut start = true;
        for (i, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => start = true,
                c if start && (c.is_alphanumeric() || c == '_') => {
                    out.push(word(&group[i..]));
                    start = false;
                }
                _ => {}
            }
        }
    }
    out
}

/// What is wrong with a file of folder `own`.
fn wrong(own: &str, text: &str) -> Vec<String> {
    let mine = level(own);
    let mut out = Vec::new();
    for target in arrows(text) {
        // names re-exported at the root: Error, Result (error), check (tape), macros of num
        let target = match target.as_str() {
            "Error" | "Result" => "error".to_owned(),
            "check" => "tape".to_owned(),
            "with_array" => "num".to_owned(),
            _ => target,
        };
        match (mine, level(&target)) {
            (_, None) => out.push(format!("crate::{target} has no level")),
            (Some(mine), Some(theirs))
                if target != own && target != "error" && theirs >= mine && !(own == "num" && theirs == 0) =>
            {
                out.push(format!("{own} (level {mine}) uses {target} (level {theirs})"));
            }
            _ => {}
        }
    }
    out
}

#[test]
fn no_file_uses_its_own_level_or_above() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    rust_files(&src, &mut files);
    let mut bad = Vec::new();
    let mut seen = 0;
    for path in &files {
        let inner = path.strip_prefix(&src).expect("below src");
        let first = inner.components().next().expect("a name").as_os_str().to_string_lossy();
        let own = first.strip_suffix(".rs").unwrap_or(&first);
        if FREE.contains(&own) {
            continue;
        }
        if level(own).is_none() {
            bad.push(format!("{}: '{own}' has no level", inner.display()));
            continue;
        }
        seen += 1;
        let text = fs::read_to_string(path).expect("a readable file");
        bad.extend(wrong(own, &text).into_iter().map(|w| format!("{}: {w}", inner.display())));
    }
    assert!(seen > 50, "the walk found {seen} files only");
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}

#[test]
fn the_reader_of_arrows_sees_what_it_should() {
    assert_eq!(arrows("use crate::num::par;"), ["num"], "a plain path");
    assert_eq!(
        arrows("use crate::{Error, Result, num::{par, sum}, io};"),
        ["Error", "Result", "num", "io"],
        "a group"
    );
    assert_eq!(arrows("let x = crate::splat::render::forward(); my_crate::a();"), ["splat"], "inside code");
    assert_eq!(
        wrong("math", "use crate::splat::plan;"),
        ["math (level 1) uses splat (level 5)"],
        "an arrow up"
    );
    assert_eq!(
        wrong("splat", "use crate::field::fetch;"),
        ["splat (level 5) uses field (level 5)"],
        "an arrow across"
    );
    assert_eq!(wrong("splat", "use crate::utils::x;"), ["crate::utils has no level"], "an unknown folder");
    assert!(wrong("cli", "use crate::oracle::run; use crate::Error;").is_empty(), "arrows down");
}

/// Hexadecimal constants of type u16 in a source text: what tells draws of one seed apart.
fn purposes(text: &str) -> Vec<(String, u16)> {
    let constant = |line: &str| {
        let (name, value) = line.split_once("const ")?.1.split_once(": u16 = 0x")?;
        let digits: String = value.chars().take_while(|c| *c != ';').filter(|c| *c != '_').collect();
        Some((name.to_owned(), u16::from_str_radix(&digits, 16).expect("a number of 16 bits")))
    };
    text.lines().filter_map(constant).collect()
}

#[test]
fn no_two_purposes_of_draws_are_the_same() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for folder in ["src", "data-gen/src", "reference/src"] {
        rust_files(&root.join(folder), &mut files);
    }
    let mut all = Vec::new();
    for path in &files {
        let place = path.strip_prefix(root).expect("below the root").display().to_string();
        let text = fs::read_to_string(path).expect("a readable file");
        all.extend(purposes(&text).into_iter().map(|(name, value)| (value, format!("{place} {name}"))));
    }
    all.sort();
    let twice: Vec<_> = all.windows(2).filter(|p| p[0].0 == p[1].0).collect();
    assert!(twice.is_empty(), "one number, two purposes: {twice:#x?}");
    assert!(all.len() > 30, "the walk found {} purposes only", all.len());
    let text = "pub const A: u16 = 0x05_01;\n    const B: u16 = 0x5eed; // why\nconst N: u16 = 256;";
    assert_eq!(purposes(text), [("A".to_owned(), 0x501), ("B".to_owned(), 0x5eed)], "the reader");
}

#[test]
fn the_twin_cannot_see_the_library() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (name, allowed) in [("reference", &["libm"][..]), ("data-gen", &["reference", "lastlight-reference"])]
    {
        let text = fs::read_to_string(root.join(name).join("Cargo.toml")).expect("a manifest");
        let section = text.split("[dependencies]").nth(1).expect("it has dependencies");
        let section = section.split("\n[").next().unwrap_or("");
        for line in section.lines().filter(|l| l.contains('=') && !l.trim_start().starts_with('#')) {
            let key = line.split(['=', '.', ' ']).next().unwrap_or("").trim();
            assert!(allowed.contains(&key), "{name} depends on {key}; allowed: {allowed:?}");
        }
    }
}
