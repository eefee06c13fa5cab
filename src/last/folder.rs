//! The folder of a data set: its record, the files that a resumed run reuses, and the files that a new run
//! removes.
//!
//! `dataset.json` is written first (`complete`: false) and again at the end, with the digest of every file.
//! While sets are being generated, `.shards/` contains the digest of every finished shard; it is written
//! after the shard, so a shard with a digest is complete and belongs to this run. A resumed run generates the
//! shards whose bytes do not match such a digest; its record must equal the existing one except for the
//! files. A run that is not resumed first removes the files of an earlier run ([`clear`]), so a folder never
//! mixes two runs. Digests are FNV-1a 64 of a file's bytes; the digest of `video` covers all of its images
//! and cameras.

use crate::fit::passes;
use crate::io::{atomic, read_bytes};
use crate::num::bits::Digest;
use crate::{Error, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the record of a data set.
pub const RECORD: &str = "dataset.json";

/// Folder with the digests of finished shards while sets are being generated.
pub(super) const JOURNAL: &str = ".shards";

/// Folders that contain shards.
const SETS: [&str; 2] = ["observational", "interventions"];

/// Removes the temporary files of a killed run, except those of the video, which its recorder removes.
pub(super) fn sweep(dir: &Path) -> Result<()> {
    atomic::sweep(dir)?;
    SETS.into_iter().chain([JOURNAL]).try_for_each(|folder| atomic::sweep(&dir.join(folder)))
}

/// A path as written in records.
pub(super) fn slashed(path: &Path) -> String {
    path.components().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// Writes the record.
pub(super) fn write_record(dir: &Path, record: &Value) -> Result<()> {
    atomic::write_bytes(&dir.join(RECORD), format!("{record:#}\n").as_bytes())
}

/// The record of the run to be resumed; `None` if no run was started.
pub(super) fn check_resumed(dir: &Path, record: &Value) -> Result<Option<Value>> {
    let path = dir.join(RECORD);
    if !path.exists() {
        if atomic::is_unused(dir)? {
            return Ok(None);
        }
        return Err(Error::input("--resume")
            .at(dir.display().to_string())
            .expected(format!("the folder of an interrupted run, containing {RECORD}"))
            .got("files but no dataset.json")
            .hint("choose another folder, or overwrite with --force"));
    }
    let bytes = read_bytes(&path, crate::io::MAX_SMALL_FILE_BYTES)?;
    let there = crate::io::json::parse(&bytes, &path.display().to_string())?;
    let differing = |wanted: &Value, there: &Value| -> Vec<String> {
        (wanted.as_object().into_iter().flatten())
            .filter(|(key, value)| there[key.as_str()] != **value)
            .map(|(key, value)| format!("{key} {} instead of {value}", there[key.as_str()]))
            .collect()
    };
    let fail = |at: &str, got: Vec<String>| {
        Error::input(path.display().to_string())
            .at(at)
            .expected("the same values as in this run")
            .got(got.join(", "))
            .hint("pass the settings of the interrupted run, or choose a new folder")
    };
    let settings = differing(&record["settings"], &there["settings"]);
    if !settings.is_empty() || record["settings"] != there["settings"] {
        return Err(fail("settings", settings));
    }
    let mut truth = record.clone();
    if let Some(top) = truth.as_object_mut() {
        // Equivalent settings may be written differently, and these entries change during a run.
        for key in ["settings", "command", "complete", "files"] {
            top.remove(key);
        }
    }
    let truth = differing(&truth, &there);
    if truth.is_empty() { Ok(Some(there)) } else { Err(fail("causes and subject", truth)) }
}

/// Digests of files by their path, read from a record.
pub(super) fn known_digests(record: &Value) -> BTreeMap<String, String> {
    let text = |v: &Value, key: &str| v[key].as_str().map(str::to_owned);
    (record["files"].as_array().into_iter().flatten())
        .filter_map(|f| Some((text(f, "file")?, text(f, "digest")?)))
        .collect()
}

/// Removes the files of an earlier run from a folder, its record first: shards, cameras, images of the ring,
/// digests. All other files are kept.
pub(super) fn clear(dir: &Path) -> Result<()> {
    for file in [RECORD, "template.npz", "video/body.npz"] {
        atomic::remove(&dir.join(file))?;
    }
    let is_number = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    let is_shard = |n: &str| n.strip_suffix(".npz").is_some_and(is_number);
    for set in SETS {
        remove_files(&dir.join(set), &is_shard)?;
    }
    let video = dir.join("video");
    remove_files(&video, &|n| n.starts_with("transforms") && n.ends_with(".json"))?;
    let is_picture = |n: &str| {
        let stem = n.rsplit_once('.').map_or(n, |(stem, _)| stem);
        let camera_and_frame = stem.strip_prefix('c').and_then(|s| s.split_once("_f"));
        camera_and_frame.is_some_and(|(c, f)| is_number(c) && is_number(f))
    };
    for folder in passes::FOLDERS {
        remove_files(&video.join(folder), &is_picture)?;
    }
    remove_folder(&dir.join(JOURNAL))
}

fn remove_files(folder: &Path, is_known: &dyn Fn(&str) -> bool) -> Result<()> {
    if !folder.is_dir() {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).map_err(|e| Error::os(folder, &e))? {
        let entry = entry.map_err(|e| Error::os(folder, &e))?;
        if is_known(&entry.file_name().to_string_lossy()) {
            atomic::remove(&entry.path())?;
        }
    }
    Ok(())
}

/// Removes a folder if it exists.
pub(super) fn remove_folder(path: &Path) -> Result<()> {
    match std::fs::remove_dir_all(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::os(path, &e)),
        _ => Ok(()),
    }
}

/// FNV-1a 64 of bytes.
pub(super) fn digest(bytes: &[u8]) -> u64 {
    let mut d = Digest::new();
    d.bytes(bytes);
    d.value()
}
