//! Training of LIRM on a miniature.

mod same;
mod steps;

use lastlight::fit::training::{History, Schedule, run};
use lastlight::lirm::r#gen::Version;
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::file::digest;
use lastlight::lirm::train::distances::Distances;
use lastlight::lirm::train::optimizer::Kind;
use lastlight::lirm::train::source::{BuiltInObjects, Scene, Source};
use lastlight::lirm::train::stage::{Stage, USES};
use lastlight::lirm::train::{Settings, Training};
use lastlight::lirm::views::Views;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// Objects that are rendered once for all trainings of a test.
#[derive(Debug)]
struct Kept {
    of: BuiltInObjects,
    made: Mutex<BTreeMap<(u64, Version), Views>>,
    added: Mutex<BTreeMap<(u64, Version, bool), [Scene; 2]>>,
}

impl Kept {
    fn new() -> Self {
        Self { of: BuiltInObjects::new(0), made: Mutex::default(), added: Mutex::default() }
    }
}

impl Source for Kept {
    fn object(&self, k: u64, version: Version) -> lastlight::Result<Views> {
        let mut made = self.made.lock().expect("no panic");
        if let Some(views) = made.get(&(k, version)) {
            return Ok(views.clone());
        }
        let views = self.of.object(k, version)?;
        made.insert((k, version), views.clone());
        Ok(views)
    }

    fn distances(&self, k: u64) -> lastlight::Result<Distances> {
        self.of.distances(k)
    }

    fn record(&self) -> String {
        self.of.record()
    }

    fn seed(&self) -> Option<u64> {
        self.of.seed()
    }

    fn added(&self, k: u64, version: Version, is_compared: bool) -> lastlight::Result<[Scene; 2]> {
        let mut made = self.added.lock().expect("no panic");
        if let Some(scenes) = made.get(&(k, version, is_compared)) {
            return Ok(scenes.clone());
        }
        let scenes = self.of.added(k, version, is_compared)?;
        made.insert((k, version, is_compared), scenes.clone());
        Ok(scenes)
    }
}

const TINY: Config =
    Config { blocks: 2, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 2, channels: 4, ..Config::SMALL };

fn settings(stage: &str, steps: usize) -> Settings {
    let stage = Stage::named(stage).expect("a name");
    let stage = Stage { steps, samples: 24, rise: 2, target: [64, 16], ..stage };
    Settings {
        stage,
        optimizer: Kind::AdamW,
        head_rate: 1.0,
        seed: 0,
        batch: 2,
        block: 2,
        uses: USES,
        at_once: 2,
        recompute: false,
        average_last: 0,
        start_share: 0.0,
    }
}

fn whole(training: &mut Training<'_>) -> String {
    let (mut history, stop) = (History::default(), AtomicBool::new(false));
    let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
    run(training, &mut history, schedule, &mut ()).expect("finite");
    digest(training.params())
}
