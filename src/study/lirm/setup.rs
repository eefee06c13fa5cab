//! What the experiments share.

use crate::experiment::{Cell, Experiment, Summary, Values};
use crate::io::memory;
use crate::num::elem::f64 as elem;
use crate::num::order;
use crate::scene::field::Placement;
use crate::{Error, Result};
use data_gen::cameras;
use lastlight_lirm::evaluate::{
    Control, Numbers, Order, Protocol, SET, Typical, settings, typical_materials,
};
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::decode::Rendering;
use lastlight_lirm::model::file::{Model, digest};
use lastlight_lirm::model::origin::training_seed;
use lastlight_lirm::model::params::count;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::subject::Subject;
use lastlight_lirm::views::Views;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Seed of the objects that are scored: trainings have 0, choices 1.
pub const SEED: u64 = 2;
/// Objects whose images are kept, at least and at most: cells with the same object follow each other, and
/// experiments use the same objects.
const KEPT: [u64; 2] = [4, 52];
/// Bytes of the 48 images of an object of 128² pixels: colours, photo, foreground and passes, without radiance.
const OBJECT_BYTES: u64 = 54 << 20;
/// Part of the memory limit that images may take.
const PART: u64 = 4;
/// Counts changes of what the cells compute: results of another number are not used again.
pub(super) const REVISION: u32 = 5;

/// Objects whose images are kept under the limit of memory.
fn most_kept() -> u64 {
    let [least, most] = KEPT;
    (memory::limit() / PART / OBJECT_BYTES).clamp(least, most)
}

/// Sizes of the runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Objects.
    pub objects: u64,
    /// Samples per pixel of their images.
    pub samples: u32,
    /// Outputs of an object that are compared.
    pub outputs: usize,
    /// Steps of a ray.
    pub steps: usize,
    /// Steps of the trainings of [`super::variants`], objects of a step, and objects in memory.
    pub training: [usize; 3],
}

impl Size {
    /// Sizes of the complete study.
    pub fn full() -> Self {
        Self { objects: 24, samples: 64, outputs: 12, steps: 128, training: [1250, 8, 100] }
    }

    /// Sizes for a quick overview.
    pub fn quick() -> Self {
        Self { objects: 3, samples: 8, outputs: 6, steps: 96, training: [100, 4, 24] }
    }

    /// Sizes for a smoke test.
    pub fn smoke() -> Self {
        Self { objects: 1, samples: 1, outputs: 1, steps: 16, training: [1, 1, 1] }
    }
}

/// A model with its name in tables.
#[derive(Debug)]
pub struct NamedModel {
    /// The last stage that made it.
    pub name: String,
    /// The model.
    pub model: Model,
    /// The digest of its weights.
    pub digest: String,
}

impl NamedModel {
    /// Names a model by its last stage.
    pub fn new(model: Model) -> Self {
        let name = model.stages().last().map_or_else(|| "first values".to_owned(), |s| format!("stage {s}"));
        let digest = digest(&model.params);
        Self { name, model, digest }
    }
}

/// The images of objects that were made last, by number and version.
type Kept = Vec<((u64, Version), Arc<Views>)>;

/// Models, sizes and images.
#[derive(Debug)]
pub struct Setup {
    /// Sizes of the runs.
    pub size: Size,
    /// The model that is scored is the last.
    pub models: Vec<NamedModel>,
    kept: Mutex<Kept>,
    typical: Mutex<BTreeMap<Version, Typical>>,
}

impl Setup {
    /// Begins without images.
    ///
    /// # Errors
    /// If there is no model.
    pub fn new(size: Size, mut models: Vec<NamedModel>) -> Result<Self> {
        if models.is_empty() {
            return Err(Error::input("--model").expected("at least one model").got("none"));
        }
        // Rows of tables are found by their names.
        let names: Vec<String> = models.iter().map(|m| m.name.clone()).collect();
        for (i, model) in models.iter_mut().enumerate() {
            let before = names[..i].iter().filter(|name| **name == names[i]).count();
            if before > 0 {
                model.name += &format!(" ({})", before + 1);
            }
        }
        Ok(Self { size, models, kept: Mutex::default(), typical: Mutex::default() })
    }

    /// The model that is scored.
    pub fn model(&self) -> &Model {
        &self.models[self.models.len() - 1].model
    }

    /// How a model is scored, without the comparison of materials.
    pub fn protocol(&self, model: &Model, version: Version) -> Protocol {
        Protocol {
            set: settings(SEED, self.size.samples),
            version,
            order: Order::Random,
            rendering: Rendering::of_field(self.size.steps, model.inverse_beta()),
            control: Control::None,
            sets: 4,
            outputs: self.size.outputs,
            typical: None,
            baselines: false,
            shapes: false,
        }
    }

