//! Common data of the experiments with persons: sizes, models, captures.

use crate::loss::lpips::Metric;
use crate::math::digraph::Digraph;
use crate::scene::person::PersonCapture;
use crate::{Error, Result};
use data_gen::figure::graph::Graph;
use lastlight_last::avatar::settings::Settings;
use lastlight_last::figure::Rendering;
use lastlight_last::generate;
use lastlight_last::model::encoder::Input;
use lastlight_last::model::file::Trained;
use lastlight_last::model::settings::Supervision;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Sizes of subjects and fits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// side of the images in pixels
    pub side: usize,
    /// frames of the video
    pub frames: usize,
    /// number of test cameras
    pub cameras: usize,
    /// number of points of the template
    pub points: usize,
    /// maximum number of Gaussians
    pub gaussians: usize,
    /// iterations of a fit
    pub iterations: usize,
    /// number of subjects
    pub subjects: u64,
    /// maximum number of candidates of each constant in the search, and of values in E5 and E7
    pub candidates: usize,
    /// steps of tuning in E9
    pub tuning: u32,
}

impl Size {
    /// Sizes of the complete study.
    pub fn full() -> Self {
        Self {
            side: 64,
            frames: 40,
            cameras: 8,
            points: 1024,
            gaussians: 4000,
            iterations: 600,
            subjects: 6,
            candidates: usize::MAX,
            tuning: 500,
        }
    }

    /// Sizes for a quick overview.
    pub fn quick() -> Self {
        Self {
            frames: 20,
            cameras: 4,
            points: 512,
            gaussians: 1500,
            iterations: 120,
            subjects: 2,
            candidates: 5,
            tuning: 100,
            ..Self::full()
        }
    }

    /// Sizes for a smoke test.
    pub fn smoke() -> Self {
        Self {
            frames: 3,
            cameras: 1,
            points: 128,
            gaussians: 300,
            iterations: 24,
            candidates: 3,
            tuning: 3,
            ..Self::quick()
        }
    }

    pub(super) fn record(&self) -> Value {
        json!({ "side": self.side, "frames": self.frames, "cameras": self.cameras, "points": self.points })
    }

    /// Settings of the host at this size.
    pub fn baseline(&self) -> Settings {
        Settings { iterations: self.iterations, max_gaussians: self.gaussians, ..Settings::baseline() }
    }

    /// At most `candidates` items of a list, from its first to its last.
    pub(super) fn some<T: Clone>(&self, list: &[T]) -> Vec<T> {
        let n = Ord::max(2, Ord::min(list.len(), self.candidates));
        (0..n).map(|i| list[i * (list.len() - 1) / (n - 1)].clone()).collect()
    }
}

/// A trained model and the graph of the data on which it was trained.
#[derive(Clone, Debug)]
pub struct Model {
    /// name of that graph
    pub graph: String,
    /// true graph A* over the blocks of the model; the supervision assigns a factor to each block
    pub truth: Digraph,
    /// digest of the trained model
    pub digest: String,
    /// the model
    pub trained: Trained,
}

impl Model {
    /// Makes a model for the graph of that name.
    ///
    /// # Errors
    /// No such graph; a model with another number of factors, without images as input, or trained without
    /// intervention targets.
    pub fn new(graph: &str, trained: Trained) -> Result<Self> {
        let n = trained.model.sizes.factors;
        let fail = |e: String| Error::input("--model").expected("GRAPH=FILE").got(e);
        let truth = Graph::named(graph, n, 0).map_err(fail)?.adjacency;
        if !matches!(trained.model.encoder.input(), Input::Picture { .. }) {
            return Err(Error::input("--model")
                .expected("a model trained on images")
                .got("a model trained on vectors"));
        }
        let supervision = trained.settings.supervision;
        if !matches!(supervision, Supervision::Groups | Supervision::Labels | Supervision::PerSample) {
            return Err(Error::input("--model")
                .expected("a model trained with supervision groups, pairs or labels, so that its blocks correspond to factors")
                .got(format!("supervision {}", supervision.name())));
        }
        Ok(Self {
            graph: graph.to_owned(),
            truth: Digraph::from_fn(n, |i, j| truth[i][j]),
            digest: trained.digest()?,
            trained,
        })
    }
}

/// Common inputs of all runs.
#[derive(Debug)]
pub struct Setup {
    /// sizes
    pub size: Size,
    /// one per graph; experiments with a single model use the first
    pub models: Vec<Model>,
    /// folder of the study
    pub dir: PathBuf,
    /// LPIPS with the digest of its weights, if available
    pub perception: Option<(Metric, u64)>,
}

impl Setup {
    /// The video of a subject; generated if it does not exist.
    ///
    /// # Errors
    /// When it cannot be generated or read.
    pub fn capture(&self, model: &Model, subject: u64) -> Result<PersonCapture> {
        let s = &self.size;
        let name = format!("{}-{subject}-{}x{}-{}-{}", model.graph, s.side, s.frames, s.cameras, s.points);
        let dir = self.dir.join("subjects").join(name);
        let settings = generate::Settings {
            set: "video".into(),
            graph: model.graph.clone(),
            factors: model.truth.n(),
            video_look: Rendering::Mesh,
            video_size: s.side,
            points: s.points,
            frames: s.frames,
            test_cameras: s.cameras,
            subject,
            ..generate::Settings::full()
        };
        generate::ensure(&settings, &dir)?;
        PersonCapture::open(&dir.join("video"))
    }
}
