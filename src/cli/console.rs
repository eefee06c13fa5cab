//! The terminal: results on stdout, errors and notes on stderr, interruption, the command line as it was typed.

use crate::visible::{escaped, escaped_json, shortened};
use crate::{Error, Result, claim};
use clap::ColorChoice;
use clap::builder::styling::{AnsiColor, Style};
use serde_json::json;
use std::ffi::OsString;
use std::io::{IsTerminal as _, Write as _};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// What the options that every command has say about output.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Output {
    /// neither progress nor notes
    pub(crate) quiet: bool,
    /// also threads and the time of every part
    pub(crate) verbose: bool,
    /// results and errors as JSON
    pub(crate) json: bool,
    /// colours in help and errors
    pub(crate) color: ColorChoice,
}

static OUTPUT: OnceLock<Output> = OnceLock::new();

/// Arguments behind the name of the program, those of `--like` written out.
static ARGUMENTS: OnceLock<Vec<String>> = OnceLock::new();

/// Those that a folder of results keeps, for `--resume`.
static KEPT: OnceLock<Vec<String>> = OnceLock::new();

/// Keeps the arguments for records and reports, once.
pub(crate) fn set_arguments(arguments: &[OsString]) {
    // A second call has no effect.
    let _ = ARGUMENTS.set(arguments.iter().skip(1).map(|a| a.to_string_lossy().into_owned()).collect());
}

/// The arguments of this run, as its record keeps them.
pub(crate) fn arguments() -> &'static [String] {
    ARGUMENTS.get().map_or(&[], Vec::as_slice)
}

/// Sets what [`kept`] returns, once.
pub(crate) fn set_kept(arguments: Vec<String>) {
    let _ = KEPT.set(arguments);
}

/// The arguments that a folder of results keeps.
pub(crate) fn kept() -> &'static [String] {
    KEPT.get().map_or(&[], Vec::as_slice)
}

/// Sets the output of this program, once.
pub(crate) fn set_output(output: Output) {
    // A second call has no effect.
    let _ = OUTPUT.set(output);
}

fn output() -> Output {
    OUTPUT.get().copied().unwrap_or_default()
}

/// Whether neither progress nor notes are printed.
pub(crate) fn is_quiet() -> bool {
    output().quiet
}

/// Whether threads and the time of every part are printed too.
pub(crate) fn is_verbose() -> bool {
    output().verbose
}

/// Whether results and errors are JSON.
pub(crate) fn is_json() -> bool {
    output().json
}

/// Options needed for errors of the command line, read before it is parsed: `--json` and `--color`.
pub(crate) fn before_parsing(arguments: &[OsString]) -> Output {
    let mut out = Output::default();
    let mut words = arguments.iter().map(|a| a.to_string_lossy()).take_while(|a| a != "--");
    while let Some(word) = words.next() {
        if word == "--json" {
            out.json = true;
        }
        let color = match word.strip_prefix("--color") {
            Some("") => words.next().map(|value| value.to_string()),
            Some(value) => value.strip_prefix('=').map(str::to_owned),
            None => None,
        };
        out.color = color.and_then(|value| value.parse().ok()).unwrap_or(out.color);
    }
    out
}

/// Writes an error to stderr: one line of text, or one line of JSON with `kind`, `message` and `exit_code`.
pub(crate) fn error(output: Output, kind: &str, message: &str, exit_code: u8) {
    let message = one_line(message);
    let message = shortened(&message);
    if output.json {
        let document = json!({"error": {"kind": kind, "message": message, "exit_code": exit_code}});
        return write_error(&escaped_json(&document.to_string()));
    }
    let is_colored = match output.color {
        ColorChoice::Always => true,
        ColorChoice::Never => false,
        ColorChoice::Auto => {
            std::io::stderr().is_terminal()
                && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
        }
    };
    let style =
        if is_colored { Style::new().bold().fg_color(Some(AnsiColor::Red.into())) } else { Style::new() };
    write_error(&format!("{style}error:{style:#} {}", escaped(&message)));
}

