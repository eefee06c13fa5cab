//! Where the method fails: mirrors and fine lettering (Fig. 15).
//!
//! Mirrors are pixels with roughness at most 0.25 and metallic at least 0.5 under a map, in the smoother
//! version of the objects. Detail is the sum of squared differences between neighbouring pixels of a row
//! inside the foreground, of the render divided by that of the truth: 1 for an image as sharp as the truth, 0
//! for a plain one; it is measured on packages and tins, which are printed. The noise of the truth counts as
//! detail of it: a render without noise has a little less than 1 at best. A score of mirrors, and of the rest
//! beside it, is the dB of an object's mean squared error over all images, as few images show many such
//! pixels.

use super::setup::{SEED, Setup, decibels, is_complete, shown, square_error};
use crate::Result;
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Summary, Values, of};
use crate::fit::field::scores::FEWEST;
use crate::fit::field::targets::target;
use crate::fit::field::{Target, view};
use crate::fit::training::Watch;
use data_gen::{cameras, objects};
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::weights::Ready;
use serde_json::Value;
use std::sync::atomic::AtomicBool;

/// Generators of printed objects.
const PRINTED: [&str; 2] = ["package", "tin"];
/// Objects of a kind.
const EACH: u64 = 4;
/// Sets that are read.
const SETS: usize = 4;
/// Largest roughness and smallest metallic of a mirror: a choice, as the paper shows mirrors without a number.
const MIRROR: [f32; 2] = [0.25, 0.5];

/// The experiment.
#[derive(Debug)]
pub struct Limits<'a> {
    setup: &'a Setup,
    /// Version and number of every object.
    objects: Vec<(Version, u64)>,
}

/// Makes the experiment.
pub fn limits(setup: &Setup) -> Limits<'_> {
    let mirrors = (0..setup.size.objects).map(|k| (Version::Shiny, k));
    let lettering = printed(Ord::min(EACH, setup.size.objects)).into_iter().map(|k| (Version::Uniform, k));
    Limits { setup, objects: mirrors.chain(lettering).collect() }
}

/// The numbers of the first printed objects of the test seed.
fn printed(count: u64) -> Vec<u64> {
    let is_printed = |k: &u64| PRINTED.contains(&objects::build(SEED, *k, 32).generator);
    (0..).filter(is_printed).take(count as usize).collect()
}

/// Squared differences between neighbours of one row that are both covered.
fn detail(image: &[f32], truth: &Target) -> f64 {
    let width = truth.camera.width;
    let pairs = (0..truth.foreground.len()).filter(|i| i % width + 1 < width);
    let covered = pairs.filter(|i| truth.foreground[*i] == 1.0 && truth.foreground[i + 1] == 1.0);
    covered.fold(0.0, |sum, i| {
        (0..3).fold(sum, |sum, c| {
            let d = f64::from(image[3 * i + c]) - f64::from(image[3 * (i + 1) + c]);
            sum + d * d
        })
    })
}

impl Experiment for Limits<'_> {
    fn id(&self) -> &'static str {
        "limits"
    }

    fn cells(&self) -> Vec<Cell> {
        let cell = |(version, k): &(Version, u64)| Cell {
            key: format!("{}_{k:03}", version.name()),
            row: if version.is_shiny() { "mirrors".into() } else { "lettering".into() },
            seed: *k,
        };
        self.objects.iter().map(cell).collect()
    }

    fn settings(&self, _: usize) -> Value {
        self.setup.record(self.setup.model())
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let ((version, k), model) = (self.objects[cell], self.setup.model());
        let views = self.setup.object(k, version)?;
        watch.lap("images");
        let p = self.setup.protocol(model, version);
        let ready = Ready::new(model.config, &model.params);
        let (state, at) = self.setup.read(&ready, &views, k, SETS)?;
        let field = ready.decode(&state, p.rendering, at);
        let cells = view::occupancy(&field)?;
        let [mut mirrors, mut others, mut details] = [(); 3].map(|()| Vec::new());
        for i in cameras::test(SEED, k, p.set.size).outputs.into_iter().take(self.setup.size.outputs) {
            let truth = target(&views.all[i].picture, &at);
            let image = view::render(&field, Some(&cells), &truth.camera, false).color().unwrap_or_default();
            let covered = (0..truth.foreground.len()).filter(|i| truth.foreground[*i] == 1.0);
            let is_mirror = |i: &usize| {
                let of = |m: &Vec<f32>| m[2 * i] <= MIRROR[0] && m[2 * i + 1] >= MIRROR[1];
                truth.material.as_ref().is_some_and(of)
            };
            let (mirror, other): (Vec<usize>, Vec<usize>) = covered.partition(is_mirror);
            let error = |pixels: &[usize]| {
                square_error(&image, &truth.color, pixels).filter(|_| pixels.len() >= FEWEST)
            };
            mirrors.extend(error(&mirror));
            others.extend(error(&other));
            let whole = detail(&truth.color, &truth);
            details.extend((whole > 0.0).then(|| detail(&image, &truth) / whole));
        }
        watch.lap("scores");
        let mut out = Values::new();
        if version.is_shiny() {
            let both = [("mirror_db", &mirrors), ("other_db", &others)];
            out.extend(
                both.into_iter()
                    .filter(|(_, x)| !x.is_empty())
                    .map(|(name, x)| (name.to_owned(), decibels(Summary::of(x).mean))),
            );
        }
        if !details.is_empty() {
            out.insert("detail".into(), Summary::of(&details).mean);
        }
        Ok(out)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        // Objects that have both.
        let pairs: Vec<(f64, f64)> =
            results.iter().filter_map(|(_, v)| Some((*v.get("mirror_db")?, *v.get("other_db")?))).collect();
        let (mirrors, others): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
        let loss = Summary::of_pairs(&mirrors, &others);
        let detail = Summary::of(&of(results, "lettering", "detail"));
        let line = |what: &str, s: &Summary| vec![what.to_owned(), shown(s, 2)];
        Report {
            id: "limits",
            claim: "Mirrors and fine lettering are not reconstructed (Fig. 15): mirrors score below the rest of the same objects, and renders of printed objects have less than half of the detail.",
            head: vec!["measure", ">value"],
            rows: vec![
                line("mirrors, dB", &Summary::of(&mirrors)),
                line("rest of the same objects, dB", &Summary::of(&others)),
                line("detail of printed objects, render / truth", &detail),
            ],
            chart_labels: ["mirrors − rest, dB", ""],
            chart: Chart::Intervals(vec![("objects with mirrors".into(), loss)]),
            outcome: Outcome::of(
                (is_complete(self, results) && detail.count > 0 && loss.count > 0)
                    .then_some(detail.mean < 0.5 && loss.mean < 0.0),
            ),
            verdict: format!("Mirrors {} dB beside the rest; detail {}.", shown(&loss, 2), shown(&detail, 2)),
        }
    }
}
