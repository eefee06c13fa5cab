//! A capture: photographs with poses and lenses, as plain records, from any layout that is read.

pub use super::frame::{Capture, Dialect, Focal, Frame, Lens, Passes, Split, nearest_rotation, rigid};
pub use super::paths::{clean, locate};
use super::{colmap, transforms};
use crate::{Error, Result};
use std::path::Path;

/// Reads a capture: a `transforms.json`, a folder with one (or with `transforms_train.json`), or a folder with a COLMAP
/// model in `.`, `sparse/0`, `sparse`, `dense/0/sparse` or `dense/sparse`.
///
/// # Errors
/// When no layout is recognised, a file is malformed or missing, or a lens is not supported.
pub fn read_capture(path: &Path) -> Result<Capture> {
    let mut capture = if path.is_file() || transforms::file_in(path).is_some() {
        transforms::read(path)?
    } else if let Some(model) = colmap::find(path) {
        colmap::read_model(&model)?
    } else {
        let what = if path.is_dir() { "a folder without them" } else { "nothing there" };
        return Err(Error::input(path.display().to_string())
            .expected("a capture: transforms.json, transforms_train.json, or a COLMAP model (cameras.bin or cameras.txt)")
            .got(what));
    };
    capture.frames.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(pair) = capture.frames.windows(2).find(|w| w[0].name == w[1].name) {
        let e = Error::input(path.display().to_string()).at(format!("frame '{}'", pair[0].name));
        return Err(e.expected("every picture once").got("two entries"));
    }
    if capture.frames.is_empty() {
        return Err(Error::input(path.display().to_string()).expected("at least one frame").got("none"));
    }
    Ok(capture)
}
