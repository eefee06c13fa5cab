//! Commands that run for a while, their inputs, and what they make when nobody disturbs them.

use crate::bases::Workshop;
use crate::program::{Execution, Program, errors, unclean};
use crate::table::Report;
use crate::tree::{self, Tree};
use std::collections::BTreeMap;
use std::io::Result;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How a command is run again after it was interrupted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Again {
    /// with `--resume`
    Resume,
    /// from the start, with `--force`
    Force,
}

/// A command; its inputs are in `../shop`, and it writes to `out`.
#[derive(Clone, Copy, Debug)]
pub struct Long {
    /// its name: a row of the table
    pub name: &'static str,
    line: &'static str,
    /// how it is run again
    pub again: Again,
    /// whether it takes more than a few seconds, so that it has a smaller share
    pub slow: bool,
}

impl Long {
    /// The words of the command on a number of threads, with more of them.
    pub fn words(&self, out: &str, threads: usize, more: &[&str]) -> Vec<String> {
        let mut words: Vec<String> = self.line.split(' ').map(str::to_owned).collect();
        words.extend(
            ["--out", out, "--json", "--quiet", "--threads", &threads.to_string()].map(str::to_owned),
        );
        words.extend(more.iter().map(|w| (*w).to_owned()));
        words
    }

    /// The words that run it again.
    pub fn again(&self, out: &str, threads: usize) -> Vec<String> {
        self.words(out, threads, &[if self.again == Again::Resume { "--resume" } else { "--force" }])
    }
}

/// All of them.
pub const ALL: [Long; 12] = [
    fast(
        "splat fit",
        "splat fit ../shop/photos --iterations 800 --initial 200 --max-gaussians 400 --checkpoint-every 20",
        Again::Resume,
    ),
    fast(
        "last fit",
        "last fit ../shop/data/video --iterations 1500 --max-gaussians 64 --checkpoint-every 50",
        Again::Resume,
    ),
    fast(
        "field fit",
        "field fit ../shop/photos --iterations 60 --side 16 --channels 4 --ray-samples 24 --crop-side 16 --crops 1 --materials shaded --checkpoint-every 4",
        Again::Resume,
    ),
    fast(
        "last pretrain",
        "last pretrain ../shop/data --iterations 13 --checkpoint-every 2 --batch-images 4 --batch-groups 4 --batch-points 16 --factor-dim 2",
        Again::Resume,
    ),
    fast(
        "last gen",
        "last gen --scale smoke --split all --observational 24 --groups 4 --appearances 2 --body-points 128 --frames 4 --test-cameras 1 --set-size 32 --video-size 48 --samples 2",
        Again::Resume,
    ),
    fast(
        "lirm train",
        "lirm train --stage 1a --config ../shop/tiny.json --iterations 10 --batch 1 --objects-at-once 1 --checkpoint-every 1",
        Again::Resume,
    ),
    fast("lirm gen", "lirm gen --objects 2 --views 6 --size 48 --samples 16 --texture 32", Again::Resume),
    fast(
        "mesh render",
        "mesh render ../shop/object.glb --cameras orbit:8 --size 48x48 --samples 32",
        Again::Resume,
    ),
    fast(
        "last tune",
        "last tune ../shop/model/model.safetensors ../shop/data/video --iterations 600",
        Again::Force,
    ),
    fast("demo, scene", "demo --only splat --iterations 40", Again::Force),
    Long {
        name: "demo, person",
        line: "demo --only last --iterations 20 --size 32",
        again: Again::Force,
        slow: true,
    },
    Long { name: "last study", line: "last study E13 --scale smoke", again: Again::Resume, slow: true },
];

const fn fast(name: &'static str, line: &'static str, again: Again) -> Long {
    Long { name, line, again, slow: false }
}

/// Configuration of a LIRM model whose steps take little time.
pub const TINY: &str =
    r#"{"blocks": 1, "width": 8, "heads": 2, "plane_tokens": 1, "embed_tokens": 1, "channels": 2}"#;

/// Command number n of a campaign: the slow ones have a share of one in five of the others, or none.
pub fn scheduled(n: u64, with_slow: bool) -> Long {
    let fast: Vec<Long> = ALL.into_iter().filter(|l| !l.slow).collect();
    let slow: Vec<Long> = ALL.into_iter().filter(|l| l.slow).collect();
    let (round, slot) = (n / 42, (n % 42) as usize);
    if with_slow && slot >= 40 {
        slow[(slot - 40 + round as usize) % slow.len()]
    } else {
        fast[slot % fast.len()]
    }
}

