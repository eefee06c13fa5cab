//! Every operator has an example, which runs as a doctest: the section `# Example` in the documentation of
//! its file.
//!
//! The names of the operators are those of the signatures in `reference/src`. The file of operator
//! `GROUP.NAME` is the one in `src/kernels/GROUP` whose documentation begins with that name, or
//! `src/train/GROUP/NAME.rs`.

use super::ROOT;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Source files in a folder and its subfolders.
fn sources(dir: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(dir).expect("the folder is readable") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}

/// `GROUP.NAME` of each signature in a source text.
fn names(text: &str) -> BTreeSet<String> {
    let is_operator = |name: &&str| {
        name.contains('.') && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '.' || c == '_')
    };
    let quoted = text.split("name: \"").skip(1).filter_map(|rest| rest.split('"').next());
    quoted.filter(is_operator).map(str::to_owned).collect()
}

/// The operator that a file documents: its documentation begins with `GROUP.NAME` as code and a colon.
fn documented(text: &str) -> Option<String> {
    let (name, _) = text.strip_prefix("//! `")?.split_once("`:")?;
    Some(name.to_owned())
}

/// Whether the documentation of a file has an example that is compiled and run.
fn has_example(text: &str) -> bool {
    let mut docs = text.lines().map_while(|line| line.strip_prefix("//!")).map(str::trim);
    docs.by_ref().any(|line| line == "# Example") && docs.any(|line| line == "```")
}

#[test]
fn every_operator_has_an_example() {
    let root = Path::new(ROOT);
    let read = |path: &PathBuf| fs::read_to_string(path).expect("a source file is readable");
    let operators: BTreeSet<String> =
        sources(&root.join("reference/src")).iter().flat_map(|path| names(&read(path))).collect();
    assert!(operators.len() >= 46, "the signatures are found: {operators:?}");

    let mut with_example = BTreeSet::new();
    for path in sources(&root.join("src/kernels")) {
        let text = read(&path);
        if has_example(&text) {
            with_example.extend(documented(&text));
        }
    }
    for name in operators.iter().filter(|name| name.starts_with("optim.")) {
        let path = root.join(format!("src/train/{}.rs", name.replace('.', "/")));
        if has_example(&read(&path)) {
            with_example.insert(name.clone());
        }
    }
    let without: Vec<_> = operators.difference(&with_example).collect();
    assert!(without.is_empty(), "operators without an example: {without:?}");
}

#[test]
fn examples_are_recognised() {
    assert!(
        has_example("//! Text.\n//!\n//! # Example\n//! ```\n//! f();\n//! ```\n"),
        "a section with code"
    );
    assert!(!has_example("//! # Example\n//! Text.\n\n//! ```\n"), "a section without code");
    assert!(!has_example("//! ```\n//! f();\n//! ```\n"), "code without a section");
    assert_eq!(documented("//! `nn.linear`: an affine map.").as_deref(), Some("nn.linear"), "a name");
    assert_eq!(
        names("    name: \"nn.linear\",\n    name: \"x\",\n").into_iter().collect::<Vec<_>>(),
        ["nn.linear"],
        "one name"
    );
}
