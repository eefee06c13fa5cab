//! `last study`: the experiments of LAST, one table and one chart each.

use crate::choices::{Choices, choices};
use crate::claim;
use crate::experiment::{Experiment, Report, RunOptions};
use crate::experiments::{self as engine, Study};
use crate::meter::Meter;
use crate::num::par;
use crate::shared::{ForceArgs, MetricArgs};
use crate::{Error, Result};
use lastlight_last::model::file::Trained;
use lastlight_last::model::shipped;
use lastlight_study::last::images::{self, StructureFromImages};
use lastlight_study::last::learn::{self, Learning};
use lastlight_study::last::person::constants::{Calibration, Constants, Search};
use lastlight_study::last::person::experiments::{self, CLAIMS};
use lastlight_study::last::person::setup::{self, Model, Setup};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Graph of the data of the model that comes with the program.
const SHIPPED: &str = "FORK";
/// The experiment that shows what a fit costs.
const COST: &str = "E14";
/// What the constants are found by.
const FOUND_BY: [(&str, &str); 2] = [
    ("calibration", "c_τ makes τ_rec a number without a scale."),
    ("search", "The strongest honest setting: constants found on subject 0, evaluated on others."),
];

/// The experiments; `calibration` and `search` find constants and run before those with persons.
const EXPERIMENTS: &Choices = &[
    ("E1", "full system against the unguided fit"),
    ("E2", "ablations"),
    ("E3", "wrong structures"),
    ("E4", "number of factors"),
    ("E5", "threshold of the latent criterion, τ_rec"),
    ("E6", "where the latent criterion adds Gaussians"),
    ("E7", "bound of the update of child factors, λ"),
    ("E8", "order of the updates"),
    ("E9", "tuning of the structure on the subject"),
    ("E10", "structure recovery from known factors"),
    ("E10p", "structure recovery from images"),
    ("E11", "the spurious edge of a fork"),
    ("E12", "independence penalty"),
    ("E13", "errors of child factors"),
    ("E14", "cost of a fit"),
    ("E15", "latent factors in the loss"),
    ("calibration", "scale of the latent criterion, c_τ"),
    ("search", "constants found on a subject that is in no experiment"),
];

/// Commands beside the study itself.
#[derive(clap::Subcommand)]
enum Command {
    /// List the experiments
    #[command(after_help = "Examples:
  lastlight last study list
  lastlight last study list --json")]
    List,
}

/// Run the experiments of LAST: the paper's claims against measurements.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last study --out study                       all experiments; hours
  lastlight last study --out study --resume              continue an interrupted study
  lastlight last study E10 --out trial --scale quick      small sizes, few seeds
  lastlight last study E1 --out study --graph-model FORK=a.safetensors,FULL=b.safetensors

`last study list` lists the experiments. E10p keeps its models in models/. Experiments with persons need a model trained on `last gen --graph GRAPH` with its default seed: the built-in one, or those of --graph-model (experiments with one model use the first). Before them, the scale of the latent criterion and the constants are searched on a subject that is in no experiment (calibration, search). Every cell (one training or fit) is a file in --out; reports are made from these files. Written to --out: study.json, one CSV per experiment and report/index.html.")]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    /// Experiments, as listed by `last study list` [default: all]
    #[arg(value_name = "ID", value_parser = choices(EXPERIMENTS))]
    ids: Vec<String>,
    /// Folder for results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR", required = true)]
    out: Option<PathBuf>,
    /// Image-to-point model of last pretrain and the graph of its data, comma-separated or repeated [default: FORK and the built-in model]
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',')]
    graph_model: Vec<String>,
    /// Use the default hyper-parameters
    #[arg(long)]
    no_search: bool,
    /// Sizes and numbers of seeds
    #[arg(long, value_name = "NAME", default_value = "full", value_parser = choices(engine::SCALES))]
    scale: String,
    /// Number of cells run at the same time; results do not depend on it [default: number of threads]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Continue an interrupted study
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Rebuild the report from existing results; implies --resume
    #[arg(long, conflicts_with = "force")]
    report_only: bool,
    #[command(flatten)]
    perception: MetricArgs,
    #[command(flatten)]
    replace: ForceArgs,
}

impl Args {
    fn sizes(&self) -> (learn::Size, images::Size, setup::Size) {
        match self.scale.as_str() {
            "quick" => (learn::Size::quick(), images::Size::quick(), setup::Size::quick()),
            "smoke" => (learn::Size::smoke(), images::Size::smoke(), setup::Size::smoke()),
            _ => (learn::Size::full(), images::Size::full(), setup::Size::full()),
        }
    }

