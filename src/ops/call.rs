//! From somebody's arrays to checked inputs of an operator, and back.

use super::op::{Dtype, Kind, Op, Port, SettingSpec};
use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use reference::settings::Setting;
use std::collections::BTreeMap;

/// Settings by key.
pub type Settings = BTreeMap<String, Setting>;

/// One run of an operator.
#[derive(Clone, Debug, Default)]
pub struct Call {
    /// inputs by name, in any width
    pub inputs: Arrays,
    /// settings by key
    pub settings: Settings,
    /// cotangents by output name; gradients are computed when there is at least one
    pub cotangents: Arrays,
    /// gradients to accumulate into, by input name; zeros where absent
    pub start: Arrays,
    /// discrete decisions to use instead of taking them
    pub plan: Option<Arrays>,
    /// also return the intermediates
    pub dump: bool,
}

/// Results of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ran {
    /// by output name
    pub outputs: Arrays,
    /// by input name
    pub gradients: Arrays,
    /// by name; filled with `dump`
    pub intermediates: Arrays,
    /// discrete decisions taken or used
    pub plan: Arrays,
}

/// Sizes of the axes by letter.
#[derive(Clone, Debug, Default)]
pub struct Dims(BTreeMap<String, Vec<usize>>);

impl Dims {
    /// Size of the axis of that letter, if an array bound it.
    pub fn get(&self, letter: &str) -> Option<usize> {
        self.0.get(letter).map(|sizes| sizes[0])
    }

    /// Holds `shape` to `pattern`: a number is a fixed size, a letter the same size everywhere, `...` the same further
    /// axes everywhere, `|` separates alternatives.
    ///
    /// # Errors
    /// Names the array, the pattern with the bound letters, and the shape found.
    pub fn bind(&mut self, name: &str, pattern: &str, shape: &[usize]) -> Result<()> {
        if let Some((first, rest)) = pattern.split_once('|') {
            return self.bind(name, first, shape).or_else(|_| self.bind(name, rest, shape));
        }
        let parts: Vec<&str> = if pattern.is_empty() { Vec::new() } else { pattern.split(',').collect() };
        let open = parts.last() == Some(&"...");
        let fixed = parts.len() - usize::from(open);
        let mut fits = if open { shape.len() >= fixed } else { shape.len() == fixed };
        let mut bound = self.0.clone();
        let mut same =
            |key: &str, sizes: &[usize]| *bound.entry(key.to_owned()).or_insert(sizes.to_vec()) == sizes;
        if fits {
            for (part, size) in parts[..fixed].iter().zip(shape) {
                fits &= part.parse::<usize>().map_or_else(|_| same(part, &[*size]), |n| n == *size);
            }
            fits &= !open || same("...", &shape[fixed..]);
        }
        if fits {
            self.0 = bound;
            return Ok(());
        }
        let with: Vec<String> = parts
            .iter()
            .filter_map(|part| self.0.get(*part).map(|sizes| format!("{part} = {}", list(sizes))))
            .collect();
        let with = if with.is_empty() { String::new() } else { format!(" with {}", with.join(", ")) };
        Err(Error::input(format!("array '{name}'"))
            .expected(format!("shape ({pattern}){with}"))
            .got(format!("({})", list(shape))))
    }
}

fn list(sizes: &[usize]) -> String {
    sizes.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

/// A call whose arrays have the right names, shapes, element types and finite values.
#[derive(Debug)]
pub struct Checked<'a> {
    /// the operator
    pub op: &'static Op,
    /// what was asked
    pub call: &'a Call,
    /// sizes of the axes
    pub dims: Dims,
    /// inputs in the width of the run, integers as their port says
    pub inputs: Arrays,
    /// cotangents in the width of the run
    pub cotangents: Arrays,
    /// settings in their final form: choices as words, the rest as numbers
    pub settings: Settings,
}

/// Brings one array to the element type of its port.
fn convert(name: &str, array: &Array, dtype: Dtype, single: bool) -> Result<Array> {
    let shape = array.shape().to_vec();
    if dtype == Dtype::Float {
        if !single {
            return Ok(Array::new(&shape, array.to_f64()));
        }
        let values = array.to_f32();
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            return Err(Error::input(format!("array '{name}'"))
                .at(format!("entry {i}"))
                .expected("a number within the range of f32")
                .got(format!("{:e}", array.to_f64()[i])));
        }
        return Ok(Array::new(&shape, values));
    }
    let whole = || {
        Error::input(format!("array '{name}'"))
            .expected(format!("whole numbers in the range of {}", dtype.name()))
    };
    let values = array.to_i64().ok_or_else(|| whole().got("a fraction"))?;
    macro_rules! narrow {
        ($t:ty) => {{
            let narrow = |&x: &i64| <$t>::try_from(x).map_err(|_| whole().got(x.to_string()));
            Array::new(&shape, values.iter().map(narrow).collect::<Result<Vec<$t>>>()?)
        }};
    }
    Ok(match dtype {
        Dtype::U8 => narrow!(u8),
        Dtype::I8 => narrow!(i8),
        Dtype::I32 => narrow!(i32),
        Dtype::I64 | Dtype::Float => Array::new(&shape, values),
    })
}

