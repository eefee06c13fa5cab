//! Samples that a grid of occupied cells saves on reconstructions (the paper: 91.2 % of 1 024 per ray).

use super::setup::{SEED, Setup, is_complete, shown};
use crate::Result;
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Summary, Values, of, rows};
use crate::fit::field::targets::placed;
use crate::fit::field::view;
use crate::fit::training::Watch;
use crate::scene::camera::Camera;
use data_gen::cameras;
use lastlight_lirm::evaluate::settings;
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::decode::Rendering;
use lastlight_lirm::model::weights::Ready;
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;

/// Steps along the diagonal, as published.
const STEPS: usize = 1024;
/// Pixels per side of an image, as the published crops.
const SIDE: usize = 192;
/// Objects; a row of one has 151 million samples.
const OBJECTS: u64 = 5;
/// Images.
const IMAGES: usize = 4;
/// Kinds of rows: the grid is filled once per field, whatever is rendered with it.
const KINDS: [&str; 3] = [ALL, FILLING, KEEPING];
const ALL: &str = "all steps";
const FILLING: &str = "filling the grid";
const KEEPING: &str = "grid and early stop";

/// The experiment.
#[derive(Debug)]
pub struct Occupied<'a> {
    setup: &'a Setup,
}

/// Makes the experiment.
pub fn occupied(setup: &Setup) -> Occupied<'_> {
    Occupied { setup }
}

/// Least ratio of how much faster rendering is to how many times fewer samples there are.
const LEAST_RATIO: f64 = 0.7;

impl Occupied<'_> {
    /// Judges what the saved samples save in time; `seconds` are by row. Unless all objects were rendered and timed
    /// in both rows, the report stays as it is.
    pub fn judge(&self, report: &mut Report, results: &[(Cell, Values)], seconds: &[(String, Summary)]) {
        let rows = [ALL, KEEPING];
        let samples = rows.map(|row| Summary::of(&of(results, row, "kept")));
        let times = rows.map(|row| seconds.iter().find(|(own, _)| own == row).map(|(_, s)| *s));
        let [Some(all), Some(with)] = times else { return };
        let count = samples[0].count;
        if !is_complete(self, results) || [&samples[1], &all, &with].iter().any(|s| s.count != count) {
            return;
        }
        let [samples, times] = [samples[0].mean / samples[1].mean, all.mean / with.mean];
        let ratio = times / samples;
        report.outcome = Outcome::of(Some(ratio >= LEAST_RATIO));
        report.verdict += &format!(
            " Samples are {samples:.1} times fewer, and rendering is {times:.1} times as fast: {ratio:.2} of that (at least {LEAST_RATIO} is required)."
        );
    }
}

impl Experiment for Occupied<'_> {
    fn id(&self) -> &'static str {
        "occupancy"
    }

    fn cells(&self) -> Vec<Cell> {
        let count = Ord::min(OBJECTS, self.setup.size.objects);
        let of = |k: u64| {
            KINDS.iter().enumerate().map(move |(n, row)| Cell {
                key: format!("{n}_{k}"),
                row: (*row).into(),
                seed: k,
            })
        };
        (0..count).flat_map(of).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        let mut record = self.setup.record(self.setup.model());
        record["render"] = json!([STEPS, SIDE, IMAGES, KINDS[cell % KINDS.len()], "all samples decoded"]);
        record
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let (k, kind, model) = ((cell / KINDS.len()) as u64, KINDS[cell % KINDS.len()], self.setup.model());
        let with_grid = kind != ALL;
        let views = self.setup.object(k, Version::Uniform)?;
        let set = settings(SEED, self.setup.size.samples);
        let protocol = cameras::test(SEED, k, set.size);
        let ready = Ready::new(model.config, &model.params);
        let (state, at) = self.setup.read(&ready, &views, k, 1)?;
        let steps = Ord::min(STEPS, 8 * self.setup.size.steps);
        let usual =
            Rendering::of_field(steps, self.setup.protocol(model, Version::Uniform).rendering.inverse_beta);
        // All heads decode every sample that is taken: with a least weight few are, however many are taken.
        let usual = Rendering { least_weight: None, ..usual };
        let rendering = if with_grid { usual } else { Rendering { early_stop: None, ..usual } };
        let field = ready.decode(&state, rendering, at);
        watch.lap(crate::experiment::AROUND);
        let cells = if with_grid { Some(view::occupancy(&field)?) } else { None };
        if let Some(cells) = cells.as_ref().filter(|_| kind == FILLING) {
            watch.lap("filling");
            return Ok(Values::from([("occupied".into(), cells.fraction())]));
        }
        watch.lap(crate::experiment::AROUND);
        let mut samples = 0;
        for i in protocol.outputs.iter().take(IMAGES) {
            let own = placed(&views.all[*i].picture.camera, &at);
            let factor = SIDE as f32 / own.width as f32;
            let camera = Camera {
                width: SIDE,
                height: SIDE,
                focal_px: own.focal_px.map(|f| f * factor),
                center_px: own.center_px.map(|c| c * factor),
                ..own
            };
            samples += view::render(&field, cells.as_ref(), &camera, false).samples;
        }
        watch.lap("rendering");
        let all = steps * SIDE * SIDE * IMAGES;
        Ok(Values::from([("kept".into(), samples as f64 / all as f64)]))
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let kept =
            |row: &str| Summary::of(&of(results, row, "kept").iter().map(|x| 100.0 * x).collect::<Vec<_>>());
        let (all, with_grid) = (kept(ALL), kept(KEEPING));
        let ratios: Vec<f64> = of(results, KEEPING, "kept")
            .iter()
            .zip(of(results, ALL, "kept"))
            .map(|(with, all)| 100.0 * with / all)
            .collect();
        let share = Summary::of(&ratios);
        let occupied = of(results, FILLING, "occupied").iter().map(|x| 100.0 * x).collect::<Vec<_>>();
        let line = |row: &String| {
            let share = if row == FILLING { Summary::of(&occupied) } else { kept(row) };
            let what = if row == FILLING { "cells that are occupied" } else { "samples that are taken" };
            vec![row.clone(), what.to_owned(), shown(&share, 1)]
        };
        Report {
            id: "occupancy",
            claim: "With occupied cells and early stop, rendering is at least 0.7 times as much faster as samples are fewer. The paper removes 91.2 % of the samples with a grid of 250³ cells, this one has 128³. Samples are counted beside 1 024 per ray in the full study; a step is the 1 024th part of the diagonal, so rays that are shorter or miss the box have fewer without any grid (first row). Times are of four images with all heads at every sample, and of filling the grid once; after --resume they may be of several runs.",
            head: vec!["row", "share of", ">%"],
            rows: rows(results).iter().map(line).collect(),
            chart_labels: ["samples taken, %", ""],
            chart: Chart::Bars(
                rows(results)
                    .iter()
                    .filter(|row| *row != FILLING)
                    .map(|row| (row.clone(), kept(row).mean))
                    .collect(),
            ),
            // Seconds are not among the results: `judge` adds them.
            outcome: Outcome::Reported,
            verdict: format!(
                "{} % are taken (the paper: 8.8 %); without a grid {} % are in the box, and the grid leaves {} % of those.",
                shown(&with_grid, 1),
                shown(&all, 1),
                shown(&share, 1)
            ),
        }
    }
}
