//! What several test programs share: the golden arrays, saying that a test did not run, folders as what is in them.
#![allow(dead_code, reason = "each test program uses its part")]

pub(crate) mod lpips;
pub(crate) mod person;
pub(crate) mod program;
pub(crate) mod python;

use lastlight::io::npz;
use lastlight::num::array::Arrays;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The golden file of that name (without `.npz`) under `tests/golden` or `$LASTLIGHT_DATA/golden`; says so when there is none.
pub(crate) fn golden(name: &str) -> Option<Arrays> {
    let file = format!("{name}.npz");
    let near = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(&file);
    let far = std::env::var_os("LASTLIGHT_DATA").map(|d| PathBuf::from(d).join("golden").join(&file));
    let found = [Some(near), far].into_iter().flatten().find(|p| p.is_file());
    if found.is_none() {
        not_run(&format!("{file} is neither in tests/golden nor in $LASTLIGHT_DATA/golden"));
    }
    found.map(|p| npz::read(&p).unwrap_or_else(|e| panic!("{e}")))
}

/// A line that the test runner does not swallow.
pub(crate) fn not_run(why: &str) {
    writeln!(std::io::stderr(), "not run: {why}").expect("standard error is open");
}

/// Whether the long tests run; says so when they do not.
pub(crate) fn long(what: &str) -> bool {
    let on = std::env::var_os("LASTLIGHT_LONG").is_some_and(|v| v == "1");
    if !on {
        not_run(&format!("{what} (set LASTLIGHT_LONG=1)"));
    }
    on
}

/// Contents of the files below a folder, by their path in it with `/` between names.
pub(crate) type Tree = BTreeMap<String, Vec<u8>>;

/// All files below a folder.
pub(crate) fn tree(dir: &Path) -> Tree {
    let mut files = Tree::new();
    let mut folders = vec![dir.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("readable") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(dir).expect("inside").to_string_lossy().replace('\\', "/");
                files.insert(name, std::fs::read(&path).expect("readable"));
            }
        }
    }
    files
}

/// The same paths with the same bytes.
pub(crate) fn assert_same(a: &Tree, b: &Tree, what: &str) {
    let names = |x: &Tree| x.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(a), names(b), "{what}: the same files");
    for (name, bytes) in a {
        assert!(*bytes == b[name], "{what}: {name} differs");
    }
}
