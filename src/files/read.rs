//! How the bytes of a file are read, and how a decoder of another crate is run.

use super::{memory, paths};
use crate::{Error, Result};
use std::cell::Cell;
use std::io::Read;
use std::path::Path;
use std::sync::Once;

/// Largest file of arrays, Gaussians or points that is read, in bytes.
pub const MAX_FILE_BYTES: u64 = 8 << 30;

/// Largest image file or text file that is read, in bytes.
pub const MAX_SMALL_FILE_BYTES: u64 = 1 << 30;

/// A file by name and bytes, so that records of it do not depend on its folder.
///
/// # Errors
/// As [`read_bytes`].
pub fn identity(path: &Path) -> Result<serde_json::Value> {
    let bytes = read_bytes(path, MAX_FILE_BYTES)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(serde_json::json!({ "file": name, "digest": digest(&bytes) }))
}

/// FNV-1a 64 of bytes, as written in records.
pub fn digest(bytes: &[u8]) -> String {
    let mut digest = crate::num::bits::Digest::new();
    digest.bytes(bytes);
    hex(digest.value())
}

/// A digest as written in records.
pub fn hex(digest: u64) -> String {
    format!("{digest:016x}")
}

/// Contents of a regular file of at most `limit` bytes.
///
/// # Errors
/// When it cannot be opened or read, is not a regular file, or is longer.
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let os = |e| Error::os(path, &e);
    let too_long = |len: u64| {
        Error::input(path.display().to_string())
            .at("file size")
            .expected(format!("at most {limit} bytes"))
            .got(len.to_string())
    };
    let meta = std::fs::metadata(path).map_err(os)?;
    if !meta.is_file() {
        let got = if meta.is_dir() { "a folder" } else { "something else" };
        return Err(Error::input(path.display().to_string()).expected("a regular file").got(got));
    }
    if meta.len() > limit {
        return Err(too_long(meta.len()));
    }
    let mut bytes = memory::room(&name_of(path), usize::try_from(meta.len()).unwrap_or(usize::MAX))?;
    // The file may grow between the two calls; `take` keeps the bound.
    std::fs::File::open(path).map_err(os)?.take(limit + 1).read_to_end(&mut bytes).map_err(os)?;
    if bytes.len() as u64 > limit {
        return Err(too_long(bytes.len() as u64));
    }
    Ok(bytes)
}

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder of another crate; a panic inside becomes an error that names `name`, and prints nothing.
///
/// # Errors
/// The errors of `f`, and an error for a panic.
pub fn guard<T>(name: &str, f: impl FnOnce() -> Result<T>) -> Result<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        // Panics elsewhere are reported as before.
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                previous(info);
            }
        }));
    });
    let outer = GUARDED.replace(true);
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(f));
    GUARDED.set(outer);
    outcome.unwrap_or_else(|panic| {
        let text = panic
            .downcast_ref::<String>()
            .map(String::as_str)
            .or_else(|| panic.downcast_ref::<&str>().copied())
            .unwrap_or("no message");
        Err(Error::input(name)
            .at("inside the decoder")
            .expected("a well-formed file")
            .got(format!("a panic: {}", reported(&text))))
    })
}

/// Reads files by relative paths from the folder of a file, at most [`MAX_FILE_BYTES`] each. The caller has
/// cleaned the paths.
///
/// # Errors
/// The returned function fails where a file is missing, or as [`read_bytes`].
pub fn beside(path: &Path) -> impl Fn(&str) -> Result<Vec<u8>> {
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
        _ => Path::new(".").to_path_buf(),
    };
    move |relative: &str| {
        let found = paths::locate(&folder, relative).ok_or_else(|| {
            Error::input(relative)
                .expected(format!("a file in {}", folder.display()))
                .got("none of that name")
        })?;
        read_bytes(&found, MAX_FILE_BYTES)
    }
}

/// Most characters of a decoder's message in an error; some decoders list whole tables.
const MOST_REPORTED: usize = 300;

/// The message of a decoder of another crate, as the found part of an error. The expected part is stated by the
/// reader, so an "expected" of the message is reworded.
pub(crate) fn reported(e: &dyn std::fmt::Display) -> String {
    let text = e.to_string().replace(" expected ", " should be ");
    match text.char_indices().nth(MOST_REPORTED) {
        Some((end, _)) => format!("{} …", &text[..end]),
        None => text,
    }
}

/// Name of a path in errors.
pub fn name_of(path: &Path) -> String {
    path.display().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_error() {
        let e = guard::<()>("x.png", || panic!("index {} out of range", 7)).expect_err("it panicked");
        assert!(e.to_string().contains("x.png") && e.to_string().contains("index 7 out of range"), "{e}");
        assert_eq!(guard("x.png", || Ok(3)).expect("no panic"), 3, "values pass");
    }

    #[test]
    fn folders_and_long_files_are_refused() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        assert!(
            read_bytes(dir.path(), 10).expect_err("a folder").to_string().contains("a folder"),
            "says what it is"
        );
        let file = dir.path().join("a");
        std::fs::write(&file, [0; 11]).expect("a small file");
        assert!(
            read_bytes(&file, 10).expect_err("too long").to_string().contains("at most 10 bytes"),
            "says the bound"
        );
        assert_eq!(read_bytes(&file, 11).expect("fits").len(), 11, "whole file");
    }
}
