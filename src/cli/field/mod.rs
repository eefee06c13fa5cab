//! `field fit | eval | mesh | import`: one object as a field, from posed images to a relightable mesh.
//!
//! Arguments are turned into records of `fit::field`, results into files and reports; nothing is computed here.

mod eval;
mod fit;
mod import;
mod mesh;
mod page;
mod scoring;

use crate::Error;
use crate::Result;
use crate::scene::field::{FILE, Field};
use clap::Subcommand;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// One object as a field.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Fit a field to the images of one object
    Fit(fit::Args),
    /// Score a field on the images of a capture
    Eval(eval::Args),
    /// Make a textured mesh of a field
    Mesh(mesh::Args),
    /// Make a capture of one object from a data set in a published layout
    Import(import::Args),
}

/// Runs one of them.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Fit(args) => fit::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Mesh(args) => mesh::run(args),
        Command::Import(args) => import::run(args),
    }
}

/// The file of a field: itself, or that in the folder of a fit.
fn field_file(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(FILE) } else { path.to_path_buf() }
}

/// Reads a field.
fn read(path: &Path) -> Result<Field> {
    let file = field_file(path);
    if path.is_dir() && !file.is_file() {
        return Err(Error::input(path.display().to_string())
            .expected(format!("the folder of a fit, with {FILE}"))
            .got("a folder without it")
            .hint("an interrupted fit is continued with --resume"));
    }
    Field::read(&file)
}

/// The factor from radiance to the images that a fit was made with, from the record beside its field.
fn exposure_of(path: &Path) -> Option<f64> {
    let record = field_file(path).with_file_name(crate::training::RESULT);
    let record: Value = serde_json::from_slice(&std::fs::read(record).ok()?).ok()?;
    record["exposure"].as_f64()
}
