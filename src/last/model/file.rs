//! The file of a trained model, in safetensors format, with every parameter, the graph, the statistics that
//! stage 2 requires, and the settings as text.
//!
//! | array | shape | |
//! |-------|-------|-|
//! | `param/…` | | as in `encoder`, `decoder`, `structure` |
//! | `graph` | (n, n) | A, 1 at i → j; acyclic |
//! | `codes` | (n, 9, k) | values of each factor in the training set, for `last intervene` |
//! | `template` | (P, 3) | the points at rest |
//! | `skeleton` | (K) | the parent of each joint of the subject, −1 for none; absent for vectors |
//! | `spread/factors`, `spread/noise` | (n, k) | standard deviations of Ẑ and ε over the training set, at least 10⁻³ |
//!
//! Metadata: `kind`, `version`, `settings` (JSON of [`Settings::json`]), `input` (`picture 64`), `features`,
//! `outputs`.

use super::decoder::Decoder;
use super::encoder::{Encoder, Input};
use super::settings::{Placement, Reading, Settings, Supervision, Weights};
use super::step::Model;
use super::structure::{Kind, Sizes};
use crate::io::safetensors;
use crate::last::avatar::guide::Framing;
use crate::math::digraph::Digraph;
use crate::num::array::{Array, Arrays};
use crate::num::bits::Digest;
use crate::optim::optimiser::ArrayNames;
use crate::scene::person::Template;
use crate::tape::Params;
use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Number of values per factor.
pub const VALUES: usize = 9;
/// Name of the file in the folder of a training.
pub const FILE: &str = "model.safetensors";
/// The kind recorded in the metadata.
const KIND: &str = "image-to-point model";

/// A trained model.
#[derive(Clone, Debug)]
pub struct Trained {
    /// Networks and parameters.
    pub model: Model,
    /// Settings of the training.
    pub settings: Settings,
    /// The adjacency matrix A.
    pub graph: Digraph,
    /// Standard deviations of the factors, shape (n, k).
    pub factor_spread: Vec<f64>,
    /// Standard deviations of their noise, shape (n, k).
    pub noise_spread: Vec<f64>,
    /// Values of the factors in the training set, from end to end of their range, shape (n, 9, k).
    pub codes: Vec<f64>,
    /// The points at rest, shape (P, 3).
    pub template: Vec<[f32; 3]>,
    /// The parent of each joint of the subject, −1 for none, shape (K); empty if it is not known.
    pub skeleton: Vec<i64>,
}

impl Trained {
    /// Digest of parameters, graph, statistics, reading and framing: 16 hexadecimal digits.
    ///
    /// # Errors
    /// If one of them is NaN.
    pub fn digest(&self) -> Result<String> {
        let mut d = Digest::new();
        for (_, array) in self.model.params.iter() {
            let values: Vec<f32> = array.iter().copied().collect();
            d.f32(array.shape(), &values)?;
        }
        let n = self.graph.n();
        d.f64(&[n, n], &self.graph.adjacency())?;
        let shape = [n, self.settings.width];
        d.f64(&shape, &self.factor_spread)?;
        d.f64(&shape, &self.noise_spread)?;
        d.f64(&[n, VALUES, self.settings.width], &self.codes)?;
        d.f32(&[self.template.len(), 3], self.template.as_flattened())?;
        d.bytes(self.settings.reading.name().as_bytes());
        d.bytes(self.settings.framing.name().as_bytes());
        Ok(format!("{:016x}", d.value()))
    }

    /// Whether the subject's skeleton is that of a capture; `None` if the model does not record its skeleton.
    pub fn is_of(&self, body: &Template) -> Option<bool> {
        let parents = body.parents.iter().map(|p| p.map_or(-1, |p| p as i64));
        (!self.skeleton.is_empty()).then(|| self.skeleton.iter().copied().eq(parents))
    }

