//! Runs the cells of experiments that have no result yet.
//!
//! Cells are independent, and most are too small to use several threads efficiently. Several cells therefore
//! run at a time, each in its own thread pool. One thread writes the files and calls the observer. The order
//! in which cells end has no effect, because all results are read from the files.

use super::cells::{Cell, Experiment, Results, Values};
use crate::fit::training::{Step, Watch};
use crate::io::{atomic, read_bytes};
use crate::num::par;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

/// Name of the laps of a cell outside the measured fit; they do not count towards its time.
pub const AROUND: &str = "around the fit";
/// Largest accepted size of a result file.
const MOST_BYTES: u64 = 1 << 20;

/// Receives the progress of the cells. It cannot influence them.
pub trait Observer {
    /// Makes the observer of one cell when it starts, on its thread.
    type Inside: Watch + Default + Send;

    /// Called when the cell `what` begins, and repeatedly during trainings and fits; `done` of `total` cells
    /// have a result.
    fn next(&mut self, done: usize, total: usize, what: &str) {
        let _ = (done, total, what);
    }

    /// Called when a cell has run; not called for cells that already had a result.
    fn ran(&mut self, folder: &str, key: &str, inside: Self::Inside) {
        let _ = (folder, key, inside);
    }
}

/// Ignores progress.
impl Observer for () {
    type Inside = ();
}

/// Options for running cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunOptions {
    /// the command, for the message of an interrupted run
    pub command: &'static str,
    /// skip cells without a result instead of running them
    pub report_only: bool,
    /// largest number of concurrent cells; they share the threads
    pub jobs: usize,
}

/// A cell and the file of its result.
struct StoredCell<'a> {
    experiment: &'a dyn Experiment,
    /// index of the cell in the experiment
    index: usize,
    cell: Cell,
    file: PathBuf,
}

impl<'a> StoredCell<'a> {
    fn all(experiment: &'a dyn Experiment, dir: &Path) -> Vec<Self> {
        let folder = dir.join("cells").join(experiment.folder());
        let place = |(index, cell): (usize, Cell)| {
            let file = folder.join(format!("{}.json", cell.key));
            Self { experiment, index, cell, file }
        };
        experiment.cells().into_iter().enumerate().map(place).collect()
    }

    fn name(&self) -> String {
        format!("{} {}", self.experiment.id(), self.cell.row)
    }

    /// The stored result, if there is one with the same settings.
    fn stored(&self) -> Option<Values> {
        let record: Value = serde_json::from_slice(&read_bytes(&self.file, MOST_BYTES).ok()?).ok()?;
        if record["settings"] != self.experiment.settings(self.index) {
            return None;
        }
        let values = record["values"].as_object()?;
        values.iter().map(|(name, x)| Some((name.clone(), x.as_f64()?))).collect()
    }

    fn run(&self, watch: &mut dyn Watch, stop: &AtomicBool) -> Result<Values> {
        let values = self.experiment.run(self.index, watch, stop).map_err(|x| x.within(self.name()))?;
        match values.iter().find(|(_, x)| !x.is_finite()) {
            Some((name, x)) => {
                Err(Error::check(self.name()).at(name.clone()).expected("a finite number").got(x.to_string()))
            }
            None => Ok(values),
        }
    }

    fn store(&self, values: &Values) -> Result<()> {
        if let Some(folder) = self.file.parent() {
            std::fs::create_dir_all(folder).map_err(|x| Error::os(folder, &x))?;
        }
        let record = json!({ "settings": self.experiment.settings(self.index), "values": values });
        atomic::write_bytes(&self.file, format!("{record:#}\n").as_bytes())
    }
}

/// Messages of a worker thread; the first number is the index of the cell.
enum Message<W> {
    Begun(usize),
    /// Number of completed steps, and of all steps.
    At(usize, usize, usize),
    Ended(usize, Result<Values>, W),
}

/// Sends the progress of a cell, each percent of a training or fit once.
struct Reporter<W> {
    inside: W,
    cell: usize,
    sender: mpsc::Sender<Message<W>>,
    last_percent: usize,
}

impl<W: Watch> Watch for Reporter<W> {
    fn lap(&mut self, part: &'static str) {
        self.inside.lap(part);
    }

    fn progress(&mut self, done: usize, total: usize, step: Step) {
        self.inside.progress(done, total, step);
        let percent = 100 * done / Ord::max(1, total);
        if percent != self.last_percent {
            self.last_percent = percent;
            // Without a receiver, sending the result of the cell fails too.
            let _ = self.sender.send(Message::At(self.cell, done, total));
        }
    }
}

