//! Tests of the source itself: the arrows between its parts.

mod adjoints;
mod arithmetic;
mod cycles;
mod exceptions;
mod functions;
mod levels;
mod modules;
mod reader;

/// The repository, from this package.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
