//! Progress reports and interruption of a long run.

use crate::{Error, Result};
use std::sync::atomic::{AtomicBool, Ordering};

/// A function that reports progress: completed units, total, name of the unit.
pub type Progress<'a> = dyn FnMut(usize, usize, &str) + 'a;

/// Returns an error if the user requested an interruption.
pub(super) fn check_stop(stop: &AtomicBool) -> Result<()> {
    if stop.load(Ordering::Relaxed) {
        return Err(Error::interrupted("last gen").hint("continue with --resume"));
    }
    Ok(())
}
