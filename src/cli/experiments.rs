//! The commands' side of the study engine: cells run with progress and a clock, tables as CSV, one page for all experiments.

use crate::choices::Choices;
use crate::console as cli;
use crate::experiment::{
    self, AROUND, Cell, Chart, Experiment, Observer, Outcome, Report, Results, RunOptions, Summary,
};
use crate::io::{self, atomic};
use crate::meter::{Laps, Meter};
use crate::num::par;
use crate::report::bars::{bars, intervals};
use crate::report::charts::{Lines, Series};
use crate::report::{self, Page, Section, Stat};
use crate::{Error, Result, claim, like, version};
use maud::{Markup, html};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The record in `--out`.
const RECORD: &str = "study.json";
/// Seconds of the cells that ran, in `--out`: nothing else there depends on a clock.
const SECONDS: &str = "seconds.csv";

/// Shows progress and records how long cells take.
struct Clock<'a> {
    meter: &'a mut Meter,
    file: PathBuf,
}

impl Observer for Clock<'_> {
    type Inside = Laps;

    fn next(&mut self, done: usize, total: usize, what: &str) {
        self.meter.count(done, total, what);
    }

    fn ran(&mut self, folder: &str, key: &str, inside: Laps) {
        let seconds = inside.parts().filter(|(part, _)| *part != AROUND).fold(0.0, |s, (_, x)| s + x);
        let line = format!("{folder},{key},{seconds:.3}\n");
        let file = std::fs::OpenOptions::new().create(true).append(true).open(&self.file);
        if let Err(e) = file.and_then(|mut f| f.write_all(line.as_bytes())) {
            self.meter.note(&format!("{}: {e}", self.file.display()));
        }
    }
}

/// Seconds by folder and key of a cell, the last entry of each.
fn seconds(dir: &Path) -> BTreeMap<(String, String), f64> {
    let text = std::fs::read_to_string(dir.join(SECONDS)).unwrap_or_default();
    let entry = |line: &str| {
        let mut parts = line.split(',');
        let cell = (parts.next()?.to_owned(), parts.next()?.to_owned());
        Some((cell, parts.next()?.parse().ok()?))
    };
    text.lines().filter_map(entry).collect()
}

/// Mean seconds of a cell by row, of the cells in `folder` that were timed in the study in `dir`.
pub(crate) fn durations(dir: &Path, folder: &str, cells: &[Cell]) -> Vec<(String, Summary)> {
    let seconds = seconds(dir);
    let mut rows: Vec<(String, Vec<f64>)> = Vec::new();
    for cell in cells {
        let Some(&s) = seconds.get(&(folder.to_owned(), cell.key.clone())) else { continue };
        match rows.iter_mut().find(|(row, _)| *row == cell.row) {
            Some((_, all)) => all.push(s),
            None => rows.push((cell.row.clone(), vec![s])),
        }
    }
    rows.into_iter().map(|(row, all)| (row, Summary::of(&all))).collect()
}

/// A study in progress: its folder, how cells run, and the reports so far.
pub(crate) struct Study<'a> {
    pub(crate) dir: PathBuf,
    pub(crate) options: RunOptions,
    pub(crate) meter: &'a mut Meter,
    pub(crate) reports: Vec<Report>,
}

impl Study<'_> {
    /// Runs the cells of some experiments that have no result, and reports the experiments.
    pub(crate) fn run(&mut self, experiments: &[&dyn Experiment]) -> Result<Vec<Results>> {
        let mut clock = Clock { meter: self.meter, file: self.dir.join(SECONDS) };
        let results =
            cli::stoppable(|stop| experiment::run(experiments, &self.dir, self.options, stop, &mut clock));
        self.meter.done();
        let results = results?;
        for (x, results) in experiments.iter().zip(&results) {
            let (mut report, total) = (x.report(results), x.cells().len());
            if results.is_empty() {
                report = Report::not_run(report.id, report.claim, "no result is there");
            } else if results.len() < total {
                report.verdict += &format!(" So far {} of {total} cells.", results.len());
            }
            self.reports.push(report);
        }
        Ok(results)
    }
}

/// Values of `--scale`.
pub(crate) const SCALES: &Choices = &[
    ("full", "the study: hours"),
    ("quick", "small sizes and few seeds or objects: minutes, not evidence"),
    ("smoke", "smallest sizes: a test that everything runs"),
];

