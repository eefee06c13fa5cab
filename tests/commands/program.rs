//! The built program: running it, interrupting it, reading its output.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// The configuration of a small model of LIRM.
pub(crate) const TINY: &str =
    r#"{"blocks": 1, "width": 16, "heads": 2, "plane_tokens": 2, "embed_tokens": 2, "channels": 4}"#;

/// Runs the program in a folder.
pub(crate) fn lastlight(args: &[&str], dir: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lastlight"))
        .args(args)
        .current_dir(dir)
        // It runs as a user starts it, not as cargo does.
        .env_remove("CARGO")
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

/// Runs and expects one error that holds all of `parts`: one line, but for errors of the command line itself, which show possible values and
/// usage below it; with `--json` one line of JSON.
pub(crate) fn refused(args: &[&str], dir: &Path, exit: i32, parts: &[&str]) {
    let o = lastlight(args, dir);
    let text = stderr(&o);
    assert_eq!(code(&o), exit, "{args:?}: {text}");
    let start = if args.contains(&"--json") { "{\"error\":" } else { "error: " };
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with(start)).collect();
    assert_eq!(errors.len(), 1, "{args:?}: one line: {text}");
    let message = if args.contains(&"--json") {
        let error: Value = serde_json::from_str(errors[0]).expect("one line of JSON");
        assert_eq!(error["error"]["exit_code"], exit, "{args:?}: {text}");
        error["error"]["message"].as_str().expect("a message").to_owned()
    } else if text.contains("For more information, try '--help'") {
        text[text.find(start).expect("found")..].to_owned()
    } else {
        errors[0].to_owned()
    };
    for part in parts {
        assert!(message.contains(part), "{args:?}: '{part}' in '{message}'");
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
