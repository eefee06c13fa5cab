//! Adapter for the gradient checks: an operator with its twin at one set of inputs.
//!
//! The frozen plan is that of the shipped forward, completed by the twin: one evaluation at the inputs of the case
//! adds the decisions that the shipped operator does not store, such as the signs in front of every ReLU. Finite
//! differences on it cross no kink. On the live plan every decision is taken again, but values that carry no gradient
//! (arrays of floats in the plan) keep those of the case: derivatives do not follow them, so that differences must
//! not either. They are not in the decision log.

use super::call::{Call, Settings};
use super::op::{Case, CheckedCall, Op};
use super::twin::{self, TwinCall};
use crate::num::array::{Array, Arrays};
use crate::num::bits::Digest;
use crate::tape::check::{Evaluation, On, Prediction, Step, Subject, Values, Variable};
use crate::tape::probe::normals;
use crate::{Error, Result};
use reference::array::{Arr, Named};
use reference::ports::{Compare, Space};
use reference::twins;
use std::collections::BTreeMap;

/// Seed of the default cotangents.
const COTANGENTS: u64 = 0x6261_7273; // "bars"

/// An operator at inputs that f32 represents exactly.
pub struct OpSubject {
    op: &'static Op,
    label: String,
    call: Call,
    twin_call: TwinCall,
    plan: Named<f64>,
    held: Option<Named<f64>>,
    outputs: Values,
    variables: Vec<Variable>,
    inputs: Values,
    cotangents: Values,
    bar_shapes: BTreeMap<String, Vec<usize>>,
    prediction: Prediction,
}

fn flat(arrays: &Arrays) -> Values {
    arrays.0.iter().map(|(name, a)| (name.clone(), a.to_f64())).collect()
}

fn round(arrays: &Arrays) -> Arrays {
    let round = |a: &Array| if a.is_float() { Array::new(a.shape(), a.to_f32()) } else { a.clone() };
    Arrays(arrays.0.iter().map(|(name, a)| (name.clone(), round(a))).collect())
}

/// Normal numbers with the shapes of the differentiable outputs, rounded to f32.
pub fn draw_cotangents(op: &Op, outputs: &Arrays) -> Arrays {
    let mut out = Arrays::new();
    for (k, port) in op.outputs.iter().enumerate().filter(|(_, p)| op.adjoint && p.differentiable) {
        let Some(y) = outputs.get(port.name) else { continue };
        let drawn = normals(COTANGENTS, k as u32, 0, y.len());
        out.put(port.name, y.shape(), drawn.into_iter().map(|x| x as f32).collect());
    }
    out
}

/// Scale of finite-difference steps of a parameter in that space.
fn step(space: Space) -> Step {
    match space {
        Space::Linear => Step::Plain,
        Space::Log => Step::Log,
        Space::Logit => Step::Logit,
    }
}

impl OpSubject {
    /// The operator at its generated case `index`.
    ///
    /// # Errors
    /// When the generated case is not valid input.
    pub fn case(op: &'static Op, index: usize) -> Result<Self> {
        let Case { inputs, settings } = (op.case)(index);
        Self::new(op, format!("{} case {index}", op.name), inputs, settings, Arrays::new())
    }

    /// The operator at user-supplied inputs, rounded to f32; missing cotangents are random.
    ///
    /// # Errors
    /// Invalid input.
    pub fn new(
        op: &'static Op,
        label: String,
        inputs: Arrays,
        settings: Settings,
        cotangents: Arrays,
    ) -> Result<Self> {
        let mut call = Call { inputs: round(&inputs), settings, dump: true, ..Call::default() };
        let ran = super::run(op, &call)?;
        if op.adjoint {
            let mut bars = draw_cotangents(op, &ran.outputs);
            bars.0.extend(round(&cotangents).0);
            call.cotangents = bars;
        }
        let checked = CheckedCall::new(op, &call, true)?;
        let prediction = (op.predict)(&checked, &ran)?;
        let variables: Vec<Variable> = op
            .inputs
            .iter()
            .filter(|p| op.adjoint && p.differentiable && !checked.f32s(p.name).is_empty())
            .map(|p| Variable { name: p.name.to_owned(), step: step(p.space) })
            .collect();
        let inputs = variables.iter().map(|v| (v.name.clone(), checked.f64s(&v.name))).collect();
        let twin_call = TwinCall::new(&checked);
        let plan = completed(op, &twin_call, Some(&twin::to_twin(&ran.plan)))?;
        let held = if op.plan.iter().any(|port| op.is_held(port.name)) {
            held(op, completed(op, &twin_call, None)?)
        } else {
            Named::new()
        };
        let bar_shapes = call.cotangents.0.iter().map(|(n, a)| (n.clone(), a.shape().to_vec())).collect();
        Ok(Self {
            op,
            label,
            twin_call,
            plan,
            held: (!held.is_empty()).then_some(held),
            outputs: flat(&ran.outputs),
            variables,
            inputs,
            cotangents: flat(&call.cotangents),
            bar_shapes,
            prediction,
            call,
        })
    }