/// How this program was called, for commands to type next: through cargo, or by its name or path.
pub(crate) fn program() -> String {
    let is_release = if cfg!(debug_assertions) { "" } else { " --release" };
    let of_cargo = std::env::var_os("CARGO").is_some()
        && std::env::var_os("CARGO_PKG_NAME").is_some_and(|name| name == "lastlight");
    if of_cargo {
        return format!("cargo run{is_release} --");
    }
    std::env::args().next().filter(|name| !name.is_empty()).map_or_else(|| "lastlight".to_owned(), quoted)
}

/// A word as a shell reads it.
fn quoted(word: String) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// Makes a write beyond the limit of file sizes (`ulimit -f`) an error; by default the signal ends the program without a message. To be called
/// before other threads are started, which inherit it; programs that this one runs do not.
pub(crate) fn fail_at_file_size_limit() {
    #[cfg(unix)]
    {
        use nix::sys::signal::{SigSet, Signal};
        let mut blocked = SigSet::empty();
        blocked.add(Signal::SIGXFSZ);
        // If it is refused, the signal does what it did.
        let _ = blocked.thread_block();
    }
}

/// Set by Ctrl-C; a fit finishes its iteration, writes its checkpoint and stops.
static STOP: AtomicBool = AtomicBool::new(false);

/// Set while work runs that checks [`STOP`]; anything else ends at once, since files are replaced atomically.
static STOPPABLE: AtomicBool = AtomicBool::new(false);

/// Runs work that checks the given flag and stops at a consistent state.
pub(crate) fn stoppable<T>(work: impl FnOnce(&'static AtomicBool) -> T) -> T {
    STOPPABLE.store(true, Ordering::Relaxed);
    let outcome = work(&STOP);
    STOPPABLE.store(false, Ordering::Relaxed);
    outcome
}

/// Writes a line of the result to stdout, with control characters from files escaped. A reader that has gone away ends the program quietly.
///
/// # Errors
/// When stdout cannot be written for another reason.
pub(crate) fn say(line: &str) -> Result<()> {
    match writeln!(std::io::stdout().lock(), "{}", escaped(line)) {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => {
            claim::release();
            std::process::exit(0)
        }
        Err(e) => Err(Error::input("standard output").got(e.to_string())),
        Ok(()) => Ok(()),
    }
}

/// Writes a line to stderr: progress, notes, errors. A closed or full stderr changes neither the result nor the exit code.
/// Control characters are escaped and long strings shortened, because they may come from files.
pub(crate) fn note(line: &str) {
    write_error(&escaped(&shortened(line)));
}

fn write_error(line: &str) {
    // One write, so that lines of two programs do not mix.
    let _ = std::io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// Writes a result record to stdout as one JSON document.
///
/// # Errors
/// When stdout cannot be written.
pub(crate) fn say_json(record: &serde_json::Value) -> Result<()> {
    say(&escaped_json(&format!("{record:#}")))
}

/// The command line as it can be typed again.
pub(crate) fn command_line() -> String {
    let rest = arguments().iter().cloned().map(quoted);
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
            let text = match claim::release() {
                claim::Kept::NoFolder => "interrupted",
                claim::Kept::Nothing => "interrupted before anything was saved",
                claim::Kept::Files => "interrupted; files in the folder of the results are complete",
            };
            error(output(), "interrupted", text, 130);
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

    #[test]
    fn json_and_colour_are_known_before_the_command_line_is_parsed() {
        let of = |words: &str| {
            let words: Vec<OsString> = words.split(' ').map(OsString::from).collect();
            let output = before_parsing(&words);
            (output.json, output.color)
        };
        assert_eq!(of("lastlight doctor"), (false, ColorChoice::Auto), "the defaults");
        assert_eq!(of("lastlight --color never x --json"), (true, ColorChoice::Never), "two words");
        assert_eq!(
            of("lastlight --color=always --color rainbow"),
            (false, ColorChoice::Always),
            "what is valid"
        );
        assert_eq!(of("lastlight x -- --json"), (false, ColorChoice::Auto), "no option behind --");
    }
}