fn setting(spec: &SettingSpec, given: &Setting) -> Result<Setting> {
    let what = || Error::input(format!("setting {}", spec.key));
    let shown = match given {
        Setting::Number(x) => x.to_string(),
        Setting::Text(text) => text.clone(),
    };
    let number = match given {
        Setting::Number(x) => Some(*x),
        Setting::Text(text) => text.trim().parse::<f64>().ok(),
    };
    match spec.kind {
        Kind::Number => match number {
            Some(x) if x.is_finite() => Ok(Setting::Number(x)),
            _ => Err(what().expected("a finite number").got(shown)),
        },
        Kind::Flag => match number {
            Some(x) if x == 0.0 || x == 1.0 => Ok(Setting::Number(x)),
            _ => Err(what().expected("0 or 1").got(shown)),
        },
        Kind::Choice(words) => {
            let by_index =
                number.and_then(|x| words.iter().enumerate().find(|(i, _)| *i as f64 == x).map(|(_, w)| w));
            let by_name = words.iter().find(|w| **w == shown);
            match by_name.or(by_index) {
                Some(word) => Ok(Setting::Text((*word).to_owned())),
                None => {
                    Err(what().expected(format!("one of {} (or its index)", words.join(", "))).got(shown))
                }
            }
        }
    }
}

impl<'a> Checked<'a> {
    /// Checks a call for a run in f32 (`single`) or f64.
    ///
    /// # Errors
    /// The first thing that is wrong: a name, a shape, an element, a setting, or a rule of the operator.
    pub fn new(op: &'static Op, call: &'a Call, single: bool) -> Result<Self> {
        Self::build(op, call, single).map_err(|e| e.within(op.name))
    }

    fn build(op: &'static Op, call: &'a Call, single: bool) -> Result<Self> {
        call.inputs.finite(op.inputs.iter().map(|p| p.name))?;
        let mut dims = Dims::default();
        let mut inputs = Arrays::new();
        for port in op.inputs {
            let Some(array) = call.inputs.get(port.name) else {
                if port.optional {
                    continue;
                }
                return Err(call.inputs.need(port.name).err().unwrap_or_else(|| Error::input(port.name)));
            };
            dims.bind(port.name, port.shape, array.shape())?;
            inputs.0.insert(port.name.to_owned(), convert(port.name, array, port.dtype, single)?);
        }
        if let Some(name) = call.inputs.0.keys().find(|n| !op.inputs.iter().any(|p| p.name == **n)) {
            let known: Vec<_> = op.inputs.iter().map(|p| p.name).collect();
            return Err(
                Error::input(format!("array '{name}'")).expected(format!("one of {}", known.join(", ")))
            );
        }
        let mut settings = Settings::new();
        for (key, given) in &call.settings {
            let Some(spec) = op.settings.iter().find(|s| s.key == key) else {
                let known: Vec<_> = op.settings.iter().map(|s| s.key).collect();
                let known = if known.is_empty() {
                    "no settings".to_owned()
                } else {
                    format!("one of {}", known.join(", "))
                };
                return Err(Error::input(format!("setting {key}")).expected(known));
            };
            settings.insert(key.clone(), setting(spec, given)?);
        }
        let checked = Self { op, call, dims, inputs, cotangents: Arrays::new(), settings };
        (op.check)(&checked)?;
        let names: Vec<&str> = call.cotangents.0.keys().map(String::as_str).collect();
        call.cotangents.finite(names).map_err(|e| e.within("cotangents"))?;
        let mut cotangents = Arrays::new();
        for (name, array) in &call.cotangents.0 {
            let place = format!("{name}_bar");
            match op.outputs.iter().find(|p| p.name == name) {
                Some(port) if op.adjoint && port.differentiable => {
                    cotangents.0.insert(name.clone(), convert(&place, array, Dtype::Float, single)?);
                }
                Some(_) if !op.adjoint => {
                    return Err(Error::input(format!("array '{place}'"))
                        .expected("no cotangent: this operator has no adjoint"));
                }
                _ => {
                    return Err(Error::input(format!("array '{place}'"))
                        .expected("the cotangent of a differentiable output"));
                }
            }
        }
        Ok(Self { cotangents, ..checked })
    }

    /// Whether gradients are wanted.
    pub fn with_gradients(&self) -> bool {
        !self.cotangents.0.is_empty()
    }

    /// Whether the input is there.
    pub fn has(&self, name: &str) -> bool {
        self.inputs.get(name).is_some()
    }

    /// Values of an input in f32; empty where an optional one is absent.
    pub fn f32s(&self, name: &str) -> Vec<f32> {
        self.inputs.get(name).map(Array::to_f32).unwrap_or_default()
    }

