//! The sizes of a model.
//!
//! | setting | `paper` | `small` | |
//! |---|---|---|---|
//! | `blocks` | 24 | 6 | blocks of the transformer |
//! | `width` | 1024 | 256 | numbers per token |
//! | `heads` | 16 | 4 | of the attention |
//! | `planes` | 6 | 6 | 6: one per side of each axis; 3 |
//! | `plane_tokens` | 48 | 8 | tokens along a side of a plane; each becomes 8×8 texels |
//! | `embed_tokens` | 32 | 4 | tokens along a side of the square of four panoramas; 0: none, colours do not depend on direction |
//! | `channels` | 32 | 16 | of planes and panoramas |
//! | `material_layers` | 3 | 3 | hidden layers of the heads of albedo and material |
//! | `fuse` | published | residual | how the last state enters |
//! | `pose` | world | azimuth | axes of the field ([`Pose`]) |
//! | `first_values` | published | scaled | [`FirstValues`] |
//! | `rays` | plucker | nearest | coordinates of a ray ([`Rays`]) |
//! | `background` | white | marked | what an image has beside the object ([`Background`]) |
//! | `whole` | false | false | whether it reads photos, and has materials and colours that depend on direction: stages 2 and 3 |

pub use super::choices::{Background, FirstValues, Fuse, Rays};
use crate::fit::field::place::Pose;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Side of the square of pixels or texels of a token.
pub const PATCH: usize = 8;
/// Panoramas, of increasing roughness: a square of 2×2.
pub const LEVELS: usize = 4;
/// Units of the hidden layers of heads.
pub const HIDDEN: usize = 32;
/// Hidden layers of the heads of albedo and material where files have no number: that of the successor of LIRM.
const MATERIAL_LAYERS: usize = 3;
/// Added to the variance by every LayerNorm.
pub const EPS: f64 = 1e-6;

/// The sizes of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Blocks of the transformer.
    pub blocks: usize,
    /// Numbers per token, D.
    pub width: usize,
    /// Heads of the attention.
    pub heads: usize,
    /// Number of planes, 6 or 3.
    pub planes: usize,
    /// Tokens along a side of a plane.
    pub plane_tokens: usize,
    /// Tokens along a side of the square of panoramas; 0: there are none.
    pub embed_tokens: usize,
    /// Channels of planes and panoramas.
    pub channels: usize,
    /// Hidden layers of the heads of albedo and material.
    pub material_layers: usize,
    /// How the last state enters.
    pub fuse: Fuse,
    /// Axes of the field.
    pub pose: Pose,
    /// First values of weights and tokens.
    pub first_values: FirstValues,
    /// Coordinates of rays.
    pub rays: Rays,
    /// What images have beside the object.
    pub background: Background,
    /// Whether it reads photos, and gives materials and colours that depend on direction.
    pub is_whole: bool,
}

impl Config {
    /// The model of the paper; 326 million parameters.
    pub const PAPER: Self = Self {
        blocks: 24,
        width: 1024,
        heads: 16,
        planes: 6,
        plane_tokens: 48,
        embed_tokens: 32,
        channels: 32,
        material_layers: MATERIAL_LAYERS,
        fuse: Fuse::Published,
        pose: Pose::World,
        first_values: FirstValues::Published,
        rays: Rays::Plucker,
        background: Background::White,
        is_whole: false,
    };
    /// A model that two cores can train; 5.7 million parameters, 5.8 as a whole model.
    pub const SMALL: Self = Self {
        blocks: 6,
        width: 256,
        heads: 4,
        planes: 6,
        plane_tokens: 8,
        embed_tokens: 4,
        channels: 16,
        material_layers: MATERIAL_LAYERS,
        fuse: Fuse::Residual,
        pose: Pose::Azimuth,
        first_values: FirstValues::Scaled,
        rays: Rays::Nearest,
        background: Background::Marked,
        is_whole: false,
    };

