//! Runs the cells of experiments that have no result yet.

use super::plan::{Cell, Experiment, Results, Values};
use crate::fit::training::Watch;
use crate::io::{atomic, read_bytes};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest file of a result.
const MOST_BYTES: u64 = 1 << 20;

/// Who looks on: at the work inside a cell, and from cell to cell. Nothing flows back.
pub trait Onlooker: Watch {
    /// The next of `total` cells, `done` of which are there.
    fn next(&mut self, done: usize, total: usize, what: &str) {
        let _ = (done, total, what);
    }

    /// A cell has run; those that were there already are not told.
    fn ran(&mut self, folder: &str, key: &str) {
        let _ = (folder, key);
    }
}

/// Nobody looks on.
impl Onlooker for () {}

fn path(dir: &Path, folder: &str, key: &str) -> PathBuf {
    dir.join("cells").join(folder).join(format!("{key}.json"))
}

/// The result of a cell, if it is there and of these settings.
fn stored(file: &Path, settings: &Value) -> Option<Values> {
    let record: Value = serde_json::from_slice(&read_bytes(file, MOST_BYTES).ok()?).ok()?;
    if record["settings"] != *settings {
        return None;
    }
    let values = record["values"].as_object()?;
    values.iter().map(|(name, x)| Some((name.clone(), x.as_f64()?))).collect()
}

/// Runs what is missing; with `only_stored` it is left out instead. Gives the results of each experiment.
///
/// # Errors
/// [`crate::error::Kind::Interrupted`] when `stop` is set between two cells; what a cell or the file system reports.
pub fn run(
    experiments: &[&dyn Experiment],
    dir: &Path,
    only_stored: bool,
    stop: &AtomicBool,
    look: &mut dyn Onlooker,
) -> Result<Vec<Results>> {
    let cells: Vec<(usize, usize, Cell)> = experiments
        .iter()
        .enumerate()
        .flat_map(|(e, x)| x.cells().into_iter().enumerate().map(move |(c, cell)| (e, c, cell)))
        .collect();
    let mut results: Vec<Results> = vec![Vec::new(); experiments.len()];
    for (done, (e, c, cell)) in cells.iter().enumerate() {
        let (id, folder) = (experiments[*e].id(), experiments[*e].folder());
        look.next(done, cells.len(), &format!("{id} {}", cell.row));
        let settings = experiments[*e].settings(*c);
        let file = path(dir, folder, &cell.key);
        let values = match stored(&file, &settings) {
            Some(values) => values,
            None if only_stored => continue,
            None => {
                if stop.load(Ordering::Relaxed) {
                    return Err(Error::interrupted("last study")
                        .at(format!("before {id} {}, {done} of {} cells done", cell.row, cells.len()))
                        .hint("run the same command with --resume to go on"));
                }
                let values =
                    experiments[*e].run(*c, look).map_err(|x| x.within(format!("{id} {}", cell.row)))?;
                if let Some(bad) = values.iter().find(|(_, x)| !x.is_finite()) {
                    return Err(Error::check(format!("{id} {}", cell.row))
                        .at(bad.0.clone())
                        .expected("a finite number")
                        .got(bad.1.to_string()));
                }
                if let Some(folder) = file.parent() {
                    std::fs::create_dir_all(folder).map_err(|x| Error::os(folder, &x))?;
                }
                let record = json!({ "settings": settings, "values": values });
                atomic::write_bytes(&file, format!("{record:#}\n").as_bytes())?;
                look.ran(folder, &cell.key);
                values
            }
        };
        results[*e].push((cell.clone(), values));
    }
    look.next(cells.len(), cells.len(), "");
    Ok(results)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::last::study::plan::{Drawing, Outcome, Report};
    use std::sync::atomic::AtomicUsize;

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
        fn run(&self, cell: usize, _: &mut dyn Watch) -> Result<Values> {
            self.ran.fetch_add(1, Ordering::Relaxed);
            Ok(Values::from([("x".into(), (cell * cell) as f64)]))
        }
        fn report(&self, results: &[(Cell, Values)]) -> Report {
            Report {
                outcome: Outcome::Reported,
                drawing: Drawing::Bars(Vec::new()),
                ..Report::not_run("E0", "", &results.len().to_string())
            }
        }
    }

    #[test]
    fn what_is_there_is_not_run_again() {
        let dir = tempfile::tempdir().expect("a folder");
        let stop = AtomicBool::new(false);
        let x = Squares { ran: AtomicUsize::new(0), version: 0 };
        let go = |x: &Squares, only_stored: bool| {
            let results = run(&[x], dir.path(), only_stored, &stop, &mut ()).expect("runs").remove(0);
            (results, x.ran.swap(0, Ordering::Relaxed))
        };
        assert!(go(&x, true).0.is_empty(), "nothing there, nothing run");
        let (first, ran) = go(&x, false);
        assert_eq!((first.len(), ran), (3, 3), "all");
        assert_eq!(go(&x, false), (first.clone(), 0), "all there");
        std::fs::remove_file(path(dir.path(), "E0", "s2")).expect("there");
        assert_eq!(go(&x, true).0, first[..2], "what is there");
        assert_eq!(go(&x, false), (first.clone(), 1), "the missing one");
        let changed = Squares { version: 1, ..x };
        assert_eq!(go(&changed, false), (first, 1), "other settings: that cell alone");
        stop.store(true, Ordering::Relaxed);
        assert!(run(&[&changed], dir.path(), false, &stop, &mut ()).is_ok(), "nothing left to do");
        std::fs::remove_file(path(dir.path(), "E0", "s0")).expect("there");
        assert!(run(&[&changed], dir.path(), false, &stop, &mut ()).is_err(), "stopped before a cell");
    }
}
