//! What an earlier run left in a folder: whether it is one of ours, to be continued or started over.
//!
//! A run leaves `transforms*.json` with the digests of its pictures, or a journal with a record per picture while it is under way (see
//! [`super::passes`], which also removes them).

use super::passes::{HEADER, JOURNAL, SPLITS, read_json};
use crate::io::atomic;
use crate::{Error, Result};
use serde_json::{Map, Value};
use std::path::Path;

/// Refuses to continue in a folder that holds files and no run.
///
/// # Errors
/// When it does, or cannot be read.
pub(super) fn check_begun(dir: &Path) -> Result<()> {
    let begun = dir.join(JOURNAL).is_dir() || SPLITS.iter().any(|(file, _)| dir.join(file).is_file());
    if begun || !dir.is_dir() || atomic::is_unused(dir)? {
        return Ok(());
    }
    Err(Error::input("--resume")
        .at(dir.display().to_string())
        .expected("the folder of an interrupted run")
        .got("files without its record")
        .hint("choose another folder, or start over with --force"))
}

/// Refuses to start over what is not a run whose header had the keys of `header`; [`Recorder::open`](super::passes::Recorder::open) then removes it.
///
/// # Errors
/// When a record is another program's or cannot be read.
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
        .expected("the record of an earlier run of this command")
        .got("another one")
        .hint("choose another folder; --force replaces results of the same command only"))
}
