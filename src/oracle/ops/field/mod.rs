//! Fields of an object.

mod embed;
mod fetch;
mod heads;
mod reach;
mod render;
mod volume;

pub(super) use embed::EMBED;
pub(super) use fetch::FETCH;
pub(super) use heads::{NORMAL_HEAD, SDF_HEAD, VALUE_HEAD};
pub(super) use render::RENDER;
pub(super) use volume::{COMPOSITE, DENSITY, INTERVAL, NORMAL};

use super::op::CheckedCall;
use crate::{Error, Result};

/// The setting `half_size`.
fn half_size(x: &CheckedCall<'_>) -> Result<f32> {
    x.single("half_size", 0.525, |r| r > 0.0, "above 0")
}

/// Checks that no axis is empty.
fn check_sizes(x: &CheckedCall<'_>, array: &str, letters: &[&str]) -> Result<()> {
    match letters.iter().find(|letter| x.dim(letter) == 0) {
        None => Ok(()),
        Some(letter) => Err(Error::input(format!("array '{array}'"))
            .expected(format!("no empty axis ({letter})"))
            .got("an empty one")),
    }
}