    /// Writes the file atomically. Its bytes depend on the model alone.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut arrays = Arrays::new();
        ArrayNames::Folders.save(&self.model.params, &mut arrays);
        let n = self.graph.n();
        arrays.put("graph", &[n, n], self.graph.adjacency());
        arrays.put("spread/factors", &[n, self.settings.width], self.factor_spread.clone());
        arrays.put("spread/noise", &[n, self.settings.width], self.noise_spread.clone());
        arrays.put("codes", &[n, VALUES, self.settings.width], self.codes.clone());
        arrays.put("template", &[self.template.len(), 3], self.template.as_flattened().to_vec());
        if !self.skeleton.is_empty() {
            arrays.put("skeleton", &[self.skeleton.len()], self.skeleton.clone());
        }
        let input = match self.model.encoder.input() {
            Input::Picture { side } => format!("picture {side}"),
            Input::Vector { size } => format!("vector {size}"),
        };
        let meta = BTreeMap::from([
            ("kind".to_owned(), KIND.to_owned()),
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("settings".to_owned(), self.settings.json().to_string()),
            ("input".to_owned(), input),
            ("features".to_owned(), self.model.decoder.features.to_string()),
            ("outputs".to_owned(), self.model.decoder.outputs.to_string()),
            ("digest".to_owned(), self.digest()?),
        ]);
        safetensors::write(path, &arrays, &meta)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If it is not a model file, an array is missing or has another shape, a number is not finite, the
    /// graph has a cycle, or the arrays do not have the digest in the metadata.
    pub fn read(path: &Path) -> Result<Self> {
        let file = safetensors::read(path)?;
        parse(&file.arrays, &file.metadata).map_err(|e| e.within(path.display().to_string()))
    }

    /// Reads the file of a model whose input is an image; for a folder, the [`FILE`] in it.
    ///
    /// # Errors
    /// As [`Self::read`]; or if it is a folder without this file, or a model of vectors.
    pub fn of_pictures(path: &Path) -> Result<Self> {
        let inside = path.join(FILE);
        if path.is_dir() && !inside.is_file() {
            return Err(Error::input(path.display().to_string())
                .expected("a model file, or the folder of a finished last pretrain")
                .got(format!("a folder without {FILE}"))
                .hint("`lastlight last pretrain DATA --out DIR` makes a model"));
        }
        let trained = Self::read(if path.is_dir() { &inside } else { path })?;
        match trained.model.encoder.input() {
            Input::Picture { .. } => Ok(trained),
            Input::Vector { size } => Err(Error::input(path.display().to_string())
                .expected("a model of images")
                .got(format!("a model of vectors with {size} entries"))),
        }
    }

    /// Reads a model from bytes; `name` is used in errors as the name of the file.
    ///
    /// # Errors
    /// See [`Self::read`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self> {
        let file = safetensors::parse(bytes, name)?;
        parse(&file.arrays, &file.metadata).map_err(|e| e.within(name.to_owned()))
    }
}

fn parse(arrays: &Arrays, meta: &BTreeMap<String, String>) -> Result<Trained> {
    let text = |key: &str| {
        meta.get(key).map(String::as_str).ok_or_else(|| {
            Error::input("metadata")
                .at(key)
                .expected("a model written by last pretrain or last tune")
                .got("no such entry")
        })
    };
    if text("kind")? != KIND {
        return Err(Error::input("metadata").at("kind").expected(KIND).got(text("kind")?));
    }
    let count = |key: &str| -> Result<usize> {
        text(key)?.parse().map_err(|_| {
            Error::input("metadata").at(key).expected("a whole number").got(text(key).unwrap_or(""))
        })
    };
    let input = text("input")?;
    let wrong = || Error::input("metadata").at("input").expected("'picture S' or 'vector N'").got(input);
    let (kind, size) = input.split_once(' ').ok_or_else(wrong)?;
    let size: usize = size.parse().map_err(|_| wrong())?;
    let input = match kind {
        "picture" => Input::Picture { side: size },
        "vector" if (1..=4096).contains(&size) => Input::Vector { size },
        _ => return Err(wrong()),
    };
    let settings =
        crate::io::json::parse(text("settings")?.as_bytes(), "metadata").map_err(|e| e.at("settings"))?;
    let settings = read_settings(&settings)?;
    settings.validate()?;
    let sizes = Sizes { factors: settings.factors, width: settings.width, kind: settings.kind };
    let encoder = Encoder::new(input, sizes.latent())?;
    let decoder =
        Decoder { features: count("features")?, latent: sizes.latent(), outputs: count("outputs")? };
    if decoder.features > 4096 || !(1..=4096).contains(&decoder.outputs) {
        return Err(Error::input("metadata").at("features, outputs").expected("1 to 4096"));
    }
    let mut dims = BTreeMap::new();
    let mut params = Params::new();
    for (name, shape) in [encoder.shapes(), decoder.shapes(), sizes.shapes()].concat() {
        params.set(&name, ArrayD::zeros(IxDyn(&shape)));
    }
    ArrayNames::Folders.load(&mut params, arrays)?;
    let names: Vec<&str> = arrays.0.keys().map(String::as_str).collect();
    arrays.finite(names)?;
    let (n, k) = (sizes.factors, sizes.width);
    let adjacency = arrays.shape("graph", &format!("{n},{n}"), &mut dims)?.to_f64();
    let graph = graph(n, &adjacency)?;
    let codes = arrays.shape("codes", &format!("{n},{},{k}", VALUES), &mut dims)?.to_f64();
    let template = arrays.shape("template", "P,3", &mut dims)?.to_f32();
    let mut spread = |name: &str| -> Result<Vec<f64>> {
        let values = arrays.shape(name, &format!("{n},{k}"), &mut dims)?.to_f64();
        match values.iter().find(|s| !(**s > 0.0)) {
            None => Ok(values),
            Some(bad) => {
                Err(Error::input(format!("array '{name}'")).expected("numbers above 0").got(bad.to_string()))
            }
        }
    };
    let trained = Trained {
        model: Model { encoder, decoder, sizes, params },
        settings,
        graph,
        factor_spread: spread("spread/factors")?,
        noise_spread: spread("spread/noise")?,
        codes,
        template: template.as_chunks().0.to_vec(),
        skeleton: arrays.get("skeleton").and_then(Array::to_i64).unwrap_or_default(),
    };
    let digest = trained.digest()?;
    match meta.get("digest") {
        Some(written) if *written != digest => Err(Error::input("metadata")
            .at("digest")
            .expected(written.clone())
            .got(digest)
            .hint("the arrays are not those that were written: copy or train the model again")),
        _ => Ok(trained),
    }
}

