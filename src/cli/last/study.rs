//! `last study`: the experiments of LAST, one table and one chart each.

use crate::cli::meter::Meter;
use crate::cli::report::charts::{Lines, Series, bars};
use crate::cli::report::{self, Page, Section, Stat};
use crate::cli::shared::Manner;
use crate::cli::{self, claim};
use crate::fit::training::Watch;
use crate::last::study::learn::{self, Learning, Size};
use crate::last::study::plan::{Experiment, Report};
use crate::last::study::run;
use crate::{Error, Result};
use maud::{Markup, html};
use serde_json::{Value, json};
use std::path::PathBuf;

/// The record in `--out`.
const RECORD: &str = "study.json";

/// Run the experiments: what the paper claims, what is found.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last study --out study                    everything; long
  lastlight last study --out study --resume           go on where it stopped
  lastlight last study E10 E12 --out study
  lastlight last study E10 --out look --quick         small sizes, one seed

E4 number of factors · E10 is the structure found · E11 the spurious edge of a fork · E12 where dependence is
punished. Every cell (one training with one seed) is a file under --out; the reports are made from these
files. --out gets study.json, one CSV per experiment and report/index.html.")]
pub(in crate::cli) struct Args {
    /// Experiments [default: all]
    #[arg(value_name = "ID")]
    ids: Vec<String>,
    /// Folder for results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Small sizes and one seed
    #[arg(long)]
    quick: bool,
    /// Go on where an interrupted study stopped
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    #[command(flatten)]
    manner: Manner,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new(args.manner.quiet);
    let size = if args.quick { Size::quick() } else { Size::full() };
    let all: [Learning; 4] =
        [learn::number, learn::correct, learn::spurious, learn::dependence].map(|make| make(size));
    for id in &args.ids {
        if !all.iter().any(|x| x.id() == id) {
            let names: Vec<&str> = all.iter().map(|x| x.id()).collect();
            return Err(Error::input("experiment").expected(names.join(", ")).got(id.as_str()));
        }
    }
    let chosen: Vec<&dyn Experiment> = all
        .iter()
        .filter(|x| args.ids.is_empty() || args.ids.iter().any(|id| id == x.id()))
        .map(|x| x as &dyn Experiment)
        .collect();
    let dir = claim::folder(&args.out, args.resume, args.manner.force)?;
    let settings = json!({
        "steps": size.steps, "refit": size.refit, "freeze": size.freeze, "data": size.data, "seeds": size.seeds,
        "lastlight": env!("CARGO_PKG_VERSION"),
    });
    let reports = cli::stoppable(|stop| {
        run::run(&chosen, &settings, &dir, stop, &mut |done, total, what| meter.count(done, total, what))
    })?;
    meter.done();
    meter.lap("cells");
    for r in &reports {
        let quoted = |row: &[String]| -> String {
            row.iter().map(|c| format!("\"{}\"", c.replace('"', "\"\""))).collect::<Vec<_>>().join(",")
        };
        let head: Vec<String> = r.head.iter().map(|h| h.trim_start_matches('>').to_owned()).collect();
        let lines: Vec<String> = std::iter::once(&head).chain(&r.rows).map(|row| quoted(row)).collect();
        let file = dir.join(format!("{}.csv", r.id));
        crate::io::atomic::write_bytes(&file, format!("{}\n", lines.join("\n")).as_bytes())?;
    }
    let record = json!({
        "kind": "last study", "settings": settings, "seconds": meter.seconds(),
        "experiments": reports.iter().map(summary).collect::<Vec<_>>(),
    });
    crate::io::atomic::write_bytes(&dir.join(RECORD), format!("{record:#}\n").as_bytes())?;
    let page = page(&reports, args.quick).write(&dir)?;
    if args.manner.json {
        return cli::say_json(&record);
    }
    for r in &reports {
        cli::say(&format!("{:4} {:11} {}", r.id, outcome(r), r.verdict))?;
    }
    cli::say(&format!("report {}", page.display()))
}

fn outcome(r: &Report) -> &'static str {
    match r.holds {
        Some(true) => "holds",
        Some(false) => "does not",
        None => "reported",
    }
}

fn summary(r: &Report) -> Value {
    json!({ "id": r.id, "claim": r.claim, "holds": r.holds, "verdict": r.verdict, "head": r.head, "rows": r.rows })
}

fn page(reports: &[Report], quick: bool) -> Page {
    let section = |r: &Report| -> Section {
        let rows: Vec<Vec<Markup>> =
            r.rows.iter().map(|row| row.iter().map(report::text).collect()).collect();
        let chart = if r.curves.is_empty() {
            bars(r.chart[0], &r.bars, 'a', 2, 0.0, None)
        } else {
            let series = r.curves.iter().enumerate().map(|(i, c)| Series {
                name: &c.name,
                color: (b'a' + (i % 8) as u8) as char,
                points: c.points.iter().map(|p| (p.0, p.1)).collect(),
                band: Vec::new(),
            });
            let lines = Lines {
                title: r.chart[0],
                x_label: r.chart[1],
                log_y: false,
                from_zero: true,
                series: series.collect(),
                marks: Vec::new(),
            };
            lines.html()
        };
        Section {
            id: r.id,
            title: r.id,
            lead: format!("{} — {}: {}", r.claim, outcome(r), r.verdict),
            body: html! { (report::table(&r.head, &rows)) (chart) },
        }
    };
    let count = |wanted: Option<bool>| reports.iter().filter(|r| r.holds == wanted).count().to_string();
    Page {
        kind: "last study".into(),
        title: if quick { "small sizes, one seed: a look, no evidence".into() } else { "experiments".into() },
        command: cli::command_line(),
        facts: Vec::new(),
        stats: vec![
            Stat { label: "hold", value: count(Some(true)), note: "of what counts as reproduced".into() },
            Stat { label: "do not", value: count(Some(false)), note: String::new() },
            Stat { label: "reported", value: count(None), note: "without a criterion".into() },
        ],
        sections: reports.iter().map(section).collect(),
    }
}
