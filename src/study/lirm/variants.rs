//! Small models of several kinds, trained from first values with equal steps (Tables 5, 9 and the comparison
//! of planes).
//!
//! | row | what differs |
//! |---|---|
//! | hexa NDE | six planes of 8² tokens, colours with the directional embedding |
//! | hexa diffuse | without the embedding |
//! | tri NDE | three planes of 11² tokens: 363 instead of 384 |
//! | no update | one set of 4 to 12 images per object instead of 1 or 2 of 3 to 6 |
//! | hexa NDE, second seed | other first values and draws |
//!
//! All are trained under the light and with the colours of stage 2: on signed distances alone in the first
//! half of the steps (trainings that began with renders hardly used their cameras, chapter `small_model` of
//! the book), then on all heads too. 1/β goes from 30 to 120; Muon, batches of eight, objects of random size
//! and place in the box as in stage 1a. They are scored on the smoother version of unseen objects after 4, 8
//! and 12 images: in sets of four, without update in one set. A cell is one training; its values name the
//! objects, so that differences are paired by object.

use super::setup::{SEED, Setup, shown};
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Summary, Values, rows};
use crate::fit::training::{History, Session, Watch};
use crate::{Error, Result};
use data_gen::cameras;
use lastlight_lirm::evaluate::{self, SET};
use lastlight_lirm::model::config::Config;
use lastlight_lirm::model::decode::Look;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::train::optimizer;
use lastlight_lirm::train::source::Rendered;
use lastlight_lirm::train::stage::{Stage, USES};
use lastlight_lirm::train::{Settings, Training};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Weight of signed distances.
const DISTANCES: f32 = 60.0;
/// Steps between checkpoints.
const EVERY: usize = 50;
/// Folder of checkpoints.
const UNFINISHED: &str = "unfinished";
/// Version of the objects that are scored.
const VERSION: &str = "shiny";
/// Sets that are scored.
const SETS: usize = 3;
/// Pixels per side of an image.
const SIDE: usize = 128;

/// A kind of model.
#[derive(Clone, Copy, Debug)]
struct Kind {
    name: &'static str,
    config: Config,
    updates: bool,
    seed: u64,
}

/// Width, heads and blocks of all kinds.
const HEXA: Config = Config { blocks: 4, width: 192, heads: 3, is_whole: true, ..Config::SMALL };
const KINDS: [Kind; 5] = [
    Kind { name: "hexa NDE", config: HEXA, updates: true, seed: 0 },
    Kind { name: "hexa diffuse", config: Config { embed_tokens: 0, ..HEXA }, updates: true, seed: 0 },
    Kind { name: "tri NDE", config: Config { planes: 3, plane_tokens: 11, ..HEXA }, updates: true, seed: 0 },
    Kind { name: "no update", config: HEXA, updates: false, seed: 0 },
    Kind { name: "hexa NDE, second seed", config: HEXA, updates: true, seed: 3 },
];

/// The experiment.
#[derive(Debug)]
pub struct Variants<'a> {
    setup: &'a Setup,
    dir: PathBuf,
}

/// Makes the experiment in the folder of a study.
pub fn variants<'a>(setup: &'a Setup, dir: &Path) -> Variants<'a> {
    Variants { setup, dir: dir.to_owned() }
}

impl Variants<'_> {
    fn training(&self, kind: &Kind) -> Result<Settings> {
        let [steps, batch, block] = self.setup.size.training;
        let later = Stage::named("2a")?;
        let stage = Stage {
            name: "variant".into(),
            steps,
            rates: [1e-3, 4e-5],
            shape_steps: steps / 2,
            light: later.light,
            tint: later.tint,
            sets: [1, if kind.updates { 2 } else { 1 }],
            images: if kind.updates { [3, 6] } else { [4, 12] },
            is_whole: true,
            ..Stage::named("1a")?
        };
        Ok(Settings {
            stage: stage.with_distances(DISTANCES),
            optimizer: optimizer::Kind::Muon,
            head_rate: 1.0,
            seed: kind.seed,
            batch,
            block,
            uses: USES,
            at_once: batch,
            recompute: false,
            average_last: steps / 10,
        })
    }
}