/// The graph with an adjacency matrix of zeros and ones.
///
/// # Errors
/// If an entry is another number, a factor has an edge to itself, or there is a cycle.
pub fn graph(n: usize, adjacency: &[f64]) -> Result<Digraph> {
    let what = || Error::input("array 'graph'");
    if let Some(at) = adjacency.iter().position(|&a| a != 0.0 && a != 1.0) {
        let place = format!("entry ({}, {})", at / n, at % n);
        return Err(what().at(place).expected("0 or 1").got(adjacency[at].to_string()));
    }
    if let Some(i) = (0..n).find(|i| adjacency[i * n + i] != 0.0) {
        return Err(what()
            .at(format!("entry ({i}, {i})"))
            .expected("0, because a factor cannot be its own cause")
            .got("1"));
    }
    let graph = Digraph::from_weights(adjacency, n, 0.5);
    if !graph.is_acyclic() {
        let on_cycle: Vec<String> = (0..n).filter(|&i| graph.reaches(i, i)).map(|i| i.to_string()).collect();
        return Err(what()
            .expected("a graph without cycles")
            .got(format!("a cycle through factors {}", on_cycle.join(", ")))
            .hint("last pretrain and last tune never write a graph with a cycle, so the file was edited; edit it to an acyclic graph, from which last tune can start"));
    }
    Ok(graph)
}

fn read_settings(v: &Value) -> Result<Settings> {
    let missing = |key: &str, what: &'static str| {
        let got = v.get(key).map_or_else(|| "nothing".to_owned(), ToString::to_string);
        Error::input("metadata 'settings'").at(key.to_owned()).expected(what).got(got)
    };
    let real = |key: &str| v.get(key).and_then(Value::as_f64).ok_or_else(|| missing(key, "a number"));
    let whole = |key: &str| v.get(key).and_then(Value::as_u64).ok_or_else(|| missing(key, "a whole number"));
    let name = |key: &str| v.get(key).and_then(Value::as_str).ok_or_else(|| missing(key, "a name"));
    let small = |key: &str, most: u64| -> Result<u64> {
        let x = whole(key)?;
        if (1..=most).contains(&x) { Ok(x) } else { Err(missing(key, "a small whole number above 0")) }
    };
    Ok(Settings {
        factors: small("factors", 64)? as usize,
        width: small("width", 64)? as usize,
        kind: Kind::parse(name("mechanism")?)?,
        reading: Reading::parse(name("reading")?)?,
        framing: Framing::parse(name("framing")?)?,
        supervision: Supervision::parse(name("supervision")?)?,
        placement: Placement::parse(name("dependence")?)?,
        weights: Weights {
            reconstruction: real("w_reconstruction")?,
            kl: real("w_kl")?,
            independence: real("w_independence")?,
            groups: real("w_groups")?,
            intervention: real("w_intervention")?,
            spread: real("w_spread")?,
            sparsity: real("w_sparsity")?,
        },
        tau: real("tau")?,
        alpha: real("alpha")?,
        steps: whole("steps")? as u32,
        refit: whole("refit")? as u32,
        freeze: whole("freeze")? as u32,
        alone: whole("alone")? as u32,
        warm_up: whole("warm_up")? as u32,
        round: whole("round")? as u32,
        lr: real("lr")?,
        lr_logits: real("lr_logits")?,
        observed: whole("observed")? as usize,
        groups: whole("groups")? as usize,
        points: whole("points")? as usize,
        seed: whole("seed")?,
    })
}
