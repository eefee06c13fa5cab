//! The model that comes with the program, for the built-in figure: `reference/weights/README.md` says how it was made, with which digest.

use super::file::Trained;
use crate::Result;

/// Name of its file, for messages.
pub const NAME: &str = "figure64.safetensors";

/// Its bytes, part of the program.
pub const BYTES: &[u8] = reference::weights::FIGURE64;

/// Reads it.
///
/// # Errors
/// Never for the file that was built in.
pub fn figure() -> Result<Trained> {
    Trained::from_bytes(BYTES, NAME)
}
