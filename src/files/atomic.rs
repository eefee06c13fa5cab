//! Atomic writes: write a temporary file beside the target, flush it to disk, rename it.

use crate::{Error, Result, lock};
use std::io::{BufWriter, Write};
use std::path::Path;

/// Prefix of the names of temporary files; letters, digits and [`SUFFIX`] follow.
const PREFIX: &str = ".lastlight-";
/// Suffix of the names of temporary files.
const SUFFIX: &str = ".part";

/// Writes a file through `f`. The target is unchanged until all data is on disk; then it is replaced in
/// one step. A failure or an interruption at any moment leaves the old file (or none), never half a new one.
///
/// # Errors
/// When the folder is missing or not writable, or `f` fails.
pub fn write(path: &Path, f: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
    put(path, f, true)
}

/// Like [`write_bytes`], but does not flush the file to disk, so that many small files are written quickly.
/// If the program ends at any moment, the file is complete or absent; a power cut may leave an empty one. Use
/// it for files whose digest is checked before they are relied on.
///
/// # Errors
/// See [`write()`].
pub fn write_unflushed(path: &Path, bytes: &[u8]) -> Result<()> {
    put(path, |w| w.write_all(bytes), false)
}

fn put(path: &Path, f: impl FnOnce(&mut dyn Write) -> std::io::Result<()>, flush: bool) -> Result<()> {
    let os = |e: std::io::Error| match e.kind() {
        std::io::ErrorKind::FileTooLarge => Error::os(path, &e)
            .hint("files of this process are limited in size (ulimit -f), or those of the disk are"),
        _ => Error::os(path, &e),
    };
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX);
    #[cfg(unix)]
    {
        // The usual permissions of a new file (the process's mask still applies), not those of a secret.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut temporary = builder.tempfile_in(folder).map_err(os)?;
    {
        let mut w = BufWriter::with_capacity(1 << 16, temporary.as_file_mut());
        f(&mut w).map_err(os)?;
        w.flush().map_err(os)?;
    }
    if flush {
        temporary.as_file().sync_all().map_err(os)?;
    }
    temporary.persist(path).map_err(|e| os(e.error))?;
    #[cfg(unix)]
    if flush {
        std::fs::File::open(folder).and_then(|d| d.sync_all()).map_err(os)?;
    }
    Ok(())
}

/// Removes a file if it is there.
///
/// # Errors
/// When it cannot be removed.
pub fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::os(path, &e)),
        _ => Ok(()),
    }
}

/// Removes the temporary files that a killed program left in a folder, not in those below it. A folder that
/// is not there has none. Call it only from the program that holds the folder's lock.
///
/// # Errors
/// When the folder cannot be read or a file not removed.
pub fn sweep(folder: &Path) -> Result<()> {
    if !folder.is_dir() {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).map_err(|e| Error::os(folder, &e))? {
        let entry = entry.map_err(|e| Error::os(folder, &e))?;
        if entry.file_name().to_str().is_some_and(is_temporary) {
            remove(&entry.path())?;
        }
    }
    Ok(())
}

fn is_temporary(name: &str) -> bool {
    name.starts_with(PREFIX) && name.ends_with(SUFFIX)
}

/// Whether a folder holds nothing that was finished: temporary files of a killed program and its lock do not
/// count. A folder that is not there is unused.
///
/// # Errors
/// When it cannot be read.
pub fn is_unused(folder: &Path) -> Result<bool> {
    if !folder.is_dir() {
        return Ok(!folder.exists());
    }
    for entry in std::fs::read_dir(folder).map_err(|e| Error::os(folder, &e))? {
        let name = entry.map_err(|e| Error::os(folder, &e))?.file_name();
        if !name.to_str().is_some_and(|n| n == lock::NAME || is_temporary(n)) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Writes bytes atomically.
///
/// # Errors
/// See [`write()`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write(path, |w| w.write_all(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.bin");
        write_bytes(&path, b"old").expect("first write");
        let e = write(&path, |w| {
            w.write_all(b"half")?;
            Err(std::io::Error::other("power cut"))
        })
        .expect_err("the writer failed");
        assert!(e.to_string().contains("a.bin") && e.to_string().contains("power cut"), "{e}");
        assert_eq!(std::fs::read(&path).expect("still there"), b"old", "old content");
        assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 1, "no temporary file is left");
    }

    #[test]
    fn leftovers_are_removed_and_nothing_else() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for name in [".lastlight-Ab12.part", "a.part", ".lastlight-notes", "a.png"] {
            std::fs::write(dir.path().join(name), "x").expect("writable");
        }
        std::fs::create_dir(dir.path().join("below")).expect("made");
        std::fs::write(dir.path().join("below/.lastlight-Cd34.part"), "x").expect("writable");
        sweep(dir.path()).expect("swept");
        sweep(&dir.path().join("not there")).expect("nothing to do");
        assert!(!dir.path().join(".lastlight-Ab12.part").exists(), "a leftover goes");
        assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 4, "the rest stays");
        assert!(dir.path().join("below/.lastlight-Cd34.part").exists(), "folders below are not entered");
    }

    #[test]
    fn a_missing_folder_is_named() {
        let e = write_bytes(Path::new("/nonexistent-folder/a.bin"), b"x").expect_err("no such folder");
        assert!(e.to_string().contains("/nonexistent-folder/a.bin"), "{e}");
    }
}
