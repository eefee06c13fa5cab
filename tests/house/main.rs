//! Tests of the source itself: the dependences between its parts, and the examples of its operators.

mod adjoints;
mod arithmetic;
mod cycles;
mod examples;
mod exceptions;
mod functions;
mod levels;
mod modules;
mod reader;

/// The repository, from this package.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
