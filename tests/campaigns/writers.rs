//! The campaign of two writers: the same command is started twice with the same output. One does its work, the other one is refused with a clear
//! message, and the result is that of one undisturbed run.

use crate::long::{self, Again};
use crate::mutate::Draws;
use crate::program::{Program, Streams, stray};
use crate::table::{Finding, Report};
use crate::tree;
use std::io::Result;
use std::path::Path;
use std::time::Duration;

/// What the draws are for, among those of a seed.
const PURPOSE: u16 = 5;

/// Columns of the table, in order.
pub const COLUMNS: [&str; 7] = [
    "trials",
    "one refused",
    "one after the other",
    "both or none",
    "message",
    "files left",
    "result differs",
];

/// The first column of faults.
pub const FAULTS: usize = 3;

/// Runs trials in a folder.
///
/// # Errors
/// When a file or a process is lost.
///
/// # Panics
/// When a command fails alone.
pub fn run(program: &Program, seed: u64, trials: std::ops::Range<u64>, scratch: &Path) -> Result<Report> {
    long::trials(
        program,
        trials,
        false,
        scratch,
        Report::new(&COLUMNS, FAULTS),
        |n, long, expected, report| {
            let mut draws = Draws::new(seed, n, 0, PURPOSE);
            let dir = long::new_folder(scratch, "trial")?;
            // Without an option, or continued: then the second may come after the first and find its work done.
            let again = draws.below(2) == 1;
            let words =
                |threads| if again { long.again("out", threads) } else { long.words("out", threads, &[]) };
            let streams = ["one", "two"].map(|name| Streams::beside(&dir.join(name)));
            let first = streams[0].attach(program.command(&words(1), &dir, ""))?.spawn()?;
            std::thread::sleep(expected.time.mul_f64(draws.below(1000) as f64 / 1000.0));
            let second = streams[1].attach(program.command(&words(2), &dir, ""))?.spawn()?;
            let limit = Duration::from_secs(60);
            let ends = [streams[0].finish(first, limit)?, streams[1].finish(second, limit)?];
            for s in ["one", "two"] {
                tree::remove(&dir.join(s).with_extension("stdout"))?;
                tree::remove(&dir.join(s).with_extension("stderr"))?;
            }
            let done: Vec<_> = ends.iter().filter(|e| e.status.success()).collect();
            let refused: Vec<_> = ends.iter().filter(|e| e.status.code() == Some(2)).collect();
            let is_file = dir.join("out").is_file();
            let verdict = if done.is_empty()
                || done.len() + refused.len() != 2
                || done.len() == 2 && !again && !is_file
            {
                (3, Some("not one of them".to_owned()))
            } else if let Some(what) = refused.iter().find_map(|e| long::bad_message(e)) {
                (4, Some(what))
            } else if let Some(e) = refused.iter().find(|e| !e.text().contains("out")) {
                (4, Some(format!("the output is not named: {}", e.text())))
            } else if let Some(name) = stray(&tree::read(&dir)?) {
                (5, Some(format!("they left {name}")))
            } else if let Some(what) = done
                .iter()
                .map(|e| long::wrong(e, &dir.join("out"), expected))
                .collect::<Result<Vec<_>>>()?
                .into_iter()
                .flatten()
                .next()
            {
                (6, Some(what))
            } else {
                (if done.len() == 2 { 2 } else { 1 }, None)
            };
            report.count(long.name, verdict.0);
            if let Some(what) = verdict.1 {
                let how = if long.again == Again::Resume { "--resume" } else { "--force" };
                let said = ends.each_ref().map(|e| format!("{}: {}", e.ended(), e.text()));
                let detail = format!("{}: {}", if again { how } else { "a new folder" }, said.join(" | "));
                report.add(Finding { row: long.name.into(), case: n, what, detail });
            }
            Ok(())
        },
    )
}
