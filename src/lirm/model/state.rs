//! The state of a model for one object: the tokens after its final LayerNorm, and where the object is.
//!
//! | array | shape | |
//! |---|---|---|
//! | `tokens` | (T, D) | those of the planes, then those of the panoramas |
//! | `placement/center`, `placement/scale`, `placement/rotation` | (3), (1), (3, 3) | x = Q·(X − centre)·scale |
//!
//! Metadata: `kind`, `version`, `configuration` of the model, `model` (digest of its weights), `sets`
//! (numbers of images, in the order in which they were read), `changes` (relative change of the tokens by
//! each of them; absent in files of earlier versions), `images` (their names, which are not scored as
//! held-out images later), `exposure` (the factor from radiance to the images, the mean of their exposures and
//! the factor that brightens them; empty where the exposures are not known; the first alone in files of earlier
//! versions). The arrays do not grow with the number of images; the three lists do, by a few bytes per image
//! and set.

use super::config::Config;
use super::file::numbers;
use crate::fit::exposure::Common;
use crate::io::safetensors;
use crate::num::array::Arrays;
use crate::scene::field::Placement;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the file in the folder of a reconstruction.
pub const FILE: &str = "state.safetensors";
/// The kind recorded in the metadata.
const KIND: &str = "LIRM state";

/// A state.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Shape (T, D).
    pub tokens: Vec<f32>,
    /// The object's place in the world.
    pub placement: Placement,
    /// Sizes of the model.
    pub config: Config,
    /// Digest of the weights of the model.
    pub model: String,
    /// Numbers of images, set by set.
    pub sets: Vec<usize>,
    /// Relative changes of the tokens, set by set; empty if they were not recorded.
    pub changes: Vec<f64>,
    /// Names of the images that were read.
    pub images: Vec<String>,
    /// The exposure of the images, if it is known.
    pub exposure: Option<Common>,
}

/// Relative change of the tokens below which, twice in a row, a state is settled.
const SETTLED: f64 = 1e-2;

impl State {
    /// Whether the last two sets changed the tokens by less than 1 %: more will change little.
    pub fn is_settled(&self) -> bool {
        matches!(self.changes[..], [.., a, b] if a < SETTLED && b < SETTLED)
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut arrays = Arrays::new();
        let width = self.config.width;
        arrays.put("tokens", &[self.tokens.len() / width, width], self.tokens.clone());
        arrays.put("placement/center", &[3], self.placement.center.to_vec());
        arrays.put("placement/scale", &[1], vec![self.placement.scale]);
        arrays.put("placement/rotation", &[3, 3], self.placement.rotation.as_flattened().to_vec());
        let sets: Vec<String> = self.sets.iter().map(ToString::to_string).collect();
        let exposure =
            self.exposure.map_or_else(String::new, |c| format!("{} {} {}", c.factor, c.mean, c.lift));
        let meta = BTreeMap::from([
            ("kind".to_owned(), KIND.to_owned()),
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("configuration".to_owned(), self.config.json().to_string()),
            ("model".to_owned(), self.model.clone()),
            ("sets".to_owned(), sets.join(" ")),
            ("changes".to_owned(), serde_json::Value::from(self.changes.clone()).to_string()),
            ("images".to_owned(), serde_json::Value::from(self.images.clone()).to_string()),
            ("exposure".to_owned(), exposure),
        ]);
        safetensors::write(path, &arrays, &meta)
    }

    /// Reads a file; for a folder, the [`FILE`] in it.
    ///
    /// # Errors
    /// If it is not a state, or an array is missing, superfluous, of another shape or not finite.
    pub fn read(path: &Path) -> Result<Self> {
        let inside = path.join(FILE);
        let path = if path.is_dir() { &*inside } else { path };
        let file = safetensors::read(path)?;
        parse(&file.arrays, &file.metadata).map_err(|e| e.within(path.display().to_string()))
    }
}

