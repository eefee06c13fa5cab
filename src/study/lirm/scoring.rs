//! Stages, rounds, controls and materials: a model on unseen objects, set by set.

use super::setup::{NamedModel, Setup, is_complete, shown, values};
use crate::Result;
use crate::experiment::{Cell, Chart, Curve, Experiment, Outcome, Report, Summary, Values, of, paired, rows};
use crate::fit::training::Watch;
use crate::num::order;
use lastlight_lirm::evaluate::{self, Control, Order};
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::origin::training_seed;
use lastlight_lirm::model::weights::Ready;
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;

/// A row of a table.
#[derive(Clone, Debug)]
pub(super) struct Row {
    name: String,
    /// Index of the model.
    model: usize,
    version: Version,
    order: Order,
    control: Control,
    sets: usize,
    shapes: bool,
    baselines: bool,
}

impl Row {
    /// Names of version, order and control.
    fn names(&self) -> [&'static str; 3] {
        [self.version.name(), self.order.name(), self.control.name()]
    }
}

/// An experiment that scores models.
#[derive(Debug)]
pub struct Scoring<'a> {
    pub(super) id: &'static str,
    pub(super) setup: &'a Setup,
    pub(super) rows: Vec<Row>,
    pub(super) report: fn(&Scoring<'_>, &[(Cell, Values)]) -> Report,
}

/// The row of the last model as it is, with all that an experiment compares: several have this row, and share
/// its results.
fn plain(setup: &Setup, name: &str) -> Row {
    Row {
        name: name.to_owned(),
        model: setup.models.len() - 1,
        version: Version::Uniform,
        order: Order::Random,
        control: Control::None,
        sets: 4,
        shapes: true,
        baselines: true,
    }
}

/// Another row than that of the last model as it is: without surfaces and baselines.
fn other(setup: &Setup, name: &str) -> Row {
    Row { shapes: false, baselines: false, ..plain(setup, name) }
}

/// Folder of the results of all experiments here: equal rows are in one file.
const FOLDER: &str = "scores";

/// Every model after four sets, with its surface.
pub fn stages(setup: &Setup) -> Scoring<'_> {
    let last = setup.models.len() - 1;
    let row = |(model, named): (usize, &NamedModel)| Row {
        model,
        baselines: model == last,
        ..plain(setup, &named.name)
    };
    let rows = setup.models.iter().enumerate().map(row).collect();
    Scoring { id: "stages", setup, rows, report: of_stages }
}

/// Random and sequential order of the inputs.
pub fn rounds(setup: &Setup) -> Scoring<'_> {
    let rows = vec![plain(setup, RANDOM), Row { order: Order::Sequential, ..other(setup, SEQUENTIAL) }];
    Scoring { id: "rounds", setup, rows, report: of_rounds }
}

/// Inputs that are broken on purpose.
pub fn controls(setup: &Setup) -> Scoring<'_> {
    let broken = |name: &str, control| Row { control, sets: 2, ..other(setup, name) };
    let rows = vec![
        plain(setup, WHOLE),
        broken(ZEROED, Control::ZeroedState),
        broken(PERMUTED, Control::PermutedCameras),
        broken(OTHER, Control::OtherObject),
        broken(SWAPPED, Control::SwappedColors),
    ];
    Scoring { id: "controls", setup, rows, report: of_controls }
}

/// Materials under maps.
pub fn materials(setup: &Setup) -> Scoring<'_> {
    let under = |version: Version| Row {
        version,
        sets: 2,
        baselines: version == UNDER[0],
        ..other(setup, version.name())
    };
    let rows = UNDER.map(under).into();
    Scoring { id: "materials", setup, rows, report: of_materials }
}

/// Versions under a map; the second is smoother.
const UNDER: [Version; 2] = [Version::Environment, Version::Shiny];
const RANDOM: &str = "random order";
const SEQUENTIAL: &str = "sequential order";
const WHOLE: &str = "unbroken";
const ZEROED: &str = "state zeroed before set 2";
const PERMUTED: &str = "cameras permuted within a set";
const OTHER: &str = "set 2 of another object";
const SWAPPED: &str = "red and green exchanged";

