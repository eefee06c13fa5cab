//! Inputs of a gradient check: a subject, options, bounds.

use crate::Result;
use crate::tape::probe::{Evaluation, Step, UNIT, Values};
use std::collections::BTreeMap;

/// A differentiable input of a subject.
#[derive(Clone, Debug)]
pub struct Variable {
    /// name
    pub name: String,
    /// scale of its finite-difference steps
    pub step: Step,
}

/// Which decisions an evaluation of the twin uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum On {
    /// Those of the shipped forward at the inputs of the case, completed by the twin's own there.
    Frozen,
    /// Its own, recomputed at every point. Values that carry no gradient are those at the inputs of the case.
    Live,
}

/// Predicted zeros of the gradient.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// per variable: entries whose gradient is exactly 0; every other entry is expected to be nonzero. A
    /// variable without a mask is expected to have no zeros.
    pub zeros: BTreeMap<String, Vec<bool>>,
    /// per variable: row length and directions d with ⟨d, x̄⟩ = 0 row by row
    pub nulls: BTreeMap<String, (usize, Vec<f64>)>,
    /// variables that the operator does not read in this call: all their gradients are 0, which is an error
    /// for other variables
    pub unread: Vec<String>,
    /// outputs in which +∞ means "none"
    pub infinite: Vec<String>,
}

/// An operator with its twin at one set of inputs, as seen by the checks.
pub trait Subject {
    /// Name shown in reports.
    fn name(&self) -> String;
    /// Whether it is a chain of operators (wider bound in R1).
    fn end_to_end(&self) -> bool;
    /// Rounding unit of the shipped arithmetic: 2⁻²⁴ or 2⁻⁵³.
    fn unit(&self) -> f64;
    /// The differentiable inputs present; empty for an operator without adjoint.
    fn variables(&self) -> &[Variable];
    /// Their values.
    fn inputs(&self) -> &Values;
    /// A cotangent for every output.
    fn cotangents(&self) -> &Values;
    /// Outputs of the shipped forward.
    fn shipped(&self) -> Result<Values>;
    /// The shipped adjoint, added to `start` (zeros when `None`).
    fn shipped_adjoint(&self, out_bar: &Values, start: Option<&Values>) -> Result<Values>;
    /// The twin at `x`.
    fn value(&self, x: &Values, on: On) -> Result<Evaluation>;
    /// The twin's directional derivative at the inputs.
    fn jvp(&self, x_dot: &Values, on: On) -> Result<Values>;
    /// The twin's reverse derivative at the inputs, on the frozen plan.
    fn vjp(&self, out_bar: &Values) -> Result<Values>;
    /// Predicted zeros of the gradient.
    fn prediction(&self) -> Result<Prediction>;
}

/// Options of a gradient check.
#[derive(Clone, Debug)]
pub struct Options {
    /// seed of directions and samples
    pub seed: u64,
    /// which of R0 … R4
    pub rungs: [bool; 5],
    /// random directions of dot-product tests
    pub directions: u16,
    /// number of entries per variable that are checked one by one
    pub entries: usize,
    /// rounding unit of the function under test, for [`function`](super::function()): it determines the noise
    /// of differences
    pub unit: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 1, rungs: [true; 5], directions: 8, entries: 6, unit: UNIT }
    }
}

/// Bound of R1 for one operator.
pub const DOT_OPERATOR: f64 = 1e-13;
/// Bound of R1 for a chain of operators.
pub const DOT_CHAIN: f64 = 1e-11;
/// Bound of R2, beyond rounding noise.
pub const FROZEN: f64 = 1e-7;
/// Bound of R3, beyond rounding noise.
pub const LIVE: f64 = 1e-6;
/// Largest share of R3's entries that may be skipped because a decision changed.
pub const SKIPPED: f64 = 0.05;
/// Bound of R4 on the relative L2 of a gradient computed in f32.
pub const SHIPPED_F32: f64 = 2e-5;
/// Bound of R4 on the relative L2 of a gradient computed in f64.
pub const SHIPPED_F64: f64 = 1e-12;
/// Bound of R4 on the relative L2 of an output computed in f32.
pub const OUTPUT_F32: f64 = 2e-6;
/// Bound of R4 on the relative L2 of an output computed in f64.
pub const OUTPUT_F64: f64 = 1e-12;
/// Bound of R4 on 1 − cosine.
pub const COSINE: f64 = 1e-9;
/// Bound of R4 on the signed bias.
pub const BIAS: f64 = 1e-6;
/// Bound on a null direction in R0, in rounding units of the shipped arithmetic.
pub const NULL_UNITS: f64 = 256.0;
/// Bound of R4 on ‖adjoint onto start − (start + gradient)‖, in rounding units: an adjoint may add its terms
/// one by one.
pub const ACCUMULATION_UNITS: f64 = 8.0;
/// Derivatives below this fraction of the largest one of their variable are compared relative to the largest.
pub(super) const SMALL: f64 = 1e-6;
/// Up to this many input entries, R1 also tests all unit vectors.
pub(super) const UNIT_VECTORS: usize = 64;
