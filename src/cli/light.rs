//! A light from the command line: a panorama of the user's, or a built-in one, and how it is turned.

use crate::choices::{ENV_AXES, choices};
use crate::io;
use crate::scene::environment_file::{self, Options, Orientation};
use crate::scene::from_data_gen;
use crate::scene::light::Environment;
use crate::scene::material::Transfer;
use crate::shade::axes;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::Path;

/// Names of the built-in environments, in the order of `data_gen::environments::KINDS`.
const BUILT_IN: [&str; 6] = ["sky", "sunset", "overcast", "studio", "indoor", "night"];

/// Rows of the axes map.
const AXES_ROWS: usize = 256;

/// The built-in studio.
pub(crate) fn studio() -> Environment {
    from_data_gen::environment(&data_gen::environments::make(0, 3, 1024, 512))
}

/// How the map of `--env` is read.
#[derive(clap::Args)]
pub(crate) struct MapArgs {
    /// Orientation of the panorama's axes
    #[arg(long, value_name = "NAME", default_value = "ours", value_parser = choices(ENV_AXES))]
    env_axes: String,
    /// Degrees the light turns about the vertical, counter-clockwise from above
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    env_rotate: f64,
    /// Factor of the light
    #[arg(long, value_name = "X", default_value_t = 1.0, allow_hyphen_values = true)]
    env_scale: f32,
    /// The panorama is a mirror image
    #[arg(long)]
    env_mirror: bool,
    /// Values of a PNG or JPEG panorama are linear, not sRGB-encoded
    #[arg(long)]
    env_linear: bool,
}

/// The text of `--env`, and how its map is read.
#[derive(Clone, Copy)]
pub(crate) struct Light<'a> {
    /// A panorama, or the name of a built-in light.
    pub(crate) env: &'a str,
    /// Options of the map.
    pub(crate) map: &'a MapArgs,
}

/// Where the light comes from.
enum Source<'a> {
    /// White from everywhere.
    Uniform,
    /// A built-in environment.
    BuiltIn(u64),
    /// The test map that colours the axes, as an image in our orientation.
    Axes,
    /// A panorama.
    File(&'a Path),
}

impl MapArgs {
    /// The first option that differs from its default.
    fn given(&self) -> Option<&'static str> {
        let all = [
            ("--env-axes", self.env_axes != "ours"),
            ("--env-rotate", self.env_rotate != 0.0),
            ("--env-scale", self.env_scale != 1.0),
            ("--env-mirror", self.env_mirror),
            ("--env-linear", self.env_linear),
        ];
        all.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// The map of an optional `--env`; built-in environments are those of `seed`.
    ///
    /// # Errors
    /// Those of [`Light::environment`], and options of a map without a light.
    pub(crate) fn environment(&self, env: Option<&str>, seed: u64) -> Result<Option<Environment>> {
        match (env, self.given()) {
            (Some(env), _) => Light { env, map: self }.environment(seed).map(Some),
            (None, Some(option)) => {
                Err(Error::input(option).expected("a light in --env, whose map it describes").got("no --env"))
            }
            (None, None) => Ok(None),
        }
    }
}

impl<'a> Light<'a> {
    fn source(self) -> Source<'a> {
        match self.env {
            "uniform" => Source::Uniform,
            "axes" => Source::Axes,
            name => match BUILT_IN.iter().position(|n| *n == name) {
                Some(k) => Source::BuiltIn(k as u64),
                None => Source::File(Path::new(name)),
            },
        }
    }

    fn options(self) -> Result<Options> {
        let map = self.map;
        let options = Options {
            orientation: Orientation::parse(&map.env_axes)?,
            mirror: map.env_mirror,
            rotate: map.env_rotate,
            scale: map.env_scale,
            transfer: if map.env_linear { Transfer::Linear } else { Transfer::Srgb },
            world_from_map: None,
        };
        options.validate()?;
        Ok(options)
    }

    /// The map in our orientation; built-in environments are those of `seed`.
    ///
    /// # Errors
    /// When an option is out of range or does not apply to this light, or the panorama cannot be used.
    pub(crate) fn environment(self, seed: u64) -> Result<Environment> {
        let (source, options) = (self.source(), self.options()?);
        let of_pictures = matches!(source, Source::File(_) | Source::Axes);
        let given = [
            ("--env-axes", options.orientation != Orientation::Ours, of_pictures),
            ("--env-mirror", options.mirror, of_pictures),
            ("--env-linear", self.map.env_linear, matches!(source, Source::File(_))),
        ];
        if let Some((name, ..)) = given.into_iter().find(|(_, given, has_a_meaning)| *given && !has_a_meaning)
        {
            return Err(Error::input(name)
                .expected("a panorama in --env, whose image it describes")
                .got(format!("the built-in light '{}'", self.env)));
        }
        let map = match source {
            Source::Uniform => environment_file::orient(Environment::constant([1.0; 3]), &options),
            Source::Axes => environment_file::orient(axes::map(AXES_ROWS), &options),
            Source::BuiltIn(k) => {
                let map = data_gen::environments::make(seed, k, 1024, 512);
                environment_file::orient(from_data_gen::environment(&map), &options)
            }
            Source::File(path) if !path.exists() => {
                return Err(Error::input("--env")
                    .expected(format!("an image, uniform, {}, axes", BUILT_IN.join(", ")))
                    .got(format!("'{}', which is not there", self.env)));
            }
            Source::File(path) => environment_file::read(path, &options)?,
        };
        map.validate("environment").map_err(|e| e.hint("--env-scale may be too large"))?;
        Ok(map)
    }

    /// For the record: a panorama by its name and digest, a built-in light by its name; then the options.
    ///
    /// # Errors
    /// When the panorama cannot be read.
    pub(crate) fn record(self) -> Result<Value> {
        let light = match self.source() {
            Source::File(path) => io::identity(path)?,
            _ => json!(self.env),
        };
        let (turn, scale) = (self.map.env_rotate, f64::from(self.map.env_scale));
        Ok(json!({
            "light": light, "axes": self.map.env_axes, "rotate_deg": turn, "scale": scale,
            "mirror": self.map.env_mirror, "linear": self.map.env_linear,
        }))
    }
}
