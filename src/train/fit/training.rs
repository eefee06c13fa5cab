//! The training loop: iterations, checkpoints, interruption, resumption.
//!
//! A [`Fit`] is a state and a step. The loop calls the step with ascending iteration numbers and manages
//! the [`History`], checkpoints and interruption. A step must be a function of the state, the
//! settings and the iteration number alone. Random draws are Philox blocks keyed by seed and iteration, so
//! that there is no generator to store, and a resumed fit is bit-identical to an uninterrupted one.
//!
//! A checkpoint is one safetensors file: the arrays of [`Fit::save`], the history under `history/…`, and the
//! text metadata `kind`, `version`, `iteration`, `settings` and `digest`. The digest is that of all arrays, so a
//! changed array is refused. The file is replaced atomically: after an interruption
//! at any moment the last complete one is on disk.

use crate::io::safetensors;
use crate::num::array::Arrays;
use crate::num::bits::Digest;
use crate::{Error, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Results of one iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// value of the loss before the update
    pub loss: f32,
    /// number of primitives after the iteration
    pub size: usize,
}

/// What a state renders to.
#[derive(Clone, Debug)]
pub struct Preview {
    /// name of the view
    pub name: String,
    /// (H, W, 3) the render, limited to 0..1
    pub image: Vec<f32>,
    /// width and height in pixels
    pub size: [usize; 2],
    /// against the image of the view; +∞ when nothing differs
    pub psnr_db: f64,
    /// name of the metric
    pub metric: &'static str,
}

/// An optimisation: a state and a step that advances it.
pub trait Fit {
    /// Name of the kind of fit, stored in checkpoints.
    fn kind(&self) -> &'static str;

    /// All settings that decide the result, as a flat JSON object. Resuming from a checkpoint with other
    /// settings is an error.
    fn settings(&self) -> Value;

    /// Total number of iterations.
    fn iterations(&self) -> usize;

    /// Runs iteration `i`, counted from 0.
    ///
    /// # Errors
    /// When the state can no longer be advanced, e.g. because a number is no longer finite.
    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step>;

    /// What the state renders to from view `k` of `count` of its held-out views, evenly spaced (of the fitted ones if none is held out), for
    /// people who watch. `None` if there is nothing to show.
    fn preview(&self, k: usize, count: usize) -> Option<Preview> {
        let _ = (k, count);
        None
    }

    /// Writes the complete state to `out`.
    fn save(&self, out: &mut Arrays);

    /// Replaces the state by a saved one.
    ///
    /// # Errors
    /// When an array is missing, has a shape that does not match the others, or has an entry that is not
    /// finite.
    fn load(&mut self, from: &Arrays) -> Result<()>;
}

/// Receives progress: which part of an iteration has just ended, and how many iterations are complete. It
/// decides when a checkpoint is written, and cannot influence the result.
pub trait Watch {
    /// The work since the previous call was `part`.
    fn lap(&mut self, part: &'static str) {
        let _ = part;
    }

    /// `done` of `total` iterations are complete.
    fn progress(&mut self, done: usize, total: usize, step: Step) {
        let _ = (done, total, step);
    }

    /// `done` of `total` pieces of work without a loss are complete.
    fn count(&mut self, done: usize, total: usize, what: &str) {
        let _ = (done, total, what);
    }

    /// Whether it is time for a checkpoint, however many iterations have passed. The lap `checkpoint` follows when it is written.
    fn is_checkpoint_due(&mut self) -> bool {
        false
    }

    /// The state after `done` of `total` iterations, first that after 0. It can be inspected, not changed.
    ///
    /// # Errors
    /// When something that is made of it cannot be stored.
    fn state(&mut self, done: usize, total: usize, fit: &dyn Fit) -> Result<()> {
        let _ = (done, total, fit);
        Ok(())
    }
}

/// Ignores progress.
impl Watch for () {}

/// Loss and size per iteration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// loss of each complete iteration
    pub loss: Vec<f32>,
    /// number of primitives after each iteration
    pub size: Vec<i32>,
}

impl History {
    /// Number of complete iterations.
    pub fn len(&self) -> usize {
        self.loss.len()
    }

