//! What several test programs share: the golden arrays, and saying that a test did not run.
#![allow(dead_code, reason = "each test program uses its part")]

use lastlight::io::npz;
use lastlight::num::array::Arrays;
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
