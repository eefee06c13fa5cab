//! What several test programs share: the golden arrays, saying that a test did not run, folders as what is in
//! them.
#![allow(dead_code, reason = "each test program uses its part")]

use lastlight::io::npz;
use lastlight::num::array::Arrays;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder `tests`: the manifest of the binary's own package is at the root of the repository or in a
/// folder of `tests`.
pub(crate) fn tests_folder() -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let below = own.join("tests");
    if below.is_dir() { below } else { own.join("..") }
}

/// `$LASTLIGHT_DATA`, if it is set; a relative path starts at the root of the repository, wherever the test
/// runs.
pub(crate) fn data_folder() -> Option<PathBuf> {
    std::env::var_os("LASTLIGHT_DATA").map(|data| tests_folder().join("..").join(data))
}

/// A file or folder below `$LASTLIGHT_DATA/data`; prints a message when it is missing.
pub(crate) fn real_data(path: &str) -> Option<PathBuf> {
    let found = data_folder().map(|data| data.join("data").join(path)).filter(|p| p.exists());
    if found.is_none() {
        not_run(&format!("$LASTLIGHT_DATA/data/{path} is not there"));
    }
    found
}

/// The golden file of that name (without `.npz`) under `tests/golden` or `$LASTLIGHT_DATA/golden`; prints a
/// message when it is missing.
pub(crate) fn golden(name: &str) -> Option<Arrays> {
    let file = format!("{name}.npz");
    let near = tests_folder().join("golden").join(&file);
    let far = data_folder().map(|data| data.join("golden").join(&file));
    let found = [Some(near), far].into_iter().flatten().find(|p| p.is_file());
    if found.is_none() {
        not_run(&format!("{file} is neither in tests/golden nor in $LASTLIGHT_DATA/golden"));
    }
    found.map(|p| npz::read(&p).unwrap_or_else(|e| panic!("{e}")))
}

/// Copies the HDF5 miniatures of a folder of `tests/samples/hdf5` to another folder: h5py wrote them
/// (`make.py` there), so that readers are tested on files of the real library.
pub(crate) fn copy_hdf5(folder: &str, to: &Path) {
    let from = tests_folder().join("samples/hdf5").join(folder);
    let files = tree(&from);
    assert!(!files.is_empty(), "{folder} has files");
    for (name, bytes) in files {
        std::fs::write(to.join(name), bytes).expect("written");
    }
}

/// A line that the test runner does not swallow, written in one piece: tests run beside each other, and so do
/// their lines.
pub(crate) fn not_run(why: &str) {
    std::io::stderr().write_all(format!("not run: {why}\n").as_bytes()).expect("standard error is open");
}

/// Whether the long tests run; prints a message when they do not.
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
