//! The folder of a data set from run to run: its record, what a continued run takes over, what a new one removes.
//!
//! `dataset.json` is written first (`complete`: false) and once more at the end, with the digest of every file. While sets are being
//! made, `.shards/` has the digest of every finished shard; it is written after the shard, so a shard with a digest is whole and of this run.
//! A run that was interrupted makes the shards whose bytes have no such digest; its record must say the same but for the files. A run that is
//! not continued first removes what an earlier one left ([`clear`]), so a folder never mixes two. Digests are FNV-1a 64 of a file's
//! bytes; that of `video` stands for all its pictures and cameras.

use crate::fit::passes;
use crate::io::{atomic, read_bytes};
use crate::num::bits::Digest;
use crate::{Error, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// The record of a data set.
pub const RECORD: &str = "dataset.json";

/// Digests of finished shards while sets are being made.
pub(super) const JOURNAL: &str = ".shards";

/// Folders of shards.
const SETS: [&str; 2] = ["observational", "interventions"];

/// Removes the temporary files of a killed run, but for those of the video, whose recorder does it.
pub(super) fn sweep(dir: &Path) -> Result<()> {
    atomic::sweep(dir)?;
    SETS.into_iter().chain([JOURNAL]).try_for_each(|folder| atomic::sweep(&dir.join(folder)))
}

/// A path as records write it.
pub(super) fn slashed(path: &Path) -> String {
    path.components().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// Writes the record.
pub(super) fn write_record(dir: &Path, record: &Value) -> Result<()> {
    atomic::write_bytes(&dir.join(RECORD), format!("{record:#}\n").as_bytes())
}

/// The record of the run that is continued; none where nothing was begun.
pub(super) fn check_resumed(dir: &Path, record: &Value) -> Result<Option<Value>> {
    let path = dir.join(RECORD);
    if !path.exists() {
        if atomic::is_unused(dir)? {
            return Ok(None);
        }
        return Err(Error::input("--resume")
            .at(dir.display().to_string())
            .expected(format!("the folder of an interrupted run, with its {RECORD}"))
            .got("files without that record")
            .hint("choose another folder, or start over with --force"));
    }
    let bytes = read_bytes(&path, crate::io::MAX_SMALL_FILE_BYTES)?;
    let there: Value = serde_json::from_slice(&bytes).map_err(|e| {
        Error::input(path.display().to_string()).expected("a JSON document").got(e.to_string())
    })?;
    let differing = |wanted: &Value, there: &Value| -> Vec<String> {
        (wanted.as_object().into_iter().flatten())
            .filter(|(key, value)| there[key.as_str()] != **value)
            .map(|(key, value)| format!("{key} {} instead of {value}", there[key.as_str()]))
            .collect()
    };
    let fail = |at: &str, got: Vec<String>| {
        Error::input(path.display().to_string())
            .at(at)
            .expected("those of this run")
            .got(got.join(", "))
            .hint("give the settings of the interrupted run, or a new folder")
    };
    let settings = differing(&record["settings"], &there["settings"]);
    if !settings.is_empty() || record["settings"] != there["settings"] {
        return Err(fail("settings", settings));
    }
    let mut truth = record.clone();
    if let Some(top) = truth.as_object_mut() {
        // Words that say the same settings, and what changes while a run goes on.
        for key in ["settings", "command", "complete", "files"] {
            top.remove(key);
        }
    }
    let truth = differing(&truth, &there);
    if truth.is_empty() { Ok(Some(there)) } else { Err(fail("causes and subject", truth)) }
}

/// Digests of files by their path, from a record.
pub(super) fn known_digests(record: &Value) -> BTreeMap<String, String> {
    let text = |v: &Value, key: &str| v[key].as_str().map(str::to_owned);
    (record["files"].as_array().into_iter().flatten())
        .filter_map(|f| Some((text(f, "file")?, text(f, "digest")?)))
        .collect()
}

/// Removes what an earlier run left in a folder, its record first: shards, cameras, pictures of the ring, digests. Everything else stays.
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

/// Removes a folder if it is there.
pub(super) fn remove_folder(path: &Path) -> Result<()> {
    match std::fs::remove_dir_all(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::os(path, &e)),
        _ => Ok(()),
    }
}

/// A digest as records write it.
pub(super) fn hex(digest: u64) -> String {
    format!("{digest:016x}")
}

/// FNV-1a 64 of bytes.
pub(super) fn digest(bytes: &[u8]) -> u64 {
    let mut d = Digest::new();
    d.bytes(bytes);
    d.value()
}