impl Experiment for Variants<'_> {
    fn id(&self) -> &'static str {
        "variants"
    }

    fn cells(&self) -> Vec<Cell> {
        let cell = |kind: &Kind| Cell {
            key: kind.name.replace([' ', ','], "-"),
            row: kind.name.into(),
            seed: kind.seed,
        };
        KINDS.iter().map(cell).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        let kind = &KINDS[cell];
        let mut record = kind.config.json();
        let training = self.training(kind);
        record["stage"] = training.as_ref().map_or(Value::Null, |s| s.stage.json());
        record["optimizer"] =
            training.map_or(Value::Null, |s| json!([s.optimizer.name(), s.batch, s.block, s.average_last]));
        record["size"] = json!([
            self.setup.size.objects,
            self.setup.size.samples,
            self.setup.size.outputs,
            self.setup.size.steps
        ]);
        record["seeds"] = json!([kind.seed, SEED]);
        record["lastlight"] = json!(env!("CARGO_PKG_VERSION"));
        record
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, stop: &AtomicBool) -> Result<Values> {
        let kind = KINDS[cell];
        let source = Rendered::new(kind.seed);
        let made = || Training::new(self.training(&kind)?, kind.config, None, &source);
        let mut training = made()?;
        let folder = self.dir.join(UNFINISHED);
        std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
        let checkpoint = folder.join(format!("{}.safetensors", self.cells()[cell].key));
        let session = Session { checkpoint: &checkpoint, every: EVERY };
        let history = match session.begin(&mut training, true) {
            Ok((so_far, _)) => so_far,
            // A checkpoint of other settings or an incomplete one cannot be used, and is kept beside.
            Err(_) => {
                let unused = checkpoint.with_extension("unused");
                std::fs::rename(&checkpoint, &unused).map_err(|e| Error::os(&unused, &e))?;
                training = made()?;
                History::default()
            }
        };
        session.run(&mut training, history, stop, watch)?;
        let ready = Ready::new(*training.config(), training.params());
        let mut p = self.setup.protocol(self.setup.model(), VERSION);
        let [_, sharpest] = self.training(&kind)?.stage.inverse_beta;
        p.look = Look::of_field(self.setup.size.steps, sharpest);
        let mut values = Values::new();
        for k in 0..self.setup.size.objects {
            let views = self.setup.object(k, VERSION)?;
            let inputs = cameras::test(SEED, k, SIDE).inputs;
            let at = views.posed(kind.config.pose, &inputs[..SET])?;
            let mut state = ready.no_state();
            for set in 0..SETS {
                let own = if kind.updates { SET * set } else { 0 };
                let from = if kind.updates { state } else { ready.no_state() };
                state = ready.read_chosen(&from, &views, &inputs[own..SET * (set + 1)], &at)?;
                let numbers = evaluate::state(&ready, &p, (&state, at), k, &views)?;
                values.insert(format!("psnr_db_{}_{k:03}", set + 1), numbers["psnr_db"]);
            }
        }
        watch.lap("scores");
        let _ = std::fs::remove_file(&checkpoint);
        Ok(values)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let of = |row: &str, set: usize| -> Vec<f64> {
            let prefix = format!("psnr_db_{set}_");
            let cells = results.iter().filter(|(cell, _)| cell.row == row);
            cells
                .flat_map(|(_, v)| v.iter().filter(|(name, _)| name.starts_with(&prefix)).map(|(_, x)| *x))
                .collect()
        };
        let pair = |a: &str, b: &str, set: usize| {
            let (a, b) = (of(a, set), of(b, set));
            (!a.is_empty() && a.len() == b.len()).then(|| Summary::of_pairs(&a, &b))
        };
        let all = [
            ("NDE − diffuse, 8 images", pair("hexa NDE", "hexa diffuse", 2)),
            ("hexa − tri, 8 images", pair("hexa NDE", "tri NDE", 2)),
            ("update − no update, 4 images", pair("hexa NDE", "no update", 1)),
            ("update − no update, 8 images", pair("hexa NDE", "no update", 2)),
            ("update − no update, 12 images", pair("hexa NDE", "no update", 3)),
            ("second seed − first, 8 images", pair("hexa NDE, second seed", "hexa NDE", 2)),
        ];
        let pairs: Vec<(String, Summary)> =
            all.into_iter().filter_map(|(name, s)| Some((name.to_owned(), s?))).collect();
        let line = |row: &String| {
            std::iter::once(row.clone())
                .chain((1..=SETS).map(|set| shown(&Summary::of(&of(row, set)), 2)))
                .collect()
        };
        let mut lines: Vec<Vec<String>> = rows(results).iter().map(line).collect();
        lines.extend(
            pairs.iter().map(|(name, s)| vec![name.clone(), String::new(), String::new(), shown(s, 2)]),
        );
        let told: Vec<String> = pairs.iter().map(|(name, s)| format!("{name}: {} dB", shown(s, 2))).collect();
        Report {
            id: "variants",
            claim: "Six planes against three at equal tokens, the directional embedding against none, updates against none (Tables 5 and 9), trained with equal steps; the difference of two seeds is what a training leaves to chance.",
            head: vec!["model", ">4 images, dB", ">8", ">12"],
            rows: lines,
            chart_labels: ["difference in dB, paired by object", ""],
            chart: Chart::Intervals(pairs),
            outcome: Outcome::Reported,
            verdict: format!("{}.", told.join("; ")),
        }
    }
}
