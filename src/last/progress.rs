//! How a long run reports its progress and is stopped.

use crate::{Error, Result};
use std::sync::atomic::{AtomicBool, Ordering};

/// Counts finished pieces of work: done, total, of what.
pub type Progress<'a> = dyn FnMut(usize, usize, &str) + 'a;

/// An error when the user asked to stop.
pub(super) fn check_stop(stop: &AtomicBool) -> Result<()> {
    if stop.load(Ordering::Relaxed) {
        return Err(Error::interrupted("last gen").hint("continue with --resume"));
    }
    Ok(())
}
