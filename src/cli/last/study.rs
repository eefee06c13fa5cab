//! `last study`: the experiments of LAST, one table and one chart each.

use crate::cli::meter::{Laps, Meter};
use crate::cli::report::charts::{Lines, Series, bars, intervals};
use crate::cli::report::{self, Page, Section, Stat};
use crate::cli::shared::{Manner, Perception};
use crate::cli::{self, claim};
use crate::io::atomic;
use crate::last::model::file::Trained;
use crate::last::model::shipped;
use crate::last::study::learn::{self, Learning};
use crate::last::study::person::constants::{Calibration, Constants, Search};
use crate::last::study::person::experiments::{self, CLAIMS};
use crate::last::study::person::stage::{self, Model, Stage};
use crate::last::study::person::trial::AROUND;
use crate::last::study::pictures::{self, Seen};
use crate::last::study::plan::{Cell, Drawing, Experiment, Outcome, Report, Results};
use crate::last::study::run::{self, Onlooker, Plan};
use crate::last::study::stats::Summary;
use crate::num::par;
use crate::{Error, Result};
use maud::{Markup, html};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The record in `--out`.
const RECORD: &str = "study.json";
/// Seconds of the fits that ran, in `--out`: nothing else here depends on a clock.
const SECONDS: &str = "seconds.csv";
/// Graph of the data of the model that comes with the program.
const SHIPPED: &str = "FORK";
/// What the constants are found by.
const FOUND_BY: [(&str, &str); 2] = [
    ("calibration", "c_τ makes τ_rec a number without a scale."),
    ("search", "The strongest honest setting: constants found on subject 0, evaluated on others."),
];

/// Run the experiments: what the paper claims, what is found.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last study --out study                       everything; hours
  lastlight last study --out study --resume              go on where it stopped
  lastlight last study E10 --out look --quick            small sizes, few seeds
  lastlight last study E1 --out study --model FORK=a.safetensors --model FULL=b.safetensors

E1 full system against host · E2 what each part does · E3 wrong structures · E4 number of factors · E5 τ_rec
E6 where the latent criterion adds · E7 λ · E8 order of the updates · E9 tuning · E10 is the structure found
(E10p from pictures; its models stay in models/) · E11 the spurious edge of a fork · E12 where dependence is
punished · E13 errors of child factors · E14 cost · E15 latent factors in the loss.
Those with persons need a model that was trained on pictures of `last gen --graph GRAPH` with its default seed: the
one that comes with the program, or those of --model, the first of which serves where an experiment asks for one.
Before them the scale of the latent criterion and the strongest constants are found on a subject that is in no
experiment (calibration, search). Every cell (one training or fit) is a file under --out; the reports are
made from these files. --out gets study.json, one CSV per experiment and report/index.html.")]
pub(in crate::cli) struct Args {
    /// Experiments [default: all]
    #[arg(value_name = "ID")]
    ids: Vec<String>,
    /// Folder for results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Image-to-point model of last pretrain and the graph of its data; once for each graph [default: FORK and the
    /// model that comes with the program]
    #[arg(long, value_name = "GRAPH=FILE")]
    model: Vec<String>,
    /// The constants of the specification instead of a search
    #[arg(long)]
    no_search: bool,
    /// Small sizes and few seeds
    #[arg(long)]
    quick: bool,
    /// The smallest sizes: shows that everything runs, in seconds
    #[arg(long, conflicts_with = "quick")]
    smoke: bool,
    /// Cells to run at a time; they share the threads and change no bit [default: as many as threads]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Go on where an interrupted study stopped
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Run nothing: report what is there
    #[arg(long, requires = "resume")]
    stored: bool,
    #[command(flatten)]
    perception: Perception,
    #[command(flatten)]
    manner: Manner,
}

/// Tells the terminal and writes down how long fits take.
struct Clock<'a> {
    meter: &'a mut Meter,
    file: PathBuf,
}

impl Onlooker for Clock<'_> {
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

