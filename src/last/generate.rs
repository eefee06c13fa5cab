//! Makes the data of LAST: which sets, with which truth, and the record of all of it in `dataset.json`.
//!
//! # Layout
//! ```text
//! dataset.json          command, settings, graph, coefficients, sortabilities, files and their digests
//! template.npz          see `sets`
//! observational/        see `sets`
//! interventions/        see `sets`
//! video/                a capture, see `subject`
//! ```
//! How a folder is begun, continued and started over: `folder`.

use super::character::{Actor, Casting};
use super::figure::{Figures, Look};
use super::folder::{self, JOURNAL, digest, hex, slashed};
use super::sets::{self, FRAMES_PER_SHARD, GROUPS_PER_SHARD, Sitter, Studio};
use super::subject::{self, BuiltIn, Subject};
use crate::io::{atomic, read_bytes};
use crate::{Error, Result};
use data_gen::figure::factors::LETTERS;
use data_gen::figure::graph::Graph;
use data_gen::figure::mechanism::{Mechanism, Scm};
use data_gen::figure::samples;
use data_gen::figure::sortability::{r2_sortability, varsortability};
use data_gen::figure::{MAX_FACTORS, video};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

pub use super::folder::RECORD;

/// Bounces of light after the first hit, for surfaces of video and sets alike.
pub const BOUNCES: u32 = 1;

/// Factors that act on a character: posture, elbow, folds, light.
pub const CHARACTER_FACTORS: usize = 4;

/// Which sets are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Which {
    /// a moving subject
    pub video: bool,
    /// frames as they come
    pub observational: bool,
    /// frames before and after do(i, v)
    pub interventions: bool,
}

impl Which {
    /// `video`, `observational`, `interventions`, `training` (both of these) or `all`.
    ///
    /// # Errors
    /// For any other name.
    pub fn parse(name: &str) -> Result<Self> {
        let only = |video, observational, interventions| Self { video, observational, interventions };
        match name {
            "video" => Ok(only(true, false, false)),
            "observational" => Ok(only(false, true, false)),
            "interventions" => Ok(only(false, false, true)),
            "training" => Ok(only(false, true, true)),
            "all" => Ok(only(true, true, true)),
            other => Err(Error::input("set")
                .expected("video, observational, interventions, training (both of these) or all")
                .got(other)),
        }
    }
}

/// Everything a data set depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// as [`Which::parse`] reads it
    pub set: String,
    /// `FORK` … `EMPTY`, `ER-m`
    pub graph: String,
    /// number of factors, 2 to 8
    pub factors: usize,
    /// `LIN`, `NL`, `NG`, `NL-NG`
    pub mechanism: String,
    /// unit noise and coefficients as drawn instead of unit variances
    pub raw: bool,
    /// of the video
    pub video_look: Look,
    /// of the sets
    pub set_look: Look,
    /// side of the video's pictures
    pub video_size: usize,
    /// side of the sets' pictures
    pub set_size: usize,
    /// per pixel, surfaces only
    pub samples: u32,
    /// observational frames
    pub count: usize,
    /// intervention groups
    pub groups: usize,
    /// looks that the sets choose from
    pub appearances: usize,
    /// points of the template
    pub points: usize,
    /// of the video
    pub frames: usize,
    /// of the video, 1 to 22
    pub test_cameras: usize,
    /// the video also gets depth, normals, albedo, material and linear radiance
    pub passes: bool,
    /// look of the video's subject
    pub subject: u64,
    /// a character instead of the built-in figure
    pub character: Option<Casting>,
    /// of every draw
    pub seed: u64,
}

impl Settings {
    /// The sizes of `last.md` §3.5.
    pub fn full() -> Self {
        Self {
            set: "all".into(),
            graph: "FORK".into(),
            factors: 4,
            mechanism: "NL".into(),
            raw: false,
            video_look: Look::Mesh,
            set_look: Look::Discs,
            video_size: 256,
            set_size: 64,
            samples: 16,
            count: 2048,
            groups: 256,
            appearances: 64,
            points: 2048,
            frames: 100,
            test_cameras: 22,
            passes: false,
            subject: 0,
            character: None,
            seed: 0,
        }
    }

