//! The field of a fit, and how its images are read.

use crate::num::order;
use crate::scene::field::{FILE, Field};
use crate::scene::views::{Masks, Options, SceneBox};
use crate::splat::fit::parse_box;
use crate::{Error, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The file of a field: itself, or that in the folder of a fit.
fn field_file(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(FILE) } else { path.to_path_buf() }
}

/// Reads a field.
pub(crate) fn field(path: &Path) -> Result<Field> {
    let file = field_file(path);
    if path.is_dir() && !file.is_file() {
        return Err(Error::input(path.display().to_string())
            .expected(format!("the folder of a fit, with {FILE}"))
            .got("a folder without it")
            .hint("an interrupted fit is continued with --resume"));
    }
    Field::read(&file)
}

/// The factor from radiance to the images that a fit was made with, from the record beside its field.
pub(crate) fn exposure_of(path: &Path) -> Option<f64> {
    let record = field_file(path).with_file_name(crate::training::RESULT);
    let record: Value = serde_json::from_slice(&std::fs::read(record).ok()?).ok()?;
    record["exposure"].as_f64()
}

/// The cube around a box that is given as a text.
pub(crate) fn cube(text: &str) -> Result<SceneBox> {
    let [low, high] = parse_box(text)?.map(|corner| corner.map(f64::from));
    let widest = (0..3).fold(0.0, |most, k| order::max(most, high[k] - low[k]));
    let center = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
    Ok(SceneBox { center, half_size: 0.5 * widest })
}

/// How the images of a capture are read.
pub(crate) fn options(downscale: u8, outside: bool) -> Options {
    Options {
        background: [1.0; 3],
        downscale: usize::from(downscale),
        masks: Masks::Ignore,
        outside,
        ..Options::default()
    }
}
