//! Fits of a field: bits, resumption, what is refused, what an exact field scores.

mod boxes;
mod chunks;
mod fields;
mod refused;
mod resume;

use crate::ball;
use lastlight::fit::field::{FieldFit, Materials, Settings, Targets};
use lastlight::fit::training::{self, Fit, History, Schedule};
use lastlight::num::array::Arrays;
use lastlight::num::bits::{self, Digest};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Iterations of the fits here; planes grow after half of them.
const ITERATIONS: usize = 50;

fn settings() -> Settings {
    Settings {
        iterations: ITERATIONS,
        seed: 4,
        side: 16,
        channels: 4,
        samples: 24,
        crop: 16,
        crops: 2,
        inverse_beta: [20.0, 80.0],
        materials: Materials::Passes,
        eikonal: 1e-3,
        ..Settings::default()
    }
}

fn targets() -> Targets {
    ball::targets(5, 20)
}

/// A fit without its first iteration.
fn new(settings: Settings, targets: &Targets) -> FieldFit<'_> {
    FieldFit::new(settings, targets, None, None).expect("valid settings")
}

/// Digest of the complete state.
fn digest(fit: &FieldFit<'_>) -> u64 {
    let mut state = Arrays::new();
    fit.save(&mut state);
    let mut all = Digest::new();
    for (name, array) in &state.0 {
        all.bytes(name.as_bytes());
        all.u64(bits::digest(array).expect("finite"));
    }
    all.value()
}

/// Runs the iterations that are missing, with a checkpoint at the end.
fn finish(fit: &mut FieldFit<'_>, history: &mut History, checkpoint: Option<&Path>) {
    let stop = AtomicBool::new(false);
    training::run(fit, history, Schedule { checkpoint, every: 1000, stop: &stop }, &mut ()).expect("runs");
}
