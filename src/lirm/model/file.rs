//! The file of a model, in safetensors format: all arrays of [`super::params`] under their names, and text.
//!
//! Metadata: `kind`, `version`, `configuration` (JSON of [`Config::json`]), `training` (JSON of its parts,
//! one after the other: [`super::origin`]), `digest` of names and values. Arrays are in half precision,
//! rounded to nearest, or in single precision; the digest is that of the numbers in the file.

use super::config::Config;
use super::origin::{self, Part};
use super::params;
use crate::io::safetensors::{self, Precision};
use crate::num::array::Arrays;
use crate::num::bits::Digest;
use crate::scene::field::MAX_VALUE;
use crate::tape::Params;
use crate::{Error, Result};
use ndarray::{ArrayD, Axis, IxDyn};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the file in the folder of a training.
pub const FILE: &str = "model.safetensors";
/// The kind recorded in the metadata.
const KIND: &str = "LIRM model";

/// The numbers of an array of a shape, in single precision.
///
/// # Errors
/// If it is missing, has another shape, or a number is not finite or too large.
pub(super) fn numbers(arrays: &Arrays, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
    let pattern: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let numbers = arrays.shape(name, &pattern.join(","), &mut BTreeMap::new())?.to_f32();
    // Phrased so that NaN fails.
    match numbers.iter().position(|x| !(x.abs() <= MAX_VALUE)) {
        Some(i) => Err(Error::input(format!("array '{name}'"))
            .at(format!("number {i}"))
            .expected(format!("a finite number up to {MAX_VALUE:e}"))
            .got(numbers[i].to_string())),
        None => Ok(numbers),
    }
}

/// A model and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Its sizes.
    pub config: Config,
    /// Its arrays.
    pub params: Params,
    /// Parts of the training that produced it, in order.
    pub training: Vec<Part>,
}

/// Digest of names and bits.
pub fn digest(params: &Params) -> String {
    let mut d = Digest::new();
    for (name, array) in params.iter() {
        d.bytes(name.as_bytes());
        array.iter().for_each(|x| d.bytes(&x.to_le_bytes()));
    }
    format!("{:016x}", d.value())
}

/// The numbers that a file of this precision holds.
fn rounded(params: &Params, precision: Precision) -> Params {
    let mut all = params.clone();
    if precision == Precision::Half {
        let names: Vec<String> = params.iter().map(|(name, _)| name.to_owned()).collect();
        for name in names {
            let array = all.get_mut(&name).expect("a name of its own");
            array.iter_mut().for_each(|x| *x = safetensors::rounded_to_half(*x));
        }
    }
    all
}

impl Model {
    /// The stages of its training.
    pub fn stages(&self) -> Vec<String> {
        origin::labels(&self.training)
    }

    /// The 1/β at which it is rendered: that of the last step of its training.
    pub fn inverse_beta(&self) -> f32 {
        origin::inverse_beta(&self.training)
    }

    /// The model with numbers of half precision, as a file of that precision holds it.
    #[must_use]
    pub fn halved(self) -> Self {
        Self { params: rounded(&self.params, Precision::Half), ..self }
    }

    /// Writes the file atomically; its bytes depend on the model and the precision alone.
    ///
    /// # Errors
    /// If it cannot be written, or a number does not fit into half precision.
    pub fn write(&self, path: &Path, precision: Precision) -> Result<()> {
        let stored = rounded(&self.params, precision);
        let mut arrays = Arrays::new();
        for (name, array) in stored.iter() {
            if let Some(bad) = array.iter().find(|x| !x.is_finite()) {
                let fits = self.params.get(name).is_some_and(|a| a.iter().all(|x| x.is_finite()));
                let expected =
                    if fits { "numbers of at most 65 504, for half precision" } else { "finite numbers" };
                return Err(Error::check("LIRM model")
                    .at(format!("array '{name}'"))
                    .expected(expected)
                    .got(bad.to_string()));
            }
            arrays.put(name, array.shape(), array.iter().copied().collect());
        }
        let meta = BTreeMap::from([
            ("kind".to_owned(), KIND.to_owned()),
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("configuration".to_owned(), self.config.json().to_string()),
            ("training".to_owned(), origin::text(&self.training)),
            ("digest".to_owned(), digest(&stored)),
        ]);
        safetensors::write_in(path, precision, &arrays, &meta)
    }

    /// Reads a file; for a folder, the [`FILE`] in it.
    ///
    /// # Errors
    /// If it is not a model, an array is missing, superfluous, or has another shape, a number is not finite,
    /// or the arrays do not have the digest in the metadata.
    pub fn read(path: &Path) -> Result<Self> {
        let inside = path.join(FILE);
        let path = if path.is_dir() { &*inside } else { path };
        let file = safetensors::read(path)?;
        parse(&file.arrays, &file.metadata).map_err(|e| e.within(path.display().to_string()))
    }

