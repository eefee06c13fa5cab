//! `lirm study`: the experiments of LIRM, one table and one chart each.

use super::weights;
use crate::Result;
use crate::choices::{Choices, choices};
use crate::claim;
use crate::experiment::{Experiment, RunOptions};
use crate::experiments::{self as engine, Study};
use crate::io::memory;
use crate::meter::Meter;
use crate::shared::ForceArgs;
use lastlight_lirm::model::file::digest;
use lastlight_study::lirm::setup::{NamedModel, Setup, Size};
use lastlight_study::lirm::{curve, limits, occupancy, relit, samples, scenes, scoring, variants};
use serde_json::{Map, json};
use std::path::{Path, PathBuf};

/// The experiments that show what a render costs.
const COSTS: [&str; 2] = ["occupancy", "samples"];

/// The experiments.
const EXPERIMENTS: &Choices = &[
    ("stages", "every model after four sets"),
    ("curve", "scores over the training, and what twice as much would add; from the results of stages"),
    ("rounds", "random and sequential order of the inputs, beside nearest input and visual hull"),
    ("controls", "state zeroed, cameras permuted, another object"),
    ("added", "an object that is added between two sets"),
    ("head", "a head-mounted camera through a fisheye and a pinhole"),
    ("materials", "albedo, roughness and metallic beside means and medians of training objects"),
    ("relit", "meshes of reconstructions under another light, beside the truth"),
    ("limits", "mirrors and fine lettering"),
    ("occupancy", "samples that a grid saves"),
    ("samples", "scores and seconds of a render over the samples of a ray"),
    ("variants", "planes, directional embedding and updates: five trainings"),
];

/// Commands beside the study itself.
#[derive(clap::Subcommand)]
enum Command {
    /// List the experiments
    #[command(after_help = "Examples:
  lastlight lirm study list
  lastlight lirm study list --json")]
    List,
}

/// Run the experiments of LIRM: the paper's claims against measurements.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm study --out study                                all experiments; hours
  lastlight lirm study --model s1c,s2b,s3 --out study             with a curve over the training; the last model is scored
  lastlight lirm study rounds controls --out trial --scale quick
  lastlight lirm study --out study --resume                       continue an interrupted study

`lirm study list` lists the experiments. Objects are those of seed 2; models are trained with seed 0, one of the variants with seed 3. Variants trains five small models of 1 250 steps each: hours on two cores. Every cell (a model and an object, or a training) is a file in --out; reports are made from these files. Written to --out: study.json, one CSV per experiment, the trainings of variants and report/index.html.")]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    /// Experiments, as listed by `lirm study list` [default: all]
    #[arg(value_name = "ID", value_parser = choices(EXPERIMENTS))]
    ids: Vec<String>,
    /// Models, or the folders of their trainings, comma-separated or repeated; the last is scored [default: the included model]
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    model: Vec<PathBuf>,
    /// Folder for results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR", required = true)]
    out: Option<PathBuf>,
    /// Sizes and numbers of objects
    #[arg(long, value_name = "NAME", default_value = "full", value_parser = choices(engine::SCALES))]
    scale: String,
    /// Continue an interrupted study
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Rebuild the report from existing results; implies --resume
    #[arg(long, conflicts_with = "force")]
    report_only: bool,
    #[command(flatten)]
    replace: ForceArgs,
}

impl Args {
    fn size(&self) -> Size {
        match self.scale.as_str() {
            "quick" => Size::quick(),
            "smoke" => Size::smoke(),
            _ => Size::full(),
        }
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    match (&args.command, &args.out) {
        (None, Some(out)) => study(args, out),
        _ => engine::list(EXPERIMENTS),
    }
}

/// All experiments, in the order of the list.
fn all<'a>(setup: &'a Setup, dir: &Path) -> Vec<Box<dyn Experiment + 'a>> {
    vec![
        Box::new(scoring::stages(setup)),
        Box::new(curve::curve(setup)),
        Box::new(scoring::rounds(setup)),
        Box::new(scoring::controls(setup)),
        Box::new(scenes::added(setup)),
        Box::new(scenes::head(setup)),
        Box::new(scoring::materials(setup)),
        Box::new(relit::relit(setup)),
        Box::new(limits::limits(setup)),
        Box::new(occupancy::occupied(setup)),
        Box::new(samples::samples(setup)),
        Box::new(variants::variants(setup, dir)),
    ]
}