/// Makes the inputs in a folder `shop`.
///
/// # Errors
/// When a file cannot be written.
pub fn prepare(program: &Program, scratch: &Path) -> Result<()> {
    let dir = scratch.join("shop");
    std::fs::create_dir(&dir)?;
    std::fs::write(dir.join("tiny.json"), TINY)?;
    let shop = Workshop::new(program, &dir);
    shop.run(
        "last gen --scale smoke --split all --observational 16 --groups 16 --appearances 1 --body-points 64 --render-as points --frames 3 \
         --test-cameras 1 --set-size 64 --video-size 32 --samples 1 --out data --quiet",
    );
    shop.run("lirm gen --views 8 --size 24 --samples 2 --texture 32 --passes photo --out objects --quiet");
    std::fs::rename(dir.join("objects/object_00000/uniform"), dir.join("photos"))?;
    std::fs::rename(dir.join("objects/object_00000/object.glb"), dir.join("object.glb"))?;
    shop.run("last pretrain data --iterations 3 --batch-images 4 --batch-groups 4 --batch-points 16 --factor-dim 2 --out model --quiet");
    Ok(())
}

/// What an undisturbed run makes.
#[derive(Clone, Debug)]
pub struct Expected {
    /// digest in the record, where there is one
    pub digest: Option<String>,
    /// files, without those that hold times
    pub files: Tree,
    /// bytes of all files
    pub bytes: u64,
    /// how long it takes
    pub time: Duration,
}

/// The files of a result without those in which times are: records and reports. A result of one file is a tree of one.
///
/// # Errors
/// When one cannot be read.
pub fn result(out: &Path) -> Result<Tree> {
    if out.is_file() {
        return Ok(Tree::from([("out".into(), std::fs::read(out)?)]));
    }
    let mut files = tree::read(out)?;
    files
        .retain(|n, _| !["result.json", "study.json", "seconds.csv", ".html"].iter().any(|e| n.ends_with(e)));
    Ok(files)
}

/// Runs a command without disturbance in a new folder.
///
/// # Errors
/// When a file or the process is lost.
///
/// # Panics
/// When it fails.
#[expect(clippy::disallowed_types, reason = "the moments of signals are parts of this time")]
pub fn undisturbed(program: &Program, long: &Long, scratch: &Path) -> Result<Expected> {
    let dir = new_folder(scratch, "expected")?;
    let start = std::time::Instant::now();
    let e = program.run(&long.words("out", 1, &[]), &dir)?;
    let time = start.elapsed();
    assert!(e.status.success(), "{}: {}: {}", long.name, e.ended(), e.text());
    let bytes = tree::read(&dir)?.values().fold(0, |s, b| s + b.len() as u64);
    Ok(Expected { digest: e.digest(), files: result(&dir.join("out"))?, bytes, time })
}

/// Runs the trials of a campaign, each on a command of the list; each adds what it found to the report, and the first column counts the trials.
///
/// # Errors
/// When a file or a process is lost.
///
/// # Panics
/// When a command fails without disturbance.
pub fn trials(
    program: &Program,
    numbers: std::ops::Range<u64>,
    with_slow: bool,
    scratch: &Path,
    mut report: Report,
    mut trial: impl FnMut(u64, Long, &Expected, &mut Report) -> Result<()>,
) -> Result<Report> {
    prepare(program, scratch)?;
    let mut expected: BTreeMap<&str, Expected> = BTreeMap::new();
    for n in numbers {
        let long = scheduled(n, with_slow);
        if !expected.contains_key(long.name) {
            expected.insert(long.name, undisturbed(program, &long, scratch)?);
        }
        report.count(long.name, 0);
        trial(n, long, &expected[long.name], &mut report)?;
    }
    Ok(report)
}

/// An empty folder of that name beside the inputs.
///
/// # Errors
/// When it cannot be made.
pub fn new_folder(scratch: &Path, name: &str) -> Result<PathBuf> {
    let dir = scratch.join(name);
    tree::remove(&dir)?;
    std::fs::create_dir(&dir)?;
    Ok(dir)
}

/// What is wrong with a run that should have succeeded and made the expected result in `out`.
///
/// # Errors
/// When a file cannot be read.
pub fn wrong(e: &Execution, out: &Path, expected: &Expected) -> Result<Option<String>> {
    if !e.status.success() {
        return Ok(Some(format!("run again, it is refused: {}: {}", e.ended(), e.text())));
    }
    if e.digest() != expected.digest {
        return Ok(Some(format!("run again, its digest is {:?}, not {:?}", e.digest(), expected.digest)));
    }
    let files = result(out)?;
    let all = files.keys().chain(expected.files.keys());
    Ok(all
        .into_iter()
        .find(|n| files.get(*n) != expected.files.get(*n))
        .map(|n| format!("run again, {n} differs")))
}

/// What is wrong with the message of a run that ended with an error: one line of error in clean text.
pub fn bad_message(e: &Execution) -> Option<String> {
    if e.late {
        return Some("it did not end in time".into());
    }
    if e.status.code() == Some(101) || e.text().contains("panicked at") {
        return Some("a panic".into());
    }
    let errors = errors(e);
    unclean(e).or_else(|| (errors != 1).then(|| format!("{errors} lines of error")))
}