    /// Returns the configuration of that name.
    ///
    /// # Errors
    /// Lists the names if there is none.
    pub fn named(name: &str) -> Result<Self> {
        match name {
            "paper" => Ok(Self::PAPER),
            "small" => Ok(Self::SMALL),
            other => Err(Error::input("--config").expected("small, paper or a .json file").got(other)),
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// Names the setting.
    pub fn validate(&self) -> Result<()> {
        let within = |name: &str, x: usize, [least, most]: [usize; 2]| {
            if (least..=most).contains(&x) {
                return Ok(());
            }
            let e = Error::input("configuration").at(name);
            Err(e.expected(format!("{least} to {most}")).got(x.to_string()))
        };
        within("blocks", self.blocks, [1, 96])?;
        within("width", self.width, [8, 8192])?;
        within("heads", self.heads, [1, 128])?;
        within("plane_tokens", self.plane_tokens, [1, 256])?;
        within("embed_tokens", self.embed_tokens, [0, 256])?;
        within("channels", self.channels, [1, 256])?;
        within("material_layers", self.material_layers, [1, 15])?;
        if !self.width.is_multiple_of(self.heads) {
            return Err(Error::input("configuration")
                .at("heads")
                .expected(format!("a divisor of the width {}", self.width))
                .got(self.heads.to_string()));
        }
        if self.planes != 6 && self.planes != 3 {
            return Err(Error::input("configuration")
                .at("planes")
                .expected("6 or 3")
                .got(self.planes.to_string()));
        }
        Ok(())
    }

    /// Returns the number of tokens of the planes, and of the panoramas: together those of a state.
    pub fn tokens(&self) -> [usize; 2] {
        [self.planes * self.plane_tokens * self.plane_tokens, self.embed_tokens * self.embed_tokens]
    }

    /// Returns the number of tokens of a state.
    pub fn state_tokens(&self) -> usize {
        let [planes, panoramas] = self.tokens();
        planes + panoramas
    }

    /// Returns the texels per side of a plane.
    pub fn plane_side(&self) -> usize {
        PATCH * self.plane_tokens
    }

    /// Returns the texels per side of a panorama.
    pub fn panorama_side(&self) -> usize {
        PATCH * self.embed_tokens / 2
    }

    /// Returns the numbers of all texels of planes and panoramas.
    pub fn texels(&self) -> usize {
        self.state_tokens() * PATCH * PATCH * self.channels
    }

    /// Whether there are panoramas.
    pub fn has_embedding(&self) -> bool {
        self.embed_tokens > 0
    }

    /// Whether colours read panoramas.
    pub fn is_directed(&self) -> bool {
        self.is_whole && self.has_embedding()
    }

    /// Returns the floating-point operations of one set of images without gradients, and those of its
    /// attention alone, for a number of image tokens: two per product and sum.
    pub fn flops(&self, image_tokens: usize) -> [f64; 2] {
        let t = (self.state_tokens() + image_tokens) as f64;
        let (d, blocks) = (self.width as f64, self.blocks as f64);
        let attention = blocks * 4.0 * t * t * d;
        let linear = blocks * 24.0 * t * d * d;
        let state = self.state_tokens() as f64;
        let patch = (PATCH * PATCH) as f64;
        let ends = 6.0 * state * d * d
            + 24.0 * patch * image_tokens as f64 * d
            + 2.0 * state * d * patch * self.channels as f64;
        [attention + linear + ends, attention]
    }

    /// Returns the bytes that one set of images without gradients needs at most, for a number of image
    /// tokens: weights, the matrices that weight norm makes, fifteen arrays of all tokens, and the texels.
    /// `parameters` is the number of weights.
    pub fn memory(&self, parameters: usize, image_tokens: usize) -> u64 {
        let (tokens, d) = (self.state_tokens() + image_tokens, self.width);
        let normed = self.blocks * 8 * d * d;
        4 * (parameters + normed + 15 * tokens * d + self.texels()) as u64
    }

    /// Returns the settings as a flat JSON object.
    pub fn json(&self) -> Value {
        let mut all = json!({
            "blocks": self.blocks, "width": self.width, "heads": self.heads, "planes": self.planes,
            "plane_tokens": self.plane_tokens, "embed_tokens": self.embed_tokens, "channels": self.channels,
            "fuse": self.fuse.name(), "pose": self.pose.name(), "first_values": self.first_values.name(), "rays": self.rays.name(),
            "background": self.background.name(), "whole": self.is_whole,
        });
        // Files and runs from before the setting have no entry.
        if self.material_layers != MATERIAL_LAYERS {
            all["material_layers"] = json!(self.material_layers);
        }
        all
    }

    /// Reads a configuration file: some of the settings of [`Self::json`] under the same names; the others
    /// are those of [`Self::SMALL`].
    ///
    /// # Errors
    /// A setting that is unknown, or out of its range; the error names it.
    pub fn of_file(from: &Value) -> Result<Self> {
        let mut all = Self::SMALL.json();
        let Some(given) = from.as_object() else {
            return Err(Error::input("configuration").expected("a JSON object").got(from.to_string()));
        };
        // A setting that does not exist is one more, which is refused.
        given.iter().for_each(|(key, value)| all[key] = value.clone());
        Self::parse(&all)
    }

    /// Reads the settings from the object of [`Self::json`].
    ///
    /// # Errors
    /// A missing or unknown setting, or one out of its range; the error names it.
    pub fn parse(from: &Value) -> Result<Self> {
        let mut known = Self::SMALL.json();
        known["material_layers"] = json!(MATERIAL_LAYERS);
        if let Some((key, _)) =
            from.as_object().into_iter().flatten().find(|(key, _)| known.get(key).is_none())
        {
            let names: Vec<&str> =
                known.as_object().into_iter().flatten().map(|(name, _)| name.as_str()).collect();
            return Err(Error::input("configuration").expected(names.join(", ")).got(key.clone()));
        }
        let missing = |key: &str, want: &str| {
            let got = from.get(key).map_or_else(|| "nothing".to_owned(), Value::to_string);
            Error::input("configuration").at(key.to_owned()).expected(want.to_owned()).got(got)
        };
        let count = |key: &str| -> Result<usize> {
            let x = from.get(key).and_then(Value::as_u64).and_then(|x| usize::try_from(x).ok());
            x.ok_or_else(|| missing(key, "an integer, 0 or more"))
        };
        let text = |key: &str| from.get(key).and_then(Value::as_str);
        // Models from before there was a choice have no entry.
        let is_old = |key: &str| from.get(key).is_none();
        let config = Self {
            blocks: count("blocks")?,
            width: count("width")?,
            heads: count("heads")?,
            planes: count("planes")?,
            plane_tokens: count("plane_tokens")?,
            embed_tokens: count("embed_tokens")?,
            channels: count("channels")?,
            material_layers: if is_old("material_layers") {
                MATERIAL_LAYERS
            } else {
                count("material_layers")?
            },
            fuse: text("fuse")
                .and_then(Fuse::named)
                .ok_or_else(|| missing("fuse", &Fuse::ALL.map(Fuse::name).join(", ")))?,
            pose: text("pose")
                .and_then(Pose::named)
                .ok_or_else(|| missing("pose", &Pose::ALL.map(Pose::name).join(", ")))?,
            first_values: text("first_values").and_then(FirstValues::named).ok_or_else(|| {
                missing("first_values", &FirstValues::ALL.map(FirstValues::name).join(", "))
            })?,
            rays: text("rays")
                .and_then(Rays::named)
                .or_else(|| is_old("rays").then_some(Rays::Plucker))
                .ok_or_else(|| missing("rays", &Rays::ALL.map(Rays::name).join(", ")))?,
            background: text("background")
                .and_then(Background::named)
                .or_else(|| is_old("background").then_some(Background::White))
                .ok_or_else(|| missing("background", &Background::ALL.map(Background::name).join(", ")))?,
            is_whole: from
                .get("whole")
                .and_then(Value::as_bool)
                .ok_or_else(|| missing("whole", "true or false"))?,
        };
        config.validate()?;
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::super::params::count;
    use super::*;

    #[test]
    fn sizes_are_those_of_the_paper() {
        let (paper, small) = (Config::PAPER, Config::SMALL);
        assert_eq!((paper.tokens(), paper.plane_side(), paper.panorama_side()), ([13_824, 1024], 384, 128));
        assert_eq!((small.tokens(), small.plane_side(), small.panorama_side()), ([384, 16], 64, 16));
        // four views of 512²: 16 384 image tokens
        let [all, attention] = paper.flops(16_384);
        assert!(
            (all / 1e12 - 115.0).abs() < 5.0 && (attention / 1e12 - 96.0).abs() < 2.0,
            "{all} {attention}"
        );
        // A reconstruction from them took 3.76 GiB (benches/record/2026-11-26-lirm.md); the estimate is not below.
        let whole = Config { is_whole: true, ..paper };
        let estimate = whole.memory(count(&whole), 16_384) as f64 / f64::from(1 << 30);
        assert!((3.76..4.2).contains(&estimate), "{estimate} GiB");
    }

    #[test]
    fn settings_survive_their_text_and_bad_ones_are_named() {
        for config in [
            Config::PAPER,
            Config::SMALL,
            Config { planes: 3, embed_tokens: 0, is_whole: true, ..Config::SMALL },
            Config { material_layers: 2, ..Config::SMALL },
        ] {
            assert_eq!(Config::parse(&config.json()).expect("its own text"), config);
        }
        for (key, value) in [
            ("planes", json!(4)),
            ("heads", json!(3)),
            ("fuse", json!("x")),
            ("first_values", json!(2)),
            ("rays", json!("moment")),
            ("background", json!(1)),
            ("width", json!(-1)),
            ("material_layers", json!(16)),
            ("attention", json!("linear")),
        ] {
            let mut bad = Config::SMALL.json();
            bad[key] = value;
            let e = Config::parse(&bad).expect_err("out of range").to_string();
            assert!(e.contains(key), "{e}");
        }
    }

    #[test]
    fn models_without_entries_are_those_from_before_the_settings() {
        let mut old = Config::SMALL.json();
        for key in ["rays", "background"] {
            old.as_object_mut().expect("an object").remove(key);
        }
        let expected = Config { rays: Rays::Plucker, background: Background::White, ..Config::SMALL };
        assert_eq!(Config::parse(&old).expect("valid"), expected);
        assert!(old.get("material_layers").is_none(), "three hidden layers have no entry");
    }

    #[test]
    fn a_file_changes_some_settings_of_small() {
        let made = Config::of_file(
            &json!({ "planes": 3, "plane_tokens": 11, "fuse": "published", "embed_tokens": 0 }),
        );
        let tri =
            Config { planes: 3, plane_tokens: 11, fuse: Fuse::Published, embed_tokens: 0, ..Config::SMALL };
        assert_eq!(made.expect("known settings"), tri);
        assert_eq!(Config::of_file(&json!({})).expect("none"), Config::SMALL);
        assert_eq!(Config::of_file(&Config::PAPER.json()).expect("all"), Config::PAPER);
        for (file, named) in [
            (json!({ "depth": 6 }), "depth"),
            (json!({ "blocks": "six" }), "blocks"),
            (json!({ "planes": 4 }), "planes"),
            (json!({ "fuse": "other" }), "fuse"),
            (json!([6]), "a JSON object"),
        ] {
            let e = Config::of_file(&file).expect_err("a bad setting").to_string();
            assert!(e.contains(named), "{e}");
        }
    }
}
