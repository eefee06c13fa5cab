//! The levels of the library: a member of the workspace depends on members before it only, and a file uses
//! its own folder and folders of a smaller level, never another of its own level or above.

use super::ROOT;
use super::modules::Modules;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A member under `src/`: its name, its place in the order, and of its folders the library path and the
/// level. `*` is every folder.
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
    // the root of a member without folders is of the level of the member; the others define nothing, so that
    // no arrow ends there
    let place = |module: usize| {
        let path = modules.path(module);
        let mut names = path.split("::");
        let member = names.next().expect("a member").to_owned();
        match names.next() {
            Some(folder) => Some((level(&member, folder), path.clone())),
            None => level(&member, "").map(|level| (Some(level), path.clone())),
        }
    };
    let mut out = Vec::new();
    for root in modules.defining_roots() {
        if place(root).is_none() {
            out.push(format!("{} defines something: it has no level", modules.all[root].file.display()));
        }
    }
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
    let outside = ["lib.rs", "main.rs", "book", "cli/build.rs"].map(|name| src.join(name));
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

#[test]
fn root_files_are_checked_too() {
    let mut modules = Modules::default();
    let files = [
        ("files", "fn f() { lastlight_scene::g() } pub use lastlight_num::Error;"),
        ("scene", "pub fn g() { lastlight_files::h() }"),
        ("kernels", "pub fn h() {} pub use lastlight_num::num;"),
        ("num", "#[macro_export] macro_rules! with { () => {} }"),
    ];
    for (member, text) in files {
        modules.add_member(member, &Path::new(member).join("lib.rs"), &|_| Some(text.to_owned()));
    }
    assert_eq!(
        wrong_levels(&modules),
        [
            "kernels/lib.rs defines something: it has no level",
            "num/lib.rs defines something: it has no level",
            "files/lib.rs: lastlight_scene::g names scene (level 3) from io (level 2)",
        ],
        "of members with folders and without"
    );
}

/// Dependencies of a manifest, of every kind and target: the section, the name they have there, and the
/// package. `shared` is the manifest of the workspace, which defines `name.workspace = true`.
fn dependencies(manifest: &str, shared: &str) -> Vec<Dependency> {
    let is_kind = |s: &str| ["dependencies", "dev-dependencies", "build-dependencies"].contains(&s);
    let mut out: Vec<Dependency> = Vec::new();
    let (mut section, mut one) = (None, false);
    for line in manifest.lines().map(|line| line.split('#').next().unwrap_or("").trim()) {
        if let Some(header) = line.strip_prefix('[') {
            let header = header.trim_start_matches('[').trim_end_matches(']');
            let mut parts = header.rsplitn(2, '.');
            let (last, before) = (parts.next().unwrap_or(""), parts.next().unwrap_or(""));
            let kind = before.rsplit('.').next().unwrap_or("");
            // [dependencies], [target.….dependencies], [workspace.dependencies]; [dependencies.NAME]
            (section, one) = match (is_kind(last), is_kind(kind)) {
                (true, _) => (Some(last.to_owned()), false),
                (_, true) => (Some(kind.to_owned()), true),
                _ => (None, false),
            };
            if one && let Some(section) = &section {
                out.push(Dependency::new(section, last));
            }
        } else if let (Some(section), Some((key, value))) = (&section, line.split_once('=')) {
            let mut keys = key.trim().split('.').map(|k| k.trim_matches([' ', '"']));
            let name = keys.next().unwrap_or("");
            if !one && out.last().is_none_or(|d| d.name != name || d.section != *section) {
                out.push(Dependency::new(section, name));
            }
            let inner = if one { name } else { keys.next().unwrap_or("") };
            let dependency = out.last_mut().expect("it was added");
            dependency.take(inner, value.trim());
        }
    }
    if !shared.is_empty() {
        let table = dependencies(shared, "");
        for dependency in out.iter_mut().filter(|d| d.is_shared) {
            if let Some(known) = table.iter().find(|d| d.name == dependency.name) {
                dependency.package.clone_from(&known.package);
            }
        }
    }
    out
}

/// One dependency of a manifest.
#[derive(Clone, Debug, PartialEq)]
struct Dependency {
    section: String,
    name: String,
    package: String,
    /// `workspace = true`
    is_shared: bool,
}

impl Dependency {
    fn new(section: &str, name: &str) -> Self {
        let (section, name) = (section.to_owned(), name.to_owned());
        Self { section, package: name.clone(), name, is_shared: false }
    }

    /// Takes an entry: `package = "…"`, `workspace = true`, or a table of them.
    fn take(&mut self, key: &str, value: &str) {
        match key {
            "package" => self.package = value.trim_matches('"').to_owned(),
            "workspace" => self.is_shared = value == "true",
            "" => {
                for entry in value.trim_matches(['{', '}']).split(',') {
                    if let Some((key, value)) = entry.split_once('=') {
                        self.take(key.trim(), value.trim());
                    }
                }
            }
            _ => {}
        }
    }

    /// The member under `src/` that it is.
    fn member(&self) -> Option<&str> {
        self.package.strip_prefix("lastlight-").filter(|name| !["reference", "data-gen"].contains(name))
    }
}

/// What is wrong with the dependencies of a member.
fn wrong_dependencies(member: &str, manifest: &str, shared: &str) -> Vec<String> {
    let place = |name: &str| MEMBERS.iter().find(|(n, ..)| *n == name).map(|(_, place, _)| *place);
    let own = place(member).expect("a member");
    let all = dependencies(manifest, shared);
    let bad = all.iter().filter(|d| {
        d.package == "lastlight" || d.member().is_some_and(|d| place(d).is_none_or(|theirs| theirs >= own))
    });
    bad.map(|d| format!("{member} depends on {}", d.member().unwrap_or("the root"))).collect()
}

