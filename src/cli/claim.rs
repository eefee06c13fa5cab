//! The rule for outputs that exist: nothing is overwritten unless asked.

use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Refuses a folder that cannot be taken; makes nothing.
///
/// # Errors
/// When it is a file, or is not empty and neither flag is given.
pub(crate) fn check(dir: &Path, resume: bool, force: bool) -> Result<()> {
    if !dir.exists() {
        return Ok(());
    }
    if !dir.is_dir() {
        return Err(Error::input("--out").at(dir.display().to_string()).expected("a folder").got("a file"));
    }
    let is_used = std::fs::read_dir(dir).map_err(|e| Error::os(dir, &e))?.next().is_some();
    if is_used && !resume && !force {
        return Err(Error::input("--out")
            .at(dir.display().to_string())
            .expected("a new or empty folder")
            .got("a folder with files")
            .hint("--force replaces its files; an interrupted run is continued by --resume, where there is that option"));
    }
    Ok(())
}

/// Makes the folder `dir`, or takes an existing one that is empty, to be resumed, or given up by `--force`.
/// Nothing in it is deleted: later writes replace files of the same name, one by one and whole.
///
/// # Errors
/// Those of [`check`], and when it cannot be made.
pub(crate) fn folder(dir: &Path, resume: bool, force: bool) -> Result<PathBuf> {
    check(dir, resume, force)?;
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    Ok(dir.to_path_buf())
}

/// Refuses an existing file unless forced.
///
/// # Errors
/// When it exists and `force` is not given, or is a folder.
pub(crate) fn file(path: &Path, force: bool) -> Result<()> {
    if path.is_dir() {
        return Err(Error::input(path.display().to_string()).expected("a file name").got("a folder"));
    }
    if path.exists() && !force {
        return Err(Error::input(path.display().to_string())
            .expected("a file that does not exist yet")
            .got("one that does")
            .hint("--force replaces it"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn used_folders_need_a_flag() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let out = dir.path().join("a/b");
        folder(&out, false, false).expect("made with its parents");
        folder(&out, false, false).expect("empty");
        std::fs::write(out.join("x"), "x").expect("writable");
        assert!(folder(&out, false, false).is_err(), "used");
        folder(&out, true, false).expect("resumed");
        folder(&out, false, true).expect("forced");
        assert!(folder(&out.join("x"), false, true).is_err(), "a file is no folder");
        assert!(file(&out.join("x"), false).is_err(), "exists");
        file(&out.join("x"), true).expect("forced");
        assert!(file(&out, true).is_err(), "a folder is no file");
    }
}