/// Checks that a folder which is continued is that of a study of this scale; gives the names of the experiments in its record, if it has one.
///
/// # Errors
/// When it holds the result of another command, or a study of another scale.
pub(crate) fn resumed(dir: &Path, scale: &str) -> Result<Vec<String>> {
    claim::is_of(dir, &[RECORD, SECONDS, "cells", "trainings"])?;
    let path = dir.join(RECORD);
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let bytes = io::read_bytes(&path, io::MAX_SMALL_FILE_BYTES)?;
    let record = io::json::parse(&bytes, &path.display().to_string())?;
    match record["sizes"].as_str() {
        Some(sizes) if sizes != scale => Err(Error::input("--scale")
            .expected(format!("{sizes}, as in {}", path.display()))
            .got(scale)
            .hint("choose another folder for another scale")),
        _ => {
            let all = record["experiments"].as_array().into_iter().flatten();
            Ok(all.filter_map(|x| x["id"].as_str().map(str::to_owned)).collect())
        }
    }
}

/// What sizes other than the study's are worth.
pub(crate) fn warning(scale: &str) -> Option<&'static str> {
    match scale {
        "quick" => Some("quick run (small sizes, few seeds or objects): not evidence"),
        "smoke" => Some("smoke test (smallest sizes): not evidence"),
        _ => None,
    }
}

/// Prints the experiments of a study.
///
/// # Errors
/// When the output cannot be written.
pub(crate) fn list(experiments: &Choices) -> Result<()> {
    if cli::is_json() {
        let all = experiments.iter().map(|(id, about)| json!({ "id": id, "about": about }));
        return cli::say_json(&json!({ "experiments": all.collect::<Vec<_>>() }));
    }
    experiments.iter().try_for_each(|(id, about)| cli::say(&format!("{id:11} {about}")))
}

/// The name of an experiment, and its mean seconds of a cell by row.
pub(crate) type Cost = (&'static str, Vec<(String, Summary)>);

/// A study that has run.
pub(crate) struct Finished<'a> {
    pub(crate) kind: &'static str,
    pub(crate) title: &'static str,
    pub(crate) dir: &'a Path,
    pub(crate) scale: &'a str,
    pub(crate) reports: &'a [Report],
    /// Experiments, and the seconds by row that are shown beside them.
    pub(crate) costs: &'a [Cost],
    /// Entries of the record beside those of every study.
    pub(crate) own: Map<String, Value>,
    pub(crate) seconds: f64,
}

impl Finished<'_> {
    /// Writes tables, record and page, and prints the verdicts.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub(crate) fn publish(self) -> Result<()> {
        write_tables(self.dir, self.reports)?;
        let mut record = json!({
            "kind": self.kind, "lastlight": env!("CARGO_PKG_VERSION"), "sizes": self.scale, "threads": par::threads(),
            "experiments": records(self.reports), "seconds": self.seconds, like::ARGUMENTS: cli::arguments(),
            "build": version::record(),
        });
        for (key, value) in self.own {
            record[key] = value;
        }
        atomic::write_bytes(&self.dir.join(RECORD), format!("{record:#}\n").as_bytes())?;
        let titles = (self.title, warning(self.scale).unwrap_or_default());
        let page = page(self.kind, titles, self.reports, self.costs).write(self.dir)?;
        if cli::is_json() {
            return cli::say_json(&record);
        }
        if let Some(warning) = warning(self.scale) {
            cli::say(warning)?;
        }
        for r in self.reports {
            cli::say(&format!("{:11} {:13} {}", r.id, r.outcome.name(), r.verdict))?;
        }
        cli::say(&format!("report {}", page.display()))
    }
}

/// Writes the table of each report as `ID.csv`.
///
/// # Errors
/// When a file cannot be written.
fn write_tables(dir: &Path, reports: &[Report]) -> Result<()> {
    let quoted = |row: &[String]| -> String {
        row.iter().map(|c| format!("\"{}\"", c.replace('"', "\"\""))).collect::<Vec<_>>().join(",")
    };
    for r in reports {
        let head: Vec<String> = r.head.iter().map(|h| h.trim_start_matches('>').to_owned()).collect();
        let lines: Vec<String> = std::iter::once(&head).chain(&r.rows).map(|row| quoted(row)).collect();
        atomic::write_bytes(
            &dir.join(format!("{}.csv", r.id)),
            format!("{}\n", lines.join("\n")).as_bytes(),
        )?;
    }
    Ok(())
}

/// Reports as part of a record.
fn records(reports: &[Report]) -> Vec<Value> {
    let record = |r: &Report| {
        json!({
            "id": r.id, "claim": r.claim, "outcome": r.outcome.name(), "verdict": r.verdict, "head": r.head,
            "rows": r.rows,
        })
    };
    reports.iter().map(record).collect()
}

