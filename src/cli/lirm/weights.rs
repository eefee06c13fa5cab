//! The model of the commands that use one.

use crate::Result;
use crate::meter::Meter;
use lastlight_lirm::model::file::Model;
use lastlight_lirm::model::shipped;
use std::path::Path;

/// The model of a command: the file, or the included one; with its name for records.
///
/// # Errors
/// If the file is not a model.
pub(crate) fn model(path: Option<&Path>, meter: &Meter) -> Result<(Model, String)> {
    if let Some(path) = path {
        return Ok((Model::read(path)?, path.display().to_string()));
    }
    let model = shipped::objects()?;
    meter.note(&format!("model {}, trained in stages {}", shipped::NAME, model.stages().join(", ")));
    Ok((model, shipped::NAME.to_owned()))
}
