//! The frame of every command that trains: folder, resumption, interruption, checkpoints, record.
//!
//! A command reads its input, makes a [`Fit`] with its settings, and hands it to [`Frame::train`]. What comes back is the
//! history of a complete training with snapshots of it; the command then evaluates it, writes its own files, and [`Frame::record`] writes `result.json`.

use crate::console as cli;
use crate::fit::training::{self, Fit, History, Schedule, Session, Start, Watch};
use crate::io::atomic;
use crate::meter::Meter;
use crate::report::film::Film;
use crate::shared::{Outcome, OutputArgs};
use crate::snapshots::Recorder;
use crate::{Error, Result, claim, like, version};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// The checkpoint in the folder of a training.
pub(crate) const CHECKPOINT: &str = "checkpoint.safetensors";
/// The record in the folder of a training.
pub(crate) const RESULT: &str = "result.json";
/// The report in the folder of a training, which is written last.
const REPORT: &str = "report/index.html";

/// The folder of a training and how it is filled.
pub(crate) struct Frame {
    /// where results go
    pub(crate) dir: PathBuf,
    /// iterations between checkpoints
    pub(crate) checkpoint_every: usize,
    /// whether the training goes on from the checkpoint that is there
    pub(crate) resume: bool,
    /// whether its arguments are kept, so that they need not be typed again
    keeps_arguments: bool,
}

impl Frame {
    /// Takes the folder of `--out`. Call it when the input is read: a command that cannot start leaves no folder.
    ///
    /// # Errors
    /// Those of [`claim::folder`].
    pub(crate) fn claim(out: &Path, filling: &OutputArgs, checkpoint_every: u32) -> Result<Self> {
        let dir = claim::folder(out, filling.resume, filling.force)?;
        if filling.resume {
            claim::is_of(&dir, &[CHECKPOINT, like::COMMAND])?;
        }
        let checkpoint_every = checkpoint_every as usize;
        Ok(Self { dir, checkpoint_every, resume: filling.resume, keeps_arguments: true })
    }

    /// A folder inside one that was claimed.
    ///
    /// # Errors
    /// When it cannot be made.
    pub(crate) fn inside(dir: PathBuf, checkpoint_every: usize) -> Result<Self> {
        std::fs::create_dir_all(&dir).map_err(|e| Error::os(&dir, &e))?;
        Ok(Self { dir, checkpoint_every, resume: false, keeps_arguments: false })
    }

    /// Whether there is a checkpoint from which the training goes on.
    pub(crate) fn is_resumed(&self) -> bool {
        self.resume && self.file(CHECKPOINT).exists()
    }

    /// A file of the folder.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Trains to the end, from the checkpoint where there is one to go on from; Ctrl-C leaves a checkpoint.
    ///
    /// # Errors
    /// What the training reports; an interruption.
    pub(crate) fn train(&self, fit: &mut dyn Fit, meter: &mut Meter) -> Result<(History, Film)> {
        let checkpoint = self.file(CHECKPOINT);
        let session = Session { checkpoint: &checkpoint, every: self.checkpoint_every };
        let (history, start) = session.begin(fit, self.resume)?;
        match start {
            Start::Fresh => {}
            Start::NoCheckpoint => meter.note("no checkpoint yet: starting at iteration 0"),
            Start::Resumed if history.len() == fit.iterations() => {}
            Start::Resumed => {
                meter.note(&format!("resuming after iteration {} of {}", history.len(), fit.iterations()));
            }
        }
        // Also of a run that goes on: how far it goes may have changed.
        if start != Start::Resumed || history.len() < fit.iterations() {
            self.keep_arguments()?;
        }
        meter.lap("start");
        let mut watch = Recorder::new(meter, &self.dir);
        watch.resume(history.len());
        let history = cli::stoppable(|stop| session.run(fit, history, stop, &mut watch))?;
        let film = watch.into_film();
        meter.done();
        Ok((history, film))
    }