/// Seconds by key, the last word of each.
fn seconds(dir: &Path) -> BTreeMap<String, f64> {
    let text = std::fs::read_to_string(dir.join(SECONDS)).unwrap_or_default();
    let entry = |line: &str| {
        let mut parts = line.split(',').skip(1);
        Some((parts.next()?.to_owned(), parts.next()?.parse().ok()?))
    };
    text.lines().filter_map(entry).collect()
}

impl Args {
    fn sizes(&self) -> (learn::Size, pictures::Size, stage::Size) {
        match (self.quick, self.smoke) {
            (true, _) => (learn::Size::quick(), pictures::Size::quick(), stage::Size::quick()),
            (_, true) => (learn::Size::smoke(), pictures::Size::smoke(), stage::Size::smoke()),
            _ => (learn::Size::full(), pictures::Size::full(), stage::Size::full()),
        }
    }

    fn sizes_name(&self) -> &'static str {
        match (self.quick, self.smoke) {
            (true, _) => "quick",
            (_, true) => "smoke",
            _ => "full",
        }
    }

    /// What sizes other than the study's are worth.
    fn warning(&self) -> Option<&'static str> {
        match (self.quick, self.smoke) {
            (true, _) => Some("small sizes, few seeds: a look, no evidence"),
            (_, true) => Some("the smallest sizes: everything runs, nothing is shown"),
            _ => None,
        }
    }

    fn wants(&self, id: &str) -> bool {
        self.ids.is_empty() || self.ids.iter().any(|x| x == id)
    }

    fn models(&self) -> Result<Vec<Model>> {
        let mut models: Vec<Model> = Vec::new();
        for text in &self.model {
            let wrong =
                |got: &str| Error::input("--model").expected("GRAPH=FILE, one for each graph").got(got);
            let (graph, file) = text.split_once('=').ok_or_else(|| wrong(text))?;
            if models.iter().any(|m| m.graph == graph) {
                return Err(wrong(&format!("{graph} twice")));
            }
            models.push(Model::new(graph, Trained::of_pictures(Path::new(file))?)?);
        }
        if models.is_empty() {
            models.push(Model::new(SHIPPED, shipped::figure()?)?);
        }
        Ok(models)
    }
}

/// Experiments in work: where, and with whom looking on.
struct Study<'a> {
    dir: PathBuf,
    plan: Plan,
    meter: &'a mut Meter,
    reports: Vec<Report>,
}

impl Study<'_> {
    /// Runs what is missing of some experiments and reports them.
    fn run(&mut self, experiments: &[&dyn Experiment]) -> Result<Vec<Results>> {
        let mut clock = Clock { meter: self.meter, file: self.dir.join(SECONDS) };
        let results = cli::stoppable(|stop| run::run(experiments, &self.dir, self.plan, stop, &mut clock));
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

    /// The constants of the guided fit; none while results are missing.
    fn constants(&mut self, stage: &Stage, published: bool) -> Result<Option<Constants>> {
        let calibration = Calibration { stage };
        let results = self.run(&[&calibration])?.remove(0);
        let Some(scales) = calibration.found(&results) else { return Ok(None) };
        if published {
            return Ok(Some(Constants::published(scales)));
        }
        let search = Search::new(stage, scales)?;
        let results = self.run(&[&search])?.remove(0);
        Ok(search.found(&results))
    }
}

