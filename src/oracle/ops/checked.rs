//! A call checked against the signature of its operator.

use super::call::{Call, RunResult, Settings, convert, list, rows};
use super::op::{CheckedCall, Op};
use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use reference::inputs::Dims;
use reference::ports::{Dtype, Kind, SettingSpec};
use reference::settings::Setting;

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

impl<'a> CheckedCall<'a> {
    /// Checks a call for a run in f32 (`single`) or f64.
    ///
    /// # Errors
    /// Names the first violation: of a name, a shape, an element, a setting, or a rule of the operator.
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
            dims.bind(port.shape, array.shape()).map_err(|expected| {
                Error::input(format!("array '{}'", port.name))
                    .expected(expected)
                    .got(format!("({})", list(array.shape())))
            })?;
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

    /// Whether gradients are requested.
    pub fn lend(&self) -> bool {
        !self.cotangents.0.is_empty()
    }

    /// Whether the input is present.
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

    /// An input that is an integer.
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

    /// A setting that is a number.
    pub fn number(&self, key: &str) -> Option<f64> {
        match self.settings.get(key) {
            Some(Setting::Number(x)) => Some(*x),
            _ => None,
        }
    }

    /// A setting that is a number, rounded to the f32 that the operator reads.
    ///
    /// # Errors
    /// When it is out of the range of f32, or violates the rule after rounding.
    pub fn single(
        &self,
        key: &str,
        default: f64,
        holds: impl Fn(f32) -> bool,
        expected: &str,
    ) -> Result<f32> {
        let given = self.number(key).unwrap_or(default);
        let single = given as f32;
        if single.is_finite() && holds(single) {
            return Ok(single);
        }
        Err(Error::input(format!("setting {key}"))
            .expected(format!("{expected}, in the range of f32"))
            .got(format!("{given:e}")))
    }

    /// A setting that is a word.
    pub fn word(&self, key: &str) -> Option<&str> {
        match self.settings.get(key) {
            Some(Setting::Text(word)) => Some(word),
            _ => None,
        }
    }

    /// Cotangent of an output with `len` entries; `None` is zero.
    ///
    /// # Errors
    /// When its shape differs from that of the output.
    pub fn bar(&self, name: &str, shape: &[usize]) -> Result<Option<Vec<f32>>> {
        Ok(self.cotangent(name, shape)?.map(Array::to_f32))
    }

    /// [`Self::bar`] for an operator that computes in f64.
    ///
    /// # Errors
    /// When its shape differs from that of the output.
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

    /// The gradient to accumulate into, zeros unless the call has one.
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

    /// The shape of an input.
    pub fn shape(&self, name: &str) -> Vec<usize> {
        self.inputs.get(name).map(|a| a.shape().to_vec()).unwrap_or_default()
    }

    /// Checks the entries of an input against a rule.
    ///
    /// # Errors
    /// Names the first entry that violates it.
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

/// Runs the shipped operator.
///
/// # Errors
/// Invalid input.
pub fn run(op: &'static Op, call: &Call) -> Result<RunResult> {
    let checked = CheckedCall::new(op, call, true)?;
    (op.run)(&checked)
}
