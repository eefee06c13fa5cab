//! The model of the commands that use one.

use crate::meter::Meter;
use crate::scene::field::INVERSE_BETA;
use crate::{Error, Result};
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
    let model = shipped::objects();
    meter.note(&format!("model {}, trained in stages {}", shipped::NAME, model.stages().join(", ")));
    Ok((model, shipped::NAME.to_owned()))
}

/// The 1/β of a command: the given one, or that of the model.
///
/// # Errors
/// If it is out of the range of a field.
pub(super) fn inverse_beta(given: Option<f32>, model: &Model) -> Result<f32> {
    let [least, most] = INVERSE_BETA;
    match given.filter(|x| !(least..=most).contains(x)) {
        Some(x) => {
            let e = Error::input("--inverse-beta").expected(format!("{least} to {most}"));
            Err(e.got(x.to_string()))
        }
        None => Ok(given.unwrap_or_else(|| model.inverse_beta())),
    }
}
