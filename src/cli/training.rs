//! The frame of every command that trains: folder, resumption, interruption, checkpoints, record.
//!
//! A command reads its input, makes a [`Fit`] with its settings, and hands it to [`Frame::train`]. What comes back is the
//! history of a complete training; the command then evaluates it, writes its own files, and [`Frame::record`] writes `result.json`.

use crate::console as cli;
use crate::fit::training::{self, Fit, History, Schedule, Session, Start, Watch};
use crate::io::atomic;
use crate::meter::Meter;
use crate::shared::OutputArgs;
use crate::{Error, Result, claim};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// The checkpoint in the folder of a training.
pub(crate) const CHECKPOINT: &str = "checkpoint.safetensors";
/// The record in the folder of a training.
pub(crate) const RESULT: &str = "result.json";

/// The folder of a training and how it is filled.
pub(crate) struct Frame {
    /// where results go
    pub(crate) dir: PathBuf,
    /// iterations between checkpoints
    pub(crate) checkpoint_every: usize,
    /// whether the training goes on from the checkpoint that is there
    pub(crate) resume: bool,
}

impl Frame {
    /// Takes the folder of `--out`. Call it when the input is read: a command that cannot start leaves no folder.
    ///
    /// # Errors
    /// Those of [`claim::folder`].
    pub(crate) fn claim(out: &Path, filling: &OutputArgs, checkpoint_every: u32) -> Result<Self> {
        let dir = claim::folder(out, filling.resume, filling.force)?;
        Ok(Self { dir, checkpoint_every: checkpoint_every as usize, resume: filling.resume })
    }

    /// A folder inside one that was claimed.
    ///
    /// # Errors
    /// When it cannot be made.
    pub(crate) fn inside(dir: PathBuf, checkpoint_every: usize) -> Result<Self> {
        std::fs::create_dir_all(&dir).map_err(|e| Error::os(&dir, &e))?;
        Ok(Self { dir, checkpoint_every, resume: false })
    }

    /// A file of the folder.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Trains to the end, from the checkpoint where there is one to go on from; Ctrl-C leaves a checkpoint.
    ///
    /// # Errors
    /// What the training reports; an interruption.
    pub(crate) fn train(&self, fit: &mut dyn Fit, meter: &mut Meter) -> Result<History> {
        let checkpoint = self.file(CHECKPOINT);
        let session = Session { checkpoint: &checkpoint, every: self.checkpoint_every };
        let (history, start) = session.begin(fit, self.resume)?;
        match start {
            Start::Fresh => {}
            Start::NoCheckpoint => meter.note("no checkpoint yet: starting at iteration 0"),
            Start::Resumed => {
                meter.note(&format!("resuming after iteration {} of {}", history.len(), fit.iterations()));
            }
        }
        meter.lap("start");
        let history = cli::stoppable(|stop| session.run(fit, history, stop, meter))?;
        meter.done();
        Ok(history)
    }

    /// Writes `result.json`: what every training records, with the entries of `own` after the digest.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn record(
        &self,
        head: Head<'_>,
        own: Value,
        history: &History,
        meter: &Meter,
    ) -> Result<Value> {
        let by_part: Map<String, Value> = meter.parts().into_iter().map(|(n, s)| (n, json!(s))).collect();
        let mut record = json!({
            "kind": head.kind, "lastlight": env!("CARGO_PKG_VERSION"), "digest": head.digest,
        });
        let rest = json!({
            "iterations": history.len(), "last_loss": history.loss.last(), "settings": head.settings,
            "seconds": meter.seconds(), "seconds_by_part": by_part,
        });
        for (name, value) in [own, rest]
            .into_iter()
            .filter_map(|part| match part {
                Value::Object(entries) => Some(entries),
                _ => None,
            })
            .flatten()
        {
            record[name] = value;
        }
        atomic::write_bytes(&self.file(RESULT), format!("{record:#}\n").as_bytes())?;
        Ok(record)
    }
}

/// Trains to the end without a checkpoint, for commands that write one file; Ctrl-C ends it without a result.
///
/// # Errors
/// What the training reports; an interruption.
pub(crate) fn run_whole(fit: &mut dyn Fit, meter: &mut Meter) -> Result<History> {
    let mut history = History::default();
    cli::stoppable(|stop| {
        let schedule = Schedule { checkpoint: None, every: usize::MAX, stop };
        training::run(fit, &mut history, schedule, meter)
    })?;
    meter.done();
    Ok(history)
}

/// What the record of a training begins with.
pub(crate) struct Head<'a> {
    /// the command
    pub(crate) kind: &'a str,
    /// digest of the result
    pub(crate) digest: &'a str,
    /// everything that decides it
    pub(crate) settings: Value,
}
