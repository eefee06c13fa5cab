//! What a render costs and what it is worth: scores and seconds over the samples of a ray.
//!
//! A state is read once per cell from two sets, and its field is rendered with more and more steps along the
//! diagonal of the box, each with its grid of occupied cells. The time is that of the grid and of all outputs,
//! with all passes; reading the state and comparing the images is not in it.

use super::setup::{SEED, Setup, is_complete, shown};
use crate::Result;
use crate::experiment::{
    AROUND, Cell, Chart, Curve, Experiment, Outcome, Report, Summary, Values, differences, of, rows,
};
use crate::fit::field::targets::target;
use crate::fit::field::view;
use crate::fit::training::Watch;
use data_gen::cameras;
use lastlight_lirm::evaluate::{self, settings};
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::decode::Rendering;
use lastlight_lirm::model::weights::Ready;
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;

/// Steps along the diagonal.
const STEPS: [usize; 5] = [16, 32, 64, 128, 256];
/// Sets that are read.
const SETS: usize = 2;
/// Objects.
const OBJECTS: u64 = 8;
/// The score of the chart.
const CHARTED: &str = "numerical_normals_deg";
/// Losses that do not count: of PSNR in dB, and of normals in degrees.
const SAME: [f64; 2] = [0.05, 0.5];

/// The experiment.
#[derive(Debug)]
pub struct Samples<'a> {
    setup: &'a Setup,
}

/// Makes the experiment.
pub fn samples(setup: &Setup) -> Samples<'_> {
    Samples { setup }
}

/// Name of a row.
fn name(steps: usize) -> String {
    format!("{steps} steps")
}

/// The error of normals, which tells steps apart better than PSNR, over seconds of an image; `seconds` are means by row. `None` without them.
pub fn over_time(results: &[(Cell, Values)], seconds: &[(String, Summary)]) -> Option<Chart> {
    let point = |row: &String| {
        let (_, time) = seconds.iter().find(|(own, _)| own == row)?;
        let images = Summary::of(&of(results, row, "images")).mean;
        let error = Summary::of(&of(results, row, CHARTED));
        (images > 0.0).then(|| (time.mean / images, error.mean, 0.0))
    };
    let points = rows(results).iter().map(point).collect::<Option<Vec<_>>>()?;
    Some(lines(points))
}

/// One curve through the points.
fn lines(points: Vec<(f64, f64, f64)>) -> Chart {
    let name = STEPS.map(|steps| steps.to_string()).join(", ") + " steps";
    Chart::Lines { curves: vec![Curve { name, points }], from_zero: false }
}

impl Experiment for Samples<'_> {
    fn id(&self) -> &'static str {
        "samples"
    }

    fn cells(&self) -> Vec<Cell> {
        let of =
            |k: u64| STEPS.map(|steps| Cell { key: format!("{steps:03}_{k:03}"), row: name(steps), seed: k });
        (0..Ord::min(OBJECTS, self.setup.size.objects)).flat_map(of).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        let mut record = self.setup.record(self.setup.model());
        record["render"] = json!([STEPS[cell % STEPS.len()], SETS]);
        record
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let (k, steps, model) = ((cell / STEPS.len()) as u64, STEPS[cell % STEPS.len()], self.setup.model());
        let views = self.setup.object(k, Version::Uniform)?;
        let ready = Ready::new(model.config, &model.params);
        let (state, at) = self.setup.read(&ready, &views, k, SETS)?;
        let mut p = self.setup.protocol(model, Version::Uniform);
        p.rendering = Rendering::of_field(steps, p.rendering.inverse_beta);
        let field = ready.decode(&state, p.rendering, at);
        let size = settings(SEED, self.setup.size.samples).size;
        let outputs = cameras::test(SEED, k, size).outputs;
        let cameras: Vec<_> =
            outputs.iter().take(p.outputs).map(|i| target(&views.all[*i].picture, &at).camera).collect();
        watch.lap(AROUND);
        let cells = view::occupancy(&field)?;
        let mut taken = 0;
        for camera in &cameras {
            taken += view::render(&field, Some(&cells), camera, true).samples;
        }
        watch.lap("rendering");
        let numbers = evaluate::score_state(&ready, &p, (&state, at), k, &views)?;
        watch.lap(AROUND);
        let names = ["psnr_db", "ssim", "foreground_iou", "depth", "numerical_normals_deg"];
        let mut values: Values =
            names.iter().filter_map(|n| Some(((*n).to_owned(), *numbers.get(n)?))).collect();
        values.insert("samples".into(), taken as f64 / (cameras.len() * size * size) as f64);
        values.insert("images".into(), cameras.len() as f64);
        Ok(values)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let all = rows(results);
        let best = name(STEPS[STEPS.len() - 1]);
        let beside = |row: &String, value: &str| Summary::of(&differences(results, [row, &best], value));
        let line = |row: &String| {
            let number = |value: &str, digits| shown(&Summary::of(&of(results, row, value)), digits);
            vec![
                row.clone(),
                number("samples", 1),
                number("psnr_db", 2),
                shown(&beside(row, "psnr_db"), 3),
                number("ssim", 3),
                number("foreground_iou", 3),
                number("depth", 4),
                number("numerical_normals_deg", 1),
            ]
        };
        let enough = all.iter().find(|row| {
            let [colors, normals] = ["psnr_db", CHARTED].map(|value| beside(row, value));
            colors.count > 0 && -colors.mean <= SAME[0] && normals.mean <= SAME[1]
        });
        let points = |row: &String| {
            let of = |value: &str| Summary::of(&of(results, row, value));
            (of("samples").mean, of(CHARTED).mean, 0.0)
        };
        Report {
            id: "samples",
            claim: "A render costs as much as the samples that its rays take, and more of them are worth less and less: scores of the fields of eight images, and seconds of the grid and all images with all passes.",
            head: vec![
                "steps along the diagonal",
                ">samples of a pixel",
                ">PSNR, dB",
                ">beside the most steps",
                ">SSIM",
                ">IoU",
                ">depth",
                ">normals, degrees",
            ],
            rows: all.iter().map(line).collect(),
            chart_labels: ["error of normals in degrees", "samples of a pixel"],
            chart: lines(all.iter().map(points).collect()),
            outcome: Outcome::Reported,
            verdict: match enough.filter(|_| is_complete(self, results)) {
                Some(row) => {
                    format!("{row} lose at most {} dB beside {best}, and {}° of normals.", SAME[0], SAME[1])
                }
                None => "Not all renders are there.".into(),
            },
        }
    }
}
