//! The campaign of damaged files: every execution damages one file of a base ([`crate::bases`]), runs a command that reads it, and judges how the
//! program ended and what it left.
//!
//! Case n of a format under a seed is the same everywhere: every number is drawn at a counter made of the case and the format's name.

use crate::bases::Base;
use crate::damage::{Content, damage};
use crate::mutate::Draws;
use crate::program::{Execution, Program, errors, unclean};
use crate::table::{Finding, Report};
use crate::tree;
use std::collections::BTreeMap;
use std::io::Result;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// What the draws are for, among those of a seed.
const PURPOSE: u16 = 2;

/// Columns of the table, in order; those from [`FAULTS`] on are faults.
pub const COLUMNS: [&str; 11] = [
    "executions",
    "accepted",
    "refused",
    "of these, naming another file",
    "panic",
    "signal",
    "memory",
    "time",
    "message",
    "files left",
    "digest",
];

/// The first column of faults.
pub const FAULTS: usize = 4;

/// Which cases are run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// seed
    pub seed: u64,
    /// the first execution
    pub first: u64,
    /// number of executions
    pub runs: u64,
    /// executions at the same time
    pub jobs: usize,
}

/// A case as it is run.
#[derive(Clone, Debug)]
pub struct Case {
    /// the file that is damaged
    pub file: String,
    /// what is done to it
    pub what: String,
    /// what is in its place
    pub content: Content,
    /// the command
    pub words: Vec<String>,
}

/// Case n of a base.
pub fn case(base: &Base, seed: u64, n: u64) -> Case {
    let mut name = 0x811c_9dc5_u32; // FNV-1a
    base.format.bytes().for_each(|b| name = (name ^ u32::from(b)).wrapping_mul(0x0100_0193));
    let mut draws = Draws::new(seed, n, name, PURPOSE);
    let file = base.damaged[draws.below(base.damaged.len())].clone();
    let words = base.words(draws.below(base.commands.len()), &file);
    let others: Vec<&[u8]> = base.damaged.iter().map(|n| &base.files[n][..]).collect();
    let (what, content) = damage(&mut draws, &base.files[&file], &others);
    Case { file, what, content, words }
}

/// Puts the damaged file into a folder that has the base.
///
/// # Errors
/// When it cannot be written.
pub fn place(case: &Case, dir: &Path) -> Result<()> {
    let path = dir.join(&case.file);
    match &case.content {
        Content::File(bytes) => std::fs::write(path, bytes),
        Content::Missing => std::fs::remove_file(path),
        Content::Folder => std::fs::remove_file(&path).and_then(|()| std::fs::create_dir(&path)),
    }
}

/// The base and the number of the case of an execution: executions go through the bases again and again, each as often as its share.
fn scheduled(bases: &[Base], execution: u64) -> (usize, u64) {
    let total = bases.iter().fold(0, |s, b| s + u64::from(b.share));
    let (round, mut slot) = (execution / total, execution % total);
    let mut base = 0;
    while slot >= u64::from(bases[base].share) {
        slot -= u64::from(bases[base].share);
        base += 1;
    }
    (base, round * u64::from(bases[base].share) + slot)
}

/// How an execution ended: the column, and for a fault what is wrong.
pub type Verdict = (usize, Option<String>);

const ACCEPTED: usize = 1;
const REFUSED: usize = 2;
const ELSEWHERE: usize = 3;

/// Judges an execution; `changed` are the files that are not as before, but for the damaged one.
fn judge(base: &Base, case: &Case, e: &Execution, changed: &[String], digest: Option<&str>) -> Verdict {
    let text = e.text();
    if e.late {
        return (7, Some("it did not end in time".into()));
    }
    if text.contains("memory allocation of") {
        return (6, Some("an allocation failed and ended the program".into()));
    }
    if e.status.code() == Some(101) || text.contains("panicked at") {
        return (4, Some("a panic".into()));
    }
    let Some(code) = e.status.code() else {
        return (5, Some(format!("signal {}", e.status.signal().unwrap_or(0))));
    };
    if let Some(what) = unclean(e) {
        return (8, Some(what));
    }
    let is_out = |n: &&String| n.starts_with("out");
    if let Some(n) = changed.iter().find(|n| n.ends_with(".part") || n.contains(".lastlight.lock")) {
        return (9, Some(format!("it left {n}")));
    }
    match code {
        0 => {
            if base.same_digest && e.digest().as_deref() != digest {
                return (10, Some(format!("accepted, with the digest {:?}, not {digest:?}", e.digest())));
            }
            let input = changed.iter().find(|n| !is_out(n) && !base.same_digest);
            input.map_or((ACCEPTED, None), |n| (9, Some(format!("it changed the input {n}"))))
        }
        1 | 2 => {
            // A capture that is inspected, and arrays that are compared, are reported on standard output.
            let reported = code == 1 && !e.stdout.is_empty();
            // The record of a data set that is continued is incomplete until the data set is complete again.
            let is_reopened = |n: &str| base.same_digest && n.ends_with("dataset.json");
            if let Some(n) = changed.iter().find(|n| !(is_reopened(n) || reported && is_out(n))) {
                return (9, Some(format!("refused, and it left {n}")));
            }
            let errors = errors(e);
            if !reported && errors != 1 {
                return (8, Some(format!("{errors} lines of error")));
            }
            let last = |name: &str| name.rsplit('/').next().unwrap_or(name).to_owned();
            // A body model is one file or a folder of several; an error about what they give together names the model.
            if reported || text.contains(&last(&case.file)) || text.contains("body model") {
                return (REFUSED, None);
            }
            let parts = base.files.keys().flat_map(|n| n.split('/')).filter(|p| p.len() > 2);
            let names: Vec<&str> = parts.filter(|p| text.contains(*p)).collect();
            if names.is_empty() { (8, Some("it names no file".into())) } else { (ELSEWHERE, None) }
        }
        code => (8, Some(format!("exit code {code}"))),
    }
}