    /// Reads the bytes of a file, which messages call `name`.
    ///
    /// # Errors
    /// See [`Self::read`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self> {
        let file = safetensors::parse(bytes, name)?;
        parse(&file.arrays, &file.metadata).map_err(|e| e.within(name.to_owned()))
    }
}

fn parse(arrays: &Arrays, meta: &BTreeMap<String, String>) -> Result<Model> {
    let text = |key: &str| {
        meta.get(key).ok_or_else(|| {
            Error::input("metadata").at(key.to_owned()).expected("the text of a LIRM model").got("none")
        })
    };
    if text("kind")? != KIND {
        return Err(Error::input("metadata").at("kind").expected(KIND).got(text("kind")?.as_str()));
    }
    let config = Config::parse(&crate::io::json::parse(text("configuration")?.as_bytes(), "configuration")?)?;
    let mut params = Params::new();
    let shapes = params::shapes(&config);
    for (name, shape) in &shapes {
        let stored = numbers(arrays, name, shape)?;
        let array = ArrayD::from_shape_vec(IxDyn(shape), stored).expect("the shape was checked");
        if name.ends_with("/v")
            && let Some(row) = array.axis_iter(Axis(0)).position(|row| row.iter().all(|x| *x == 0.0))
        {
            return Err(Error::input(format!("array '{name}'"))
                .at(format!("row {row}"))
                .expected("a direction, which weight norm gives a length")
                .got("zeros"));
        }
        params.set(name, array);
    }
    if let Some(extra) = arrays.0.keys().find(|name| params.get(name).is_none()) {
        return Err(Error::input(format!("array '{extra}'"))
            .expected("no array besides those of the configuration")
            .got("one more"));
    }
    let found = digest(&params);
    if *text("digest")? != found {
        return Err(Error::input("digest of the arrays").expected(text("digest")?.as_str()).got(found));
    }
    let training = origin::parse(text("training")?)?;
    Ok(Model { config, params, training })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_back_and_bad_ones_refused() {
        let dir = tempfile::tempdir().expect("a folder");
        let config =
            Config { blocks: 1, width: 16, heads: 2, plane_tokens: 1, embed_tokens: 1, ..Config::SMALL };
        let model = Model { config, params: params::first(&config, 4), training: Vec::new() };
        let path = dir.path().join(FILE);
        model.write(&path, Precision::Single).expect("written");
        assert_eq!(Model::read(dir.path()).expect("the file in the folder"), model);
        let whole = std::fs::metadata(&path).expect("there").len();
        model.write(&path, Precision::Half).expect("written");
        let half = Model::read(&path).expect("a model");
        assert!(std::fs::metadata(&path).expect("there").len() < whole * 3 / 4, "half of the numbers' bytes");
        assert_eq!(half.params, rounded(&model.params, Precision::Half));
        half.write(&path, Precision::Half).expect("written");
        assert_eq!(Model::read(&path).expect("a model"), half, "rounding twice changes nothing");

        let write = |change: &dyn Fn(&mut Arrays, &mut BTreeMap<String, String>)| {
            let mut file = safetensors::read(&path).expect("a file");
            change(&mut file.arrays, &mut file.metadata);
            let other = dir.path().join("other");
            safetensors::write(&other, &file.arrays, &file.metadata).expect("written");
            Model::read(&other).expect_err("changed").to_string()
        };
        let e = write(&|a, _| drop(a.0.remove("norm/gain")));
        assert!(e.contains("norm/gain"), "{e}");
        let e = write(&|a, _| a.put("more", &[1], vec![0.0_f32]));
        assert!(e.contains("'more'"), "{e}");
        let e = write(&|a, _| a.put("norm/gain", &[16], vec![f32::NAN; 16]));
        assert!(e.contains("norm/gain"), "{e}");
        let e = write(&|a, _| a.put("norm/gain", &[16], vec![1e300_f64; 16]));
        assert!(e.contains("norm/gain") && e.contains("inf"), "{e}");
        let e = write(&|a, _| a.put("block/00/fc2/v", &[16, 64], vec![0.0_f32; 1024]));
        assert!(e.contains("block/00/fc2/v") && e.contains("row 0"), "{e}");
        let e = write(&|a, _| a.put("norm/gain", &[16], vec![0.5_f32; 16]));
        assert!(e.contains("digest"), "{e}");
        let e = write(&|_, m| drop(m.insert("kind".to_owned(), "field".to_owned())));
        assert!(e.contains("kind"), "{e}");
        let e = write(&|_, m| drop(m.insert("training".to_owned(), "1a".to_owned())));
        assert!(e.contains("training"), "{e}");
        let e = write(&|_, m| drop(m.insert("configuration".to_owned(), Config::SMALL.json().to_string())));
        assert!(e.contains("tokens/image"), "another configuration: {e}");
    }
}