/// Of `E7`, 7; what comes before the experiments is 0.
fn number(id: &str) -> u32 {
    id.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap_or(0)
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new(args.manner.quiet);
    let (vectors, seen, persons) = args.sizes();
    let of_vectors: [Learning; 4] =
        [learn::number, learn::correct, learn::spurious, learn::dependence].map(|make| make(vectors));
    let of_pictures = Seen::new(seen, &args.out);
    let learning: Vec<&dyn Experiment> =
        of_vectors.iter().map(|x| x as &dyn Experiment).chain([&of_pictures as &dyn Experiment]).collect();
    let guided: Vec<&str> = FOUND_BY.iter().chain(&CLAIMS).map(|(id, _)| *id).collect();
    for id in &args.ids {
        if !learning.iter().any(|x| x.id() == id) && !guided.contains(&id.as_str()) {
            let mut names: Vec<&str> =
                learning.iter().map(|x| x.id()).chain(guided.iter().copied()).collect();
            names.sort_by_key(|id| number(id));
            return Err(Error::input("experiment").expected(names.join(", ")).got(id.as_str()));
        }
    }
    let models = args.models()?;
    let with_persons = guided.iter().any(|id| args.wants(id));
    let perception = if with_persons { args.perception.load(&meter)? } else { None };
    let perception = perception.map(|metric| metric.digest().map(|d| (metric, d))).transpose()?;
    let dir = claim::folder(&args.out, args.resume, args.manner.force)?;
    let named = models.iter().map(|m| json!({ "graph": m.graph, "digest": m.digest })).collect::<Vec<_>>();
    let plan = Plan { only_stored: args.stored, jobs: args.jobs.map_or_else(par::threads, usize::from) };
    let mut study = Study { dir: dir.clone(), plan, meter: &mut meter, reports: Vec::new() };
    let mut constants = None;
    let mut costs = Vec::new();
    if with_persons {
        // Constants are found without LPIPS, whose weights make no difference to them.
        let mut stage = Stage { size: persons, models, dir: dir.clone(), perception: None };
        if let Some(found) = study.constants(&stage, args.no_search)? {
            stage.perception = perception;
            let all = experiments::all(&stage, &found)?;
            let chosen: Vec<&dyn Experiment> =
                all.iter().filter(|x| args.wants(x.id())).map(|x| x as &dyn Experiment).collect();
            study.run(&chosen)?;
            constants = Some(found.text());
            let cost = all.iter().find(|x| x.id() == "E14");
            costs = cost.map_or_else(Vec::new, |x| durations(&x.cells(), &seconds(&dir)));
        } else {
            let wanted = CLAIMS.iter().filter(|(id, _)| args.wants(id));
            let why = "the search for constants is not complete";
            study.reports.extend(wanted.map(|(id, claim)| Report::not_run(id, claim, why)));
        }
    }
    let chosen: Vec<&dyn Experiment> = learning.iter().copied().filter(|x| args.wants(x.id())).collect();
    study.run(&chosen)?;
    let mut reports = study.reports;
    reports.sort_by_key(|r| number(r.id));
    for r in &reports {
        let quoted = |row: &[String]| -> String {
            row.iter().map(|c| format!("\"{}\"", c.replace('"', "\"\""))).collect::<Vec<_>>().join(",")
        };
        let head: Vec<String> = r.head.iter().map(|h| h.trim_start_matches('>').to_owned()).collect();
        let lines: Vec<String> = std::iter::once(&head).chain(&r.rows).map(|row| quoted(row)).collect();
        let file = dir.join(format!("{}.csv", r.id));
        atomic::write_bytes(&file, format!("{}\n", lines.join("\n")).as_bytes())?;
    }
    let record = json!({
        "kind": "last study", "lastlight": env!("CARGO_PKG_VERSION"), "sizes": args.sizes_name(),
        "threads": par::threads(), "jobs": plan.jobs, "models": named, "constants": constants,
        "experiments": reports.iter().map(summary).collect::<Vec<_>>(), "seconds": meter.seconds(),
    });
    atomic::write_bytes(&dir.join(RECORD), format!("{record:#}\n").as_bytes())?;
    let page = page(args, &reports, &costs).write(&dir)?;
    if args.manner.json {
        return cli::say_json(&record);
    }
    if let Some(warning) = args.warning() {
        cli::say(warning)?;
    }
    for r in &reports {
        cli::say(&format!("{:11} {:9} {}", r.id, r.outcome.name(), r.verdict))?;
    }
    cli::say(&format!("report {}", page.display()))
}

