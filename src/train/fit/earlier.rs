//! Checks whether a folder holds the results of a previous run that can be continued or replaced.
//!
//! A finished run has written `transforms*.json` with the digests of its images; an unfinished run has a
//! journal with a record per image (see [`super::passes`], which also removes them).

use super::passes::{HEADER, JOURNAL, SPLITS, read_json};
use crate::io::atomic;
use crate::{Error, Result};
use serde_json::{Map, Value};
use std::path::Path;

/// Returns an error for a folder that holds files but no run to continue.
///
/// # Errors
/// When this is the case, or the folder cannot be read.
pub(super) fn check_begun(dir: &Path) -> Result<()> {
    let begun = dir.join(JOURNAL).is_dir() || SPLITS.iter().any(|(file, _)| dir.join(file).is_file());
    if begun || !dir.is_dir() || atomic::is_unused(dir)? {
        return Ok(());
    }
    Err(Error::input("--resume")
        .at(dir.display().to_string())
        .expected("the folder of an interrupted run")
        .got("files without the record of a run")
        .hint("choose another folder, or start again with --force"))
}

/// Returns an error unless the folder holds a run whose header has the keys of `header`, which
/// [`Recorder::open`](super::passes::Recorder::open) may remove.
///
/// # Errors
/// When a record was written by another command or cannot be read.
pub(super) fn check_ours(dir: &Path, header: &Map<String, Value>) -> Result<()> {
    let records = SPLITS.iter().map(|(file, _)| dir.join(file)).chain([dir.join(JOURNAL).join(HEADER)]);
    records.filter(|path| path.is_file()).try_for_each(|path| ours(&path, header))
}

/// A record with all keys of the header.
fn ours(path: &Path, header: &Map<String, Value>) -> Result<()> {
    let top = read_json(path).unwrap_or(Value::Null);
    if header.keys().all(|key| top.get(key).is_some()) {
        return Ok(());
    }
    Err(Error::input("--out")
        .at(path.display().to_string())
        .expected("the record of a previous run of this command")
        .got("another record")
        .hint("choose another folder; --force replaces only results of the same command"))
}
