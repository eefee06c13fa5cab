//! What the list knows of an operator.

use super::call::{Checked, Ran};
use crate::Result;
use crate::num::array::Arrays;
use crate::tape::check::{Prediction, Step};
use reference::settings::Setting;
use std::collections::BTreeMap;

/// Element type of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Dtype {
    /// f32 or f64, as the run
    Float,
    /// mask bytes
    U8,
    /// signs
    I8,
    /// indices
    I32,
    /// counts and offsets
    I64,
}

impl Dtype {
    /// As lists show it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Float => "float",
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::I32 => "i32",
            Self::I64 => "i64",
        }
    }
}

/// What `oracle compare` holds an array to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Compare {
    /// every entry
    Values,
    /// which entries are zero
    ZeroPattern,
    /// rows (the first two axes) where this other array is not zero in both files
    RowsOf(&'static str),
}

/// One input, output, intermediate or plan array.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Port {
    /// argument name
    pub name: &'static str,
    /// axes by letter or size, `...` for any further axes
    pub shape: &'static str,
    /// element type
    pub dtype: Dtype,
    /// whether the adjoint gives its gradient (inputs) or takes its cotangent (outputs)
    pub differentiable: bool,
    /// whether it may be absent
    pub optional: bool,
    /// one line
    pub doc: &'static str,
    /// how finite differences move it
    #[serde(skip)]
    pub step: Step,
    /// how it is compared
    #[serde(skip)]
    pub compare: Compare,
}

impl Port {
    /// A float array with gradient.
    pub const fn var(name: &'static str, shape: &'static str, doc: &'static str) -> Self {
        Self {
            name,
            shape,
            dtype: Dtype::Float,
            differentiable: true,
            optional: false,
            doc,
            step: Step::Plain,
            compare: Compare::Values,
        }
    }

    /// A float array without gradient.
    pub const fn fixed(name: &'static str, shape: &'static str, doc: &'static str) -> Self {
        Self { differentiable: false, ..Self::var(name, shape, doc) }
    }

    /// An integer array.
    pub const fn int(name: &'static str, shape: &'static str, dtype: Dtype, doc: &'static str) -> Self {
        Self { dtype, ..Self::fixed(name, shape, doc) }
    }

    /// The same, may be absent.
    pub const fn or_absent(self) -> Self {
        Self { optional: true, ..self }
    }

    /// The same, moved by finite differences in another space.
    pub const fn moved(self, step: Step) -> Self {
        Self { step, ..self }
    }

    /// The same, compared otherwise.
    pub const fn compared(self, compare: Compare) -> Self {
        Self { compare, ..self }
    }
}

/// What a setting may be.
#[derive(Clone, Copy, Debug, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// a finite number
    Number,
    /// 0 or 1
    Flag,
    /// one of these words, or its index in the list
    Choice(&'static [&'static str]),
}

/// One setting.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct SettingSpec {
    /// `--set key=value`, array `setting_key`
    pub key: &'static str,
    /// admissible values
    pub kind: Kind,
    /// default as text
    pub default: &'static str,
    /// one line
    pub doc: &'static str,
}

/// One operator inside a composite one, by the names its arrays have in files of the composite.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Stage {
    /// operator, with ` adjoint` for its reverse
    pub operator: &'static str,
    /// arrays it reads
    pub inputs: &'static [&'static str],
    /// arrays it writes
    pub outputs: &'static [&'static str],
}

/// Inputs and settings of a generated case.
#[derive(Clone, Debug, Default)]
pub struct Case {
    /// inputs by name
    pub inputs: Arrays,
    /// settings by key
    pub settings: BTreeMap<String, Setting>,
}

/// Arithmetic of the shipped operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Width {
    /// f32 storage and fast path
    F32,
    /// f64 in runs of either precision
    F64,
}

impl Width {
    /// Rounding unit, 2⁻²⁴ or 2⁻⁵³.
    pub fn unit(self) -> f64 {
        match self {
            Self::F32 => 1.0 / 16_777_216.0,
            Self::F64 => crate::tape::check::UNIT,
        }
    }
}

/// One operator of the list.
#[derive(serde::Serialize)]
pub struct Op {
    /// `group.name`
    pub name: &'static str,
    /// one line
    pub summary: &'static str,
    /// arguments
    pub inputs: &'static [Port],
    /// results
    pub outputs: &'static [Port],
    /// further results of `--dump`
    pub intermediates: &'static [Port],
    /// discrete decisions
    pub plan: &'static [Port],
    /// names in other programs' files that belong to this operator and are ignored
    pub companions: &'static [&'static str],
    /// settings
    pub settings: &'static [SettingSpec],
    /// operators it is made of, in order; empty for a single one
    pub stages: &'static [Stage],
    /// whether it has an adjoint; the others are marked `no adjoint`
    pub adjoint: bool,
    /// arithmetic of the shipped code
    pub width: Width,
    /// what a unit of work is, for the estimate of an f64 run
    /// what a unit of work is called, in the plural
    pub work_unit: &'static str,
    /// nanoseconds per unit of the f64 run, without and with gradients, as measured once; for the estimate only
    pub work_ns: [f64; 2],
    /// refuses what the patterns of the ports cannot
    #[serde(skip)]
    pub check: fn(&Checked<'_>) -> Result<()>,
    /// the shipped operator
    #[serde(skip)]
    pub run: fn(&Checked<'_>) -> Result<Ran>,
    /// zeros of its gradient known beforehand, from a checked call and its run with plan and intermediates
    #[serde(skip)]
    pub predict: fn(&Checked<'_>, &Ran) -> Result<Prediction>,
    /// number of generated cases
    pub cases: usize,
    /// generated case `i < cases`: small, asymmetric, without accidental zeros
    #[serde(skip)]
    pub case: fn(usize) -> Case,
}

impl Op {
    /// Whether it is a chain of operators.
    pub fn is_composite(&self) -> bool {
        !self.stages.is_empty()
    }

    /// The port of that name among inputs, outputs, intermediates and plan.
    pub fn port(&self, name: &str) -> Option<&Port> {
        [self.inputs, self.outputs, self.intermediates, self.plan]
            .into_iter()
            .flatten()
            .find(|p| p.name == name)
    }

    /// Whether `name` is an input, an output, or an intermediate.
    pub fn knows(&self, name: &str) -> bool {
        [self.inputs, self.outputs, self.intermediates].into_iter().flatten().any(|p| p.name == name)
    }
}

impl std::fmt::Debug for Op {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

/// No rule beyond the patterns.
pub(super) fn no_rule(_: &Checked<'_>) -> Result<()> {
    Ok(())
}

/// No zeros are known.
pub(super) fn no_zeros(_: &Checked<'_>, _: &Ran) -> Result<Prediction> {
    Ok(Prediction::default())
}