    /// Small enough to look at in seconds.
    pub fn smoke() -> Self {
        Self {
            video_size: 64,
            count: 128,
            groups: 16,
            appearances: 8,
            points: 1024,
            frames: 20,
            test_cameras: 4,
            ..Self::full()
        }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// Names the setting.
    pub fn validate(&self) -> Result<()> {
        let which = Which::parse(&self.set)?;
        let of_character = |is_wrong: bool, name: &str, expected: &str, got: String| match &self.character {
            Some(_) if is_wrong => {
                Err(Error::input(format!("setting {name}")).expected(expected.to_owned()).got(got))
            }
            _ => Ok(()),
        };
        let sets = which.observational || which.interventions;
        let plays = self.character.as_ref().is_some_and(|c| c.play);
        let look = self.video_look;
        of_character(
            which.video && look != Look::Mesh,
            "video look",
            "mesh for a character",
            look.name().into(),
        )?;
        of_character(
            sets && self.appearances != 1,
            "appearances",
            "1: a character has one look",
            self.appearances.to_string(),
        )?;
        of_character(
            sets && plays,
            "play",
            "no time in the sets: their pictures have no order",
            "animations that run on".into(),
        )?;
        let within = |name: &str, x: usize, low: usize, high: usize| {
            if (low..=high).contains(&x) {
                Ok(())
            } else {
                Err(Error::input(format!("setting {name}"))
                    .expected(format!("{low} to {high}"))
                    .got(x.to_string()))
            }
        };
        within("factors", self.factors, 2, MAX_FACTORS)?;
        within("samples", self.samples as usize, 1, 65_536)?;
        within("points", self.points, 64, 1 << 15)?;
        if which.observational {
            within("count", self.count, 1, 1 << 24)?;
        }
        if which.interventions {
            within("groups", self.groups, 1, 1 << 20)?;
        }
        if which.observational || which.interventions {
            within("set size", self.set_size, 8, 512)?;
            within("appearances", self.appearances, 1, 1 << 16)?;
        }
        if which.video {
            within("video size", self.video_size, 8, 4096)?;
            within("frames", self.frames, 1, 100_000)?;
            within("test cameras", self.test_cameras, 1, video::CAMERAS - 1)?;
        }
        if which.video && self.passes && self.video_look != Look::Mesh {
            return Err(Error::input("setting passes")
                .expected("the video look mesh: points have no depth, normals or material")
                .got(self.video_look.name()));
        }
        if self.character.is_some() && self.factors > CHARACTER_FACTORS {
            return Err(Error::input("setting factors")
                .expected(format!("2 to {CHARACTER_FACTORS} for a character: further ones act on nothing"))
                .got(self.factors.to_string()));
        }
        Ok(())
    }

    /// The truth behind the data.
    ///
    /// # Errors
    /// When graph and factors do not fit, or a name is unknown.
    pub fn scm(&self) -> Result<Scm> {
        let fail = |e: String| Error::input("settings").expected("a causal model").got(e);
        let graph = Graph::named(&self.graph, self.factors, self.seed).map_err(fail)?;
        let mechanism = Mechanism::parse(&self.mechanism).map_err(fail)?;
        Ok(Scm::new(graph, mechanism, !self.raw, self.seed))
    }

    fn record(&self) -> Value {
        let mut record = json!({
            "set": self.set, "graph": self.graph, "factors": self.factors, "mechanism": self.mechanism,
            "raw": self.raw, "video_look": self.video_look.name(), "set_look": self.set_look.name(),
            "video_size": self.video_size, "set_size": self.set_size, "samples": self.samples,
            "count": self.count, "groups": self.groups, "appearances": self.appearances,
            "points": self.points, "frames": self.frames, "test_cameras": self.test_cameras, "passes": self.passes,
            "subject": self.subject, "seed": self.seed, "bounces": BOUNCES,
        });
        // Only where it is: data sets of the figure keep their bytes.
        if let Some(c) = &self.character {
            record["character"] = c.record();
        }
        record
    }

    /// A command line that makes the same data, but for the folder.
    pub fn command(&self) -> String {
        let which = Which::parse(&self.set).ok();
        let mut words = vec![format!(
            "lastlight last gen --set {} --graph {} --factors {} --mechanism {} --points {} --samples {} --seed {}",
            self.set, self.graph, self.factors, self.mechanism, self.points, self.samples, self.seed
        )];
        if self.raw {
            words.push("--raw".into());
        }
        if which.is_some_and(|w| w.observational) {
            words.push(format!("--count {}", self.count));
        }
        if which.is_some_and(|w| w.interventions) {
            words.push(format!("--groups {}", self.groups));
        }
        if which.is_some_and(|w| w.observational || w.interventions) {
            words.push(format!(
                "--appearances {} --set-look {} --set-size {}",
                self.appearances,
                self.set_look.name(),
                self.set_size
            ));
        }
        if which.is_some_and(|w| w.video) {
            words.push(format!(
                "--frames {} --test-cameras {} --subject {} --video-look {} --video-size {}",
                self.frames,
                self.test_cameras,
                self.subject,
                self.video_look.name(),
                self.video_size
            ));
            if self.passes {
                words.push("--passes".into());
            }
        }
        if let Some(c) = &self.character {
            words.push(c.options().trim_start().to_owned());
        }
        words.join(" ")
    }
}

/// How far marginal statistics give the causal order away; absent for a graph without edges, R² also for collinear factors.
#[derive(Clone, Debug, PartialEq)]
pub struct Sortability {
    /// which factor set
    pub set: &'static str,
    /// its size
    pub samples: usize,
    /// by variance
    pub varsortability: Option<f64>,
    /// by explained variance
    pub r2_sortability: Option<f64>,
}

/// What was made.
#[derive(Clone, Debug)]
pub struct Report {
    /// one per factor set
    pub sortabilities: Vec<Sortability>,
    /// relative to the folder, with their digests
    pub files: Vec<(PathBuf, u64)>,
    /// what `dataset.json` says
    pub record: Value,
}

/// Counts finished pieces of work: done, total, of what.
pub type Progress<'a> = dyn FnMut(usize, usize, &str) + 'a;

/// Makes the data in a folder, or goes on with them, unless they are there, whole. The folder's name must say what matters of the settings.
///
/// # Errors
/// As [`run`].
pub fn ensure(settings: &Settings, dir: &Path) -> Result<()> {
    // Two that want the same data at a time: the second finds them.
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

/// Makes the data in a folder, which is made if need be. With `resume` it continues the run that left the folder; otherwise it first removes what
/// an earlier run left there.
///
/// # Errors
/// When the settings are not valid, a character cannot play its part (then nothing is touched), the run to be continued was another one or is unknown, a file
/// cannot be written, or `stop` was set: then everything finished so far is on disk.
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
    let actor = settings.character.as_ref().map(|c| Actor::new(c, &scm, settings)).transpose()?;
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
            // Until the end these are what is known to be whole.
            record["files"] = there["files"].clone();
        }
    } else {
        folder::clear(dir)?;
    }
    folder::write_record(dir, &record)?;
    let mut files: Vec<(PathBuf, u64)> = Vec::new();
    if which.observational || which.interventions {
        let figures;
        let sitter: &dyn Sitter = match &actor {
            Some(actor) => actor,
            None => {
                figures = Figures::new(settings.points, settings.seed);
                &figures
            }
        };
        files.extend(write_sets(settings, which, (&scm, sitter), dir, &known, stop, progress)?);
    }
    if let Some(subject) = subject.filter(|_| which.video) {
        let shoot = subject::Shoot {
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

/// An error when the user asked to stop.
pub(super) fn check_stop(stop: &AtomicBool) -> Result<()> {
    if stop.load(Ordering::Relaxed) {
        return Err(Error::interrupted("last gen").hint("continue with --resume"));
    }
    Ok(())
}

fn write_sets(
    settings: &Settings,
    which: Which,
    (scm, sitter): (&Scm, &dyn Sitter),
    dir: &Path,
    known: &BTreeMap<String, String>,
    stop: &AtomicBool,
    progress: &mut Progress<'_>,
) -> Result<Vec<(PathBuf, u64)>> {
    let journal = dir.join(JOURNAL);
    std::fs::create_dir_all(&journal).map_err(|e| Error::os(&journal, &e))?;
    let studio = Studio {
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
            // That of this run before that of the finished one it repairs.
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
