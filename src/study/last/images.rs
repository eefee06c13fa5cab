//! E10 and E11 on images: FORK and FULL, NL, groups that share a value against pairs (chapter *Learned
//! causes*).
//!
//! A run renders images of a figure with one appearance (`sets/` in the folder of the study, shared by all
//! kinds of supervision), trains a model on them and compares its graph with the true one. An interrupted run
//! continues from its checkpoint (`unfinished/`); the trained model is kept (`models/`). E10, whose vectors
//! are from the same generators, lists the result of the search on the true factors.

use super::learn::{measured, plain, scores};
use crate::experiment::{Cell, Experiment, Outcome, Report, Values, median, of, rows};
use crate::fit::training::{History, Session, Watch};
use crate::math::digraph::Digraph;
use crate::{Error, Result};
use data_gen::figure::graph::Graph;
use lastlight_last::generate;
use lastlight_last::model::evaluation;
use lastlight_last::model::pictures::Pictures;
use lastlight_last::model::settings::{Settings, Supervision};
use lastlight_last::model::train::Training;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Sizes of the runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// steps of joint training
    pub steps: u32,
    /// number of coordinates decoded per image
    pub points: usize,
    /// number of observed items and of groups in a data set
    pub data: [usize; 2],
    /// number of repetitions
    pub seeds: u64,
}

impl Size {
    /// Sizes of the complete study.
    pub fn full() -> Self {
        Self { steps: 6_000, points: 64, data: [2048, 256], seeds: 3 }
    }

    /// Sizes for a quick overview.
    pub fn quick() -> Self {
        Self { steps: 600, points: 32, data: [256, 32], seeds: 1 }
    }

    /// Sizes for a smoke test.
    pub fn smoke() -> Self {
        Self { steps: 4, points: 8, data: [32, 8], seeds: 1 }
    }
}

const GRAPHS: [&str; 2] = ["FORK", "FULL"];
/// Folder of trained models, which can be used in E1 to E15.
const MODELS: &str = "models";
/// Folder of checkpoints.
const UNFINISHED: &str = "unfinished";
/// Steps between checkpoints of a training.
const EVERY: usize = 500;

/// Settings of one training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct TrainingRun {
    graph: &'static str,
    supervision: Supervision,
    seed: u64,
}

impl TrainingRun {
    fn row(&self) -> String {
        format!("{} NL {} images", self.graph, self.supervision.name())
    }

    fn key(&self) -> String {
        format!("{}_{}", plain(&self.row()), self.seed)
    }
}

/// The experiment E10p.
#[derive(Clone, Debug)]
pub struct StructureFromImages {
    size: Size,
    runs: Vec<TrainingRun>,
    dir: PathBuf,
}

impl StructureFromImages {
    /// Makes the experiment for the folder of a study.
    pub fn new(size: Size, dir: &Path) -> Self {
        let kinds = [Supervision::Groups, Supervision::PerSample];
        let runs = GRAPHS.into_iter().flat_map(|graph| {
            kinds.into_iter().flat_map(move |supervision| {
                (0..size.seeds).map(move |seed| TrainingRun { graph, supervision, seed })
            })
        });
        Self { size, runs: runs.collect(), dir: dir.to_owned() }
    }

    fn training(&self, run: &TrainingRun) -> Settings {
        Settings {
            supervision: run.supervision,
            points: self.size.points,
            seed: run.seed,
            ..Settings::of_pictures()
        }
        .scaled(self.size.steps)
    }

    /// The images of a graph and seed; generated if they do not exist.
    fn images(&self, graph: &str, seed: u64) -> Result<PathBuf> {
        let [count, groups] = self.size.data;
        let dir = self.dir.join("sets").join(format!("{graph}-{seed}-{count}-{groups}"));
        let settings = generate::Settings {
            set: "training".into(),
            graph: graph.to_owned(),
            appearances: 1,
            count,
            groups,
            seed,
            ..generate::Settings::full()
        };
        generate::ensure(&settings, &dir)?;
        Ok(dir)
    }
}

