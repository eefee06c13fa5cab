//! Scenes of Gaussians from file to file: `.ply`, `.splat`, `.npz` by extension.

use super::gaussians::Gaussians;
use crate::io::{gaussian_ply, npz, splat_file};
use crate::num::array::Arrays;
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
            other => {
                let got = if other.is_empty() { "none".to_owned() } else { format!(".{other}") };
                let e = Error::input(path.display().to_string()).at("extension");
                let e = e.expected(".ply, .splat or .npz").got(got);
                Err(match other {
                    "spz" | "sog" | "ksplat" | "lcc" => e.hint(format!(
                        "convert it to PLY, for example with `splat-transform SCENE.{other} SCENE.ply`, or in SuperSplat: export PLY"
                    )),
                    "usdz" | "usd" | "usda" | "usdc" => {
                        e.hint("export the scene as 3DGS PLY from the program that wrote it")
                    }
                    "obj" | "gltf" | "glb" => e.hint("`lastlight mesh render` renders meshes"),
                    _ => e,
                })
            }
        }
    }
}

/// What is done with Gaussians that are not valid: a zero quaternion, NaN, a number out of range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Invalid {
    /// The file is refused.
    #[default]
    Refuse,
    /// They are left out.
    Drop,
}

/// Reads and validates a scene.
///
/// # Errors
/// When the extension is unknown or the file is invalid; the hint states how many Gaussians are not valid.
pub fn read_scene(path: &Path) -> Result<Gaussians> {
    let name = path.display().to_string();
    let scene = match SceneFormat::of(path)? {
        SceneFormat::Ply => gaussian_ply::read(path).and_then(|r| Gaussians::from_record(r, &name)),
        SceneFormat::Splat => splat_file::read(path).and_then(|s| Gaussians::from_splats(&s, &name)),
        SceneFormat::Npz => arrays(path).and_then(|a| Gaussians::from_arrays(&a, &name)),
    };
    scene.map_err(|e| match valid_part(path) {
        Ok((_, dropped)) if dropped > 0 => e.hint(format!(
            "with --drop-invalid, convert and splat render leave out {dropped} such Gaussians"
        )),
        _ => e,
    })
}

/// Reads a scene; returns it and the number of Gaussians that were left out.
///
/// # Errors
/// See [`read_scene`]; when no valid Gaussian is left.
pub fn read_scene_with(path: &Path, invalid: Invalid) -> Result<(Gaussians, usize)> {
    if invalid == Invalid::Refuse {
        return Ok((read_scene(path)?, 0));
    }
    let (scene, dropped) = valid_part(path)?;
    if scene.is_empty() && dropped > 0 {
        let e = Error::input(path.display().to_string()).expected("at least one valid Gaussian");
        return Err(e.got(format!("{dropped} that are not valid")));
    }
    Ok((scene, dropped))
}

/// The valid Gaussians of a file, and the number of others.
fn valid_part(path: &Path) -> Result<(Gaussians, usize)> {
    let mut scene = match SceneFormat::of(path)? {
        SceneFormat::Ply => Gaussians::from_record_unchecked(gaussian_ply::read_unchecked(path)?),
        SceneFormat::Splat => {
            Gaussians::from_record_unchecked(splat_file::to_gaussians(&splat_file::read_unchecked(path)?))
        }
        SceneFormat::Npz => Gaussians::from_arrays_unchecked(&arrays(path)?, &path.display().to_string())?,
    };
    let dropped = scene.drop_invalid();
    Ok((scene, dropped))
}

/// The arrays of a file that describe Gaussians; others are not read.
fn arrays(path: &Path) -> Result<Arrays> {
    npz::read_some(path, &["means", "quats", "scales", "opacities", "sh", "rgb"])
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
    Ok(convert_with(from, to, Invalid::Refuse)?.0)
}

/// Like [`convert`]; also returns the number of Gaussians that were left out.
///
/// # Errors
/// See [`read_scene_with`] and [`write_scene`].
pub fn convert_with(from: &Path, to: &Path, invalid: Invalid) -> Result<(Gaussians, usize)> {
    SceneFormat::of(to)?;
    let (g, dropped) = read_scene_with(from, invalid)?;
    let comments = match SceneFormat::of(from)? {
        SceneFormat::Ply if SceneFormat::of(to)? == SceneFormat::Ply => {
            gaussian_ply::read_unchecked(from)?.comments
        }
        _ => Vec::new(),
    };
    write_scene(to, &g, &comments)?;
    Ok((g, dropped))
}
