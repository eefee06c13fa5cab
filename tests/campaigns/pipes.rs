//! The campaign of closed and full streams: what nobody can read changes neither an exit code nor a result.

use crate::long;
use crate::program::{Program, Streams, wait};
use crate::table::{Finding, Report};
use crate::tree::{self, Tree};
use std::fs::OpenOptions;
use std::io::{BufRead as _, BufReader, Result};
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

/// Columns of the table, in order.
pub const COLUMNS: [&str; 4] = ["runs", "as with open streams", "wrong exit", "result differs"];

/// The first column of faults.
pub const FAULTS: usize = 2;

/// What happens to the streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    /// standard output is a pipe that nobody reads
    OutputUnread,
    /// standard output is closed after its first line, as by `head -1`
    OutputCut,
    /// standard output is not open at all
    OutputClosed,
    /// standard output is a full disk
    OutputFull,
    /// standard error is a pipe that nobody reads
    ErrorUnread,
    /// standard error is not open at all
    ErrorClosed,
    /// standard error is a full disk
    ErrorFull,
    /// nobody reads either
    BothUnread,
}

const MODES: [Mode; 8] = [
    Mode::OutputUnread,
    Mode::OutputCut,
    Mode::OutputClosed,
    Mode::OutputFull,
    Mode::ErrorUnread,
    Mode::ErrorClosed,
    Mode::ErrorFull,
    Mode::BothUnread,
];

/// Commands that print something; `out` is what they write.
const COMMANDS: [&str; 22] = [
    "--help",
    "splat fit --help",
    "--version",
    "doctor --threads 1",
    "oracle list",
    "oracle list --json",
    "oracle mint nn.linear --out out --json",
    "gradcheck nn.linear --threads 1",
    "gradcheck nn.linear --threads 1 --json",
    "convert ../shop/fit/scene.ply out.npz --json",
    "convert nothing.ply out.npz",
    "splat fit",
    "splat fit ../shop/photos --iterations 20 --initial 50 --out out --threads 1",
    "splat fit ../shop/photos --iterations 20 --initial 50 --out out --threads 1 --json",
    "splat eval ../shop/fit/scene.ply ../shop/photos --threads 1",
    "splat render ../shop/fit/scene.ply --cameras orbit:2 --size 8x8 --out out --threads 1",
    "mesh render ../shop/object.glb --cameras orbit:1 --size 8x8 --samples 1 --out out --threads 1",
    "lirm gen --views 1 --size 8 --samples 1 --texture 32 --out out --threads 1",
    "last gen --profile smoke --set video --frames 1 --test-cameras 1 --points 64 --video-size 16 --out out --threads 1",
    "last inspect ../shop/data/video --threads 1",
    "last fit ../shop/data/video --iterations 10 --max-gaussians 64 --out out --threads 1",
    "last intervene ../shop/model/model.safetensors ../shop/data/video --out out --threads 1",
];

/// Every `step`-th of all commands with all modes.
///
/// # Errors
/// When a file or a process is lost.
pub fn run(program: &Program, step: usize, scratch: &Path) -> Result<Report> {
    long::prepare(program, scratch)?;
    crate::bases::Workshop::new(program, &scratch.join("shop"))
        .run("splat fit photos --iterations 20 --initial 50 --out fit --threads 1 --quiet");
    let mut report = Report::new(&COLUMNS, FAULTS);
    for (n, (line, mode)) in COMMANDS.iter().flat_map(|c| MODES.map(|m| (*c, m))).enumerate().step_by(step) {
        let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let dir = long::new_folder(scratch, "trial")?;
        let usual = program.run(&words, &dir)?;
        let files = made(&dir)?;
        let dir = long::new_folder(scratch, "trial")?;
        let status = disturbed(program, &words, &dir, mode)?;
        let prints = !usual.stdout.is_empty();
        // An output that cannot be written is an error; a reader that left is not.
        let expected = if mode == Mode::OutputFull && prints { Some(2) } else { usual.status.code() };
        report.count(line, 0);
        let mut fault = |column, what: String| {
            report.count(line, column);
            report.add(Finding { row: line.into(), case: n as u64, what, detail: format!("{mode:?}") });
        };
        if status.code() != expected {
            fault(
                2,
                format!("exit code {:?}, signal {:?}, not {expected:?}", status.code(), status.signal()),
            );
        } else if mode != Mode::OutputFull && made(&dir)? != files {
            fault(3, "other files".into());
        } else {
            report.count(line, 1);
        }
    }
    Ok(report)
}

/// What a command made, without times.
fn made(dir: &Path) -> Result<Tree> {
    let mut files = Tree::new();
    for name in ["out", "out.npz"] {
        let path = dir.join(name);
        if path.exists() {
            files.extend(long::result(&path)?.into_iter().map(|(n, b)| (format!("{name}/{n}"), b)));
        }
    }
    files.extend(
        tree::read(dir)?
            .into_keys()
            .filter(|n| n.ends_with(".part") || n.ends_with(".lock"))
            .map(|n| (n, Vec::new())),
    );
    Ok(files)
}

/// A stream that nobody reads.
fn unread() -> Result<Stdio> {
    let (reader, writer) = std::io::pipe()?;
    drop(reader);
    Ok(writer.into())
}

fn full() -> Result<Stdio> {
    OpenOptions::new().write(true).open("/dev/full").map(Stdio::from)
}

fn disturbed(program: &Program, words: &[String], dir: &Path, mode: Mode) -> Result<ExitStatus> {
    let more = match mode {
        Mode::OutputClosed => "&& exec >&-",
        Mode::ErrorClosed => "&& exec 2>&-",
        _ => "",
    };
    let mut command = Streams::beside(dir).attach(program.command(words, dir, more))?;
    match mode {
        Mode::OutputUnread => drop(command.stdout(unread()?)),
        Mode::OutputFull => drop(command.stdout(full()?)),
        Mode::ErrorUnread => drop(command.stderr(unread()?)),
        Mode::ErrorFull => drop(command.stderr(full()?)),
        Mode::BothUnread => drop(command.stdout(unread()?).stderr(unread()?)),
        Mode::OutputCut => drop(command.stdout(Stdio::piped())),
        Mode::OutputClosed | Mode::ErrorClosed => {}
    }
    let mut child = command.spawn()?;
    if let Some(stdout) = child.stdout.take() {
        BufReader::with_capacity(16, stdout).read_line(&mut String::new())?;
    }
    Ok(wait(&mut child, Duration::from_secs(60))?.0)
}
