//! Runs in f64 by the twin, and conversion between its arrays and ours.

use super::call::{Call, RunResult, Settings, cast};
use super::op::CheckedCall;
use super::op::Op;
use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use reference::array::{Arr, Named};
use reference::twins::{self, Request};

/// Converts arrays to those of the twin; integers become f64.
pub(super) fn to_twin(arrays: &Arrays) -> Named<f64> {
    arrays
        .0
        .iter()
        .map(|(name, a)| (name.clone(), Arr { shape: a.shape().to_vec(), data: a.to_f64() }))
        .collect()
}

/// Converts arrays of the twin to ours, in f64.
pub(super) fn from_twin(arrays: Named<f64>) -> Arrays {
    Arrays(arrays.into_iter().map(|(name, a)| (name, Array::new(&a.shape, a.data))).collect())
}

/// A checked call in the types of the twin.
pub(super) struct TwinCall {
    /// operator
    op: &'static Op,
    /// inputs
    pub(super) inputs: Named<f64>,
    /// settings in their final form
    settings: Settings,
    /// discrete decisions to use
    plan: Option<Named<f64>>,
}

impl TwinCall {
    /// Converts a checked call.
    pub(super) fn new(x: &CheckedCall<'_>) -> Self {
        Self {
            op: x.op,
            inputs: to_twin(&x.inputs),
            settings: x.settings.clone(),
            plan: x.call.plan.as_ref().map(to_twin),
        }
    }

    /// The request to the twin.
    pub(super) fn request(&self) -> Request<'_> {
        Request { op: self.op.name, inputs: &self.inputs, settings: &self.settings, plan: self.plan.as_ref() }
    }
}

/// Converts an error of the twin.
pub(super) fn refused(op: &Op) -> impl Fn(String) -> Error {
    let name = op.name;
    move |message| Error::input(name).got(message)
}

/// Runs a call in f64.
///
/// # Errors
/// Invalid input.
pub fn run(op: &'static Op, call: &Call) -> Result<RunResult> {
    let x = CheckedCall::new(op, call, false)?;
    let twin_call = TwinCall::new(&x);
    let (results, gradients) = if x.lend() {
        twins::vjp(&twin_call.request(), &to_twin(&x.cotangents)).map_err(refused(op))?
    } else {
        (twins::value(&twin_call.request()).map_err(refused(op))?, Named::new())
    };
    let intermediates = if call.dump { from_twin(results.intermediates) } else { Arrays::new() };
    Ok(RunResult {
        outputs: cast(&from_twin(results.outputs), op.outputs, false)?,
        gradients: from_twin(gradients),
        intermediates: cast(&intermediates, op.intermediates, false)?,
        plan: cast(&from_twin(results.plan), op.plan, false)?,
    })
}

/// Amount of work of an f64 run in the unit of the operator, computed before the run.
///
/// # Errors
/// Invalid input.
pub fn work(op: &'static Op, call: &Call) -> Result<f64> {
    let x = CheckedCall::new(op, call, false)?;
    Ok(twins::work(&TwinCall::new(&x).request()) as f64)
}
