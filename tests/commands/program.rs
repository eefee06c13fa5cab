//! The built program: running it, interrupting it, reading its output.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the program in a folder.
pub(crate) fn lastlight(args: &[&str], dir: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lastlight"))
        .args(args)
        .current_dir(dir)
        .output()
        .expect("the binary starts")
}

/// Its exit code.
pub(crate) fn code(o: &Output) -> i32 {
    o.status.code().expect("it exits by itself")
}

/// Its stdout.
pub(crate) fn stdout(o: &Output) -> String {
    String::from_utf8(o.stdout.clone()).expect("text")
}

/// Its stderr.
pub(crate) fn stderr(o: &Output) -> String {
    String::from_utf8(o.stderr.clone()).expect("text")
}

/// Runs, expects success and returns the JSON on stdout.
pub(crate) fn json(args: &[&str], dir: &Path) -> Value {
    let o = lastlight(args, dir);
    assert_eq!(code(&o), 0, "{args:?}: {}", stderr(&o));
    serde_json::from_slice(&o.stdout).unwrap_or_else(|e| panic!("{args:?}: one JSON document on stdout: {e}"))
}

/// Runs and expects one error line that holds all of `parts`.
pub(crate) fn refused(args: &[&str], dir: &Path, exit: i32, parts: &[&str]) {
    let o = lastlight(args, dir);
    let text = stderr(&o);
    assert_eq!(code(&o), exit, "{args:?}: {text}");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{args:?}: one line: {text}");
    for part in parts {
        assert!(errors[0].contains(part), "{args:?}: '{part}' in '{}'", errors[0]);
    }
    assert!(!text.contains("panicked"), "{args:?}: {text}");
}

/// Starts the program, waits until `is_time`, sends a signal, waits for its end.
#[cfg(unix)]
pub(crate) fn signalled(args: &[&str], dir: &Path, signal: &str, is_time: &dyn Fn() -> bool) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_lastlight"))
        .args(args)
        .current_dir(dir)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the binary starts");
    while !is_time() {
        assert!(child.try_wait().expect("a child").is_none(), "{args:?}: it ended before it was time");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill runs");
    assert!(sent.success(), "the signal was sent");
    child.wait_with_output().expect("it ends")
}
