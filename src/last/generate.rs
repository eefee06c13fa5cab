//! Generates the data sets of LAST and records settings, causal truth and files in `dataset.json`.
//!
//! # Layout
//! ```text
//! dataset.json          command, settings, graph, coefficients, sortabilities, files and their digests
//! template.npz          see `sets`
//! observational/        see `sets`
//! interventions/        see `sets`
//! video/                a capture, see `subject`
//! ```
//! The module `folder` describes how a folder is created, resumed and overwritten.

use super::character::CharacterSubject;
use super::figure::Figures;
use super::folder::{self, JOURNAL, digest, slashed};
pub use super::progress::Progress;
use super::progress::check_stop;
use super::sets::{self, FRAMES_PER_SHARD, GROUPS_PER_SHARD, ImageSource, RenderJob};
pub use super::settings::{BOUNCES, CHARACTER_FACTORS, Settings, Which};
use super::subject::{self, BuiltIn, Subject};
use crate::io::{atomic, hex, read_bytes};
use crate::{Error, Result};
use data_gen::figure::factors::LETTERS;
use data_gen::figure::mechanism::Scm;
use data_gen::figure::samples;
use data_gen::figure::sortability::{r2_sortability, varsortability};
use data_gen::figure::video;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

pub use super::folder::RECORD;
pub use data_gen::figure::samples::BASES;

/// How strongly marginal statistics reveal the causal order; absent for a graph without edges, R² also for
/// collinear factors.
#[derive(Clone, Debug, PartialEq)]
pub struct Sortability {
    /// Name of the set of factors.
    pub set: &'static str,
    /// Number of samples.
    pub samples: usize,
    /// Sortability by variance.
    pub varsortability: Option<f64>,
    /// Sortability by explained variance (R²).
    pub r2_sortability: Option<f64>,
}

/// The result of a run.
#[derive(Clone, Debug)]
pub struct Report {
    /// Sortability of each set of factors.
    pub sortabilities: Vec<Sortability>,
    /// Paths relative to the folder, with their digests.
    pub files: Vec<(PathBuf, u64)>,
    /// Contents of `dataset.json`.
    pub record: Value,
}

/// Generates the data in a folder, or resumes an interrupted run, unless the folder is already complete. The
/// name of the folder must identify the relevant settings.
///
/// # Errors
/// See [`run`].
pub fn ensure(settings: &Settings, dir: &Path) -> Result<()> {
    // If two threads request the same data at the same time, the second finds them complete.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let record = std::fs::read(dir.join(RECORD)).ok();
    let complete = record
        .and_then(|b| serde_json::from_slice::<Value>(&b).ok())
        .is_some_and(|record| record["complete"] == true);
    if !complete {
        run(settings, dir, true, &AtomicBool::new(false), &mut |_, _, _| ())?;
    }
    Ok(())
}

/// Generates the data in a folder, which is created if necessary. With `resume`, continues the run that left
/// the folder; otherwise first removes the files of an earlier run.
///
/// # Errors
/// If the settings are invalid, a character cannot be used (then no file is changed), the run to be resumed
/// had other settings or is unknown, a file cannot be written, or `stop` was set; in the last case everything
/// finished so far is on disk.
pub fn run(
    settings: &Settings,
    dir: &Path,
    resume: bool,
    stop: &AtomicBool,
    progress: &mut Progress<'_>,
) -> Result<Report> {
    settings.validate()?;
    let which = Which::parse(&settings.set)?;
    let scm = settings.scm()?;
    let sortabilities = sortabilities(settings, which, &scm);
    let mut record = json!({
        "format": "lastlight LAST data set", "version": 1, "complete": false,
        "command": settings.command(), "settings": settings.record(),
        "letters": LETTERS[..settings.factors].iter().map(char::to_string).collect::<Vec<_>>(),
        "adjacency": scm.graph.adjacency.iter()
            .map(|row| row.iter().map(|&edge| i32::from(edge)).collect::<Vec<_>>()).collect::<Vec<_>>(),
        "coefficients": scm.a, "noise": scm.s, "standardised": scm.standardised,
        "sortability": sortabilities.iter().map(|s| json!({
            "set": s.set, "samples": s.samples, "varsortability": s.varsortability, "r2_sortability": s.r2_sortability,
        })).collect::<Vec<_>>(),
    });
    let actor = settings.character.as_ref().map(|c| CharacterSubject::new(c, &scm, settings)).transpose()?;
    let figure = (which.video && actor.is_none()).then(|| BuiltIn::new(settings, &scm));
    let subject = actor.as_ref().map(|a| a as &dyn Subject).or(figure.as_ref().map(|f| f as &dyn Subject));
    if let Some(subject) = subject {
        record["subject"] = subject.record();
    }
    if which.video {
        record["video_causes_are_balanced"] = json!(video::is_balanced(settings.factors, settings.frames));
    }
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    folder::sweep(dir)?;
    let mut known = BTreeMap::new();
    if resume {
        if let Some(there) = folder::check_resumed(dir, &record)? {
            known = folder::known_digests(&there);
            // Until the end, these are the files known to be complete.
            record["files"] = there["files"].clone();
        }
    } else {
        folder::clear(dir)?;
    }
    folder::write_record(dir, &record)?;
    let mut files: Vec<(PathBuf, u64)> = Vec::new();
    if which.observational || which.interventions {
        let figures;
        let sitter: &dyn ImageSource = match &actor {
            Some(actor) => actor,
            None => {
                figures = Figures::new(settings.points, settings.seed);
                &figures
            }
        };
        files.extend(write_sets(settings, which, (&scm, sitter), dir, &known, stop, progress)?);
    }
    if let Some(subject) = subject.filter(|_| which.video) {
        let shoot = subject::CaptureJob {
            size: settings.video_size,
            samples: settings.samples,
            test_cameras: video::test_cameras(settings.test_cameras),
            test_step: video::TEST_STEP,
            passes: settings.passes,
            seed: settings.seed,
        };
        files.extend(subject::write(subject, &shoot, &dir.join("video"), resume, stop, progress)?);
    }
    record["files"] =
        files.iter().map(|(path, digest)| json!({"file": slashed(path), "digest": hex(*digest)})).collect();
    record["complete"] = json!(true);
    folder::write_record(dir, &record)?;
    folder::remove_folder(&dir.join(JOURNAL))?;
    Ok(Report { sortabilities, files, record })
}

