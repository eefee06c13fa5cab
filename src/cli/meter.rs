//! Progress on stderr and where the time went.

#![expect(clippy::disallowed_types, reason = "the clock is read for messages only; no result depends on it")]

use crate::console;
use crate::fit::training::{Step, Watch};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Seconds between lines where stderr is not a terminal.
const LINE_SECONDS: u64 = 15;
/// Seconds after which a training writes a checkpoint, however few iterations it has done.
const CHECKPOINT_SECONDS: u64 = 60;

/// A stopwatch with named parts.
pub(crate) struct Laps {
    last: Instant,
    parts: Vec<(&'static str, Duration)>,
}

impl Default for Laps {
    /// Starts the clock.
    fn default() -> Self {
        Self { last: Instant::now(), parts: Vec::new() }
    }
}

impl Laps {
    /// Parts and their seconds, in the order in which they first came.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.parts.iter().map(|(name, d)| (*name, d.as_secs_f64()))
    }
}

impl Watch for Laps {
    fn lap(&mut self, part: &'static str) {
        let now = Instant::now();
        let d = now - self.last;
        self.last = now;
        match self.parts.iter_mut().find(|p| p.0 == part) {
            Some(p) => p.1 += d,
            None => self.parts.push((part, d)),
        }
    }
}

/// A stopwatch and a progress display: a bar on a terminal, else a line every 15 seconds.
pub(crate) struct Meter {
    started: Instant,
    laps: Laps,
    bar: Option<ProgressBar>,
    last_line: Instant,
    last_checkpoint: Instant,
    counted: Option<(Instant, usize)>,
    primitives: &'static str,
}

impl Meter {
    /// Starts the clock; with `--quiet` it shows nothing.
    pub(crate) fn new() -> Self {
        let now = Instant::now();
        Self {
            started: now,
            laps: Laps::default(),
            bar: None,
            last_line: now,
            last_checkpoint: now,
            counted: None,
            primitives: "Gaussians",
        }
    }

    /// A stopwatch whose last checkpoint is so long ago that the next one is due.
    #[cfg(test)]
    pub(crate) fn with_checkpoint_due() -> Self {
        let mut meter = Self::new();
        let ago = Instant::now().checked_sub(Duration::from_secs(CHECKPOINT_SECONDS));
        meter.last_checkpoint = ago.expect("the clock runs for longer than that");
        meter
    }

    /// A stopwatch for one part of the work, with a clock of its own; [`Self::add`] takes it back.
    pub(crate) fn part() -> Self {
        Self::new()
    }

    /// Adds the parts of a stopwatch that ran until now.
    pub(crate) fn add(&mut self, part: &Self) {
        for (name, d) in &part.laps.parts {
            match self.laps.parts.iter_mut().find(|p| p.0 == *name) {
                Some(p) => p.1 += *d,
                None => self.laps.parts.push((name, *d)),
            }
        }
        self.laps.last = Instant::now();
    }

    /// What the steps that it watches have a number of, where these are not Gaussians.
    pub(crate) fn of(mut self, primitives: &'static str) -> Self {
        self.primitives = primitives;
        self
    }

    /// A remark for the person at the terminal.
    pub(crate) fn note(&self, line: &str) {
        if console::is_quiet() {
            return;
        }
        match &self.bar {
            Some(bar) => bar.suspend(|| console::note(line)),
            None => console::note(line),
        }
    }

    /// Ends the bar of the work so far.
    pub(crate) fn done(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
        self.counted = None;
    }

    /// Seconds since the start.
    pub(crate) fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Parts and their seconds, longest first.
    pub(crate) fn parts(&self) -> Vec<(String, f64)> {
        let mut parts: Vec<_> = self.laps.parts().map(|(name, s)| (name.to_owned(), s)).collect();
        parts.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        parts
    }

    /// Counts `done` of `total` pieces of work with a message.
    pub(crate) fn count(&mut self, done: usize, total: usize, message: &str) {
        if console::is_quiet() {
            return;
        }
        // The rate counts from the first call, so that a resumed fit does not claim the work of its predecessor.
        let (since, first) = *self.counted.get_or_insert_with(|| (Instant::now(), done));
        if std::io::stderr().is_terminal() {
            let bar = self.bar.get_or_insert_with(|| {
                let style =
                    ProgressStyle::with_template("{bar:32} {pos}/{len} · {pace} · {eta} left · {msg}")
                        .unwrap_or_else(|_| ProgressStyle::default_bar())
                        .with_key("pace", |state: &ProgressState, to: &mut dyn std::fmt::Write| {
                            let _ = to.write_str(&pace(state.per_sec()));
                        })
                        .progress_chars("━━─");
                let bar =
                    ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(8));
                bar.set_style(style);
                bar.set_position(done as u64);
                bar.reset_eta();
                bar
            });
            bar.set_message(message.to_owned());
            bar.set_position(done as u64);
        } else if self.last_line.elapsed() >= Duration::from_secs(LINE_SECONDS) {
            self.last_line = Instant::now();
            let rate = (done - first) as f64 / since.elapsed().as_secs_f64();
            if rate > 0.0 {
                let left = super::units::seconds((total - done) as f64 / rate);
                console::note(&format!("{done}/{total} · {} · {left} left · {message}", pace(rate)));
            } else {
                console::note(&format!("{done}/{total} · {message}"));
            }
        }
    }
}

/// A rate per second in words: of slow work what one piece takes.
fn pace(rate: f64) -> String {
    if rate > 0.0 && rate < 0.1 {
        format!("{} each", super::units::seconds(1.0 / rate))
    } else {
        format!("{rate:.1}/s")
    }
}

impl Watch for Meter {
    fn lap(&mut self, part: &'static str) {
        self.laps.lap(part);
        if part == "start" || part == "checkpoint" {
            self.last_checkpoint = self.laps.last;
        }
    }

    fn count(&mut self, done: usize, total: usize, what: &str) {
        Self::count(self, done, total, what);
    }

    fn is_checkpoint_due(&mut self) -> bool {
        self.last_checkpoint.elapsed() >= Duration::from_secs(CHECKPOINT_SECONDS)
    }

    fn progress(&mut self, done: usize, total: usize, step: Step) {
        if !console::is_quiet() {
            self.count(done, total, &format!("loss {:.4} · {} {}", step.loss, step.size, self.primitives));
        }
    }
}

impl Drop for Meter {
    fn drop(&mut self) {
        self.done();
        if console::is_verbose() {
            for (part, seconds) in self.parts() {
                console::note(&format!("{part}: {}", super::units::seconds(seconds)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_has_a_clock_of_its_own() {
        let mut whole = Meter::new();
        std::thread::sleep(Duration::from_millis(30));
        whole.lap("first");
        let mut part = Meter::part();
        std::thread::sleep(Duration::from_millis(10));
        part.lap("second");
        assert!(part.seconds() < whole.seconds() - 0.029, "what was before it does not count");
        whole.add(&part);
        let parts = whole.parts();
        assert_eq!(parts.len(), 2, "{parts:?}");
        assert!(parts.iter().fold(0.0, |s, p| s + p.1) <= whole.seconds(), "nothing counts twice: {parts:?}");
    }
}
