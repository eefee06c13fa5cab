//! The rule for outputs: nothing that exists is overwritten without `--force`, and one program at a time writes to a folder.

use crate::io::{atomic, lock::Lock, paths};
use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A folder that this program has taken.
struct Claim {
    lock: Lock,
    dir: PathBuf,
    /// the folder and those above it that were not there, the deepest first
    made: Vec<PathBuf>,
}

/// The folders of this program.
static TAKEN: Mutex<Vec<Claim>> = Mutex::new(Vec::new());

/// Takes a folder until [`release`]; makes it if it is not there, and removes temporary files that a killed program left in it.
fn take(dir: &Path) -> Result<()> {
    let mut taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner);
    let made: Vec<PathBuf> = dir
        .ancestors()
        .take_while(|a| !a.as_os_str().is_empty() && !a.exists())
        .map(Path::to_path_buf)
        .collect();
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    let dir = dir.canonicalize().map_err(|e| Error::os(dir, &e))?;
    if taken.iter().all(|t| t.dir != dir) {
        let lock = Lock::take(&dir)?;
        // Parts of files of a program that was killed while it wrote them.
        atomic::sweep(&dir)?;
        taken.push(Claim { lock, dir, made });
    }
    Ok(())
}

/// What is in the folders that were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    /// No folder was taken.
    NoFolder,
    /// They hold no file.
    Nothing,
    /// They hold files, of this program or of an earlier one.
    Files,
}

/// Gives back every folder that was taken. Those that were made and hold nothing are removed: a command that could not start leaves none.
pub(crate) fn release() -> Kept {
    let mut kept = Kept::NoFolder;
    for Claim { lock, dir, made } in TAKEN.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        drop(lock);
        if kept != Kept::Files {
            kept = if atomic::is_unused(&dir).unwrap_or(false) { Kept::Nothing } else { Kept::Files };
        }
        for dir in made {
            if std::fs::remove_dir(dir).is_err() {
                break; // it holds something
            }
        }
    }
    kept
}

/// Takes the folder `dir`: makes it, or takes one that is empty, to be resumed, or given up by `--force`, and keeps other programs out until
/// [`release`]. Nothing in it is deleted: later writes replace files of the same name, one by one and whole.
///
/// # Errors
/// When it is a file, holds a link to a folder outside it, is not empty and neither flag is given, is in use by another program, or cannot be made.
pub(crate) fn check(dir: &Path, resume: bool, force: bool) -> Result<()> {
    if dir.exists() && !dir.is_dir() {
        return Err(Error::input("--out").at(dir.display().to_string()).expected("a folder").got("a file"));
    }
    paths::without_links_out(dir)?;
    if !resume && !force && !atomic::is_unused(dir)? {
        return Err(Error::input("--out")
            .at(dir.display().to_string())
            .expected("a new or empty folder")
            .got("a folder with files")
            .hint("--force replaces its files; an interrupted run is continued by --resume, where there is that option"));
    }
    take(dir)
}

/// What a command writes when it has its result. A run that was killed has none of them, whatever else it has written.
const RESULTS: [&str; 2] = ["result.json", "report/index.html"];

/// Refuses to resume in a folder that holds the result of another command, and nothing with one of the names that the own runs write first.
///
/// # Errors
/// When it is such a folder.
pub(crate) fn is_of(dir: &Path, names: &[&str]) -> Result<()> {
    let is_there = |name: &&&str| dir.join(name).exists();
    match RESULTS.iter().find(is_there) {
        Some(result) if !names.iter().any(|name| dir.join(name).exists()) => Err(Error::input("--out")
            .at(dir.display().to_string())
            .expected(format!("a new folder, or that of an interrupted run, with {}", names.join(" or ")))
            .got(format!("{result} of another command"))
            .hint("choose another folder; --force instead of --resume replaces files of the same name")),
        _ => Ok(()),
    }
}

/// [`check`], and the folder.
///
/// # Errors
/// Those of [`check`].
pub(crate) fn folder(dir: &Path, resume: bool, force: bool) -> Result<PathBuf> {
    check(dir, resume, force)?;
    Ok(dir.to_path_buf())
}

/// Refuses an existing file unless forced.
///
/// # Errors
/// When it exists and `force` is not given, or is a folder, or its folder does not exist.
pub(crate) fn file(path: &Path, force: bool) -> Result<()> {
    if path.is_dir() {
        return Err(Error::input(path.display().to_string()).expected("a file name").got("a folder"));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.exists());
    if let Some(folder) = folder {
        let e = Error::input(path.display().to_string()).expected("a file in a folder that exists");
        return Err(e
            .got(format!("no folder {}", folder.display()))
            .hint(format!("mkdir -p {}", folder.display())));
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
        let killed = dir.path().join("killed");
        std::fs::create_dir(&killed).expect("writable");
        std::fs::write(killed.join(".lastlight-Ab12.part"), "x").expect("writable");
        folder(&killed, true, false).expect("resumed");
        assert!(
            !killed.join(".lastlight-Ab12.part").exists(),
            "part of a file, left by a program that was killed"
        );
        folder(&out, true, false).expect("resumed");
        folder(&out, false, true).expect("forced");
        is_of(&out, &["y"]).expect("a run that was killed may have written anything but a result");
        std::fs::write(out.join("result.json"), "{}").expect("writable");
        is_of(&out, &["y", "x"]).expect("x is there");
        let e = is_of(&out, &["y"]).expect_err("a result").to_string();
        assert!(e.contains("with y") && e.contains("result.json of another command"), "{e}");
        assert!(folder(&out.join("x"), false, true).is_err(), "a file is no folder");
        assert!(file(&out.join("x"), false).is_err(), "exists");
        file(&out.join("x"), true).expect("forced");
        assert!(file(&out, true).is_err(), "a folder is no file");
        let e = file(&out.join("deep/er/x.ply"), true).expect_err("no folder").to_string();
        assert!(e.contains("no folder ") && e.contains("mkdir -p "), "{e}");
    }
}
