//! Runs of the program within limits of memory and time, and what they leave.

#![expect(clippy::disallowed_types, reason = "limits of time, for runs that do not end")]

use crate::tree::Tree;
use std::fs::File;
use std::io::Result;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// The program under test and the limits of one run.
#[derive(Clone, Debug)]
pub struct Program {
    /// the binary
    pub path: PathBuf,
    /// most address space, in KiB
    pub memory_kib: u64,
    /// longest run
    pub time: Duration,
}

/// A run that has ended.
#[derive(Clone, Debug)]
pub struct Execution {
    /// exit status
    pub status: ExitStatus,
    /// standard output
    pub stdout: Vec<u8>,
    /// standard error
    pub stderr: Vec<u8>,
    /// whether it was stopped at the limit of time
    pub late: bool,
}

impl Execution {
    /// Both streams as text, for messages.
    pub fn text(&self) -> String {
        format!("{}{}", String::from_utf8_lossy(&self.stdout), String::from_utf8_lossy(&self.stderr))
    }

    /// How it ended.
    pub fn ended(&self) -> String {
        match (self.late, self.status.code(), self.status.signal()) {
            (true, ..) => "did not end in time".into(),
            (_, Some(code), _) => format!("exit code {code}"),
            (_, _, signal) => format!("signal {}", signal.unwrap_or(0)),
        }
    }

    /// The value of `"digest"` in the JSON document on standard output.
    pub fn digest(&self) -> Option<String> {
        let record: serde_json::Value = serde_json::from_slice(&self.stdout).ok()?;
        record["digest"].as_str().map(str::to_owned)
    }
}

impl Program {
    /// With the usual limits: 1 GiB of address space and 20 s.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_path_buf(), memory_kib: 1 << 20, time: Duration::from_secs(20) }
    }

    /// The command, under the limit of memory and `more` limits of the shell's `ulimit`.
    pub fn command(&self, words: &[String], dir: &Path, more: &str) -> Command {
        let mut command = Command::new("sh");
        let limits = format!("ulimit -v {} && ulimit -c 0 {more} && exec \"$0\" \"$@\"", self.memory_kib);
        command.args(["-c", &limits]).arg(&self.path).args(words).current_dir(dir).stdin(Stdio::null());
        command
    }

    /// Runs the program in a folder. Its streams go to files beside `dir`, so that no pipe fills up.
    ///
    /// # Errors
    /// When the program cannot be started or a stream not be read.
    pub fn run(&self, words: &[String], dir: &Path) -> Result<Execution> {
        self.run_limited(words, dir, "")
    }

    /// [`Self::run`] under more limits of `ulimit`.
    ///
    /// # Errors
    /// Those of [`Self::run`].
    pub fn run_limited(&self, words: &[String], dir: &Path, more: &str) -> Result<Execution> {
        let streams = Streams::beside(dir);
        let child = streams.attach(self.command(words, dir, more))?.spawn()?;
        streams.finish(child, self.time)
    }
}

/// The files to which a run writes.
#[derive(Clone, Debug)]
pub struct Streams([PathBuf; 2]);

impl Streams {
    /// Files next to the folder, named after it.
    pub fn beside(dir: &Path) -> Self {
        Self([dir.with_extension("stdout"), dir.with_extension("stderr")])
    }

    /// Lets a command write to them.
    ///
    /// # Errors
    /// When they cannot be made.
    pub fn attach(&self, mut command: Command) -> Result<Command> {
        command.stdout(File::create(&self.0[0])?).stderr(File::create(&self.0[1])?);
        Ok(command)
    }

    /// Waits for the end, at most `time`, and reads what was written.
    ///
    /// # Errors
    /// When the process or a file is lost.
    pub fn finish(&self, mut child: Child, time: Duration) -> Result<Execution> {
        let (status, late) = wait(&mut child, time)?;
        Ok(Execution { status, stdout: std::fs::read(&self.0[0])?, stderr: std::fs::read(&self.0[1])?, late })
    }
}

/// Waits for the end of a process, and ends it after `time`.
///
/// # Errors
/// When the process is lost.
pub fn wait(child: &mut Child, time: Duration) -> Result<(ExitStatus, bool)> {
    let (start, mut pause) = (Instant::now(), Duration::from_micros(300));
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok((status, false));
        }
        if start.elapsed() > time {
            child.kill()?;
            return Ok((child.wait()?, true));
        }
        std::thread::sleep(pause);
        pause = Ord::min(2 * pause, Duration::from_millis(4));
    }
}

/// Why the text of a run cannot be shown in a terminal: a control character, bytes that are not UTF-8, or a line of more than 4 200 characters.
pub fn unclean(e: &Execution) -> Option<String> {
    for stream in [&e.stdout, &e.stderr] {
        let Ok(text) = std::str::from_utf8(stream) else { return Some("bytes that are not UTF-8".into()) };
        if let Some(c) = text.chars().find(|c| c.is_control() && !matches!(c, '\n' | '\t')) {
            return Some(format!("the control character {:#04x}", u32::from(c)));
        }
    }
    let text = String::from_utf8_lossy(&e.stderr);
    text.lines().any(|l| l.chars().count() > 4200).then(|| "a line of more than 4 200 characters".into())
}

/// Number of errors that a run reports: lines of `error: `, or a JSON document with an `error` where a command has `--json`.
pub fn errors(e: &Execution) -> usize {
    let text = e.text();
    let is_record = |line: &&str| {
        serde_json::from_str::<serde_json::Value>(line)
            .is_ok_and(|record| record["error"]["message"].is_string())
    };
    text.lines().filter(|line| line.starts_with("error: ") || is_record(line)).count()
}

/// Files that no run may leave: temporary ones, and the lock of a folder.
pub fn stray(tree: &Tree) -> Option<&str> {
    tree.keys().map(String::as_str).find(|name| name.ends_with(".part") || name.ends_with(".lastlight.lock"))
}
