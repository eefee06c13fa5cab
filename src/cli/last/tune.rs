//! `last tune`: the structure of a model, fine-tuned on one subject.

use crate::Result;
use crate::claim;
use crate::console as cli;
use crate::fit::training::Watch;
use crate::meter::Meter;
use crate::scene::person::PersonCapture;
use crate::shared::ForceArgs;
use crate::training;
use lastlight_last::model::file::Trained;
use lastlight_last::model::tune::{Settings, Subject, Tuning};
use serde_json::json;
use std::path::PathBuf;

/// Fine-tune a model's structure on the training images of one person.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last tune model/model.safetensors subject/video --out tuned.safetensors

Encoder, decoder and the networks of the nodes stay; the logits of the edges move for 500 iterations, with a penalty of 0.1 times the squared change of each probability. The table shows the edges before and after.")]
pub(crate) struct Args {
    /// Model written by last pretrain, or its folder
    #[arg(value_name = "FILE")]
    model: PathBuf,
    /// Capture of the person
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// File for the tuned model
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Iterations
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    iterations: u32,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    replace: ForceArgs,
}

/// Edges as text: `0>1 0>2`, or `none`.
pub(crate) fn edges(edges: &[(usize, usize)]) -> String {
    let all: Vec<String> = edges.iter().map(|(i, j)| format!("{i}>{j}")).collect();
    if all.is_empty() { "none".into() } else { all.join(" ") }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new().of("edges");
    claim::file(&args.out, args.replace.force)?;
    let mut trained = Trained::of_pictures(&args.model)?;
    let capture = PersonCapture::open(&args.capture)?;
    super::fit::check_skeleton(&trained, &capture, &meter)?;
    let subject = Subject::new(&trained, &capture)?;
    meter.lap("images");
    let settings = Settings { steps: args.iterations, seed: args.seed, ..Settings::default() };
    let mut tuning = Tuning::new(&mut trained, &subject, settings)?;
    training::run_whole(&mut tuning, &mut meter)?;
    let tuned = tuning.finish();
    meter.lap("tuning");
    trained.write(&args.out)?;
    super::graph_note::note_empty_graph(&trained, &meter);
    let n = trained.model.sizes.factors;
    if cli::is_json() {
        return cli::say_json(&json!({
            "kind": "last tune", "lastlight": env!("CARGO_PKG_VERSION"), "digest": trained.digest()?,
            "images": capture.train.len(), "before": tuned.before, "after": tuned.after,
            "edges_before": tuned.edges[0], "edges_after": tuned.edges[1], "losses": tuned.losses,
            "seconds": meter.seconds(),
        }));
    }
    for i in 0..n {
        let row = |p: &[f64]| -> String { (0..n).map(|j| format!(" {:.3}", p[i * n + j])).collect() };
        cli::say(&format!("from {i}    {}   →  {}", row(&tuned.before), row(&tuned.after)))?;
    }
    cli::say(&format!("edges       {} → {}", edges(&tuned.edges[0]), edges(&tuned.edges[1])))?;
    cli::say(&format!("loss        {:.4} → {:.4}", tuned.losses[0], tuned.losses[1]))?;
    cli::say(&format!("digest      {}", trained.digest()?))?;
    cli::say(&format!("model       {}", args.out.display()))
}
