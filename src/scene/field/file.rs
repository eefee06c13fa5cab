//! The file of a field, in safetensors format.
//!
//! | array | shape | type |
//! |---|---|---|
//! | `planes` | (P, S, S, C) | f32 |
//! | `panoramas` | (L, H, W, C') | f32, optional |
//! | `heads/NAME/LAYER` | (outputs, inputs) | f32; layers count from 0 |
//! | `placement/center` | (3) | f64 |
//! | `placement/scale` | (1) | f64 |
//! | `placement/rotation` | (3, 3) | f64; missing where the axes are those of the world |
//!
//! Metadata: `kind` = `field`, `version`, `settings` ([`Settings::json`]), `heads` =
//! `separate` or `trunk`, `digest` ([`Field::digest`]). Other arrays and settings are errors: a reader that
//! ignored them would render another field.

use super::{Combine, FILE, Field, Heads, Network, Panoramas, Placement, Planes, Rule, Settings, Stencil};
use crate::io::safetensors;
use crate::num::array::{Array, Arrays, entries};
use crate::{Error, Result};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

/// The kind in the metadata.
const KIND: &str = "field";

/// Entries of the JSON object that are not read yet.
struct Entries<'a>(Map<String, Value>, &'a str);

impl Entries<'_> {
    fn take(&mut self, name: &str) -> Result<Value> {
        let e = || Error::input(self.1).expected(format!("an entry '{name}'")).got("none");
        self.0.remove(name).ok_or_else(e)
    }

    fn number(&mut self, name: &str) -> Result<f32> {
        let value = self.take(name)?;
        // Every f32 is read back exactly: its decimal digits are those of the f64 with the same value.
        value.as_f64().map(|x| x as f32).ok_or_else(|| {
            Error::input(format!("setting '{name}'")).expected("a number").got(value.to_string())
        })
    }

    /// Reads a number, or null.
    fn number_or_null(&mut self, name: &str) -> Result<Option<f32>> {
        if self.0.get(name) == Some(&Value::Null) {
            self.0.remove(name);
            return Ok(None);
        }
        self.number(name).map(Some)
    }

    /// Reads a number, if the entry is there.
    fn number_if_present(&mut self, name: &str) -> Result<Option<f32>> {
        self.0.contains_key(name).then(|| self.number(name)).transpose()
    }

    fn text(&mut self, name: &str) -> Result<String> {
        let value = self.take(name)?;
        value.as_str().map(str::to_owned).ok_or_else(|| {
            Error::input(format!("setting '{name}'")).expected("a text").got(value.to_string())
        })
    }
}

fn parse_settings(text: &str) -> Result<Settings> {
    const WHAT: &str = "metadata 'settings'";
    let Value::Object(entries) = crate::io::json::parse(text.as_bytes(), WHAT)? else {
        return Err(Error::input(WHAT).expected("a JSON object").got("another value"));
    };
    let mut entries = Entries(entries, WHAT);
    let samples = entries.take("samples")?;
    let made = Settings {
        half_size: entries.number("half_size")?,
        combine: Combine::parse(&entries.text("combine")?)?,
        samples: samples.as_u64().and_then(|n| usize::try_from(n).ok()).ok_or_else(|| {
            Error::input("setting 'samples'").expected("a positive integer").got(samples.to_string())
        })?,
        rule: Rule::parse(&entries.text("rule")?)?,
        inverse_beta: entries.number("inverse_beta")?,
        early_stop: entries.number_or_null("early_stop")?,
        least_weight: entries.number_if_present("least_weight")?,
        stencil: Stencil::parse(&entries.text("stencil")?)?,
        epsilon: entries.number("epsilon")?,
        background: entries.number("background")?,
    };
    match entries.0.keys().next() {
        None => Ok(made),
        Some(name) => Err(Error::input(WHAT)
            .at(format!("entry '{name}'"))
            .expected("no such setting")
            .got("one that this version does not have")),
    }
}

