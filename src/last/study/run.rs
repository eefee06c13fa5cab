//! Runs the cells of experiments that have no result yet.

use super::plan::{Cell, Experiment, Report, Values};
use crate::io::{atomic, read_bytes};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest file of a result.
const MOST_BYTES: u64 = 1 << 20;

fn path(dir: &Path, id: &str, cell: &Cell) -> PathBuf {
    dir.join("cells").join(id).join(format!("{}.json", cell.key))
}

/// The result of a cell, if it is there and of these settings.
fn stored(dir: &Path, id: &str, cell: &Cell, settings: &Value) -> Option<Values> {
    let bytes = read_bytes(&path(dir, id, cell), MOST_BYTES).ok()?;
    let record: Value = serde_json::from_slice(&bytes).ok()?;
    if record["settings"] != *settings {
        return None;
    }
    let values = record["values"].as_object()?;
    values.iter().map(|(name, x)| Some((name.clone(), x.as_f64()?))).collect()
}

/// Runs what is missing and reports; `settings` is what all cells depend on, `progress` is told how many cells of how many are done and which is next.
///
/// # Errors
/// [`crate::error::Kind::Interrupted`] when `stop` is set between two cells; what a cell or the file system reports.
pub fn run(
    experiments: &[&dyn Experiment],
    settings: &Value,
    dir: &Path,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<Vec<Report>> {
    let cells: Vec<(usize, usize, Cell)> = experiments
        .iter()
        .enumerate()
        .flat_map(|(e, x)| x.cells().into_iter().enumerate().map(move |(c, cell)| (e, c, cell)))
        .collect();
    let mut results: Vec<Vec<(Cell, Values)>> = vec![Vec::new(); experiments.len()];
    for (done, (e, c, cell)) in cells.iter().enumerate() {
        let id = experiments[*e].id();
        progress(done, cells.len(), &format!("{id} {}", cell.key));
        let values = match stored(dir, id, cell, settings) {
            Some(values) => values,
            None => {
                if stop.load(Ordering::Relaxed) {
                    return Err(Error::interrupted("last study")
                        .at(format!("before {id} {}, {done} of {} cells done", cell.key, cells.len()))
                        .hint("run the same command with --resume to go on"));
                }
                let values = experiments[*e].run(*c).map_err(|x| x.within(format!("{id} {}", cell.key)))?;
                let file = path(dir, id, cell);
                if let Some(folder) = file.parent() {
                    std::fs::create_dir_all(folder).map_err(|x| Error::os(folder, &x))?;
                }
                let record =
                    json!({ "settings": settings, "row": cell.row, "seed": cell.seed, "values": values });
                atomic::write_bytes(&file, format!("{record:#}\n").as_bytes())?;
                values
            }
        };
        results[*e].push((cell.clone(), values));
    }
    progress(cells.len(), cells.len(), "");
    Ok(experiments.iter().zip(&results).map(|(x, r)| x.report(r)).collect())
}
