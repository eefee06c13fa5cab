//! Locks that keep other programs out of a result folder.
//!
//! A lock is a file in the folder that the operating system locks while the program runs. The lock is
//! released when the program ends for any reason; a file left by a killed program is reused. The file
//! contains the process id, which is printed when another program is refused.

use crate::{Error, Result};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

/// Name of the lock file.
pub const NAME: &str = ".lastlight.lock";

/// An exclusive lock on a folder, released on drop.
#[derive(Debug)]
pub struct Lock {
    file: File,
    path: PathBuf,
}

impl Lock {
    /// Locks an existing folder. On a file system without locks this has no effect.
    ///
    /// # Errors
    /// When another program holds the lock, or no file can be written in the folder.
    pub fn take(folder: &Path) -> Result<Self> {
        let path = folder.join(NAME);
        if path.is_symlink() {
            // Another program's file would be opened and emptied.
            let e = Error::input(path.display().to_string()).expected("a lock file");
            return Err(e.got("a link").hint("remove it"));
        }
        loop {
            let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
            let mut file = opened.map_err(|e| Error::os(&path, &e))?;
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => return Err(in_use(folder, &mut file)),
                Err(TryLockError::Error(e)) if e.kind() != std::io::ErrorKind::Unsupported => {
                    return Err(Error::os(&path, &e));
                }
                _ => {}
            }
            // The previous program may have removed the file between opening and locking.
            if !is_at(&file, &path) {
                continue;
            }
            let written = file.set_len(0).and_then(|()| file.rewind());
            let written = written.and_then(|()| write!(file, "{}", std::process::id()));
            written.map_err(|e| Error::os(&path, &e))?;
            return Ok(Self { file, path });
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Removed while locked, so that the lock of another program is never removed.
        let _ = std::fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

fn in_use(folder: &Path, file: &mut File) -> Error {
    let mut process = String::new();
    let by = match file.read_to_string(&mut process) {
        Ok(_) if process.bytes().all(|b| b.is_ascii_digit()) && !process.is_empty() => {
            format!("a folder in use by process {process}")
        }
        _ => "a folder in use by another process".into(),
    };
    Error::input("--out")
        .at(folder.display().to_string())
        .expected("a folder that no other lastlight writes to")
        .got(by)
        .hint("wait until that process has ended, or choose another folder")
}

/// Whether a path still refers to the file that was opened.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true // an open file cannot be removed there
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time_and_a_file_left_behind_is_taken_over() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let first = Lock::take(dir.path()).expect("free");
        let text = Lock::take(dir.path()).expect_err("taken").to_string();
        assert!(text.contains(&format!("process {}", std::process::id())), "{text}");
        drop(first);
        assert!(!dir.path().join(NAME).exists(), "no file is left");
        std::fs::write(dir.path().join(NAME), "999999").expect("writable");
        drop(Lock::take(dir.path()).expect("nobody holds it"));
    }
}
