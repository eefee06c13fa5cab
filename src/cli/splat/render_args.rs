//! How to render: the options that all three commands have.

use crate::choices::{PROFILES, choices};
use crate::scene::profile::Profile;
use crate::{Error, Result};
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use lastlight_kernels::splat::render::Settings;

/// How to render; the same options for all three commands.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct RenderArgs {
    /// Semantics of the renderer
    #[arg(long, value_name = "NAME", default_value = "exact", value_parser = choices(PROFILES))]
    pub(super) profile: String,
    /// Side of a tile in pixels; changes the speed, never a bit
    #[arg(long, value_name = "N", default_value = "16", value_parser = PossibleValuesParser::new(["8", "16", "32"]).try_map(|text| text.parse::<usize>()))]
    pub(super) tile: usize,
    /// Colour behind the scene, sRGB-encoded: R,G,B in 0..1, or black or white
    #[arg(long, value_name = "R,G,B", default_value = "black")]
    pub(super) background: String,
}

impl RenderArgs {
    /// Settings of the renderer and the background.
    ///
    /// # Errors
    /// When a name or a number is not one of those listed.
    pub(super) fn settings(&self) -> Result<(Settings, [f32; 3])> {
        let settings =
            Settings { profile: Profile::parse(&self.profile)?, tile: self.tile, ..Settings::default() };
        Ok((settings, color(&self.background)?))
    }
}

/// `R,G,B` in 0..1, or a name.
fn color(text: &str) -> Result<[f32; 3]> {
    let wrong =
        || Error::input("--background").expected("black, white, or R,G,B with numbers in 0..1").got(text);
    match text {
        "black" => Ok([0.0; 3]),
        "white" => Ok([1.0; 3]),
        _ => {
            let parts = numbers(text).ok_or_else(wrong)?;
            let rgb: [f32; 3] = parts.try_into().map_err(|_| wrong())?;
            if rgb.iter().all(|x| (0.0..=1.0).contains(x)) { Ok(rgb) } else { Err(wrong()) }
        }
    }
}

/// Finite numbers comma-separated.
pub(super) fn numbers(text: &str) -> Option<Vec<f32>> {
    text.split(',').map(|p| p.trim().parse::<f32>().ok().filter(|x| x.is_finite())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_names_or_three_numbers() {
        assert_eq!(color("white").ok(), Some([1.0; 3]), "a name");
        assert_eq!(color("0,0.5, 1").ok(), Some([0.0, 0.5, 1.0]), "three numbers");
        for bad in ["", "grey", "1,1", "1,1,1,1", "0,0,2", "0,NaN,0"] {
            assert!(color(bad).is_err(), "'{bad}' is refused");
        }
    }
}