    fn wants(&self, id: &str) -> bool {
        self.ids.is_empty() || self.ids.iter().any(|x| x == id)
    }

    fn models(&self) -> Result<Vec<Model>> {
        let mut models: Vec<Model> = Vec::new();
        for text in &self.graph_model {
            let wrong =
                |got: &str| Error::input("--graph-model").expected("GRAPH=FILE, one for each graph").got(got);
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

/// The constants of the guided fit; none while results are missing.
fn constants_of(study: &mut Study<'_>, setup: &Setup, published: bool) -> Result<Option<Constants>> {
    let calibration = Calibration { setup };
    let results = study.run(&[&calibration])?.remove(0);
    let Some(scales) = calibration.found(&results) else { return Ok(None) };
    if published {
        return Ok(Some(Constants::published(scales)));
    }
    let search = Search::new(setup, scales)?;
    let results = study.run(&[&search])?.remove(0);
    Ok(search.found(&results))
}

/// Of `E7`, 7; what comes before the experiments is 0.
fn number(id: &str) -> u32 {
    id.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap_or(0)
}

pub(super) fn run(args: &Args) -> Result<()> {
    match (&args.command, &args.out) {
        (None, Some(out)) => study(args, out),
        _ => engine::list(EXPERIMENTS),
    }
}

fn study(args: &Args, out: &Path) -> Result<()> {
    let mut meter = Meter::new();
    let (vectors, seen, persons) = args.sizes();
    let of_vectors: [Learning; 4] =
        [learn::number, learn::correct, learn::spurious, learn::dependence].map(|make| make(vectors));
    let of_pictures = StructureFromImages::new(seen, out);
    let learning: Vec<&dyn Experiment> =
        of_vectors.iter().map(|x| x as &dyn Experiment).chain([&of_pictures as &dyn Experiment]).collect();
    let guided: Vec<&str> = FOUND_BY.iter().chain(&CLAIMS).map(|(id, _)| *id).collect();
    let models = args.models()?;
    let with_persons = guided.iter().any(|id| args.wants(id));
    let perception = if with_persons { args.perception.load()? } else { None };
    let perception = perception.map(|metric| metric.digest().map(|d| (metric, d))).transpose()?;
    let resume = args.resume || args.report_only;
    let dir = claim::folder(out, resume, args.replace.force)?;
    if resume {
        engine::resumed(&dir, &args.scale)?;
    }
    let named = models.iter().map(|m| json!({ "graph": m.graph, "digest": m.digest })).collect::<Vec<_>>();
    let options = RunOptions {
        command: "last study",
        report_only: args.report_only,
        jobs: args.jobs.map_or_else(par::threads, usize::from),
    };
    let mut study = Study { dir: dir.clone(), options, meter: &mut meter, reports: Vec::new() };
    let mut constants = None;
    let mut costs = Vec::new();
    if with_persons {
        // Constants are found without LPIPS, whose weights make no difference to them.
        let mut setup = Setup { size: persons, models, dir: dir.clone(), perception: None };
        if let Some(found) = constants_of(&mut study, &setup, args.no_search)? {
            setup.perception = perception;
            let all = experiments::all(&setup, &found)?;
            let chosen: Vec<&dyn Experiment> =
                all.iter().filter(|x| args.wants(x.id())).map(|x| x as &dyn Experiment).collect();
            study.run(&chosen)?;
            constants = Some(found.text());
            let cost = all.iter().find(|x| x.id() == COST);
            costs.extend(cost.map(|x| (COST, engine::durations(&dir, x.folder(), &x.cells()))));
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
    let own = json!({ "jobs": options.jobs, "models": named, "constants": constants });
    let finished = engine::Finished {
        kind: "last study",
        title: "Experiments of LAST",
        dir: &dir,
        scale: &args.scale,
        reports: &reports,
        costs: &costs,
        own: own.as_object().cloned().unwrap_or_default(),
        seconds: meter.seconds(),
    };
    finished.publish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_listed_experiments_are_those_that_can_run() {
        let learning: [Learning; 4] = [learn::number, learn::correct, learn::spurious, learn::dependence]
            .map(|make| make(learn::Size::smoke()));
        let of_images = StructureFromImages::new(images::Size::smoke(), Path::new("out"));
        let mut ids: Vec<&str> = learning.iter().map(Experiment::id).collect();
        ids.push(of_images.id());
        ids.extend(FOUND_BY.iter().chain(&CLAIMS).map(|(id, _)| *id));
        ids.sort_unstable();
        let mut listed: Vec<&str> = EXPERIMENTS.iter().map(|(id, _)| *id).collect();
        listed.sort_unstable();
        assert_eq!(listed, ids, "a line for each, and no other");
    }
}