impl Experiment for Scoring<'_> {
    fn id(&self) -> &'static str {
        self.id
    }

    fn folder(&self) -> &'static str {
        FOLDER
    }

    fn cells(&self) -> Vec<Cell> {
        // Object by object, so that its images are made once.
        let cell = |k: u64, row: &Row| {
            let digest = &self.setup.models[row.model].digest;
            let [version, order, control] = row.names();
            let key = format!("{digest}_{version}_{order}_{control}_{k:03}");
            Cell { key, row: row.name.clone(), seed: k }
        };
        (0..self.setup.size.objects).flat_map(|k| self.rows.iter().map(move |row| cell(k, row))).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        let row = &self.rows[cell % self.rows.len()];
        let mut record = self.setup.record(&self.setup.models[row.model].model);
        record["row"] = json!([row.names(), row.sets, row.shapes, row.baselines]);
        if row.version.is_under_map() {
            record["typical"] = json!(training_seed(&self.setup.model().training).unwrap_or_default());
        }
        record
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let (k, row) = ((cell / self.rows.len()) as u64, &self.rows[cell % self.rows.len()]);
        let model = &self.setup.models[row.model].model;
        // A model of the first stages has no materials.
        if row.version.is_under_map() && !model.config.is_whole {
            return Ok(Values::from([("has_materials".to_owned(), 0.0)]));
        }
        let views = self.setup.object(k, row.version)?;
        let other = match row.control {
            Control::OtherObject => Some(self.setup.object(k + 1, row.version)?),
            _ => None,
        };
        watch.lap("images");
        let mut p = self.setup.protocol(model, row.version);
        (p.order, p.control, p.sets) = (row.order, row.control, row.sets);
        (p.shapes, p.baselines) = (row.shapes, row.baselines);
        if row.version.is_under_map() {
            p.typical = Some(self.setup.typical(row.version)?);
        }
        let scores =
            evaluate::score_views(&Ready::new(model.config, &model.params), &p, k, &views, other.as_deref())?;
        watch.lap("scores");
        Ok(values(&scores.rounds))
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        (self.report)(self, results)
    }
}

/// The mean of a value over the objects of a row.
pub(super) fn mean(results: &[(Cell, Values)], row: &str, name: &str) -> Summary {
    Summary::of(&of(results, row, name))
}

/// A line of a table.
fn line(results: &[(Cell, Values)], row: &str, names: &[(String, usize)]) -> Vec<String> {
    let number = |(name, digits): &(String, usize)| shown(&mean(results, row, name), *digits);
    std::iter::once(row.to_owned()).chain(names.iter().map(number)).collect()
}

/// Curves of PSNR over the sets, with those of the baselines in the first row.
fn curves(results: &[(Cell, Values)], baselines: bool) -> Chart {
    let curve = |name: String, row: &str, value: &str| Curve {
        name,
        points: (1..=4)
            .map(|set| (set, mean(results, row, &format!("{value}_{set}"))))
            .filter(|(_, s)| s.count > 0)
            .map(|(set, s)| (4.0 * f64::from(set), s.mean, s.deviation))
            .collect(),
    };
    let mut curves: Vec<Curve> = rows(results).iter().map(|r| curve(r.clone(), r, "psnr_db")).collect();
    if let Some(row) = rows(results).first().filter(|_| baselines) {
        for (name, value) in [
            ("visual hull, 64²", "small_hull_db"),
            ("visual hull, 128²", "hull_db"),
            ("visual hull, 128², blurred", "blurred_hull_db"),
            ("nearest input", "nearest_db"),
        ] {
            curves.push(curve(format!("{name}, {row}"), row, value));
        }
    }
    Chart::Lines { curves, from_zero: false }
}

/// Results of the paper on scans of real objects (GSO), with some million times the training: Table 7, PSNR
/// and SSIM after four sets.
const PAPER_STAGES: [[&str; 3]; 3] = [
    ["paper, stage 1", "27.56", "0.924"],
    ["paper, stage 2", "30.80", "0.950"],
    ["paper, stage 3", "30.56", "0.948"],
];
/// Table 8: PSNR after 4, 8, 12 and 16 images.
const PAPER_ROUNDS: [[&str; 5]; 2] = [
    ["paper, random order", "29.27", "30.48", "30.65", "30.56"],
    ["paper, sequential order", "27.70", "30.09", "30.66", "30.56"],
];

/// A line of a table with numbers of the paper, which are of other objects: its other columns are empty.
fn published(own: &[&str], columns: usize) -> Vec<String> {
    let blank = std::iter::repeat("–");
    own.iter().copied().chain(blank).take(columns).map(str::to_owned).collect()
}

const BY_IMAGES: [&str; 2] = ["PSNR in dB", "images"];