fn write_sets(
    settings: &Settings,
    which: Which,
    (scm, sitter): (&Scm, &dyn ImageSource),
    dir: &Path,
    known: &BTreeMap<String, String>,
    stop: &AtomicBool,
    progress: &mut Progress<'_>,
) -> Result<Vec<(PathBuf, u64)>> {
    let journal = dir.join(JOURNAL);
    std::fs::create_dir_all(&journal).map_err(|e| Error::os(&journal, &e))?;
    let studio = RenderJob {
        scm,
        sitter,
        seed: settings.seed,
        appearances: settings.appearances,
        look: settings.set_look,
        size: settings.set_size,
        samples: settings.samples,
    };
    let template = sets::bytes(&sitter.rest())?;
    atomic::write_bytes(&dir.join("template.npz"), &template)?;
    let mut files = vec![(PathBuf::from("template.npz"), digest(&template))];
    let jobs = [
        ("observational", which.observational, settings.count, FRAMES_PER_SHARD),
        ("interventions", which.interventions, settings.groups, GROUPS_PER_SHARD),
    ];
    for (name, wanted, count, per_shard) in jobs {
        if !wanted {
            continue;
        }
        let folder = dir.join(name);
        std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
        for shard in 0..count.div_ceil(per_shard) {
            check_stop(stop)?;
            progress(shard * per_shard, count, name);
            let relative = PathBuf::from(name).join(format!("{shard:04}.npz"));
            let path = dir.join(&relative);
            let mark = journal.join(format!("{name}-{shard:04}"));
            // The digest recorded by this run takes precedence over that of the finished run that it repairs.
            let expected =
                std::fs::read_to_string(&mark).ok().or_else(|| known.get(&slashed(&relative)).cloned());
            if expected.is_some() && path.exists() {
                let there = digest(&read_bytes(&path, crate::io::MAX_FILE_BYTES)?);
                if expected == Some(hex(there)) {
                    files.push((relative, there));
                    continue;
                }
            }
            let arrays = match name {
                "observational" => studio.observational(shard, count)?,
                _ => studio.interventions(shard, count)?,
            };
            let bytes = sets::bytes(&arrays)?;
            atomic::write_bytes(&path, &bytes)?;
            atomic::write_unflushed(&mark, hex(digest(&bytes)).as_bytes())?;
            files.push((relative, digest(&bytes)));
        }
        progress(count, count, name);
    }
    Ok(files)
}

fn sortabilities(settings: &Settings, which: Which, scm: &Scm) -> Vec<Sortability> {
    let of = |set, samples: Vec<Vec<f64>>| Sortability {
        set,
        samples: samples.len(),
        varsortability: varsortability(&scm.graph, &samples),
        r2_sortability: r2_sortability(&scm.graph, &samples),
    };
    let mut all = Vec::new();
    if which.observational {
        let frame = |i| samples::observed(scm, settings.seed, i, settings.count, settings.appearances).u;
        all.push(of("observational", (0..settings.count).map(frame).collect()));
    }
    if which.interventions {
        let bases = |i| samples::group(scm, settings.seed, i, settings.appearances).bases;
        all.push(of("intervention bases", (0..settings.groups).flat_map(bases).map(|f| f.u).collect()));
    }
    if which.video {
        let frame = |t| video::frame(scm, settings.seed, settings.subject, t, settings.frames).u;
        all.push(of("video", (0..settings.frames).map(frame).collect()));
    }
    all
}
