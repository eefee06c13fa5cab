//! The campaign of signals: a command is ended at random moments, on one thread or more, and run again until it is done; the result must be that
//! of an undisturbed run.

use crate::long::{self, Again, Expected, Long};
use crate::mutate::Draws;
use crate::program::{Program, Streams};
use crate::table::{Finding, Report};
use crate::tree;
use std::io::Result;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// What the draws are for, among those of a seed.
const PURPOSE: u16 = 3;

/// Columns of the table, in order.
pub const COLUMNS: [&str; 9] = [
    "trials",
    "signals",
    "killed",
    "stopped in good order",
    "before it could stop in good order",
    "after its end",
    "ended wrongly",
    "files left",
    "result differs",
];

/// The first column of faults.
pub const FAULTS: usize = 6;

const SIGNALS: [(&str, i32); 4] = [("KILL", 9), ("TERM", 15), ("INT", 2), ("HUP", 1)];

/// Runs trials `first` to `first + runs` in a folder; `with_slow` has the commands of several seconds too.
///
/// # Errors
/// When a file or a process is lost.
///
/// # Panics
/// When a command fails without a signal.
pub fn run(
    program: &Program,
    seed: u64,
    trials: std::ops::Range<u64>,
    with_slow: bool,
    scratch: &Path,
) -> Result<Report> {
    let report = Report::new(&COLUMNS, FAULTS);
    long::trials(program, trials, with_slow, scratch, report, |n, long, expected, report| {
        let mut draws = Draws::new(seed, n, 0, PURPOSE);
        let mut trial = Trial { program, long, expected, log: Vec::new() };
        if let Some((column, what)) = trial.run(&mut draws, scratch, report)? {
            report.count(long.name, column);
            report.add(Finding { row: long.name.into(), case: n, what, detail: trial.log.join("\n  ") });
        }
        Ok(())
    })
}

/// One trial: signals, and the run that ends.
struct Trial<'a> {
    program: &'a Program,
    long: Long,
    expected: &'a Expected,
    /// what was done, for the list of faults
    log: Vec<String>,
}

impl Trial<'_> {
    fn run(
        &mut self,
        draws: &mut Draws,
        scratch: &Path,
        report: &mut Report,
    ) -> Result<Option<(usize, String)>> {
        let dir = long::new_folder(scratch, "trial")?;
        let out = dir.join("out");
        for k in 0..=draws.below(3) {
            let threads = 1 + draws.below(3);
            let again = k > 0 && (self.long.again == Again::Resume || out.exists());
            let words =
                if again { self.long.again("out", threads) } else { self.long.words("out", threads, &[]) };
            let (name, number) = SIGNALS[draws.below(SIGNALS.len())];
            // A little beyond the end, so that the last steps are met too.
            let moment = self.expected.time.mul_f64(1.1 * draws.below(1000) as f64 / 1000.0);
            let streams = Streams::beside(&dir);
            let child = streams.attach(self.program.command(&words, &dir, ""))?.spawn()?;
            std::thread::sleep(moment);
            // It may have ended; then there is nothing to send it to.
            let _sent = Command::new("kill")
                .args(["-s", name, &child.id().to_string()])
                .stderr(std::process::Stdio::null())
                .status()?;
            let e = streams.finish(child, Duration::from_secs(60))?;
            self.log.push(format!(
                "{name} after {:.3} s on {threads} threads: {}",
                moment.as_secs_f64(),
                e.ended()
            ));
            report.count(self.long.name, 1);
            let left = if out.is_dir() { tree::read(&out)? } else { tree::Tree::new() };
            match (e.status.code(), e.status.signal()) {
                (Some(0), _) => {
                    report.count(self.long.name, 5);
                    break;
                }
                (_, Some(9)) if name == "KILL" => report.count(self.long.name, 2),
                // Before there is something to save, and after the last of it, the program ends at once and without a word.
                (Some(130), _)
                    if name != "KILL" && e.text().is_empty() && crate::program::stray(&left).is_none() =>
                {
                    report.count(self.long.name, 4);
                }
                (Some(130), _) if name != "KILL" => {
                    report.count(self.long.name, 3);
                    if let Some(what) = long::bad_message(&e) {
                        self.log.push(e.text());
                        return Ok(Some((6, what)));
                    }
                    if let Some(n) = crate::program::stray(&left) {
                        return Ok(Some((7, format!("stopped in good order, it left {n}"))));
                    }
                }
                // The first milliseconds: nothing is handled yet, and nothing is written.
                (_, Some(s)) if s == number && left.keys().all(|n| again || n.ends_with(".lock")) => {
                    report.count(self.long.name, 4);
                }
                _ => {
                    self.log.push(e.text());
                    return Ok(Some((6, format!("{name}: {}", e.ended()))));
                }
            }
        }
        let threads = 1 + draws.below(3);
        let e = self.program.run(&self.long.again("out", threads), &dir)?;
        if let Some(what) = long::wrong(&e, &out, self.expected)? {
            return Ok(Some((8, what)));
        }
        let left = tree::read(&dir)?;
        Ok(crate::program::stray(&left).map(|n| (7, format!("in the end, it left {n}"))))
    }
}