    fn plan_for(&self, on: On) -> Option<&Named<f64>> {
        match on {
            On::Frozen => Some(&self.plan),
            On::Live => self.held.as_ref(),
        }
    }

    fn request(&self, on: On) -> twins::Request<'_> {
        twins::Request { plan: self.plan_for(on), ..self.twin_call.request() }
    }

    fn shaped_bars(&self, out_bar: &Values) -> Named<f64> {
        let shaped = |(name, v): (&String, &Vec<f64>)| {
            (name.clone(), Arr { shape: self.bar_shapes[name].clone(), data: v.clone() })
        };
        out_bar.iter().map(shaped).collect()
    }
}

/// The plan of the twin that has the given decisions.
fn completed(op: &Op, call: &TwinCall, given: Option<&Named<f64>>) -> Result<Named<f64>> {
    if op.plan.is_empty() {
        return Ok(Named::new());
    }
    let request = twins::Request { plan: given, ..call.request() };
    Ok(twins::value(&request).map_err(twin::refused(op))?.plan)
}

/// The values of a plan that carry no gradient.
fn held(op: &Op, plan: Named<f64>) -> Named<f64> {
    plan.into_iter().filter(|(name, _)| op.is_held(name)).collect()
}

/// Digest of the decisions.
fn log_of(op: &Op, plan: &Named<f64>) -> Result<u64> {
    let mut digest = Digest::new();
    for (name, a) in plan.iter().filter(|(name, _)| !op.is_held(name)) {
        digest.bytes(name.as_bytes());
        digest.f64(&a.shape, &a.data)?;
    }
    Ok(digest.value())
}

fn values_of(named: Named<f64>) -> Values {
    named.into_iter().map(|(name, a)| (name, a.data)).collect()
}

impl Subject for OpSubject {
    fn name(&self) -> String {
        self.label.clone()
    }
    fn end_to_end(&self) -> bool {
        self.op.is_composite()
    }
    fn unit(&self) -> f64 {
        self.op.width.unit()
    }
    fn variables(&self) -> &[Variable] {
        &self.variables
    }
    fn inputs(&self) -> &Values {
        &self.inputs
    }
    fn cotangents(&self) -> &Values {
        &self.cotangents
    }
    fn shipped(&self) -> Result<Values> {
        let whole =
            |name: &str| self.op.outputs.iter().any(|p| p.name == name && p.compare != Compare::ZeroPattern);
        Ok(self.outputs.iter().filter(|(name, _)| whole(name)).map(|(n, v)| (n.clone(), v.clone())).collect())
    }
    fn shipped_adjoint(&self, out_bar: &Values, start: Option<&Values>) -> Result<Values> {
        let mut call = Call { dump: false, ..self.call.clone() };
        for (name, v) in out_bar {
            call.cotangents.put(name, &self.bar_shapes[name], v.iter().map(|&x| x as f32).collect());
        }
        if let Some(start) = start {
            for (name, v) in start {
                let shape = &self.twin_call.inputs[name].shape;
                match self.op.width {
                    super::op::Width::F32 => {
                        call.start.put(name, shape, v.iter().map(|&x| x as f32).collect())
                    }
                    super::op::Width::F64 => call.start.put(name, shape, v.clone()),
                }
            }
        }
        Ok(flat(&super::run(self.op, &call)?.gradients))
    }
    fn value(&self, x: &Values, on: On) -> Result<Evaluation> {
        let mut inputs = self.twin_call.inputs.clone();
        for (name, values) in x {
            if let Some(input) = inputs.get_mut(name) {
                input.data.clone_from(values);
            }
        }
        let request = twins::Request { inputs: &inputs, ..self.request(on) };
        let results = twins::value(&request).map_err(twin::refused(self.op))?;
        Ok(Evaluation { log: log_of(self.op, &results.plan)?, outputs: values_of(results.outputs) })
    }
    fn jvp(&self, x_dot: &Values, on: On) -> Result<Values> {
        let mut tangents = Named::new();
        for (name, v) in x_dot {
            let shape = self.twin_call.inputs.get(name).map(|a| a.shape.clone());
            let shape =
                shape.ok_or_else(|| Error::input(format!("tangent of '{name}'")).expected("an input"))?;
            tangents.insert(name.clone(), Arr { shape, data: v.clone() });
        }
        Ok(values_of(twins::jvp(&self.request(on), &tangents).map_err(twin::refused(self.op))?.1))
    }
    fn vjp(&self, out_bar: &Values) -> Result<Values> {
        let bars = self.shaped_bars(out_bar);
        Ok(values_of(twins::vjp(&self.request(On::Frozen), &bars).map_err(twin::refused(self.op))?.1))
    }
    fn prediction(&self) -> Result<Prediction> {
        Ok(self.prediction.clone())
    }
}