/// Runs cells, `jobs` at a time, and stores their results. After an error, or when `stop` is set, no new cell
/// begins; running cells are completed.
fn run_all<L: Observer>(
    missing: &[&StoredCell<'_>],
    there: usize,
    options: RunOptions,
    stop: &AtomicBool,
    observer: &mut L,
) -> Result<()> {
    let total = there + missing.len();
    let (jobs, threads) = (Ord::clamp(options.jobs, 1, Ord::max(1, missing.len())), par::threads());
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let work = |job: usize, sender: mpsc::Sender<Message<L::Inside>>| {
        let threads = Ord::max(1, threads / jobs + usize::from(job < threads % jobs));
        par::with_threads(threads, || {
            while !stop.load(Ordering::Relaxed) && !failed.load(Ordering::Relaxed) {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(place) = missing.get(i) else { break };
                let inside = L::Inside::default();
                let mut reporter = Reporter { inside, cell: i, sender: sender.clone(), last_percent: 0 };
                let sent = sender.send(Message::Begun(i)).and_then(|()| {
                    let outcome = place.run(&mut reporter, stop);
                    reporter.lap("end");
                    if outcome.is_err() {
                        failed.store(true, Ordering::Relaxed);
                    }
                    sender.send(Message::Ended(i, outcome, reporter.inside))
                });
                if sent.is_err() {
                    break;
                }
            }
        })
    };
    let mut done = there;
    std::thread::scope(|scope| {
        let mut outcome = Ok(());
        let (sender, receiver) = mpsc::channel();
        let work = &work;
        let threads: Vec<_> = (0..jobs)
            .map(|job| {
                let sender = sender.clone();
                scope.spawn(move || work(job, sender))
            })
            .collect();
        drop(sender);
        for message in receiver {
            match message {
                Message::Begun(i) => observer.next(done, total, &missing[i].name()),
                Message::At(i, step, of) => {
                    observer.next(done, total, &format!("{}, step {step} of {of}", missing[i].name()));
                }
                Message::Ended(i, values, inside) => {
                    match values.and_then(|values| missing[i].store(&values)) {
                        Ok(()) => {
                            done += 1;
                            observer.ran(missing[i].experiment.folder(), &missing[i].cell.key, inside);
                        }
                        Err(e) => {
                            failed.store(true, Ordering::Relaxed);
                            outcome = outcome.and(Err(e));
                        }
                    }
                }
            }
        }
        for thread in threads {
            match thread.join() {
                Ok(started) => outcome = outcome.and(started),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        outcome
    })?;
    if done < total {
        return Err(Error::interrupted(options.command)
            .at(format!("{done} of {total} cells done"))
            .hint("run the same command with --resume to continue"));
    }
    observer.next(total, total, "");
    Ok(())
}

/// Runs the cells without a result, or skips them, and returns the results of each experiment. Experiments
/// that share a cell share its result.
///
/// # Errors
/// [`crate::error::Kind::Interrupted`] when `stop` is set while cells are missing (running cells end first);
/// errors of a cell or of the file system.
pub fn run(
    experiments: &[&dyn Experiment],
    dir: &Path,
    options: RunOptions,
    stop: &AtomicBool,
    observer: &mut impl Observer,
) -> Result<Vec<Results>> {
    let places: Vec<Vec<StoredCell<'_>>> = experiments.iter().map(|x| StoredCell::all(*x, dir)).collect();
    let mut files = BTreeSet::new();
    let different: Vec<&StoredCell<'_>> = places.iter().flatten().filter(|p| files.insert(&p.file)).collect();
    let missing: Vec<&StoredCell<'_>> = different.iter().copied().filter(|p| p.stored().is_none()).collect();
    if !options.report_only {
        run_all(&missing, different.len() - missing.len(), options, stop, observer)?;
    }
    let results = |places: Vec<StoredCell<'_>>| -> Results {
        places.into_iter().filter_map(|p| p.stored().map(|values| (p.cell, values))).collect()
    };
    Ok(places.into_iter().map(results).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::report::{Chart, Outcome, Report};

    /// A version whose cell 1 fails.
    const FAILS: u32 = 9;

    /// Records the calls.
    #[derive(Default)]
    struct Heard(Vec<String>);

    impl Observer for Heard {
        type Inside = ();
        fn next(&mut self, done: usize, total: usize, what: &str) {
            let step = what.split_once(", ").map_or("", |(_, step)| step);
            self.0.push(format!("{done}/{total} {step}").trim().to_owned());
        }
        fn ran(&mut self, _: &str, key: &str, (): ()) {
            self.0.push(key.to_owned());
        }
    }

    /// Counts how often a cell runs.
    struct Squares {
        ran: AtomicUsize,
        version: u32,
    }

    impl Experiment for Squares {
        fn id(&self) -> &'static str {
            "E0"
        }
        fn cells(&self) -> Vec<Cell> {
            (0..3).map(|seed| Cell { key: format!("s{seed}"), row: "square".into(), seed }).collect()
        }
        fn settings(&self, cell: usize) -> Value {
            json!({ "cell": cell, "version": if cell == 1 { self.version } else { 0 } })
        }
        fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
            self.ran.fetch_add(1, Ordering::Relaxed);
            // one long cell that reports every hundredth of its steps
            for done in 0..if cell == 0 { 250 } else { 0 } {
                watch.progress(done, 10_000, Step { loss: 0.0, size: 0 });
            }
            if cell == 1 && self.version == FAILS {
                return Err(Error::check("toy").at("cell 1").expected("no failure").got("one"));
            }
            Ok(Values::from([("x".into(), (cell * cell) as f64)]))
        }
        fn report(&self, results: &[(Cell, Values)]) -> Report {
            Report {
                outcome: Outcome::Reported,
                chart: Chart::Bars(Vec::new()),
                ..Report::not_run("E0", "", &results.len().to_string())
            }
        }
    }

    fn options(report_only: bool) -> RunOptions {
        RunOptions { command: "toy study", report_only, jobs: 2 }
    }

    #[test]
    fn what_is_there_is_not_run_again() {
        let dir = tempfile::tempdir().expect("a folder");
        let stop = AtomicBool::new(false);
        let x = Squares { ran: AtomicUsize::new(0), version: 0 };
        let go = |x: &Squares, only_stored: bool| {
            let results =
                run(&[x], dir.path(), options(only_stored), &stop, &mut ()).expect("runs").remove(0);
            (results, x.ran.swap(0, Ordering::Relaxed))
        };
        assert!(go(&x, true).0.is_empty(), "nothing there, nothing run");
        let (first, ran) = go(&x, false);
        assert_eq!((first.len(), ran), (3, 3), "all");
        assert_eq!(go(&x, false), (first.clone(), 0), "all there");
        let lost = dir.path().join("cells/E0/s2.json");
        std::fs::remove_file(&lost).expect("there");
        assert_eq!(go(&x, true).0, first[..2], "what is there");
        assert_eq!(go(&x, false), (first.clone(), 1), "the missing one");
        let changed = Squares { version: 1, ..x };
        assert_eq!(go(&changed, false), (first, 1), "other settings: that cell alone");
        let both = run(&[&changed, &changed], dir.path(), options(true), &stop, &mut ()).expect("stored");
        assert_eq!(both[0], both[1], "a result that two experiments share");
        std::fs::remove_file(&lost).expect("there");
        run(&[&changed, &changed], dir.path(), options(false), &stop, &mut ()).expect("runs");
        assert_eq!(changed.ran.swap(0, Ordering::Relaxed), 1, "and it is run once");
        stop.store(true, Ordering::Relaxed);
        assert!(run(&[&changed], dir.path(), options(false), &stop, &mut ()).is_ok(), "nothing left to do");
        std::fs::remove_file(&lost).expect("there");
        let e =
            run(&[&changed], dir.path(), options(false), &stop, &mut ()).expect_err("stopped before a cell");
        assert_eq!(e.kind(), crate::error::Kind::Interrupted);
        assert!(e.to_string().contains("2 of 3 cells done"), "{e}");
    }

    #[test]
    fn an_error_ends_the_study_and_keeps_what_is_done() {
        let dir = tempfile::tempdir().expect("a folder");
        let stop = AtomicBool::new(false);
        let x = Squares { ran: AtomicUsize::new(0), version: FAILS };
        let mut heard = Heard::default();
        let go = RunOptions { jobs: 1, ..options(false) };
        let e = run(&[&x], dir.path(), go, &stop, &mut heard).expect_err("a cell fails");
        assert!(e.to_string().contains("E0 square"), "{e}");
        assert_eq!(x.ran.load(Ordering::Relaxed), 2, "the cell before it and itself");
        assert_eq!(
            heard.0,
            ["0/3", "0/3 step 100 of 10000", "0/3 step 200 of 10000", "s0", "1/3"],
            "the reported progress, in order"
        );
        let stored = run(&[&x], dir.path(), options(true), &stop, &mut ()).expect("stored");
        assert_eq!(stored[0].len(), 1, "the one before it");
    }
}