fn study(args: &Args, out: &Path) -> Result<()> {
    let mut meter = Meter::new();
    let given: Vec<_> = args.model.iter().map(|path| Some(path.as_path())).collect();
    let given = if given.is_empty() { vec![None] } else { given };
    let models = given
        .into_iter()
        .map(|path| Ok(NamedModel::new(weights::model(path, &meter)?.0)))
        .collect::<Result<_>>()?;
    let setup = Setup::new(args.size(), models)?;
    if !args.report_only {
        let needs_training = args.ids.is_empty() || args.ids.iter().any(|id| id == variants::ID);
        let training = if needs_training { variants::memory(&setup)? } else { 0 };
        memory::check("lirm study", setup.memory() + training).map_err(|e| match needs_training {
            true => e.hint("variants needs most; leave it out: lirm study stages rounds controls --out DIR"),
            false => e,
        })?;
    }
    let resume = args.resume || args.report_only;
    let dir = claim::folder(out, resume, args.replace.force)?;
    let earlier = if resume { engine::resumed(&dir, &args.scale)? } else { Vec::new() };
    // A cell uses all threads: several would only share the images of an object.
    let options = RunOptions { command: "lirm study", report_only: args.report_only, jobs: 1 };
    let mut study = Study { dir: dir.clone(), options, meter: &mut meter, reports: Vec::new() };
    let experiments = all(&setup, &dir);
    let is_named = |x: &dyn Experiment| args.ids.is_empty() || args.ids.iter().any(|id| id == x.id());
    // Those of an earlier command stay in the report.
    let is_kept = |x: &dyn Experiment| earlier.iter().any(|id| id == x.id());
    let every = || experiments.iter().map(|x| &**x);
    let named: Vec<&dyn Experiment> = every().filter(|x| is_named(*x)).collect();
    let kept: Vec<&dyn Experiment> = every().filter(|x| !is_named(*x) && is_kept(*x)).collect();
    let mut results = study.run(&named)?;
    study.options.report_only = true;
    results.extend(study.run(&kept)?);
    let mut made: Vec<_> = named.into_iter().chain(kept).zip(results).zip(study.reports).collect();
    made.sort_by_key(|((x, _), _)| every().position(|y| y.id() == x.id()));
    let (found, mut reports): (Vec<_>, Vec<_>) = made.into_iter().unzip();
    let (chosen, results): (Vec<&dyn Experiment>, Vec<_>) = found.into_iter().unzip();
    let mut costs = Vec::new();
    for (i, x) in chosen.iter().enumerate().filter(|(_, x)| COSTS.contains(&x.id())) {
        let seconds = engine::durations(&dir, x.folder(), &x.cells());
        if x.id() == COSTS[0] {
            occupancy::occupied(&setup).judge(&mut reports[i], &results[i], &seconds);
        } else if let Some(chart) = samples::over_time(&results[i], &seconds) {
            reports[i].chart = chart;
            reports[i].chart_labels[1] = "seconds of an image";
        }
        costs.push((x.id(), seconds));
    }
    let named = setup.models.iter().map(|m| json!({ "name": m.name, "digest": digest(&m.model.params) }));
    let own = Map::from_iter([("models".to_owned(), named.collect())]);
    let finished = engine::Finished {
        kind: "lirm study",
        title: "Experiments of LIRM",
        dir: &dir,
        scale: &args.scale,
        reports: &reports,
        costs: &costs,
        own,
        seconds: meter.seconds(),
    };
    finished.publish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lastlight_lirm::model::config::Config;
    use lastlight_lirm::model::file::Model;
    use lastlight_lirm::model::params::first;

    #[test]
    fn the_listed_experiments_are_those_that_can_run() {
        let config =
            Config { blocks: 1, width: 16, heads: 2, plane_tokens: 1, embed_tokens: 1, ..Config::SMALL };
        let model = Model { config, params: first(&config, 0), training: Vec::new() };
        let setup = Setup::new(Size::smoke(), vec![NamedModel::new(model)]).expect("a model");
        let ids: Vec<&str> = all(&setup, Path::new("out")).iter().map(|x| x.id()).collect();
        let listed: Vec<&str> = EXPERIMENTS.iter().map(|(id, _)| *id).collect();
        assert_eq!(listed, ids, "a line for each, and no other");
    }
}