    /// Writes the arguments that `--resume` takes from the folder.
    fn keep_arguments(&self) -> Result<()> {
        if !self.keeps_arguments {
            return Ok(());
        }
        let record = json!({ "lastlight": env!("CARGO_PKG_VERSION"), like::ARGUMENTS: cli::kept() });
        atomic::write_bytes(&self.file(like::COMMAND), format!("{record:#}\n").as_bytes())
    }

    /// The outcome of a training that was resumed after its end, if all of its results are there, the `files` of the command among them: nothing is
    /// written again.
    pub(crate) fn finished(
        &self,
        digest: &str,
        settings: &Value,
        history: &History,
        files: &[&str],
    ) -> Option<Outcome> {
        let bytes = if self.resume { std::fs::read(self.file(RESULT)).ok()? } else { return None };
        let record: Value = serde_json::from_slice(&bytes).ok()?;
        // Settings pass through text, as those of the record did.
        let settings: Value = serde_json::from_str(&settings.to_string()).ok()?;
        let is_same = record["digest"] == digest
            && record["settings"] == settings
            && record["iterations"] == history.len();
        if !is_same || ![REPORT].iter().chain(files).all(|name| self.file(name).is_file()) {
            return None;
        }
        let done = match history.len() {
            1 => "the iteration is".to_owned(),
            n => format!("all {n} iterations are"),
        };
        let lines = vec![
            format!("complete    {done} done; no file was changed (--force starts over)"),
            format!("digest      {digest}"),
        ];
        Some(Outcome { record, page: None, lines, held_out_db: f64::NAN })
    }

    /// Writes `result.json`: what every training records, with the entries of `own` after the digest; and the arguments again, which may be
    /// others than those of the last result.
    ///
    /// # Errors
    /// When it cannot be written.
    ///
    /// # Panics
    /// When a name of `own` is one of those that every record has.
    pub(crate) fn record(
        &self,
        head: Head<'_>,
        own: Map<String, Value>,
        history: &History,
        meter: &Meter,
    ) -> Result<Value> {
        let by_part: Map<String, Value> = meter.parts().into_iter().map(|(n, s)| (n, json!(s))).collect();
        let before = entries([
            ("kind", json!(head.kind)),
            ("lastlight", json!(env!("CARGO_PKG_VERSION"))),
            ("digest", json!(head.digest)),
        ]);
        let after = entries([
            ("iterations", json!(history.len())),
            ("last_loss", json!(history.loss.last())),
            (like::ARGUMENTS, json!(cli::arguments())),
            ("build", Value::Object(version::record())),
            ("settings", head.settings),
            ("seconds", json!(meter.seconds())),
            ("seconds_by_part", Value::Object(by_part)),
        ]);
        let record = Value::Object(joined([before, own, after]));
        self.keep_arguments()?;
        atomic::write_bytes(&self.file(RESULT), format!("{record:#}\n").as_bytes())?;
        Ok(record)
    }
}

/// Entries of a record, in this order.
pub(crate) fn entries<const N: usize>(entries: [(&str, Value); N]) -> Map<String, Value> {
    entries.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// The entries of all parts in their order.
///
/// # Panics
/// When two have the same name.
fn joined<const N: usize>(parts: [Map<String, Value>; N]) -> Map<String, Value> {
    let mut out = Map::new();
    for (name, value) in parts.into_iter().flatten() {
        assert!(!out.contains_key(&name), "a record has one entry '{name}'");
        out.insert(name, value);
    }
    out
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_record_keep_their_order() {
        let all = joined([entries([("z", json!(1))]), entries([("a", json!(2)), ("b", json!(null))])]);
        assert_eq!(Value::Object(all).to_string(), r#"{"z":1,"a":2,"b":null}"#, "as written");
    }

    #[test]
    #[should_panic(expected = "a record has one entry 'digest'")]
    fn an_entry_of_its_own_replaces_none_of_every_record() {
        joined([entries([("digest", json!("0123"))]), entries([("digest", json!("4567"))])]);
    }
}
