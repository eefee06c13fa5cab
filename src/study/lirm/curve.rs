//! Scores over the training: object-rounds, and what twice as many would add.
//!
//! An object-round is an object of a step that reads one set of images ([`object_rounds`]). Between a model
//! with n₁ of them and one with n₂ > n₁, the score rises by (s₂ − s₁) / log₂(n₂/n₁) per doubling; if that
//! slope stays, twice the training of the second adds as much. Stages also change the light, the sharpness
//! and the rate, and the rate falls to its end in each: the slope is that of the schedule, not of one
//! setting.

use super::scoring::{Scoring, mean, stages};
use super::setup::{Setup, shown};
use crate::experiment::{Cell, Chart, Curve, Outcome, Report, Summary, Values, differences};
use crate::num::elem::f64 as elem;
use lastlight_lirm::train::stage::object_rounds;

/// Object-rounds of one unit of the chart.
const THOUSAND: f64 = 1e3;
/// Sets that have a curve.
const SETS: [usize; 3] = [1, 2, 4];

/// Makes the experiment; its results are those of [`stages`].
pub fn curve(setup: &Setup) -> Scoring<'_> {
    Scoring { id: "curve", report: of_curve, ..stages(setup) }
}

/// Name of a score after a set.
fn score(set: usize) -> String {
    format!("psnr_db_{set}")
}

/// The gain in dB per doubling from one row to another with `factor` times the object-rounds, paired by
/// object.
fn per_doubling(results: &[(Cell, Values)], [from, to]: [&str; 2], factor: f64, set: usize) -> Summary {
    let doublings = elem::log10(factor) / elem::log10(2.0);
    Summary::of(
        &differences(results, [to, from], &score(set)).iter().map(|d| d / doublings).collect::<Vec<_>>(),
    )
}

fn of_curve(x: &Scoring<'_>, results: &[(Cell, Values)]) -> Report {
    // Models of unknown stages have no place on the axis.
    let mut models: Vec<(&str, f64)> = x
        .setup
        .models
        .iter()
        .filter_map(|m| Some((m.name.as_str(), object_rounds(&m.model.training).ok()?)))
        .filter(|(name, _)| mean(results, name, &score(1)).count > 0)
        .collect();
    models.sort_by(|a, b| a.1.total_cmp(&b.1));
    let slope = |i: usize, set: usize| -> Option<Summary> {
        let [(from, few), (to, many)] = [*models.get(i.checked_sub(1)?)?, *models.get(i)?];
        (few > 0.0 && many > few).then(|| per_doubling(results, [from, to], many / few, set))
    };
    let row = |(i, (name, count)): (usize, &(&str, f64))| {
        let scores = SETS.map(|set| shown(&mean(results, name, &score(set)), 2));
        let slopes = [1, 2].map(|set| slope(i, set).map_or_else(|| "–".to_owned(), |s| shown(&s, 2)));
        [(*name).to_owned(), format!("{:.1}", count / THOUSAND)]
            .into_iter()
            .chain(scores)
            .chain(slopes)
            .collect()
    };
    let line = |set: usize| Curve {
        name: format!("{} images", 4 * set),
        points: models
            .iter()
            .map(|(name, count)| (count / THOUSAND, mean(results, name, &score(set))))
            .map(|(count, s)| (count, s.mean, s.deviation))
            .collect(),
    };
    let last = models.len().saturating_sub(1);
    Report {
        id: x.id,
        claim: "Scores rise with the training: an object-round is an object of a step that reads one set of images. The slope is the gain per doubling since the model before.",
        head: vec![
            "model",
            ">thousand object-rounds",
            ">4 images, dB",
            ">8",
            ">16",
            ">slope of 4 images, dB",
            ">of 8",
        ],
        rows: models.iter().enumerate().map(row).collect(),
        chart_labels: ["PSNR in dB", "thousand object-rounds"],
        chart: Chart::Lines { curves: SETS.map(line).into(), from_zero: false },
        outcome: Outcome::Reported,
        verdict: match (slope(last, 1), slope(last, 2)) {
            (Some(first), Some(second)) => format!(
                "With the slope of the last two models, twice the training of {} would add {} dB after 4 images, {} after 8.",
                models[last].0,
                shown(&first, 2),
                shown(&second, 2)
            ),
            _ => "One model: --model with several gives a curve.".into(),
        },
    }
}
