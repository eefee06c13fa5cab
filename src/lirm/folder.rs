//! The folder of a set from run to run: what is announced, what a continued run takes over, what a new one removes.
//!
//! `dataset.json` is written before the first picture (`complete`: false) and once more at the end; `object.json` when its object is
//! made. A continued run skips an object that has one if every file of its captures has the digest that `transforms*.json` records and
//! each capture and [`truth`] the one of `object.json`; pictures that do not agree are made again (they reach the disk in the system's own time, so that a power
//! cut can empty them).

use super::settings::{Settings, VERSIONS};
use super::shots::shots;
use super::truth;
use crate::fit::passes::{self, Recorder};
use crate::io::atomic;
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::path::Path;

/// The record of a set.
pub(super) const RECORD: &str = "dataset.json";
/// What it says of itself.
pub(super) const FORMAT: &str = "lastlight lirm gen 1";

/// Sweeps what a killed run left. A run that is not continued also removes the set that is there, its records first, so that a folder never
/// mixes two.
pub(super) fn begin(dir: &Path, asked: &Map<String, Value>, resume: bool) -> Result<()> {
    if !dir.is_dir() {
        return Ok(());
    }
    let mut objects = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(|e| Error::os(dir, &e))? {
        let path = entry.map_err(|e| Error::os(dir, &e))?.path();
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let number = name.strip_prefix("object_").unwrap_or_default();
        if path.is_dir() && !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()) {
            objects.push(path);
        }
    }
    let record = dir.join(RECORD);
    if resume && record.is_file() {
        same_settings(&record, asked)?;
    } else if resume && !atomic::is_unused(dir)? {
        return Err(Error::input("--resume")
            .at(dir.display().to_string())
            .expected(format!("the folder of an interrupted run, with its {RECORD}"))
            .got("other files")
            .hint("choose another folder, or start over with --force"));
    }
    atomic::sweep(dir)?;
    if resume {
        return Ok(());
    }
    atomic::remove(&record)?;
    objects.sort();
    for object in &objects {
        atomic::remove(&object.join("object.json"))?;
        truth::clear(object)?;
        VERSIONS.iter().try_for_each(|version| passes::clear(&object.join(version)))?;
    }
    Ok(())
}

/// Says, before the first picture, what the set in `dir` will be; what is said already stays.
pub(super) fn announce(dir: &Path, asked: &Map<String, Value>) -> Result<()> {
    let path = dir.join(RECORD);
    if path.is_file() {
        return Ok(());
    }
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    let top = json!({ "format": FORMAT, "complete": false, "settings": asked, "objects": [] });
    atomic::write_bytes(&path, format!("{top:#}\n").as_bytes())
}

/// A record whose settings are these.
fn same_settings(path: &Path, asked: &Map<String, Value>) -> Result<Value> {
    let bytes = crate::io::read_bytes(path, crate::io::MAX_SMALL_FILE_BYTES)?;
    let record: Value = serde_json::from_slice(&bytes).map_err(|e| {
        Error::input(path.display().to_string()).expected("JSON").got(e.to_string()).hint("remove it")
    })?;
    if record["settings"].as_object() == Some(asked) {
        return Ok(record);
    }
    Err(Error::input("--resume")
        .at(path.display().to_string())
        .expected("a set that was begun with the same settings")
        .got("one with others")
        .hint("choose another folder, or repeat the settings it was begun with"))
}

/// The record of object k if its folder is whole: it was made with these settings, and every file has the digest it had.
pub(super) fn finished(
    folder: &Path,
    settings: &Settings,
    asked: &Map<String, Value>,
    k: u64,
) -> Result<Option<Value>> {
    let path = folder.join("object.json");
    if !path.is_file() {
        return Ok(None);
    }
    let record = same_settings(&path, asked)?;
    let (shots, _) = shots(settings, k);
    let mut is_whole = true;
    for (n, (version, ..)) in settings.versions().into_iter().enumerate() {
        let dir = folder.join(version);
        let there = Recorder::verify(&dir, header(asked, k, version), &shots)?;
        if there.is_some_and(|there| record["versions"][n]["digest"] != hex(there.digest)) {
            return Err(Error::input("--resume")
                .at(dir.display().to_string())
                .expected("cameras and digests as they were written")
                .got("others in transforms*.json")
                .hint("remove that folder to have it made again"));
        }
        is_whole &= there.is_some_and(|there| there.is_whole);
    }
    is_whole &= truth::is_whole(folder, &record["truth"]);
    Ok(is_whole.then_some(record))
}

/// The top of the `transforms.json` of a version of object k.
pub(super) fn header(asked: &Map<String, Value>, k: u64, version: &str) -> Map<String, Value> {
    let made = json!({ "object": k, "version": version, "settings": asked });
    Map::from_iter([("lirm_gen".to_owned(), made)])
}

/// A digest as records write it.
pub(super) fn hex(digest: u64) -> String {
    format!("{digest:016x}")
}