    /// The images of object `k` of the test set.
    ///
    /// # Errors
    /// Those of the rendering.
    pub fn object(&self, k: u64, version: Version) -> Result<Arc<Views>> {
        let key = (k, version);
        let find = |kept: &Kept| kept.iter().find(|(own, _)| *own == key).map(|(_, views)| views.clone());
        if let Some(views) = find(&self.kept.lock().unwrap_or_else(PoisonError::into_inner)) {
            return Ok(views);
        }
        let mut views = Views::rendered(&settings(SEED, self.size.samples), k, version)?;
        // No experiment compares it: the scores of linear values are left out.
        views.all.iter_mut().for_each(|view| view.picture.passes.radiance = None);
        let views = Arc::new(views);
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() as u64 >= most_kept() {
            kept.remove(0);
        }
        kept.push((key, views.clone()));
        Ok(views)
    }

    /// Typical materials of training objects; of those of seed 0 for a model that was trained with others.
    ///
    /// # Errors
    /// Those of the rendering.
    pub fn typical(&self, version: Version) -> Result<Typical> {
        let mut all = self.typical.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(typical) = all.get(&version) {
            return Ok(*typical);
        }
        let typical = typical_materials(training_seed(&self.model().training).unwrap_or_default(), version)?;
        all.insert(version, typical);
        Ok(typical)
    }

    /// Reads the first sets of an object's test views in random order; returns the state, and the place of the object.
    ///
    /// # Errors
    /// When the images do not show which direction is up.
    pub fn read(
        &self,
        ready: &Ready<'_>,
        views: &Views,
        k: u64,
        sets: usize,
    ) -> Result<(Vec<f32>, Placement)> {
        let inputs = cameras::test(SEED, k, settings(SEED, self.size.samples).size).inputs;
        let place = views.posed(ready.config.pose, &inputs[..SET])?;
        let mut state = ready.no_state();
        for set in inputs.chunks(SET).take(sets) {
            state = ready.read_chosen(&state, views, set, &place)?;
        }
        Ok((state, place))
    }

    /// The bytes that models and the images of objects need.
    pub fn memory(&self) -> u64 {
        let weights = self.models.iter().fold(0, |sum, m| sum + 4 * count(&m.model.config) as u64);
        weights + most_kept() * OBJECT_BYTES
    }

    /// Object `k` of the test set.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn subject(&self, k: u64) -> Result<Subject> {
        Subject::new(&settings(SEED, self.size.samples), k)
    }

    /// The settings that a result depends on.
    pub fn record(&self, model: &Model) -> Value {
        json!({
            "model": digest(&model.params), "configuration": model.config.json(), "inverse_beta": model.inverse_beta(),
            "samples": self.size.samples, "outputs": self.size.outputs, "steps": self.size.steps,
            "seed": SEED, "revision": REVISION,
            "lastlight": env!("CARGO_PKG_VERSION"),
        })
    }
}

/// Whether all cells have results: a criterion is not evaluated on a part of them.
pub(super) fn is_complete(x: &dyn Experiment, results: &[(Cell, Values)]) -> bool {
    results.len() == x.cells().len()
}

/// Numbers of all rounds as values of a cell, `NAME_1` and so on.
pub fn values(rounds: &[Numbers]) -> Values {
    let numbered = |(r, numbers): (usize, &Numbers)| {
        numbers.iter().map(move |(name, x)| (format!("{name}_{}", r + 1), *x)).collect::<Vec<_>>()
    };
    rounds.iter().enumerate().flat_map(numbered).collect::<BTreeMap<_, _>>()
}

/// A mean with its interval, for a table.
pub fn shown(s: &Summary, digits: usize) -> String {
    match s.count {
        0 => "–".into(),
        1 => format!("{:.digits$}", s.mean),
        _ => format!("{:.digits$} ± {:.digits$}", s.mean, s.half_width),
    }
}

/// The mean squared difference of the colours of some pixels; `None` without any.
pub(super) fn square_error(image: &[f32], truth: &[f32], pixels: &[usize]) -> Option<f64> {
    let square = |i: &usize| {
        (0..3).fold(0.0, |sum, c| {
            let d = f64::from(image[3 * i + c]) - f64::from(truth[3 * i + c]);
            sum + d * d
        })
    };
    let sum = pixels.iter().map(square).fold(0.0, |sum, x| sum + x);
    (!pixels.is_empty()).then(|| sum / (3 * pixels.len()) as f64)
}

/// A mean squared difference of colours in 0..1, in dB.
pub(super) fn decibels(mean: f64) -> f64 {
    -10.0 * elem::log10(order::max(mean, 1e-12))
}
