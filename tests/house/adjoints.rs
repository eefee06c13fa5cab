//! Every hand-derived adjoint that a system runs is one that the operator list runs: read off the sources.
//!
//! Two rules. In the folders of operators, every function that is named as an adjoint is reached from a function of `src/oracle/ops`. Above them, no function is
//! named as one, but for the compositions listed here, each with its reason.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Folders of operators: levels 1 to 6, and the optimisers.
const OPERATORS: &[&str] = &["math", "nn", "splat", "field", "shade", "causal", "body", "loss", "optim"];

/// Folders above them that run adjoints: the tape, fits, systems.
const SYSTEMS: &[&str] = &["tape", "fit", "experiment", "last", "lirm", "study", "cli"];

/// What tells an adjoint by its name.
const MARKS: &[&str] = &["adjoint", "_back", "pull_back", "backward", "_bar", "spread", "gradients", "vjp"];

/// Adjoints of operator folders that no entry of the list runs.
const OFF_THE_LIST: &[(&str, &str)] = &[
    (
        "body/pose.rs squared_adjoint",
        "a copy without the constant last rows, which body.skin gives no gradient",
    ),
    ("splat/render.rs adjoint", "makes room for splat.render's adjoint_into, which the entry runs"),
];

/// Functions that are named like adjoints and derive nothing, or only string adjoints of the list.
const EXCEPTIONS: &[(&str, &str)] = &[
    ("fit/splat/graph.rs give_back", "puts a buffer back"),
    (
        "last/avatar/person.rs adjoint",
        "strings body.skin, body.rest, splat.covariance, splat.activate and shade.diffuse",
    ),
    ("last/avatar/pose.rs adjoint", "puts the joints of body.pose into another order"),
    ("last/avatar/skin.rs adjoint", "strings body.skin and body.rest"),
    (
        "last/model/latent/mod.rs adjoint",
        "strings the operators of causal and loss.groups; sums what they give",
    ),
    ("last/model/latent/pieces.rs link_adjoint", "causal.structure in the mode of the reading"),
    ("last/model/step.rs spread", "variances of factors, no adjoint"),
    (
        "last/structure/mcsl.rs pull_back",
        "a check of structure learning that no system runs; held to differences by its own test",
    ),
    ("tape/check/subject.rs shipped_adjoint", "runs the operator under test"),
    ("tape/check/subject.rs vjp", "runs the twin of the operator under test"),
    ("tape/check/sabotage.rs shipped_adjoint", "runs the operator under test"),
    ("tape/check/sabotage.rs vjp", "runs the operator under test"),
    ("tape/record.rs backward", "replays the adjoints that were recorded"),
    ("tape/record.rs backward_scalar", "replays the adjoints that were recorded"),
    ("cli/report/pictures.rs scale_bar", "a bar of colours"),
];

#[derive(Clone, Debug)]
struct Function {
    /// path below the member, as `nn/linear.rs`
    file: String,
    name: String,
    body: String,
}

impl Function {
    fn label(&self) -> String {
        format!("{} {}", self.file, self.name)
    }
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// A source text without comments and strings, and without its test module.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text);
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or(line));
    lines.collect::<Vec<_>>().join("\n")
}

/// All functions with a body.
fn functions(file: &str, text: &str) -> Vec<Function> {
    let code = code(text);
    let mut out = Vec::new();
    for (at, _) in code.match_indices("fn ") {
        if code[..at].chars().next_back().is_some_and(is_word) {
            continue;
        }
        let rest = &code[at + 3..];
        let name: String = rest.chars().take_while(|c| is_word(*c)).collect();
        // a declaration without body ends with a semicolon before any brace
        let (Some(open), end) = (rest.find('{'), rest.find(';').unwrap_or(usize::MAX)) else { continue };
        let array = rest[..open].contains('[');
        if name.is_empty() || (end < open && !array) {
            continue;
        }
        let mut depth = 0;
        let close = rest[open..].char_indices().find_map(|(i, c)| {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            (depth == 0).then_some(open + i)
        });
        let body = rest[open..close.unwrap_or(rest.len())].to_owned();
        out.push(Function { file: file.to_owned(), name, body });
    }
    out
}

/// The modules a file may be called by: its stem, or its folder for `mod.rs`; and its parent for what it re-exports.
fn modules(file: &str) -> Vec<String> {
    let parts: Vec<&str> = file.trim_end_matches(".rs").split('/').collect();
    let own = if parts.last() == Some(&"mod") { parts.len().saturating_sub(1) } else { parts.len() };
    parts[..own].iter().rev().take(2).map(|part| (*part).to_owned()).collect()
}

/// Words before `(` or `::<` or as a value, with the module named before them: `linear::adjoint` gives (linear, adjoint), `adjoint` (none, adjoint).
fn mentions(body: &str) -> BTreeSet<(Option<String>, String)> {
    let mut out = BTreeSet::new();
    let mut word = String::new();
    let mut before: Option<String> = None;
    let mut rest = body;
    while let Some(c) = rest.chars().next() {
        if is_word(c) {
            word.push(c);
        } else if !word.is_empty() {
            let path = rest.starts_with("::") && !rest.starts_with("::<");
            let done = std::mem::take(&mut word);
            if path {
                before = Some(done);
                rest = &rest[2..];
                continue;
            }
            out.insert((before.take(), done));
        }
        rest = &rest[c.len_utf8()..];
    }
    out
}