/// Returns an array of that rank as f32 with its shape.
fn array<const N: usize>(arrays: &Arrays, name: &str) -> Result<([usize; N], Vec<f32>)> {
    let array = arrays.need(name)?;
    let wrong = |got: String| {
        let e = Error::input(format!("array '{name}'"));
        Err(e.expected(format!("numbers of type float32 with {N} axes")).got(got))
    };
    match (array, <[usize; N]>::try_from(array.shape())) {
        (Array::F32(a), Ok(shape)) => Ok((shape, a.iter().copied().collect())),
        (a, _) => wrong(format!("{} of shape {:?}", a.dtype(), a.shape())),
    }
}

/// Returns the layers of a head, if it has any.
fn network(arrays: &Arrays, name: &str) -> Result<Option<Network>> {
    let mut made = Network::default();
    loop {
        let layer = format!("heads/{name}/{}", made.weights.len());
        if arrays.get(&layer).is_none() {
            return Ok((!made.weights.is_empty()).then_some(made));
        }
        let ([outputs, inputs], weights) = array(arrays, &layer)?;
        if made.widths.last().is_some_and(|n| *n != inputs) {
            return Err(Error::input(format!("array '{layer}'"))
                .expected(format!("{} inputs, the outputs of the layer before", made.outputs()))
                .got(inputs.to_string()));
        }
        if made.widths.is_empty() {
            made.widths.push(inputs);
        }
        made.widths.push(outputs);
        made.weights.push(weights);
    }
}

fn placement(arrays: &Arrays) -> Result<Placement> {
    let doubles = |name: &str, shape: &[usize]| -> Result<Vec<f64>> {
        match arrays.need(name)? {
            Array::F64(a) if a.shape() == shape => Ok(a.iter().copied().collect()),
            other => {
                let e = Error::input(format!("array '{name}'"));
                let got = format!("{} of shape {:?}", other.dtype(), other.shape());
                let n = entries(shape);
                Err(e.expected(format!("{n} numbers of type float64")).got(got))
            }
        }
    };
    let (center, scale) = (doubles("placement/center", &[3])?, doubles("placement/scale", &[1])?);
    let made = Placement::new([center[0], center[1], center[2]], scale[0]);
    if arrays.get("placement/rotation").is_none() {
        return Ok(made);
    }
    let q = doubles("placement/rotation", &[3, 3])?;
    Ok(Placement { rotation: std::array::from_fn(|r| std::array::from_fn(|c| q[3 * r + c])), ..made })
}

impl Field {
    /// Returns the arrays of the file.
    fn arrays(&self) -> Arrays {
        let mut out = Arrays::new();
        out.put("planes", &self.planes.shape(), self.planes.values.clone());
        if let Some(panoramas) = &self.panoramas {
            out.put("panoramas", &panoramas.shape(), panoramas.values.clone());
        }
        for (name, head) in Heads::NAMES.into_iter().zip(self.heads.all()) {
            for (i, (shape, weights)) in head.into_iter().flat_map(Network::layers).enumerate() {
                out.put(&format!("heads/{name}/{i}"), &shape, weights.to_vec());
            }
        }
        out.put("placement/center", &[3], self.placement.center.to_vec());
        out.put("placement/scale", &[1], vec![self.placement.scale]);
        if self.placement.is_turned() {
            out.put("placement/rotation", &[3, 3], self.placement.rotation.as_flattened().to_vec());
        }
        out
    }

