//! The levels of the library: a member of the workspace depends on members before it only, and a file uses its own folder and
//! folders of a smaller level, never another of its own level or above.

use super::ROOT;
use super::modules::Modules;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A member under `src/`: its name, its place in the order, and of its folders the library path and the level. `*` is every folder.
pub(crate) type Member = (&'static str, u32, &'static [(&'static str, &'static str, u32)]);

/// All of them. A member may depend on members of a smaller place.
pub(crate) const MEMBERS: &[Member] = &[
    ("num", 0, &[("error", "error", 0), ("num", "num", 0), ("math", "math", 1)]),
    ("files", 1, &[("*", "io", 2)]),
    ("scene", 2, &[("*", "scene", 3)]),
    ("import", 3, &[("io", "io", 2), ("scene", "scene", 3)]),
    (
        "kernels",
        3,
        &[
            ("nn", "nn", 4),
            ("geometry", "geometry", 4),
            ("splat", "splat", 5),
            ("field", "field", 5),
            ("shade", "shade", 5),
            ("causal", "causal", 5),
            ("body", "body", 5),
            ("loss", "loss", 6),
        ],
    ),
    (
        "train",
        4,
        &[("tape", "tape", 7), ("optim", "optim", 8), ("fit", "fit", 9), ("experiment", "experiment", 10)],
    ),
    ("oracle", 5, &[("ops", "ops", 9), ("oracle", "oracle", 11)]),
    ("last", 5, &[("*", "last", 10)]),
    ("lirm", 5, &[("*", "lirm", 10)]),
    ("study", 6, &[("*", "study", 12)]),
    ("cli", 7, &[("*", "cli", 13)]),
];

/// Library path and level of a folder of a member; the root file of a member has none.
fn level(member: &str, folder: &str) -> Option<(&'static str, u32)> {
    let (_, _, folders) = MEMBERS.iter().find(|(name, ..)| *name == member)?;
    folders.iter().find(|(name, ..)| *name == folder || *name == "*").map(|(_, path, level)| (*path, *level))
}

/// What is wrong with the arrows between folders.
fn wrong_levels(modules: &Modules) -> Vec<String> {
    let place = |module: usize| {
        let path = modules.path(module);
        let mut names = path.split("::");
        let member = names.next().expect("a member").to_owned();
        names.next().map(|folder| (level(&member, folder), path.clone()))
    };
    let mut out = Vec::new();
    for module in 0..modules.all.len() {
        if let Some((None, path)) = place(module) {
            out.push(format!("{path} has no level"));
        }
    }
    for arrow in modules.arrows() {
        let (Some((Some(own), _)), Some((Some(other), _))) = (place(arrow.from), place(arrow.to)) else {
            continue;
        };
        // the error type is below everything, and of level 0 as num is
        if own.0 != other.0 && other.1 >= own.1 && other.0 != "error" {
            out.push(format!(
                "{}: {} names {} (level {}) from {} (level {})",
                modules.all[arrow.from].file.display(),
                arrow.path,
                other.0,
                other.1,
                own.0,
                own.1
            ));
        }
    }
    out
}

#[test]
fn no_file_uses_its_own_level_or_above() {
    let mut modules = Modules::default();
    for (name, ..) in MEMBERS {
        modules.read_member(Path::new(ROOT), name);
    }
    let across = modules.arrows().iter().filter(|a| modules.root(a.from) != modules.root(a.to)).count();
    assert!(across > 1000, "the walk found {across} arrows between members only");
    let bad = wrong_levels(&modules);
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}