    /// Whether no iteration has run.
    pub fn is_empty(&self) -> bool {
        self.loss.is_empty()
    }
}

/// When to write checkpoints and when to stop early.
#[derive(Clone, Copy)]
pub struct Schedule<'a> {
    /// file of the checkpoint; `None` writes none
    pub checkpoint: Option<&'a Path>,
    /// iterations between checkpoints; there is always one at the end and one on interruption, and one whenever
    /// [`Watch::is_checkpoint_due`]
    pub every: usize,
    /// flag that stops the fit after the current iteration
    pub stop: &'a AtomicBool,
}

/// Checkpoint of a training that can be resumed.
#[derive(Clone, Copy, Debug)]
pub struct Session<'a> {
    /// file of the checkpoint
    pub checkpoint: &'a Path,
    /// iterations between checkpoints
    pub every: usize,
}

/// How a training started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At its first iteration.
    Fresh,
    /// At its first iteration, because there is no checkpoint to resume from.
    NoCheckpoint,
    /// From its checkpoint.
    Resumed,
}

impl Session<'_> {
    /// Loads the checkpoint into a fit made with the same settings if `resume` is set and there is one;
    /// returns the history so far.
    ///
    /// # Errors
    /// See [`resume`].
    pub fn begin(&self, fit: &mut dyn Fit, is_resumed: bool) -> Result<(History, Start)> {
        match (is_resumed, self.checkpoint.exists()) {
            (false, _) => Ok((History::default(), Start::Fresh)),
            (true, false) => Ok((History::default(), Start::NoCheckpoint)),
            (true, true) => Ok((resume(fit, self.checkpoint)?, Start::Resumed)),
        }
    }

    /// Calls [`run`] with this checkpoint and returns the complete history.
    ///
    /// # Errors
    /// See [`run`].
    pub fn run(
        &self,
        fit: &mut dyn Fit,
        mut history: History,
        stop: &AtomicBool,
        watch: &mut dyn Watch,
    ) -> Result<History> {
        let schedule = Schedule { checkpoint: Some(self.checkpoint), every: self.every, stop };
        run(fit, &mut history, schedule, watch)?;
        Ok(history)
    }
}

/// Runs the iterations that are not yet in `history`.
///
/// # Errors
/// [`crate::error::Kind::Interrupted`] when `stop` was set before the last iteration; otherwise what the step
/// or the file system reports.
pub fn run(
    fit: &mut dyn Fit,
    history: &mut History,
    schedule: Schedule<'_>,
    watch: &mut dyn Watch,
) -> Result<()> {
    assert!(schedule.every > 0, "checkpoints are a positive number of iterations apart");
    let total = fit.iterations();
    watch.lap("start");
    if history.is_empty() {
        watch.state(0, total, fit)?;
    }
    while history.len() < total {
        let step = fit.step(history.len(), watch)?;
        history.loss.push(step.loss);
        history.size.push(i32::try_from(step.size).expect("a fit is capped far below 2³¹ primitives"));
        let done = history.len();
        watch.progress(done, total, step);
        watch.state(done, total, fit)?;
        let interrupted = schedule.stop.load(Ordering::Relaxed) && done < total;
        if let Some(path) = schedule.checkpoint
            && (interrupted
                || done == total
                || done.is_multiple_of(schedule.every)
                || watch.is_checkpoint_due())
        {
            save(fit, history, path)?;
            watch.lap("checkpoint");
        }
        if interrupted {
            let e = Error::interrupted(command(fit.kind()))
                .at(format!("stopped after iteration {done} of {total}"));
            return Err(match schedule.checkpoint {
                Some(_) => {
                    e.hint("the checkpoint is complete: run the same command with --resume to continue")
                }
                None => e,
            });
        }
    }
    Ok(())
}

/// The command of a kind of fit, for messages: a kind of two words is the command; otherwise ` fit` is
/// appended.
fn command(kind: &str) -> String {
    if kind.contains(' ') { kind.to_owned() } else { format!("{kind} fit") }
}

