//! A note of the commands that use a model: its graph has no edges.

use crate::meter::Meter;
use crate::report::thousands;
use lastlight_last::model::file::Trained;
use lastlight_last::model::settings as model;

/// Notes that the graph of a model has no edges, and how long the model was trained.
pub(super) fn note_empty_graph(trained: &Trained, meter: &Meter) {
    if !trained.graph.edges().is_empty() {
        return;
    }
    let all = |s: &model::Settings| thousands(s.steps as usize + s.refit as usize);
    meter.note(&format!(
        "the graph of the model has no edges: no factor affects another (the model was trained for {} iterations; the default of last \
         pretrain is {})",
        all(&trained.settings),
        all(&model::Settings::default())
    ));
}
