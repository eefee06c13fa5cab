//! Entries of the operator list: signature, and how the shipped operator runs, checks inputs and generates
//! cases.

use super::call::{Call, RunResult, Settings};
use crate::Result;
use crate::num::array::Arrays;
use crate::tape::check::Prediction;
use reference::inputs::Dims;
use reference::ports::Signature;
use reference::settings::Setting;
use std::collections::BTreeMap;
use std::ops::Deref;

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
    /// f64 in runs of both precisions
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

/// One operator of the list: its signature, shared with its twin, and the data of the shipped operator.
pub struct Op {
    /// names, shapes and documentation of all inputs and outputs
    pub signature: &'static Signature,
    /// whether it has an adjoint; the others are marked `no adjoint`
    pub adjoint: bool,
    /// arithmetic of the shipped code
    pub width: Width,
    /// name of the unit of work of the twin, in the plural
    pub work_unit: &'static str,
    /// nanoseconds per unit of the f64 run, without and with gradients, measured once; used only for
    /// estimates
    pub work_ns: [f64; 2],
    /// checks rules that the patterns of the ports cannot express
    pub check: fn(&CheckedCall<'_>) -> Result<()>,
    /// the shipped operator
    pub run: fn(&CheckedCall<'_>) -> Result<RunResult>,
    /// predicted zeros of its gradient, from a checked call and its run with plan and intermediates
    pub predict: fn(&CheckedCall<'_>, &RunResult) -> Result<Prediction>,
    /// number of generated cases
    pub cases: usize,
    /// generated case `i < cases`: small, asymmetric, without accidental zeros
    pub case: fn(usize) -> Case,
}

impl Op {
    /// Makes an entry with an adjoint in f32, two cases, no rules beyond the patterns of its ports and no
    /// predicted zeros; other values are set by struct update.
    pub(super) const fn new(
        signature: &'static Signature,
        run: fn(&CheckedCall<'_>) -> Result<RunResult>,
        case: fn(usize) -> Case,
    ) -> Self {
        Self {
            signature,
            adjoint: true,
            width: Width::F32,
            work_unit: "entries",
            work_ns: [10.0, 100.0],
            check: no_rule,
            run,
            predict: no_zeros,
            cases: 2,
            case,
        }
    }
}

/// Gives access to the fields of the signature: `op.name`, `op.inputs`.
impl Deref for Op {
    type Target = Signature;
    fn deref(&self) -> &Signature {
        self.signature
    }
}

impl std::fmt::Debug for Op {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

/// A call whose arrays have the right names, shapes, element types and finite values.
#[derive(Debug)]
pub struct CheckedCall<'a> {
    /// the operator
    pub op: &'static Op,
    /// the original call
    pub call: &'a Call,
    /// sizes of the axes
    pub dims: Dims,
    /// inputs in the width of the run, integers in the type of their port
    pub inputs: Arrays,
    /// cotangents in the width of the run
    pub cotangents: Arrays,
    /// settings in their final form: choices as words, the rest as numbers
    pub settings: Settings,
}

/// Checks nothing beyond the patterns.
pub(super) fn no_rule(_: &CheckedCall<'_>) -> Result<()> {
    Ok(())
}

/// Predicts no zeros.
pub(super) fn no_zeros(_: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(Prediction::default())
}
