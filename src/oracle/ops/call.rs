//! Calls of operators with named arrays, and their results.

use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use reference::ports::{Dtype, Port, Signature};
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
    /// given discrete decisions; they are not recomputed
    pub plan: Option<Arrays>,
    /// also return the intermediates
    pub dump: bool,
}

/// Results of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunResult {
    /// by output name
    pub outputs: Arrays,
    /// by input name
    pub gradients: Arrays,
    /// by name; filled with `dump`
    pub intermediates: Arrays,
    /// discrete decisions taken or used
    pub plan: Arrays,
}

impl RunResult {
    /// Rounds every float array to f32, as stored by a run in f32, whatever its internal precision.
    ///
    /// # Errors
    /// When a number is out of the range of f32.
    pub fn stored_in_f32(self, op: &Signature) -> Result<Self> {
        Ok(Self {
            outputs: cast(&self.outputs, op.outputs, true)?,
            gradients: cast(&self.gradients, op.inputs, true)?,
            intermediates: cast(&self.intermediates, op.intermediates, true)?,
            plan: self.plan,
        })
    }
}

pub(super) fn list(sizes: &[usize]) -> String {
    sizes.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

/// Converts one array to the element type of its port.
pub(super) fn convert(name: &str, array: &Array, dtype: Dtype, single: bool) -> Result<Array> {
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

/// Consecutive values as rows.
pub(super) fn rows<const K: usize>(values: &[f32]) -> Vec<[f32; K]> {
    values.chunks_exact(K).map(|row| std::array::from_fn(|k| row[k])).collect()
}

/// Converts the arrays named by ports to the element types of the ports; other arrays are unchanged.
///
/// # Errors
/// When an entry of an integer port is not an integer in its range.
pub(super) fn cast(arrays: &Arrays, ports: &[Port], single: bool) -> Result<Arrays> {
    let mut out = Arrays::new();
    for (name, array) in &arrays.0 {
        let dtype = ports.iter().find(|p| p.name == name).map_or(Dtype::Float, |p| p.dtype);
        out.0.insert(name.clone(), convert(name, array, dtype, single)?);
    }
    Ok(out)
}