fn parse(arrays: &Arrays, meta: &BTreeMap<String, String>) -> Result<State> {
    let text = |key: &str| {
        meta.get(key).ok_or_else(|| {
            Error::input("metadata").at(key.to_owned()).expected("the text of a LIRM state").got("none")
        })
    };
    if text("kind")? != KIND {
        return Err(Error::input("metadata").at("kind").expected(KIND).got(text("kind")?.as_str()));
    }
    let config = Config::parse(&crate::io::json::parse(text("configuration")?.as_bytes(), "configuration")?)?;
    let wrong = |key: &str, want: &str| -> Result<Error> {
        Ok(Error::input("metadata").at(key.to_owned()).expected(want.to_owned()).got(text(key)?.as_str()))
    };
    let sets: Option<Vec<usize>> = text("sets")?.split_whitespace().map(|n| n.parse().ok()).collect();
    let Some(sets) = sets else { return Err(wrong("sets", "numbers of images")?) };
    let recorded = meta.get("changes").map_or("[]", String::as_str);
    let changes: Option<Vec<f64>> = serde_json::from_str(recorded).ok();
    let Some(changes) = changes else { return Err(wrong("changes", "a list of numbers")?) };
    let Ok(images) = serde_json::from_str::<Vec<String>>(text("images")?) else {
        return Err(wrong("images", "a list of names")?);
    };
    let is_factor = |x: &f64| *x > 0.0 && x.is_finite();
    let factors = text("exposure")?.split_whitespace().map(|x| x.parse().ok().filter(is_factor));
    let exposure = match factors.collect::<Option<Vec<f64>>>().as_deref() {
        Some([]) => None,
        Some([factor]) => Some(Common::of(*factor)),
        Some([factor, mean, lift]) => Some(Common { factor: *factor, mean: *mean, lift: *lift }),
        _ => return Err(wrong("exposure", "three factors above 0, or nothing")?),
    };
    let is_change = |x: &f64| x.is_finite() && *x >= 0.0;
    if !(changes.is_empty() || changes.len() == sets.len()) || !changes.iter().all(is_change) {
        return Err(wrong("changes", "a number of 0 or more for every set")?);
    }
    if sets.iter().try_fold(0_usize, |sum, n| sum.checked_add(*n)) != Some(images.len()) {
        return Err(wrong("images", &format!("as many names as the sets {sets:?} have"))?);
    }
    let mut sizes = BTreeMap::new();
    let tokens = numbers(arrays, "tokens", &[config.state_tokens(), config.width])?;
    let center = arrays.shape("placement/center", "3", &mut sizes)?.to_f64();
    let scale = arrays.shape("placement/scale", "1", &mut sizes)?.to_f64();
    let q = arrays.shape("placement/rotation", "3,3", &mut sizes)?.to_f64();
    let names = ["tokens", "placement/center", "placement/scale", "placement/rotation"];
    arrays.finite(names)?;
    if let Some(extra) = arrays.0.keys().find(|name| !names.contains(&name.as_str())) {
        return Err(Error::input(format!("array '{extra}'"))
            .expected("tokens and a placement")
            .got("one more"));
    }
    let rotation = std::array::from_fn(|r| std::array::from_fn(|c| q[3 * r + c]));
    let placement = Placement { center: std::array::from_fn(|k| center[k]), scale: scale[0], rotation };
    placement.validate()?;
    Ok(State { tokens, placement, config, model: text("model")?.clone(), sets, changes, images, exposure })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_read_back_and_bad_ones_refused() {
        let dir = tempfile::tempdir().expect("a folder");
        let config =
            Config { blocks: 1, width: 8, heads: 2, plane_tokens: 1, embed_tokens: 1, ..Config::SMALL };
        let state = State {
            tokens: (0..56).map(|i| i as f32 / 7.0).collect(),
            placement: Placement {
                rotation: [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
                ..Placement::new([0.1, -2.0, 3.5], 0.3)
            },
            config,
            model: "0123456789abcdef".to_owned(),
            sets: vec![1, 2],
            changes: vec![1.0, 0.1 + 0.2],
            images: ["0001.png", "a \"b\".png", "0003.png"].map(str::to_owned).into(),
            exposure: Some(Common { factor: 1.7, mean: 0.1 + 0.7, lift: 2.1 }),
        };
        let settled = |changes: &[f64]| State { changes: changes.into(), ..state.clone() }.is_settled();
        assert!(settled(&[0.3, 9e-3, 2e-3]), "twice in a row");
        assert!(![&[0.3, 1e-3, 2e-2, 1e-3][..], &[1e-3], &[]].into_iter().any(settled));
        let path = dir.path().join(FILE);
        state.write(&path).expect("written");
        assert_eq!(State::read(dir.path()).expect("the file in the folder"), state);
        let mut old = safetensors::read(&path).expect("a file");
        old.metadata.remove("changes");
        let earlier = dir.path().join("earlier");
        safetensors::write(&earlier, &old.arrays, &old.metadata).expect("written");
        assert_eq!(State::read(&earlier).expect("a file of an earlier version").changes, [0.0; 0]);
        for (text, exposure) in [("1.7", Some(Common::of(1.7))), ("", None)] {
            old.metadata.insert("exposure".to_owned(), text.to_owned());
            safetensors::write(&earlier, &old.arrays, &old.metadata).expect("written");
            assert_eq!(State::read(&earlier).expect("a state").exposure, exposure);
        }
        let write = |change: &dyn Fn(&mut Arrays, &mut BTreeMap<String, String>)| {
            let mut file = safetensors::read(&path).expect("a file");
            change(&mut file.arrays, &mut file.metadata);
            let other = dir.path().join("other");
            safetensors::write(&other, &file.arrays, &file.metadata).expect("written");
            State::read(&other).expect_err("changed").to_string()
        };
        let e = write(&|a, _| a.put("tokens", &[7, 8], vec![f32::NAN; 56]));
        assert!(e.contains("tokens"), "{e}");
        let e = write(&|a, _| a.put("tokens", &[7, 8], vec![1e300_f64; 56]));
        assert!(e.contains("tokens") && e.contains("inf"), "{e}");
        let e = write(&|a, _| a.put("placement/scale", &[1], vec![1e300_f64]));
        assert!(e.contains("scale"), "{e}");
        for (key, text) in [
            ("changes", "[1.0]"),
            ("changes", "[1.0, -5.0]"),
            ("sets", "0 99999999 7"),
            ("images", r#"["a", "b"]"#),
        ] {
            let e = write(&|_, m| drop(m.insert(key.to_owned(), text.to_owned())));
            assert!(e.contains("changes") || e.contains("images"), "{key} {text}: {e}");
        }
        let e = write(&|a, _| a.put("tokens", &[8, 8], vec![0.0_f32; 64]));
        assert!(e.contains("tokens"), "{e}");
        let e = write(&|a, _| a.put("more", &[1], vec![0.0_f32]));
        assert!(e.contains("more"), "{e}");
        for name in ["tokens", "placement/center", "placement/scale", "placement/rotation"] {
            let e = write(&|a, _| drop(a.0.remove(name)));
            assert!(e.contains(name), "a missing array: {e}");
        }
        for mirrored in
            [[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0], [2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]
        {
            let e = write(&|a, _| a.put("placement/rotation", &[3, 3], mirrored.to_vec()));
            assert!(e.contains("rotation"), "{e}");
        }
        let e = write(&|a, _| a.put("placement/scale", &[1], vec![0.0_f64]));
        assert!(e.contains("scale"), "{e}");
        let e = write(&|_, m| drop(m.insert("sets".to_owned(), "4 x".to_owned())));
        assert!(e.contains("sets"), "{e}");
        let e = write(&|_, m| drop(m.insert("changes".to_owned(), "[\"x\"]".to_owned())));
        assert!(e.contains("changes"), "{e}");
        let e = write(&|_, m| drop(m.insert("images".to_owned(), "[1]".to_owned())));
        assert!(e.contains("images"), "{e}");
        for text in ["0", "1 2", "1 2 inf", "x"] {
            let e = write(&|_, m| drop(m.insert("exposure".to_owned(), text.to_owned())));
            assert!(e.contains("exposure"), "{e}");
        }
        let e = write(&|_, m| drop(m.remove("model")));
        assert!(e.contains("model"), "{e}");
    }
}