/// Writes a checkpoint atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn save(fit: &dyn Fit, history: &History, path: &Path) -> Result<()> {
    let mut arrays = Arrays::new();
    fit.save(&mut arrays);
    arrays.put("history/loss", &[history.len()], history.loss.clone());
    arrays.put("history/size", &[history.len()], history.size.clone());
    let meta = BTreeMap::from([
        ("digest".to_owned(), digest(&arrays)),
        ("kind".to_owned(), fit.kind().to_owned()),
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("iteration".to_owned(), history.len().to_string()),
        ("settings".to_owned(), fit.settings().to_string()),
    ]);
    safetensors::write(path, &arrays, &meta)
}

/// Digest of names, shapes and bits of arrays, as text.
fn digest(arrays: &Arrays) -> String {
    let mut digest = Digest::new();
    for (name, array) in &arrays.0 {
        digest.bytes(name.as_bytes());
        digest.bytes(array.dtype().as_bytes());
        array.shape().iter().for_each(|&n| digest.u64(n as u64));
        crate::with_array!(array, a => a.iter().for_each(|x| digest.bytes(&x.to_le_bytes())));
    }
    format!("{:016x}", digest.value())
}

/// Loads a checkpoint into a fit made with the same settings and returns the history so far.
///
/// # Errors
/// When the file is not a complete checkpoint of this kind of fit, or a setting differs; the error names the
/// setting.
pub fn resume(fit: &mut dyn Fit, path: &Path) -> Result<History> {
    let file = safetensors::read(path)?;
    restore(fit, &file.arrays, &file.metadata).map_err(|e| e.within(path.display().to_string()))
}

fn restore(fit: &mut dyn Fit, arrays: &Arrays, meta: &BTreeMap<String, String>) -> Result<History> {
    let text = |key: &str| {
        meta.get(key).ok_or_else(|| {
            Error::input("metadata").at(key).expected("a checkpoint written by a fit").got("no such entry")
        })
    };
    if text("kind")? != fit.kind() {
        return Err(Error::input("metadata").at("kind").expected(fit.kind()).got(text("kind")?.as_str()));
    }
    let stored =
        crate::io::json::parse(text("settings")?.as_bytes(), "metadata").map_err(|e| e.at("settings"))?;
    // Ours as text too, as they were stored: a number in single precision has fewer digits there.
    let ours = serde_json::from_str(&fit.settings().to_string()).expect("JSON text of a JSON value");
    same_settings(&stored, &ours)?;
    let loss = arrays.need("history/loss")?.to_f32();
    let size: Vec<i32> = arrays
        .need("history/size")?
        .to_i64()
        .and_then(|v| v.into_iter().map(|n| i32::try_from(n).ok()).collect())
        .ok_or_else(|| Error::input("array 'history/size'").expected("counts below 2³¹"))?;
    let found = digest(arrays);
    if *text("digest")? != found {
        return Err(Error::input("digest of the arrays")
            .expected(text("digest")?.as_str())
            .got(found)
            .hint("the file was changed after it was written; start over with --force"));
    }
    let iteration = text("iteration")?;
    if loss.len() > fit.iterations() {
        return Err(Error::input("checkpoint")
            .expected(format!("at most {} iterations, those of this run", fit.iterations()))
            .got(loss.len().to_string()));
    }
    if loss.len() != size.len() || loss.len().to_string() != *iteration {
        return Err(Error::input("array 'history/loss'")
            .expected(format!("{iteration} entries, as many as 'history/size'"))
            .got(format!("{} and {}", loss.len(), size.len())));
    }
    fit.load(arrays)?;
    Ok(History { loss, size })
}

/// Checks that both are flat objects with equal entries.
fn same_settings(stored: &Value, ours: &Value) -> Result<()> {
    let empty = serde_json::Map::new();
    let (stored, ours) = (stored.as_object().unwrap_or(&empty), ours.as_object().unwrap_or(&empty));
    for key in ours.keys().chain(stored.keys()) {
        let (a, b) = (stored.get(key), ours.get(key));
        if a != b {
            let show = |v: Option<&Value>| v.map_or_else(|| "nothing".to_owned(), Value::to_string);
            return Err(Error::input("setting")
                .at(key.as_str())
                .expected(format!("{} as in the checkpoint", show(a)))
                .got(show(b))
                .hint("resume with the settings and the input of the first run, or choose another --out"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
