//! The model included in the program, trained on the built-in figure; `reference/weights/README.md` gives the
//! command that reproduces it and its digest.

use super::file::Trained;
use crate::Result;
use data_gen::figure::skeleton::bones;

/// Name of its file, for messages.
pub const NAME: &str = "figure64.safetensors";

/// Contents of the file, compiled into the program.
pub const BYTES: &[u8] = reference::weights::FIGURE64;

/// Reads the model; its skeleton is that of the figure.
///
/// # Errors
/// Never for the included file.
pub fn figure() -> Result<Trained> {
    let skeleton = bones().iter().map(|b| b.parent.map_or(-1, |p| p as i64)).collect();
    Ok(Trained { skeleton, ..Trained::from_bytes(BYTES, NAME)? })
}