fn of_stages(x: &Scoring<'_>, results: &[(Cell, Values)]) -> Report {
    let names: Vec<(String, usize)> = [
        ("psnr_db_4", 2),
        ("ssim_4", 3),
        ("rfd_4", 1),
        ("foreground_iou_4", 3),
        ("numerical_normals_deg_4", 1),
        ("distance_radii_4", 4),
        ("has_surface_4", 2),
    ]
    .map(|(name, digits)| (name.to_owned(), digits))
    .into();
    let all = rows(results);
    let gain = match all.as_slice() {
        [first, .., last] => Some(paired(results, [last.as_str(), first.as_str()], "psnr_db_4")),
        _ => None,
    };
    Report {
        id: x.id,
        claim: "Later stages are better after four sets (Table 7). The paper's numbers are of scans of real objects, after some million times the training.",
        head: vec![
            "model",
            ">PSNR, dB",
            ">SSIM",
            ">RFD (not LPIPS)",
            ">IoU of foregrounds",
            ">normals, degrees",
            ">surface, radii",
            ">of objects with one",
        ],
        rows: all
            .iter()
            .map(|row| line(results, row, &names))
            .chain(PAPER_STAGES.map(|own| published(&own, 1 + names.len())))
            .collect(),
        chart_labels: BY_IMAGES,
        chart: curves(results, false),
        outcome: Outcome::of(
            gain.filter(|g| g.count > 1 && is_complete(x, results)).map(|g| g.is_positive()),
        ),
        verdict: match gain {
            Some(gain) => format!("From the first to the last model {} dB.", shown(&gain, 2)),
            None => "One model.".into(),
        },
    }
}

/// Whether all objects of all rows have this value.
fn are_complete(x: &Scoring<'_>, results: &[(Cell, Values)], name: &str) -> bool {
    is_complete(x, results) && results.iter().all(|(_, values)| values.contains_key(name))
}

/// The difference of two values of a row, object by object.
pub(super) fn between(results: &[(Cell, Values)], row: &str, [a, b]: [&str; 2]) -> Summary {
    let own = results.iter().filter(|(cell, _)| cell.row == row);
    Summary::of(&own.filter_map(|(_, v)| Some(v.get(a)? - v.get(b)?)).collect::<Vec<_>>())
}

fn of_rounds(x: &Scoring<'_>, results: &[(Cell, Values)]) -> Report {
    let db = |row: &str, name: &str| mean(results, row, name).mean;
    let [one, two, three, four] = [1, 2, 3, 4].map(|set| db(RANDOM, &format!("psnr_db_{set}")));
    // The hull is made from the images that the model reads, and from those of twice their side; the better one counts.
    let stronger = if db(RANDOM, "hull_db_1") >= db(RANDOM, "small_hull_db_1") {
        "hull_db_1"
    } else {
        "small_hull_db_1"
    };
    let hull = db(RANDOM, stronger);
    let nearest = db(RANDOM, "nearest_db_1");
    let [second, third, fourth] = [2, 3, 4].map(|set| db(SEQUENTIAL, &format!("psnr_db_{set}")));
    let orders = (four - fourth).abs();
    let later = order::min(order::min(three, four) - two, order::min(third, fourth) - second);
    let met = [one >= nearest + 4.0, one >= hull + 1.0, two >= one + 0.5, orders <= 0.3, later >= -0.2];
    let head = [
        "order",
        ">4 images",
        ">8",
        ">12",
        ">16",
        ">hull of 64², 4",
        ">8",
        ">12",
        ">16",
        ">hull of 128², 4",
        ">blurred, 4",
        ">nearest, 4",
    ];
    let mut names: Vec<(String, usize)> = (1..=4).map(|set| (format!("psnr_db_{set}"), 2)).collect();
    names.extend((1..=4).map(|set| (format!("small_hull_db_{set}"), 2)));
    names.push(("hull_db_1".into(), 2));
    names.push(("blurred_hull_db_1".into(), 2));
    names.push(("nearest_db_1".into(), 2));
    Report {
        id: x.id,
        claim: "The first set gives 4 dB more than the nearest input and 1 dB more than the visual hull, the second another 0.5 dB; both orders end within 0.3 dB, and in neither a later set loses more than 0.2 dB (Table 8). The paper's numbers are of scans of real objects, after some million times the training.",
        rows: rows(results)
            .iter()
            .map(|row| line(results, row, &names))
            .chain(PAPER_ROUNDS.map(|own| published(&own, head.len())))
            .collect(),
        head: head.into(),
        chart_labels: BY_IMAGES,
        chart: curves(results, true),
        outcome: Outcome::of(are_complete(x, results, "psnr_db_4").then(|| met.iter().all(|m| *m))),
        verdict: format!(
            "Beside the nearest input {} dB, beside the hull {} ({} beside a blurred one); the second set {}; later ones {later:+.2}; orders differ by {orders:.2}.",
            shown(&between(results, RANDOM, ["psnr_db_1", "nearest_db_1"]), 2),
            shown(&between(results, RANDOM, ["psnr_db_1", stronger]), 2),
            shown(&between(results, RANDOM, ["psnr_db_1", "blurred_hull_db_1"]), 2),
            shown(&between(results, RANDOM, ["psnr_db_2", "psnr_db_1"]), 2),
        ),
    }
}

