//! The folder of a set: its records, the files that a resumed run reuses, and the files that a new run
//! removes.
//!
//! `dataset.json` is written before the first image (`complete`: false) and again at the end; `object.json`
//! is written when its object is finished. A resumed run skips an object with `object.json` if every file of
//! its captures has the digest recorded in `transforms*.json`, and each capture and [`truth`] have the
//! digests recorded in `object.json`; images with other digests are rendered again (files are not flushed to
//! disk explicitly, so a power failure can leave them empty).

use super::settings::{Settings, Version};
use super::shots::shots;
use super::truth;
use crate::fit::passes::{self, Recorder};
use crate::io::{self, atomic, hex};
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Name of the record of a set.
pub(super) const RECORD: &str = "dataset.json";
/// The format recorded in it.
pub(super) const FORMAT: &str = "lastlight lirm gen 1";

/// Removes the temporary files of a killed run. A run that is not resumed also removes the existing set, its
/// records first, so that a folder never mixes two sets.
pub(super) fn begin(dir: &Path, settings_record: &Map<String, Value>, resume: bool) -> Result<()> {
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
        same_settings(&record, settings_record)?;
    } else if resume && !atomic::is_unused(dir)? {
        return Err(Error::input("--resume")
            .at(dir.display().to_string())
            .expected(format!("the folder of an interrupted run, containing {RECORD}"))
            .got("other files only")
            .hint("choose another folder, or overwrite with --force"));
    }
    atomic::sweep(dir)?;
    if resume {
        return Ok(());
    }
    atomic::remove(&record)?;
    objects.sort();
    for object in &objects {
        atomic::remove(&object.join(OBJECT))?;
        truth::clear(object)?;
        Version::ALL.iter().try_for_each(|version| passes::clear(&object.join(version.name())))?;
    }
    Ok(())
}

/// Writes the record of the set in `dir` before the first image; an existing record is kept.
pub(super) fn announce(dir: &Path, settings_record: &Map<String, Value>) -> Result<()> {
    let path = dir.join(RECORD);
    if path.is_file() {
        return Ok(());
    }
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    let top = json!({ "format": FORMAT, "complete": false, "settings": settings_record, "objects": [] });
    atomic::write_bytes(&path, format!("{top:#}\n").as_bytes())
}

/// Reads a record and checks that its settings equal these.
fn same_settings(path: &Path, settings_record: &Map<String, Value>) -> Result<Value> {
    let bytes = crate::io::read_bytes(path, crate::io::MAX_SMALL_FILE_BYTES)?;
    let name = path.display().to_string();
    let record = crate::io::json::parse(&bytes, &name)
        .map_err(|e| e.hint("remove the file to generate the set again"))?;
    if record["settings"].as_object() == Some(settings_record) {
        return Ok(record);
    }
    let of = |x: &Value, name: &str| match &x[name] {
        Value::Null => "none".to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let own = Value::Object(settings_record.clone());
    let theirs = record["settings"].as_object().into_iter().flatten().map(|(name, _)| name);
    let mut names = settings_record.keys().chain(theirs);
    let (expected, got) = match names.find(|name| record["settings"][name.as_str()] != own[name.as_str()]) {
        Some(name) => (format!("{name}: {}, as in the set", of(&record["settings"], name)), of(&own, name)),
        None => ("a set with settings".to_owned(), "none".to_owned()),
    };
    Err(Error::input("--resume")
        .at(path.display().to_string())
        .expected(expected)
        .got(got)
        .hint("choose another folder, or pass the settings of that set"))
}

/// Name of the record of an object.
const OBJECT: &str = "object.json";

/// The digest of the record of an object.
fn sealed(record: &Value) -> Value {
    json!(io::digest(format!("{record:#}").as_bytes()))
}

/// Writes the record of an object, with its own digest as the last entry.
pub(super) fn write_object(folder: &Path, record: &Value) -> Result<()> {
    let mut written = record.clone();
    written["digest"] = sealed(record);
    atomic::write_bytes(&folder.join(OBJECT), format!("{written:#}\n").as_bytes())
}

/// The record of object k if its folder is complete: it was generated with these settings, and every file has
/// the recorded digest.
pub(super) fn finished(
    folder: &Path,
    settings: &Settings,
    settings_record: &Map<String, Value>,
    k: u64,
) -> Result<Option<Value>> {
    let path = folder.join(OBJECT);
    if !path.is_file() {
        return Ok(None);
    }
    let mut record = same_settings(&path, settings_record)?;
    let digest = record.as_object_mut().and_then(|entries| entries.shift_remove("digest"));
    if digest != Some(sealed(&record)) {
        return Err(Error::input("--resume")
            .at(path.display().to_string())
            .expected("an unchanged record")
            .got("one that differs from its digest")
            .hint("remove that file to write it again"));
    }
    let (shots, _) = shots(settings, k);
    let mut is_whole = true;
    for (n, version) in settings.versions().into_iter().enumerate() {
        let dir = folder.join(version.name());
        let there = Recorder::verify(&dir, header(settings_record, k, version), &shots)?;
        if there.is_some_and(|there| record["versions"][n]["digest"] != hex(there.digest)) {
            return Err(Error::input("--resume")
                .at(dir.display().to_string())
                .expected("unchanged cameras and digests")
                .got("changed entries in transforms*.json")
                .hint("remove that folder to generate it again"));
        }
        is_whole &= there.is_some_and(|there| there.is_whole);
    }
    is_whole &= truth::is_whole(folder, &record["truth"]);
    Ok(is_whole.then_some(record))
}

/// The header of the `transforms.json` of a version of object k.
pub(super) fn header(settings_record: &Map<String, Value>, k: u64, version: Version) -> Map<String, Value> {
    let made = json!({ "object": k, "version": version.name(), "settings": settings_record });
    Map::from_iter([("lirm_gen".to_owned(), made)])
}
