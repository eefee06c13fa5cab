//! The model included in the program, trained on the built-in objects; `reference/weights/README.md` gives
//! the commands that reproduce it, how far its training has come, and its digest.

use super::file::Model;

/// Name of its file, for messages and records.
pub const NAME: &str = "objects64.safetensors";

/// Contents of the file, compiled into the program. It is included here and not by `reference`, whose sources
/// decide bits of operators: a new model would ask for the whole bit matrix.
pub const BYTES: &[u8] = include_bytes!("../../../reference/weights/objects64.safetensors");

/// Reads the model.
///
/// # Panics
/// Never: a test reads the included file (`tests/commands/weights.rs`).
pub fn objects() -> Model {
    Model::from_bytes(BYTES, NAME).expect("the included file is a model")
}
