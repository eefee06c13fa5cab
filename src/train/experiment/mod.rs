//! The study engine: experiments made of many trainings or fits. Level 10.
//!
//! ```text
//! cells    an experiment: its cells, each a training or fit with one seed, and their pairs
//! run      runs the cells without a result, several at a time, one file each
//! stats    means, deviations, intervals of paired differences
//! report   a table, a chart, and whether a claim holds
//! ```
//!
//! The result of a cell is a file `cells/FOLDER/KEY.json` in the folder of the study, written completely or
//! not at all, with the settings on which it depends. An interrupted study therefore continues where it
//! stopped, a cell whose settings have changed runs again, and two studies with the same seed write identical
//! files. Reports are made from these files only. The experiments themselves are defined in `study`; `cli`
//! prints.

mod cells;
mod report;
mod run;
mod stats;

pub use cells::{Cell, Experiment, Results, Values, differences, differences_by_seed, of, paired, rows};
pub use report::{Chart, Curve, Outcome, Report};
pub use run::{AROUND, Observer, RunOptions, run};
pub use stats::{Summary, median};
