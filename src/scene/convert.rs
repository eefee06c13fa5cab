//! Scenes of Gaussians from file to file: `.ply`, `.splat`, `.npz` by extension.

use super::gaussians::Gaussians;
use crate::io::{gaussian_ply, npz, splat_file};
use crate::{Error, Result};
use std::path::Path;

/// The formats a scene is read from and written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneFormat {
    /// 3DGS PLY: all parameters
    Ply,
    /// `.splat`: degree 0, quantised, sorted
    Splat,
    /// the arguments of `splat.render`
    Npz,
}

impl SceneFormat {
    /// By the extension of a path, in any case.
    ///
    /// # Errors
    /// When it is another one.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "ply" => Ok(Self::Ply),
            "splat" => Ok(Self::Splat),
            "npz" => Ok(Self::Npz),
            other => Err(Error::input(path.display().to_string())
                .at("extension")
                .expected(".ply, .splat or .npz")
                .got(if other.is_empty() { "none".to_owned() } else { format!(".{other}") })),
        }
    }
}

/// Reads and validates a scene.
///
/// # Errors
/// When the extension is unknown or the file is bad.
pub fn read_scene(path: &Path) -> Result<Gaussians> {
    let name = path.display().to_string();
    match SceneFormat::of(path)? {
        SceneFormat::Ply => Gaussians::from_record(gaussian_ply::read(path)?, &name),
        SceneFormat::Splat => Gaussians::from_splats(&splat_file::read(path)?, &name),
        SceneFormat::Npz => Gaussians::from_arrays(&npz::read(path)?, &name),
    }
}

/// Writes a scene atomically. `comments` go into the header of a PLY and nowhere else.
///
/// # Errors
/// When the extension is unknown or the file cannot be written.
pub fn write_scene(path: &Path, g: &Gaussians, comments: &[String]) -> Result<()> {
    match SceneFormat::of(path)? {
        SceneFormat::Ply => gaussian_ply::write(path, &g.to_record(comments)),
        SceneFormat::Splat => splat_file::write(path, &g.to_splats(&path.display().to_string())?),
        SceneFormat::Npz => npz::write(path, &g.to_arrays()),
    }
}

/// Converts a scene; returns the scene that was read. The output's extension is checked before the input is
/// read.
///
/// # Errors
/// See [`read_scene`] and [`write_scene`].
pub fn convert(from: &Path, to: &Path) -> Result<Gaussians> {
    SceneFormat::of(to)?;
    let g = read_scene(from)?;
    let comments = match SceneFormat::of(from)? {
        SceneFormat::Ply if SceneFormat::of(to)? == SceneFormat::Ply => gaussian_ply::read(from)?.comments,
        _ => Vec::new(),
    };
    write_scene(to, &g, &comments)?;
    Ok(g)
}