fn chart(r: &Report) -> Markup {
    match &r.chart {
        Chart::Bars(rows) if rows.is_empty() => html! {},
        Chart::Bars(rows) => {
            let decimals = if rows.iter().all(|(_, x)| x.abs() >= 100.0) { 0 } else { 2 };
            bars(r.chart_labels[0], rows, 'a', decimals, 0.0, None)
        }
        Chart::Intervals(rows) => {
            let rows: Vec<(String, f64, f64)> =
                rows.iter().map(|(name, s)| (name.clone(), s.mean, s.half_width)).collect();
            intervals(r.chart_labels[0], &rows, 'a')
        }
        Chart::Lines { curves, from_zero } => {
            let series = curves.iter().enumerate().map(|(i, c)| Series {
                name: &c.name,
                color: (b'a' + (i % 8) as u8) as char,
                points: c.points.iter().map(|p| (p.0, p.1)).collect(),
                band: Vec::new(),
            });
            let lines = Lines {
                title: r.chart_labels[0],
                x_label: r.chart_labels[1],
                log_y: false,
                from_zero: *from_zero,
                series: series.collect(),
                marks: Vec::new(),
            };
            lines.html()
        }
    }
}

/// One report: its claim, table and chart, with a table of seconds beside the chart where some are given.
fn section(r: &Report, seconds: &[(String, Summary)]) -> Section {
    // A row's name stays on one line.
    let text = |(i, cell): (usize, &String)| {
        report::text(if i == 0 { cell.replace(' ', "\u{a0}") } else { cell.clone() })
    };
    let rows: Vec<Vec<Markup>> =
        r.rows.iter().map(|row| row.iter().enumerate().map(text).collect()).collect();
    let seconds: Vec<Vec<Markup>> =
        seconds.iter().map(|(row, s)| vec![report::text(row), report::text(format!("{s:.2}"))]).collect();
    Section {
        id: r.id,
        title: r.id,
        lead: r.claim.to_owned(),
        body: html! { div.stack {
            p.notice { span.strong.good[r.outcome == Outcome::Holds].bad[r.outcome == Outcome::Fails] { (r.outcome.name()) ": " } (r.verdict) }
            @if !r.head.is_empty() { (report::table(&r.head, &rows)) }
            div.two.keep {
                (chart(r))
                @if !seconds.is_empty() { (report::table(&["time on this machine", ">seconds"], &seconds)) }
            }
        } },
    }
}

/// The page of a study.
fn page(kind: &str, (title, notice): (&str, &'static str), reports: &[Report], costs: &[Cost]) -> Page {
    let seconds_of = |id: &str| {
        costs.iter().find(|(own, _)| *own == id).map_or(&[][..], |(_, seconds)| seconds.as_slice())
    };
    let count = |outcome: Outcome| reports.iter().filter(|r| r.outcome == outcome).count().to_string();
    let stat = |outcome: Outcome, note: &str| Stat {
        label: outcome.name(),
        value: count(outcome),
        note: note.to_owned(),
    };
    Page {
        kind: kind.into(),
        title: title.into(),
        notice,
        command: cli::command_line(),
        facts: Vec::new(),
        stats: vec![
            stat(Outcome::Holds, "the criterion is met"),
            stat(Outcome::Fails, "the criterion is not met"),
            stat(Outcome::Reported, "there is no criterion"),
            stat(Outcome::NotRun, "an input is missing"),
        ],
        sections: reports.iter().map(|r| section(r, seconds_of(r.id))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_belong_to_the_folder_of_a_cell() {
        let dir = tempfile::tempdir().expect("a folder");
        let text = "E1,s0,1.000\nE2,s0,8.000\nE1,s1,3.000\nE1,s0,2.000\n";
        std::fs::write(dir.path().join(SECONDS), text).expect("written");
        let cells = ["s0", "s1", "s2"].map(|key| Cell { key: key.into(), row: "all".into(), seed: 0 });
        let means = |folder: &str| {
            let rows = durations(dir.path(), folder, &cells);
            rows.into_iter().map(|(row, summary)| (row, summary.mean)).collect::<Vec<_>>()
        };
        assert_eq!(means("E1"), [("all".to_owned(), 2.5)], "the last entry of each cell");
        assert_eq!(means("E2"), [("all".to_owned(), 8.0)], "the same key in another folder");
        assert!(means("E3").is_empty(), "nothing was timed");
    }
}