#[test]
fn every_source_file_is_reached_from_its_root() {
    let src = Path::new(ROOT).join("src");
    let mut modules = Modules::default();
    for (name, ..) in MEMBERS {
        modules.read_member(Path::new(ROOT), name);
    }
    let read: BTreeSet<PathBuf> = modules.all.iter().map(|m| Path::new(ROOT).join(&m.file)).collect();
    let mut files = Vec::new();
    rust_files(&src, &mut files);
    let outside = ["lib.rs", "main.rs", "book"].map(|name| src.join(name));
    let unread: Vec<_> =
        files.iter().filter(|f| !read.contains(*f) && !outside.iter().any(|o| f.starts_with(o))).collect();
    assert!(unread.is_empty(), "no module: {unread:?}");
}

#[test]
fn arrows_up_and_across_are_found() {
    let files = [
        ("kernels/lib.rs", "pub mod nn; pub mod splat; pub mod body; pub use lastlight_num::{Error, num};"),
        ("kernels/nn.rs", "use crate::splat::plan; use crate::num::par; use crate::Error;"),
        ("kernels/splat.rs", "use crate::body::skin; use crate::nn::linear;"),
        ("kernels/body.rs", "fn f() { lastlight_num::num::par() }"),
        ("num/lib.rs", "pub mod error; pub mod num; pub mod utils; pub use error::Error;"),
        ("num/error.rs", ""),
        ("num/num.rs", "use crate::error::Error;"),
        ("num/utils.rs", ""),
    ];
    let mut modules = Modules::default();
    for name in ["num", "kernels"] {
        modules.add_member(name, &Path::new(name).join("lib.rs"), &|path| {
            files.iter().find(|(file, _)| Path::new(file) == path).map(|(_, text)| (*text).to_owned())
        });
    }
    assert_eq!(
        wrong_levels(&modules),
        [
            "num::utils has no level",
            "kernels/nn.rs: crate::splat::plan names splat (level 5) from nn (level 4)",
            "kernels/splat.rs: crate::body::skin names body (level 5) from splat (level 5)",
        ],
        "an unknown folder, an arrow up, an arrow across"
    );
}

/// Members that a manifest depends on.
fn dependencies(manifest: &str) -> Vec<String> {
    let keys = manifest.lines().filter_map(|line| line.trim_start().strip_prefix("lastlight-"));
    keys.map(|line| line.chars().take_while(|c| c.is_alphanumeric() || *c == '-').collect()).collect()
}

/// What is wrong with the dependencies of a member.
fn wrong_dependencies(member: &str, manifest: &str) -> Vec<String> {
    let place = |name: &str| MEMBERS.iter().find(|(n, ..)| *n == name).map(|(_, place, _)| *place);
    let own = place(member).expect("a member");
    let bad = dependencies(manifest).into_iter().filter(|d| place(d).is_none_or(|theirs| theirs >= own));
    bad.map(|d| format!("{member} depends on {d}")).collect()
}

#[test]
fn members_depend_on_members_before_them_only() {
    let src = Path::new(ROOT).join("src");
    let mut found = BTreeSet::new();
    let mut bad = Vec::new();
    for entry in fs::read_dir(&src).expect("src is readable") {
        let path = entry.expect("an entry").path();
        let Ok(manifest) = fs::read_to_string(path.join("Cargo.toml")) else { continue };
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        bad.extend(wrong_dependencies(&name, &manifest));
        found.insert(name);
    }
    let listed: BTreeSet<String> = MEMBERS.iter().map(|(name, ..)| (*name).to_owned()).collect();
    assert_eq!(found, listed, "the members under src/");
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    let manifest = "[dependencies]\nlastlight-num.workspace = true\nlastlight-lirm = { path = \"../lirm\" }\nlibm = \"1\"";
    assert_eq!(dependencies(manifest), ["num", "lirm"], "the reader");
    assert_eq!(wrong_dependencies("last", manifest), ["last depends on lirm"], "the systems never meet");
    assert_eq!(wrong_dependencies("scene", manifest), ["scene depends on lirm"], "an arrow up");
    assert!(wrong_dependencies("cli", manifest).is_empty(), "arrows down");
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
    let root = Path::new(ROOT);
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
    let root = Path::new(ROOT);
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
