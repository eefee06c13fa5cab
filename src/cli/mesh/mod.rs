//! `mesh render | compare | view`: any glTF, OBJ or PLY mesh under any light, how far two surfaces are apart, and a page about one.
//!
//! Arguments are turned into records of `fit`, `scene` and `geometry`, results into files and tables; nothing is computed here.

mod compare;
mod page;
pub(crate) mod render;
mod sheets;
mod view;

use crate::Result;
use clap::Subcommand;

/// Triangle meshes.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Render a glTF, OBJ or PLY mesh under an environment map, with all passes
    Render(Box<render::Args>),
    /// Compare two surfaces: Chamfer distance, normals, distances to the mesh
    Compare(compare::Args),
    /// Write a page about a mesh: turntable, texture sheets, maps, facts
    View(view::Args),
}

/// Runs one of them.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Render(args) => render::run(args),
        Command::Compare(args) => compare::run(args),
        Command::View(args) => view::run(args),
    }
}