fn of_controls(x: &Scoring<'_>, results: &[(Cell, Values)]) -> Report {
    let mut names: Vec<(String, usize)> = (1..=2).map(|set| (format!("psnr_db_{set}"), 2)).collect();
    names.extend([("color_2".into(), 3), ("gray_2".into(), 3)]);
    let colors = paired(results, [SWAPPED, WHOLE], "color_2").mean;
    let gain = between(results, WHOLE, ["psnr_db_2", "psnr_db_1"]);
    let [zeroed, permuted, other] =
        [ZEROED, PERMUTED, OTHER].map(|row| paired(results, [WHOLE, row], "psnr_db_2"));
    let met = (zeroed.mean - gain.mean).abs() <= 0.2 && permuted.mean >= 3.0 && other.mean >= 3.0;
    let is_empty = if gain.count > 1 && !gain.is_positive() {
        " As the second set gains nothing beyond chance, the zeroed state is no test."
    } else {
        ""
    };
    Report {
        id: x.id,
        claim: "A zeroed state costs what the second set had gained (± 0.2 dB); wrong cameras or another object cost at least 3 dB.",
        head: vec!["inputs", ">set 1, dB", ">set 2, dB", ">error of colour, set 2", ">of grey"],
        rows: rows(results).iter().map(|row| line(results, row, &names)).collect(),
        chart_labels: BY_IMAGES,
        chart: curves(results, false),
        outcome: Outcome::of(are_complete(x, results, "psnr_db_2").then_some(met)),
        verdict: format!(
            "The second set gains {} dB; the zeroed state costs {}, permuted cameras {}, another object {}. Exchanged colours change the error of the mean colour by {colors:+.3}.{is_empty}",
            shown(&gain, 2),
            shown(&zeroed, 2),
            shown(&permuted, 2),
            shown(&other, 2),
        ),
    }
}

fn of_materials(x: &Scoring<'_>, results: &[(Cell, Values)]) -> Report {
    let all = [
        ("albedo_error", 3),
        ("mean_albedo_error", 3),
        ("input_albedo_error", 3),
        ("albedo_db", 2),
        ("mean_albedo_db", 2),
        ("roughness", 3),
        ("mean_roughness", 3),
        ("median_roughness", 3),
        ("metallic", 3),
        ("mean_metallic", 3),
        ("median_metallic", 3),
    ];
    let names: Vec<(String, usize)> =
        all.iter().map(|(name, digits)| (format!("{name}_2"), *digits)).collect();
    let is_better = |row: &String| {
        let of = |name: &str| mean(results, row, &format!("{name}_2")).mean;
        of("albedo_error") < of("mean_albedo_error")
            && of("roughness") < of("mean_roughness")
            && of("metallic") < of("mean_metallic")
    };
    let beats_medians = |row: &&String| {
        let of = |name: &str| mean(results, row, &format!("{name}_2")).mean;
        of("roughness") < of("median_roughness") && of("metallic") < of("median_metallic")
    };
    let has_materials = results.iter().any(|(_, v)| v.contains_key("albedo_error_2"));
    let beside = |row: &String| {
        let of = |name: &str| {
            let own = between(results, row, [&format!("{name}_2"), &format!("mean_{name}_2")]);
            shown(&own, 3)
        };
        let [albedo, roughness, metallic] = ["albedo_error", "roughness", "metallic"].map(of);
        let inputs = shown(&between(results, row, ["albedo_error_2", "input_albedo_error_2"]), 3);
        format!(
            "{row}: albedo {albedo} and, beside the mean colour of the inputs, {inputs}, roughness {roughness}, metallic {metallic}"
        )
    };
    let all = rows(results);
    Report {
        id: x.id,
        claim: "Albedo after its scale (one factor per image), roughness and metallic are each better than the means of training objects, after two sets.",
        head: vec![
            "light",
            ">albedo, error",
            ">of the mean",
            ">of the inputs' colour",
            ">albedo, a factor per channel, dB",
            ">of the mean",
            ">roughness, error",
            ">of the mean",
            ">of the median",
            ">metallic, error",
            ">of the mean",
            ">of the median",
        ],
        rows: all.iter().map(|row| line(results, row, &names)).collect(),
        chart_labels: BY_IMAGES,
        chart: curves(results, true),
        outcome: Outcome::of(are_complete(x, results, "albedo_error_2").then(|| all.iter().all(is_better))),
        verdict: match has_materials {
            false => "The model has no materials.".into(),
            true => {
                let held = all.iter().filter(|row| is_better(row)).count();
                let medians = all.iter().filter(beats_medians).count();
                format!(
                    "All three are better under {held} of {n} lights; roughness and metallic are better than the medians under {medians}. Errors beside those of the means ({}).",
                    all.iter().map(beside).collect::<Vec<_>>().join("; "),
                    n = all.len()
                )
            }
        },
    }
}