impl Experiment for StructureFromImages {
    fn id(&self) -> &'static str {
        "E10p"
    }

    fn cells(&self) -> Vec<Cell> {
        self.runs.iter().map(|t| Cell { key: t.key(), row: t.row(), seed: t.seed }).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        let training = self.training(&self.runs[cell]).json();
        json!({ "data": self.size.data, "training": training, "lastlight": env!("CARGO_PKG_VERSION") })
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, stop: &AtomicBool) -> Result<Values> {
        let run = self.runs[cell];
        let settings = self.training(&run);
        let data = Pictures::read(&self.images(run.graph, run.seed)?, true, settings.framing)?;
        watch.lap("images");
        let mut training = Training::new(settings, &data)?;
        let checkpoint = self.dir.join(UNFINISHED).join(format!("{}.safetensors", run.key()));
        let session = Session { checkpoint: &checkpoint, every: EVERY };
        let history = match session.begin(&mut training, true) {
            Ok((so_far, _)) => so_far,
            // A checkpoint of other settings or an incomplete one cannot be used.
            Err(_) => {
                training = Training::new(settings, &data)?;
                History::default()
            }
        };
        for folder in [UNFINISHED, MODELS].map(|name| self.dir.join(name)) {
            std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
        }
        session.run(&mut training, history, stop, watch)?;
        let fail = |e: String| Error::input("graph").expected("a graph of the list").got(e);
        let graph = Graph::named(run.graph, settings.factors, run.seed).map_err(fail)?;
        let truth = Digraph::from_fn(settings.factors, |i, j| graph.adjacency[i][j]);
        let trained = training.finish()?;
        let score = evaluation::of(&trained, &data, &Some(graph.adjacency))?;
        let mut values = measured(&trained, &score, &truth);
        trained.write(&self.dir.join(MODELS).join(format!("{}.safetensors", run.key())))?;
        let _ = std::fs::remove_file(&checkpoint);
        values.insert("space".into(), score.space_error);
        values.insert("colour".into(), score.colour_error);
        Ok(values)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let (head, lines, chart) = scores(
            results,
            &[
                ("p_wo", ">p(W→O)"),
                ("p_ow", ">p(O→W)"),
                ("space", ">error of points"),
                ("colour", ">error of colours"),
            ],
        );
        let supervised: Vec<String> =
            rows(results).into_iter().filter(|row| row.contains(" groups ")).collect();
        let middle = |row: &str, name: &str| median(&of(results, row, name));
        let is_found = |row: &str| {
            let spurious =
                row.starts_with("FORK") && ["p_wo", "p_ow"].iter().any(|p| !(middle(row, p) < 0.5));
            middle(row, "shd") <= 1.0 && middle(row, "targets") >= 0.95 && !spurious
        };
        let missed: Vec<&str> = supervised.iter().map(String::as_str).filter(|row| !is_found(row)).collect();
        Report {
            id: "E10p",
            claim: "The structure is learned correctly from images. Criterion with groups, as medians: SHD ≤ 1, targets ≥ 95 %, no edge between the effects of a fork. Scores are computed on the training images.",
            head,
            rows: lines,
            chart_labels: ["median SHD", "row"],
            chart,
            outcome: Outcome::of((!supervised.is_empty()).then_some(missed.is_empty())),
            verdict: if missed.is_empty() {
                "With groups that share a value, graph and targets are found from images.".into()
            } else {
                format!("Not found with groups: {}.", missed.join(", "))
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::training::Step;
    use lastlight_last::model::file::Trained;
    use lastlight_num::error::Kind;
    use std::sync::atomic::Ordering;

    /// Stops a training after some steps.
    struct StopAfter<'a>(usize, &'a AtomicBool);

    impl Watch for StopAfter<'_> {
        fn progress(&mut self, done: usize, _: usize, _: Step) {
            self.1.store(done == self.0, Ordering::Relaxed);
        }
    }

    /// Records the first step.
    struct First<'a>(&'a mut Option<usize>);

    impl Watch for First<'_> {
        fn progress(&mut self, done: usize, _: usize, _: Step) {
            self.0.get_or_insert(done);
        }
    }

    #[test]
    fn a_training_that_was_stopped_continues() {
        let dir = tempfile::tempdir().expect("a folder");
        let x = StructureFromImages::new(Size::smoke(), dir.path());
        let stop = AtomicBool::new(false);
        let e = x.run(0, &mut StopAfter(2, &stop), &stop).expect_err("stopped");
        assert_eq!(e.kind(), Kind::Interrupted);
        let left = || std::fs::read_dir(dir.path().join(UNFINISHED)).expect("a folder").count();
        assert_eq!(left(), 1, "a checkpoint");
        stop.store(false, Ordering::Relaxed);
        let mut first = None;
        let resumed = x.run(0, &mut First(&mut first), &stop).expect("runs");
        assert_eq!(first, Some(3), "from where it stopped");
        assert_eq!(left(), 0, "the checkpoint is gone");
        let model = dir.path().join(MODELS).join("FORK-NL-groups-images_0.safetensors");
        assert_eq!(Trained::read(&model).expect("a model").model.sizes.factors, 4, "a model of four factors");
        assert_eq!(x.run(0, &mut (), &stop).expect("runs"), resumed, "bit-identical to an uninterrupted run");
    }
}