    /// Returns the bytes of the file; equal fields give equal bytes.
    ///
    /// # Errors
    /// Returns an error if the field is not valid.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let metadata = self.metadata()?;
        Ok(safetensors::to_bytes(&self.arrays(), &metadata))
    }

    fn metadata(&self) -> Result<BTreeMap<String, String>> {
        self.validate()?;
        let heads = if self.heads.is_trunk() { "trunk" } else { "separate" };
        Ok(BTreeMap::from([
            ("kind".to_owned(), KIND.to_owned()),
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("settings".to_owned(), self.settings.json().to_string()),
            ("heads".to_owned(), heads.to_owned()),
            ("digest".to_owned(), self.digest()?),
        ]))
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// Returns an error if the field is not valid or the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let metadata = self.metadata()?;
        safetensors::write(path, &self.arrays(), &metadata)
    }

    /// Reads a file; of a folder, the [`FILE`] in it.
    ///
    /// # Errors
    /// Returns an error if there is no such file, it is not that of a field, an array is missing, unknown or
    /// has another type or shape, a number is not finite, a setting is missing, unknown or out of its range,
    /// or the contents do not have the digest in the metadata.
    pub fn read(path: &Path) -> Result<Self> {
        let inside = path.join(FILE);
        if path.is_dir() && !inside.is_file() {
            return Err(Error::input(path.display().to_string())
                .expected("the file of a field, or the folder of a finished field fit")
                .got(format!("a folder without {FILE}")));
        }
        let path = if path.is_dir() { inside.as_path() } else { path };
        let file = safetensors::read(path)?;
        Self::of_file(&file).map_err(|e| e.within(path.display().to_string()))
    }

    /// Reads a field from bytes; `name` is the file name in errors.
    ///
    /// # Errors
    /// See [`Self::read`].
    pub fn parse(bytes: &[u8], name: &str) -> Result<Self> {
        let file = safetensors::parse(bytes, name)?;
        Self::of_file(&file).map_err(|e| e.within(name.to_owned()))
    }

    fn of_file(file: &safetensors::Tensors) -> Result<Self> {
        let text = |key: &str| {
            let e = || Error::input("metadata").at(key).expected("the file of a field").got("no such entry");
            file.metadata.get(key).map(String::as_str).ok_or_else(e)
        };
        if text("kind")? != KIND {
            return Err(Error::input("metadata").at("kind").expected(KIND).got(text("kind")?));
        }
        let arrays = &file.arrays;
        let ([count, side, columns, channels], values) = array(arrays, "planes")?;
        if side != columns {
            let e = Error::input("array 'planes'").expected("square planes, (P, S, S, C)");
            return Err(e.got(format!("{side}x{columns} texels")));
        }
        let panoramas = match arrays.get("panoramas") {
            None => None,
            Some(_) => {
                let ([levels, height, width, channels], values) = array(arrays, "panoramas")?;
                Some(Panoramas { values, levels, height, width, channels })
            }
        };
        let head = |name: &str| network(arrays, name);
        let sdf =
            head("sdf")?.ok_or_else(|| Error::input("array 'heads/sdf/0'").expected("to be present"))?;
        let made = Self {
            planes: Planes { values, count, side, channels },
            panoramas,
            heads: Heads {
                sdf,
                color: head("color")?,
                albedo: head("albedo")?,
                material: head("material")?,
                normal: head("normal")?,
                rho: head("rho")?,
            },
            settings: parse_settings(text("settings")?)?,
            placement: placement(arrays)?,
        };
        made.validate()?;
        let own = made.arrays();
        if let Some(name) = arrays.0.keys().find(|name| own.get(name).is_none()) {
            let e = Error::input(format!("array '{name}'"));
            return Err(e.expected("no such array in a field").got("one"));
        }
        let heads = if made.heads.is_trunk() { "trunk" } else { "separate" };
        if text("heads")? != heads {
            return Err(Error::input("metadata").at("heads").expected(heads).got(text("heads")?));
        }
        let digest = made.digest()?;
        if text("digest")? != digest {
            return Err(Error::input("metadata")
                .at("digest")
                .expected(text("digest")?)
                .got(digest)
                .hint("the file was changed after it was written: copy or fit the field again"));
        }
        Ok(made)
    }
}