    /// Rows of K values of an input.
    pub fn rows<const K: usize>(&self, name: &str) -> Vec<[f32; K]> {
        rows(&self.f32s(name))
    }

    /// Values of an input in f64.
    pub fn f64s(&self, name: &str) -> Vec<f64> {
        self.inputs.get(name).map(Array::to_f64).unwrap_or_default()
    }

    /// A whole number among the inputs.
    ///
    /// # Errors
    /// When it is negative.
    pub fn whole(&self, name: &str) -> Result<usize> {
        let x = self.inputs.scalar(name)?;
        if !(x >= 0.0) {
            return Err(Error::input(format!("array '{name}'"))
                .expected("a whole number, 0 or more")
                .got(x.to_string()));
        }
        Ok(x as usize)
    }

    /// Size of an axis; 0 when no array has it.
    pub fn dim(&self, letter: &str) -> usize {
        self.dims.get(letter).unwrap_or(0)
    }

    /// A number among the settings.
    pub fn number(&self, key: &str) -> Option<f64> {
        match self.settings.get(key) {
            Some(Setting::Number(x)) => Some(*x),
            _ => None,
        }
    }

    /// A choice among the settings.
    pub fn word(&self, key: &str) -> Option<&str> {
        match self.settings.get(key) {
            Some(Setting::Text(word)) => Some(word),
            _ => None,
        }
    }

    /// Cotangent of an output with `len` entries; `None` is zero.
    ///
    /// # Errors
    /// When its shape is not that of the output.
    pub fn bar(&self, name: &str, shape: &[usize]) -> Result<Option<Vec<f32>>> {
        Ok(self.cotangent(name, shape)?.map(Array::to_f32))
    }

    /// [`Self::bar`] for an operator that computes in f64.
    ///
    /// # Errors
    /// When its shape is not that of the output.
    pub fn bar_f64(&self, name: &str, shape: &[usize]) -> Result<Option<Vec<f64>>> {
        Ok(self.cotangent(name, shape)?.map(Array::to_f64))
    }

    fn cotangent(&self, name: &str, shape: &[usize]) -> Result<Option<&Array>> {
        let Some(array) = self.cotangents.get(name) else { return Ok(None) };
        if array.shape() != shape {
            return Err(Error::input(format!("array '{name}_bar'"))
                .expected(format!("the shape of {name}, ({})", list(shape)))
                .got(format!("({})", list(array.shape()))));
        }
        Ok(Some(array))
    }

    /// The gradient to accumulate into, zeros unless the call brings one.
    pub fn start(&self, name: &str, len: usize) -> Vec<f32> {
        match self.call.start.get(name) {
            Some(array) => array.to_f32(),
            None => vec![0.0; len],
        }
    }

    /// [`Self::start`] for an operator that computes in f64.
    pub fn start_f64(&self, name: &str, len: usize) -> Vec<f64> {
        self.call.start.get(name).map_or_else(|| vec![0.0; len], Array::to_f64)
    }

    /// [`Self::start`] in rows.
    pub fn start_rows<const K: usize>(&self, name: &str, len: usize) -> Vec<[f32; K]> {
        rows(&self.start(name, K * len))
    }

    /// The shape an input has.
    pub fn shape(&self, name: &str) -> Vec<usize> {
        self.inputs.get(name).map(|a| a.shape().to_vec()).unwrap_or_default()
    }

    /// Refuses entries that break a rule.
    ///
    /// # Errors
    /// Names the first such entry.
    pub fn rule(&self, name: &str, expected: &str, holds: impl Fn(f64) -> bool) -> Result<()> {
        match self.f64s(name).into_iter().enumerate().find(|(_, x)| !holds(*x)) {
            None => Ok(()),
            Some((i, x)) => Err(Error::input(format!("array '{name}'"))
                .at(format!("entry {i}"))
                .expected(expected)
                .got(x.to_string())),
        }
    }
}

/// Number of entries of a shape.
pub(super) fn entries(shape: &[usize]) -> usize {
    let mut entries = 1;
    for size in shape {
        entries *= size;
    }
    entries
}

/// Consecutive values as rows.
pub(super) fn rows<const K: usize>(values: &[f32]) -> Vec<[f32; K]> {
    values.chunks_exact(K).map(|row| std::array::from_fn(|k| row[k])).collect()
}

/// Brings arrays that use the ports' names to the ports' element types; other names keep theirs.
///
/// # Errors
/// When an entry of an integer port is no whole number in its range.
pub(super) fn cast(arrays: &Arrays, ports: &[Port], single: bool) -> Result<Arrays> {
    let mut out = Arrays::new();
    for (name, array) in &arrays.0 {
        let dtype = ports.iter().find(|p| p.name == name).map_or(Dtype::Float, |p| p.dtype);
        out.0.insert(name.clone(), convert(name, array, dtype, single)?);
    }
    Ok(out)
}
