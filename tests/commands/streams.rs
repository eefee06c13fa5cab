//! Closed and full streams: unread output changes neither a result nor an exit code.
#![cfg(unix)]

use crate::program::lastlight;
use std::fs::OpenOptions;
use std::path::Path;
use std::process::{Command, Stdio};

/// A stream that is never read.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

/// A stream that takes nothing.
fn full() -> Option<Stdio> {
    OpenOptions::new().write(true).open("/dev/full").ok().map(Stdio::from)
}

fn run(args: &[&str], dir: &Path, out: Stdio, err: Stdio) -> Option<i32> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lastlight"));
    let status = command.args(args).current_dir(dir).stdout(out).stderr(err).status();
    status.expect("the binary starts").code()
}

/// Commands that write to stderr: notes, progress, a usage error, an error.
const COMMANDS: [(&[&str], i32); 4] = [
    (&["gradcheck", "nn.linear"], 0),
    (&["demo", "--only", "splat", "--iterations", "40", "--out", "shown", "--force"], 0),
    (&["convert", "nothing.ply", "x.npz"], 2),
    (&["splat", "fit"], 2),
];

#[test]
fn a_closed_or_full_stderr_changes_no_exit_code() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (args, expected) in COMMANDS {
        let usual = lastlight(args, dir.path());
        let said = String::from_utf8_lossy(&usual.stderr);
        assert_eq!(usual.status.code(), Some(expected), "{args:?}: {said}");
        assert!(!said.is_empty(), "{args:?}: writes to stderr, or the test shows nothing");
        assert_eq!(run(args, dir.path(), Stdio::null(), closed()), Some(expected), "{args:?}: closed");
        if let Some(full) = full() {
            assert_eq!(run(args, dir.path(), Stdio::null(), full), Some(expected), "{args:?}: full");
        }
    }
}

#[test]
fn a_full_stdout_is_an_error_for_help_too() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for args in
        [&["--help"][..], &["splat", "fit", "--help"], &["--version"], &["doctor"], &["oracle", "list"]]
    {
        if let Some(full) = full() {
            assert_eq!(run(args, dir.path(), full, Stdio::null()), Some(2), "{args:?}: full");
        }
        assert_eq!(run(args, dir.path(), closed(), Stdio::null()), Some(0), "{args:?}: closed by a pager");
    }
}