fn manifest(folder: &str) -> String {
    fs::read_to_string(Path::new(ROOT).join(folder).join("Cargo.toml")).expect("a manifest")
}

#[test]
fn members_depend_on_members_before_them_only() {
    let (src, shared) = (Path::new(ROOT).join("src"), manifest("."));
    let mut found = BTreeSet::new();
    let mut bad = Vec::new();
    let mut arrows = 0;
    for entry in fs::read_dir(&src).expect("src is readable") {
        let path = entry.expect("an entry").path();
        let Ok(manifest) = fs::read_to_string(path.join("Cargo.toml")) else { continue };
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        bad.extend(wrong_dependencies(&name, &manifest, &shared));
        arrows += dependencies(&manifest, &shared).iter().filter(|d| d.member().is_some()).count();
        found.insert(name);
    }
    let listed: BTreeSet<String> = MEMBERS.iter().map(|(name, ..)| (*name).to_owned()).collect();
    assert_eq!(found, listed, "the members under src/");
    assert!(arrows > 30, "{arrows} dependencies found");
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}

#[test]
fn every_way_to_write_a_dependency_is_read() {
    let shared = "[workspace.dependencies]\nup = { package = \"lastlight-cli\", path = \"x\" }\nlibm = \"1\"";
    let packages = |manifest: &str| {
        let all = dependencies(manifest, shared);
        all.iter().map(|d| format!("{} {}", d.section, d.package)).collect::<Vec<_>>()
    };
    let written = "[package]\nname = \"x\"\n[dependencies]\nlastlight-num.workspace = true\nlibm = \"1\" # why\n\
                   a = { path = \"../lirm\", package = \"lastlight-lirm\" }\nup.workspace = true\n[features]\nf = []\n\
                   [dev-dependencies]\nup = { workspace = true }\n[build-dependencies.b]\nversion = \"1\"\npackage = \"lastlight-last\"\n\
                   [target.'cfg(target_arch = \"x86_64\")'.dependencies]\nc.package = \"lastlight-study\"\nc.path = \"y\"\n\
                   [target.x86.dev-dependencies.d]\npackage = \"lastlight\"\n";
    let expected = [
        "dependencies lastlight-num",
        "dependencies libm",
        "dependencies lastlight-lirm",
        "dependencies lastlight-cli",
        "dev-dependencies lastlight-cli",
        "build-dependencies lastlight-last",
        "dependencies lastlight-study",
        "dev-dependencies lastlight",
    ];
    assert_eq!(packages(written), expected, "sections, tables, other names");
    let wrong = |member: &str, manifest: &str| wrong_dependencies(member, manifest, shared);
    let plain = "[dependencies]\nlastlight-num.workspace = true\nlastlight-lirm = { path = \"../lirm\" }\nlibm = \"1\"";
    assert_eq!(wrong("last", plain), ["last depends on lirm"], "the systems never meet");
    assert_eq!(wrong("scene", plain), ["scene depends on lirm"], "an arrow up");
    assert!(wrong("cli", plain).is_empty(), "arrows down");
    let renamed = "[dependencies]\nnum = { package = \"lastlight-cli\", path = \"../cli\" }";
    assert_eq!(wrong("scene", renamed), ["scene depends on cli"], "under another name");
    let header = "[dependencies.lastlight-cli]\nworkspace = true";
    assert_eq!(wrong("scene", header), ["scene depends on cli"], "in a section of its own");
    assert_eq!(wrong("scene", "[dev-dependencies]\nup.workspace = true"), ["scene depends on cli"], "shared");
    assert_eq!(
        wrong("cli", "[dependencies]\nx = { package = \"lastlight\" }"),
        ["cli depends on the root"],
        "the root"
    );
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

/// Packages that the twin and what makes its scenes may depend on, by section.
const TWIN: &[(&str, &[(&str, &str)])] = &[
    ("reference", &[("dependencies", "libm"), ("dev-dependencies", "zip")]),
    ("data-gen", &[("dependencies", "lastlight-reference")]),
];

/// Dependencies of a manifest that are not allowed.
fn not_allowed(manifest: &str, shared: &str, allowed: &[(&str, &str)]) -> Vec<String> {
    let all = dependencies(manifest, shared);
    let bad = all.iter().filter(|d| !allowed.contains(&(d.section.as_str(), d.package.as_str())));
    bad.map(|d| format!("{} {}", d.section, d.package)).collect()
}

#[test]
fn the_twin_cannot_see_the_library() {
    let shared = manifest(".");
    for (name, allowed) in TWIN {
        let text = manifest(name);
        assert_eq!(dependencies(&text, &shared).len(), allowed.len(), "{name}: what is allowed is there");
        let bad = not_allowed(&text, &shared, allowed);
        assert!(bad.is_empty(), "{name} depends on {bad:?}; allowed: {allowed:?}");
    }
    let (_, allowed) = TWIN[0];
    for text in [
        "[dev-dependencies]\nlastlight-num.workspace = true",
        "[dependencies]\nlibm = { package = \"lastlight-num\", path = \"../src/num\" }",
        "[target.'cfg(unix)'.dependencies]\nlastlight-num.workspace = true",
        "[build-dependencies.lastlight-num]\nworkspace = true",
    ] {
        assert_eq!(not_allowed(text, &shared, allowed).len(), 1, "{text}");
    }
}
