//! Where the method fails: mirrors and fine lettering (Fig. 15).
//!
//! Mirrors are pixels with roughness at most 0.25 and metallic at least 0.5 under a map, in the smoother
//! version of the objects. A score of mirrors, and of the rest of the same images, is the dB of an object's mean
//! squared error over all images that show enough of both. Mirrors may have more contrast than the rest, so the
//! nearest input is scored on the same pixels.
//!
//! Detail is the sum of squared differences between neighbouring pixels of a row inside the foreground, of the
//! render divided by that of the truth: 1 for an image as sharp as the truth, 0 for a plain one; it is measured
//! on packages and tins, which are printed. A model that reads images of 64² cannot show all of it, and the noise
//! of the truth counts as its detail: beside it is the truth as such a model reads it, reduced and enlarged again.

use super::setup::{SEED, Setup, decibels, is_complete, shown, square_error};
use crate::Result;
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Summary, Values, of};
use crate::fit::field::scores::FEWEST;
use crate::fit::field::targets::target;
use crate::fit::field::{Target, view};
use crate::fit::training::Watch;
use crate::num::order;
use data_gen::{cameras, objects};
use lastlight_lirm::baselines::nearest;
use lastlight_lirm::evaluate::SET;
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::reading::INPUT_SIDE;
use lastlight_lirm::views::View;
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

/// A square image (H, W, 3) with `factor` times as many pixels per side: bilinear between the centres of pixels,
/// constant beyond the outer ones.
fn enlarged(small: &[f32], side: usize, factor: usize) -> Vec<f32> {
    // The two pixels beside a coordinate, and the part of the second.
    let between = |x: usize| {
        let x = order::clamp((x as f32 + 0.5) / factor as f32 - 0.5, 0.0, (side - 1) as f32);
        (x as usize, Ord::min(x as usize + 1, side - 1), x.fract())
    };
    let at = |y: usize, x: usize, c: usize| {
        let ((above, below, v), (left, right, u)) = (between(y), between(x));
        let along = |y: usize| {
            let of = |x: usize| small[(y * side + x) * 3 + c];
            of(left) + u * (of(right) - of(left))
        };
        along(above) + v * (along(below) - along(above))
    };
    let width = factor * side;
    (0..width * width * 3).map(|i| at(i / 3 / width, i / 3 % width, i % 3)).collect()
}

/// Values of a model and of the nearest input: mirrors, and the rest of the same images.
const SCORES: [[&str; 2]; 2] = [["mirror_db", "other_db"], ["nearest_mirror_db", "nearest_other_db"]];

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
        let inputs = cameras::test(SEED, k, p.set.size).inputs;
        let inputs: Vec<&View> = inputs.iter().take(SET * SETS).map(|i| &views.all[*i]).collect();
        let factor = p.set.size / INPUT_SIDE;
        let small = views.small(factor)?;
        let mut errors = [(); 2].map(|()| [(); 2].map(|()| Vec::new()));
        let [mut details, mut ceilings] = [(); 2].map(|()| Vec::new());
        for i in cameras::test(SEED, k, p.set.size).outputs.into_iter().take(self.setup.size.outputs) {
            let truth = target(&views.all[i].picture, &at);
            let image = view::render(&field, Some(&cells), &truth.camera, false).color().unwrap_or_default();
            let covered = (0..truth.foreground.len()).filter(|i| truth.foreground[*i] == 1.0);
            let is_mirror = |i: &usize| {
                let of = |m: &Vec<f32>| m[2 * i] <= MIRROR[0] && m[2 * i + 1] >= MIRROR[1];
                truth.material.as_ref().is_some_and(of)
            };
            let (mirror, other): (Vec<usize>, Vec<usize>) = covered.partition(is_mirror);
            if Ord::min(mirror.len(), other.len()) >= FEWEST {
                let shown = &nearest(&inputs, &views.all[i].picture.camera).picture.color;
                for (errors, image) in errors.iter_mut().zip([&image, shown]) {
                    for (errors, pixels) in errors.iter_mut().zip([&mirror, &other]) {
                        errors.extend(square_error(image, &truth.color, pixels));
                    }
                }
            }
            let whole = detail(&truth.color, &truth);
            if whole > 0.0 {
                details.push(detail(&image, &truth) / whole);
                ceilings
                    .push(detail(&enlarged(&small.all[i].picture.color, INPUT_SIDE, factor), &truth) / whole);
            }
        }
        watch.lap("scores");
        let mut out = Values::new();
        if version.is_shiny() {
            let named = SCORES.as_flattened().iter().zip(errors.as_flattened());
            let seen = named.filter(|(_, x)| !x.is_empty());
            out.extend(seen.map(|(name, x)| ((*name).to_owned(), decibels(Summary::of(x).mean))));
        } else if !details.is_empty() {
            out.insert("detail".into(), Summary::of(&details).mean);
            out.insert("ceiling".into(), Summary::of(&ceilings).mean);
        }
        Ok(out)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let of = |name: &str| of(results, if name.ends_with("_db") { "mirrors" } else { "lettering" }, name);
        // What mirrors cost, the model and the nearest input.
        let [cost, nearest] = SCORES.map(|[mirror, other]| Summary::of_pairs(&of(other), &of(mirror)));
        let (details, ceilings) = (of("detail"), of("ceiling"));
        let share: Vec<f64> = details.iter().zip(&ceilings).map(|(detail, most)| detail / most).collect();
        let share = Summary::of(&share);
        let line = |what: &str, s: &Summary| vec![what.to_owned(), shown(s, 2)];
        Report {
            id: "limits",
            claim: "Mirrors and fine lettering are not reconstructed (Fig. 15): mirrors score below the rest of the same images, and renders of printed objects have less than half of the detail that images of 64² show.",
            head: vec!["measure", ">value"],
            rows: vec![
                line("mirrors, dB", &Summary::of(&of(SCORES[0][0]))),
                line("rest of the same images, dB", &Summary::of(&of(SCORES[0][1]))),
                line("mirrors, nearest input, dB", &Summary::of(&of(SCORES[1][0]))),
                line("rest, nearest input, dB", &Summary::of(&of(SCORES[1][1]))),
                line("detail of printed objects, render / truth", &Summary::of(&details)),
                line("detail of the truth as a model reads it / truth", &Summary::of(&ceilings)),
            ],
            chart_labels: ["rest − mirrors, dB", ""],
            chart: Chart::Intervals(vec![("model".into(), cost), ("nearest input".into(), nearest)]),
            outcome: Outcome::of(
                (is_complete(self, results) && share.count > 0 && cost.count > 1)
                    .then(|| share.mean < 0.5 && cost.is_positive()),
            ),
            verdict: format!(
                "Mirrors cost {} dB (objects with mirrors: {}), the nearest input {}; renders have {} of the detail that images of 64² show.",
                shown(&cost, 2),
                cost.count,
                shown(&nearest, 2),
                shown(&share, 2)
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_enlarged_to_a_slope() {
        let small: Vec<f32> = (0..4 * 4 * 3).map(|i| (i / 3 % 4) as f32 + (i % 3) as f32).collect();
        let large = enlarged(&small, 4, 2);
        let row: Vec<f32> = (0..8).map(|x| large[(5 * 8 + x) * 3 + 1]).collect();
        assert_eq!(row, [1.0, 1.25, 1.75, 2.25, 2.75, 3.25, 3.75, 4.0]);
        assert_eq!(enlarged(&small, 4, 1), small, "as large as before");
    }
}
