//! What an earlier run left in a folder: whether it is one of ours, and its removal.
//!
//! A run leaves `transforms*.json` with the digests of its pictures, or `.shots/` with a record per picture while it is under way (see
//! [`super::passes`]). A run that is not continued removes the records first and then the pictures they name, so that no record ever
//! stands beside pictures of another run. Files that no record names stay.

use crate::io::{MAX_SMALL_FILE_BYTES, read_bytes};
use crate::{Error, Result};
use serde_json::{Map, Value};
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// Records of a finished set.
const RECORDS: [&str; 4] =
    ["transforms.json", "transforms_train.json", "transforms_val.json", "transforms_test.json"];
/// Records of a set under way, and the file that holds its header.
const JOURNAL: [&str; 2] = [".shots", "header.json"];

/// Refuses to continue in a folder that holds files and no run.
///
/// # Errors
/// When it does, or cannot be read.
pub(super) fn check_begun(dir: &Path) -> Result<()> {
    let begun = dir.join(JOURNAL[0]).is_dir() || RECORDS.iter().any(|r| dir.join(r).is_file());
    if begun || !dir.is_dir() || std::fs::read_dir(dir).map_err(|e| Error::os(dir, &e))?.next().is_none() {
        return Ok(());
    }
    Err(Error::input("--resume")
        .at(dir.display().to_string())
        .expected("the folder of an interrupted run")
        .got("files without its record")
        .hint("choose another folder, or start over with --force"))
}

/// Removes records and pictures of a run whose header had the keys of `header`.
///
/// # Errors
/// When a record is another program's or cannot be read, or a file cannot be removed; then nothing was, or the records at least.
pub(super) fn remove(dir: &Path, header: &Map<String, Value>) -> Result<()> {
    let (mut pictures, mut records) = (BTreeSet::new(), Vec::new());
    for path in RECORDS.iter().map(|r| dir.join(r)).filter(|p| p.is_file()) {
        let top = ours(&path, header)?;
        top["frames"].as_array().into_iter().flatten().for_each(|frame| named(dir, frame, &mut pictures));
        records.push(path);
    }
    let journal = dir.join(JOURNAL[0]);
    if journal.is_dir() {
        let mark = journal.join(JOURNAL[1]);
        if mark.is_file() {
            ours(&mark, header)?;
        }
        for entry in std::fs::read_dir(&journal).map_err(|e| Error::os(&journal, &e))? {
            let path = entry.map_err(|e| Error::os(&journal, &e))?.path();
            // A record that is no JSON is half of one: its pictures stay and are replaced or not.
            if let Ok(frame) = read(&path) {
                named(dir, &frame, &mut pictures);
            }
        }
        std::fs::remove_dir_all(&journal).map_err(|e| Error::os(&journal, &e))?;
    }
    for path in records.into_iter().chain(pictures) {
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::os(&path, &e)),
            _ => {}
        }
    }
    Ok(())
}

/// A record with all keys of the header.
fn ours(path: &Path, header: &Map<String, Value>) -> Result<Value> {
    let top = read(path).unwrap_or(Value::Null);
    if header.keys().all(|key| top.get(key).is_some()) {
        return Ok(top);
    }
    Err(Error::input("--out")
        .at(path.display().to_string())
        .expected("the record of an earlier run of this command")
        .got("another one")
        .hint("choose another folder; --force replaces results of the same command only"))
}

/// Adds the files that a frame has digests of; only those inside the folder.
fn named(dir: &Path, frame: &Value, into: &mut BTreeSet<PathBuf>) {
    let inside = |file: &&String| Path::new(file).components().all(|c| matches!(c, Component::Normal(_)));
    let files = frame["digests"].as_object().into_iter().flatten().map(|(file, _)| file);
    into.extend(files.filter(inside).map(|file| dir.join(file)));
}

fn read(path: &Path) -> Result<Value> {
    let bytes = read_bytes(path, MAX_SMALL_FILE_BYTES)?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Error::input(path.display().to_string()).expected("JSON").got(e.to_string()))
}