/// Functions that are reached from the given ones: by a path whose last module is that of the file, or by a bare name or method within the operators.
fn reached(all: &[Function], from: &[Function]) -> BTreeSet<String> {
    let mut by_name: BTreeMap<&str, Vec<&Function>> = BTreeMap::new();
    for f in all {
        by_name.entry(&f.name).or_default().push(f);
    }
    let mut seen = BTreeSet::new();
    let mut work: Vec<&Function> = from.iter().collect();
    while let Some(f) = work.pop() {
        for (module, name) in mentions(&f.body) {
            for &target in by_name.get(name.as_str()).into_iter().flatten() {
                let named = match &module {
                    Some(module) => {
                        modules(&target.file).contains(module) || module == "Self" || module == "self"
                    }
                    // a method, a function of this file, or one that was imported by its name
                    None => target.file == f.file || !GENERIC.contains(&name.as_str()),
                };
                if named && seen.insert(target.label()) {
                    work.push(target);
                }
            }
        }
    }
    seen
}

/// Names that many files have: without a module before them they mean those of their own file.
const GENERIC: &[&str] = &["adjoint", "forward"];

fn is_adjoint(name: &str) -> bool {
    MARKS.iter().any(|mark| {
        name == *mark
            || name.ends_with(mark)
            || (name.contains("adjoint") && *mark == "adjoint")
            || (name.starts_with("gradients") && *mark == "gradients")
    })
}

fn read(folder: &Path, root: &Path, into: &mut Vec<Function>) {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).expect("a readable folder").map(|e| e.expect("an entry").path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            read(&path, root, into);
        } else if path.extension().is_some_and(|e| e == "rs")
            && path.file_stem().is_none_or(|s| s != "tests" && s != "trials")
        {
            let file = path.strip_prefix(root).expect("below the root").display().to_string();
            into.extend(functions(&file, &fs::read_to_string(&path).expect("a readable file")));
        }
    }
}

/// The folder of a level and the member that holds it: `src/kernels/nn` and `src/kernels`.
fn find(src: &Path, name: &str) -> Option<(PathBuf, PathBuf)> {
    let mut roots = vec![src.to_path_buf()];
    roots.extend(fs::read_dir(src).ok()?.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.is_dir()));
    roots.into_iter().map(|root| (root.join(name), root)).find(|(folder, _)| folder.is_dir())
}

fn of(names: &[&str]) -> Vec<Function> {
    let src = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../src")).to_path_buf();
    let mut out = Vec::new();
    for name in names {
        if let Some((folder, root)) = find(&src, name) {
            read(&folder, &root, &mut out);
        }
    }
    out
}

/// Adjoints of operators that the entries do not reach.
fn unlisted(operators: &[Function], entries: &[Function]) -> Vec<String> {
    let reached = reached(operators, entries);
    let adjoints = operators.iter().filter(|f| is_adjoint(&f.name)).map(Function::label);
    let known = |label: &String| OFF_THE_LIST.iter().any(|(off, _)| off == label);
    adjoints.filter(|label| !reached.contains(label) && !known(label)).collect()
}

/// Adjoints of systems without an exception.
fn derived(systems: &[Function]) -> Vec<String> {
    let named = systems.iter().filter(|f| is_adjoint(&f.name)).map(Function::label);
    named.filter(|label| !EXCEPTIONS.iter().any(|(known, _)| known == label)).collect()
}

#[test]
fn every_adjoint_of_an_operator_is_run_by_an_entry_of_the_list() {
    let (operators, entries) = (of(OPERATORS), of(&["ops"]));
    let count = operators.iter().filter(|f| is_adjoint(&f.name)).count();
    assert!(
        count > 40 && entries.len() > 100,
        "{count} adjoints and {} functions of entries found",
        entries.len()
    );
    let left = unlisted(&operators, &entries);
    assert!(left.is_empty(), "adjoints that the operator list does not run: {left:#?}");
}

#[test]
fn no_system_derives_an_adjoint_of_its_own() {
    let systems = of(SYSTEMS);
    assert!(systems.len() > 1000, "{} functions found", systems.len());
    let left = derived(&systems);
    assert!(left.is_empty(), "adjoints outside the operators: {left:#?}");
    for (label, reason) in EXCEPTIONS {
        assert!(systems.iter().any(|f| f.label() == *label), "{label} is no longer there");
        assert!(!reason.is_empty(), "{label}: a reason");
    }
}

#[test]
fn an_adjoint_that_the_list_does_not_know_is_found() {
    let operators = functions(
        "nn/extra.rs",
        "pub fn adjoint(x: &[f32]) { helper_back(x) }\nfn helper_back(x: &[f32]) {}",
    );
    let entry = |text: &str| functions("ops/extra.rs", text);
    assert_eq!(unlisted(&operators, &entry("fn run() { extra::forward(x); }")).len(), 2, "not called");
    assert_eq!(
        unlisted(&operators, &entry("fn run() { other::adjoint(x); }")).len(),
        2,
        "another operator's"
    );
    assert!(
        unlisted(&operators, &entry("fn run() { extra::adjoint(x); }")).is_empty(),
        "called, and what it calls"
    );
    let system = functions(
        "last/avatar/new.rs",
        "impl A {\n    fn shade_adjoint(&self) { }\n}\nfn feed_back() {}\nfn plain() {}",
    );
    assert_eq!(derived(&system), ["last/avatar/new.rs shade_adjoint", "last/avatar/new.rs feed_back"]);
    let inside = "fn f() { }\n#[cfg(test)]\nmod tests { fn g_adjoint() {} }";
    assert!(derived(&functions("last/a.rs", inside)).is_empty(), "tests may");
}
