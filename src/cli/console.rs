//! The terminal: results on stdout, interruption, the command line as it was typed.

use crate::{Error, Result, claim};
use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set by Ctrl-C; a fit finishes its iteration, writes its checkpoint and stops.
static STOP: AtomicBool = AtomicBool::new(false);

/// Set while something runs that looks at [`STOP`]; anything else ends at once, since files are replaced whole.
static STOPPABLE: AtomicBool = AtomicBool::new(false);

/// Runs work that looks at the flag it is given and stops in good order.
pub(crate) fn stoppable<T>(work: impl FnOnce(&'static AtomicBool) -> T) -> T {
    STOPPABLE.store(true, Ordering::Relaxed);
    let outcome = work(&STOP);
    STOPPABLE.store(false, Ordering::Relaxed);
    outcome
}

/// Writes a line of the result to stdout. A reader that has gone away ends the program quietly.
///
/// # Errors
/// When stdout cannot be written for another reason.
pub(crate) fn say(line: &str) -> Result<()> {
    match writeln!(std::io::stdout().lock(), "{line}") {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => {
            claim::release();
            std::process::exit(0)
        }
        Err(e) => Err(Error::input("standard output").got(e.to_string())),
        Ok(()) => Ok(()),
    }
}

/// Writes a line to stderr: progress, notes, errors. Nobody may read it: a closed or full stderr changes neither the result nor the exit code.
pub(crate) fn note(line: &str) {
    // One write, so that lines of two programs do not mix.
    let _ = std::io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// Writes a result record to stdout as one JSON document.
///
/// # Errors
/// When stdout cannot be written.
pub(crate) fn say_json(record: &serde_json::Value) -> Result<()> {
    say(&format!("{record:#}"))
}

/// The command line as it can be typed again.
pub(crate) fn command_line() -> String {
    let plain =
        |s: &str| !s.is_empty() && s.chars().all(|c| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c));
    let quote = |s: String| if plain(&s) { s } else { format!("'{}'", s.replace('\'', "'\\''")) };
    let rest = std::env::args_os().skip(1).map(|a| quote(a.to_string_lossy().into_owned()));
    std::iter::once("lastlight".to_owned()).chain(rest).collect::<Vec<_>>().join(" ")
}

/// Makes Ctrl-C stop what is [`stoppable`] in good order, and anything else at once.
///
/// # Errors
/// When the system lets no handler be set.
pub(crate) fn stop_on_interrupt() -> std::result::Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| {
        if !STOPPABLE.load(Ordering::Relaxed) || STOP.swap(true, Ordering::Relaxed) {
            // Nothing that would stop in good order, or asked twice: nothing on disk is lost.
            claim::release();
            std::process::exit(130);
        }
        note("stopping in good order; press Ctrl-C again to stop at once");
    })
}

/// Errors of other crates may hold line breaks; ours is one line.
pub(crate) fn one_line(text: &str) -> String {
    text.split(['\n', '\r']).map(str::trim).filter(|s| !s.is_empty()).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_one_line() {
        assert_eq!(one_line("a\n  b\r\n\n"), "a; b", "joined");
    }
}