/// The folders of one worker.
struct Worker<'a> {
    program: &'a Program,
    bases: &'a [Base],
    dir: PathBuf,
    ready: Vec<bool>,
}

impl Worker<'_> {
    /// The folder with a base.
    fn folder(&mut self, base: usize) -> Result<PathBuf> {
        let dir = self.dir.join(base.to_string());
        if !self.ready[base] {
            tree::write(&dir, &self.bases[base].files)?;
            self.ready[base] = true;
        }
        Ok(dir)
    }

    /// Runs a case and puts the folder back as it was.
    fn execute(&mut self, base: usize, case: &Case, digest: Option<&str>) -> Result<(Verdict, Execution)> {
        let dir = self.folder(base)?;
        place(case, &dir)?;
        let e = self.program.run(&case.words, &dir)?;
        let path = dir.join(&case.file);
        tree::remove(&path)?;
        std::fs::write(&path, &self.bases[base].files[&case.file])?;
        let changed = tree::restore(&dir, &self.bases[base].files)?;
        Ok((judge(&self.bases[base], case, &e, &changed, digest), e))
    }
}

/// Runs every command of every base on the undamaged files: each must be accepted. Optional bases that are not are removed. Gives the digests.
///
/// # Errors
/// When a file or a process is lost.
///
/// # Panics
/// When a valid base is refused.
pub fn check_bases(
    program: &Program,
    bases: &mut Vec<Base>,
    scratch: &Path,
) -> Result<BTreeMap<&'static str, Option<String>>> {
    let (mut digests, mut skipped, mut refused) = (BTreeMap::new(), Vec::new(), String::new());
    let dir = scratch.join("valid");
    for base in &*bases {
        for (command, line) in base.commands.iter().enumerate() {
            let of_each = line.contains("{file}");
            for file in if of_each { &base.damaged[..] } else { &base.damaged[..1] } {
                tree::write(&dir, &base.files)?;
                let words = base.words(command, file);
                let e = program.run(&words, &dir)?;
                tree::remove(&dir)?;
                if base.same_digest {
                    digests.insert(base.format, e.digest());
                }
                match e.status.code() {
                    Some(0) => {}
                    Some(2) if base.optional => skipped.push(base.format),
                    _ => {
                        refused +=
                            &format!("{}: {}: {}: {}\n", base.format, words.join(" "), e.ended(), e.text())
                    }
                }
            }
        }
    }
    assert!(refused.is_empty(), "valid files are accepted:\n{refused}");
    bases.retain(|b| !skipped.contains(&b.format));
    assert!(!bases.is_empty(), "a base that this build reads");
    Ok(digests)
}

/// Runs the campaign in a folder; `progress` is called with the number of executions so far.
///
/// # Errors
/// When a file or a process is lost.
///
/// # Panics
/// When a valid base is refused.
pub fn run(
    program: &Program,
    bases: &mut Vec<Base>,
    settings: &Settings,
    scratch: &Path,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Report> {
    let digests = check_bases(program, bases, scratch)?;
    let bases = &bases[..];
    let report = Mutex::new(Report::new(&COLUMNS, FAULTS));
    let (next, end) = (AtomicU64::new(settings.first), settings.first + settings.runs);
    let work = |job: usize| -> Result<()> {
        let dir = scratch.join(format!("worker{job}"));
        let mut worker = Worker { program, bases, dir, ready: vec![false; bases.len()] };
        loop {
            let execution = next.fetch_add(1, Ordering::Relaxed);
            if execution >= end {
                return Ok(());
            }
            let (b, n) = scheduled(bases, execution);
            let (base, case) = (&bases[b], case(&bases[b], settings.seed, n));
            let ((column, fault), e) =
                worker.execute(b, &case, digests.get(base.format).and_then(Option::as_deref))?;
            let mut report = report.lock().expect("no other worker panicked");
            report.count(base.format, 0);
            report.count(base.format, column);
            if column == ELSEWHERE {
                report.count(base.format, REFUSED);
            }
            if let Some(fault) = fault {
                report.add(Finding {
                    row: base.format.into(),
                    case: n,
                    what: fault,
                    detail: format!(
                        "{}: {}\n  {}\n  {}: {}",
                        case.file,
                        shortened(&case.what),
                        case.words.join(" "),
                        e.ended(),
                        shortened(&e.text())
                    ),
                });
            }
            drop(report);
            progress(execution + 1 - settings.first);
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..settings.jobs).map(|job| scope.spawn(move || work(job))).collect();
        workers.into_iter().try_for_each(|w| w.join().expect("a worker ends"))
    })?;
    Ok(report.into_inner().expect("the workers have ended"))
}

/// The first 400 characters without control characters.
fn shortened(text: &str) -> String {
    text.escape_debug().take(400).collect()
}