/// Mean seconds of a fit by row.
fn durations(cells: &[Cell], seconds: &BTreeMap<String, f64>) -> Vec<(String, Summary)> {
    let mut rows: Vec<(String, Vec<f64>)> = Vec::new();
    for cell in cells {
        let Some(&s) = seconds.get(&cell.key) else { continue };
        match rows.iter_mut().find(|(row, _)| *row == cell.row) {
            Some((_, all)) => all.push(s),
            None => rows.push((cell.row.clone(), vec![s])),
        }
    }
    rows.into_iter().map(|(row, all)| (row, Summary::of(&all))).collect()
}

fn summary(r: &Report) -> Value {
    json!({
        "id": r.id, "claim": r.claim, "outcome": r.outcome.name(), "verdict": r.verdict, "head": r.head,
        "rows": r.rows,
    })
}

fn drawing(r: &Report) -> Markup {
    match &r.drawing {
        Drawing::Bars(rows) if rows.is_empty() => html! {},
        Drawing::Bars(rows) => {
            let decimals = if rows.iter().all(|(_, x)| x.abs() >= 100.0) { 0 } else { 2 };
            bars(r.chart[0], rows, 'a', decimals, 0.0, None)
        }
        Drawing::Intervals(rows) => {
            let rows: Vec<(String, f64, f64)> =
                rows.iter().map(|(name, s)| (name.clone(), s.mean, s.half_width)).collect();
            intervals(r.chart[0], &rows, 'a')
        }
        Drawing::Lines { curves, from_zero } => {
            let series = curves.iter().enumerate().map(|(i, c)| Series {
                name: &c.name,
                color: (b'a' + (i % 8) as u8) as char,
                points: c.points.iter().map(|p| (p.0, p.1)).collect(),
                band: Vec::new(),
            });
            let lines = Lines {
                title: r.chart[0],
                x_label: r.chart[1],
                log_y: false,
                from_zero: *from_zero,
                series: series.collect(),
                marks: Vec::new(),
            };
            lines.html()
        }
    }
}

fn page(args: &Args, reports: &[Report], costs: &[(String, Summary)]) -> Page {
    let section = |r: &Report| -> Section {
        // A row's name stays on one line.
        let text = |(i, cell): (usize, &String)| {
            report::text(if i == 0 { cell.replace(' ', "\u{a0}") } else { cell.clone() })
        };
        let rows: Vec<Vec<Markup>> =
            r.rows.iter().map(|row| row.iter().enumerate().map(text).collect()).collect();
        let seconds: Vec<Vec<Markup>> = costs
            .iter()
            .filter(|_| r.id == "E14")
            .map(|(row, s)| vec![report::text(row), report::text(format!("{s:.2}"))])
            .collect();
        Section {
            id: r.id,
            title: r.id,
            lead: format!("{} — {}: {}", r.claim, r.outcome.name(), r.verdict),
            body: html! {
                @if !r.head.is_empty() { (report::table(&r.head, &rows)) }
                div.two style="margin-top:16px;grid-template-columns:repeat(auto-fill,minmax(min(100%,460px),1fr))" {
                    (drawing(r))
                    @if !seconds.is_empty() { (report::table(&["fit on this machine", ">seconds"], &seconds)) }
                }
            },
        }
    };
    let count = |wanted: Outcome| reports.iter().filter(|r| r.outcome == wanted).count().to_string();
    let stat = |wanted: Outcome, note: &str| Stat {
        label: wanted.name(),
        value: count(wanted),
        note: note.to_owned(),
    };
    Page {
        kind: "last study".into(),
        title: args.warning().unwrap_or("experiments").into(),
        command: cli::command_line(),
        facts: Vec::new(),
        stats: vec![
            stat(Outcome::Holds, "what counts as reproduced came out"),
            stat(Outcome::Fails, "it did not"),
            stat(Outcome::Reported, "without a criterion"),
            stat(Outcome::NotRun, "something is missing"),
        ],
        sections: reports.iter().map(section).collect(),
    }
}
