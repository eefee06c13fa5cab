//! Tests of the source itself: the dependences between its parts, the examples of its operators, and the
//! language of its texts.

mod adjoints;
mod arithmetic;
mod cycles;
mod examples;
mod exceptions;
mod functions;
mod language;
mod levels;
mod modules;
mod prose;
mod reader;

/// The repository, from this package.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
