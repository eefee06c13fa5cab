//! Calls twins by name: values, directional derivatives, gradients.
//!
//! Integers, masks and plan arrays are represented exactly as `f64`. A composite operator is a chain of
//! stages that share one pool of arrays; reverse mode runs them last to first, with every array of the pool
//! as new leaves, so that the adjoints of one stage's inputs are the cotangents of the previous stage.
//! Derivatives are those of the smooth function with the plan of the forward pass held fixed.

mod heads;
mod list;

use std::collections::BTreeMap;

use crate::array::{Arr, Named, Out};
use crate::dual::Dual;
use crate::ports::Signature;
use crate::rev::{self, Rev};
use crate::scalar::Scalar;
pub use crate::settings::Setting;
use crate::settings::Settings;
pub use heads::head;
pub use list::LIST;

/// The arguments of one stage of a twin.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a, S> {
    /// The pool: inputs of the operator, and the arrays written by previous stages.
    pub arrays: &'a Named<S>,
    /// Settings.
    pub settings: Settings<'a>,
    /// Given decisions; those missing are computed from the values.
    pub plan: Option<&'a Named<f64>>,
    /// Index of the stage in its chain.
    pub stage: usize,
}

/// One stage for one scalar type.
pub type Run<S> = fn(&Call<'_, S>, &mut Out<'_, S>) -> Result<(), String>;

/// One stage for the scalar types with derivatives.
pub type SmoothRun = (Run<Dual>, Run<Rev>);

/// One stage of a twin: one function for each of the three scalar types.
#[derive(Clone, Copy, Debug)]
pub struct Stage {
    /// Values.
    pub value: Run<f64>,
    /// Values and gradients; `None` for an operator without gradient.
    pub smooth: Option<SmoothRun>,
}

/// One operator of the list.
#[derive(Clone, Copy, Debug)]
pub struct Twin {
    /// Names, shapes and documentation.
    pub signature: &'static Signature,
    /// The chain of its stages.
    pub stages: &'static [Stage],
    /// The amount of work of a call of the first stage.
    pub work: fn(&Call<'_, f64>) -> Result<u64, String>,
}

/// A call of an operator.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Name of the operator.
    pub op: &'a str,
    /// Inputs by name; sizes and degrees are 0-d.
    pub inputs: &'a Named<f64>,
    /// Settings by name.
    pub settings: &'a BTreeMap<String, Setting>,
    /// Given decisions; those missing are computed from the values.
    pub plan: Option<&'a Named<f64>>,
}

/// Results of an operator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Results {
    /// Outputs by name.
    pub outputs: Named<f64>,
    /// Intermediate results.
    pub intermediates: Named<f64>,
    /// Every discrete decision.
    pub plan: Named<f64>,
}

/// Names of all operators that have a twin.
pub fn names() -> Vec<&'static str> {
    LIST.iter().map(|twin| twin.signature.name).collect()
}

/// Inputs of an operator that have a gradient, including optional ones; empty for one without a gradient.
///
/// # Errors
/// When there is no such operator.
pub fn smooth_inputs(op: &str) -> Result<Vec<&'static str>, String> {
    Ok(find(op)?.signature.smooth_inputs())
}

/// Outputs of an operator that take a cotangent, including those of an inactive mode.
///
/// # Errors
/// When there is no such operator.
pub fn smooth_outputs(op: &str) -> Result<Vec<&'static str>, String> {
    Ok(find(op)?.signature.smooth_outputs())
}

fn find(op: &str) -> Result<&'static Twin, String> {
    LIST.iter().find(|twin| twin.signature.name == op).ok_or_else(|| format!("operator {op}: no such twin"))
}

/// Checks names of inputs and that every number is finite, and settings.
fn check<'a>(request: &Request<'a>) -> Result<(&'static Twin, Settings<'a>), String> {
    let twin = find(request.op)?;
    let Signature { name: op, inputs, settings, .. } = twin.signature;
    let settings = Settings::new(settings, request.settings)?;
    for (name, x) in request.inputs {
        if !inputs.iter().any(|port| port.name == name) {
            let known: Vec<_> = inputs.iter().map(|port| port.name).collect();
            return Err(format!("input {name}: unknown to {op}; known: {}", known.join(", ")));
        }
        if let Some(i) = x.data.iter().position(|x| !x.is_finite()) {
            return Err(format!("input {name}: expected finite numbers, got {} at entry {i}", x.data[i]));
        }
    }
    Ok((twin, settings))
}

/// Checks names and shapes of tangents or cotangents.
fn check_directions(
    what: &str,
    given: &Named<f64>,
    allowed: &[&str],
    arrays: &Named<f64>,
) -> Result<(), String> {
    for (name, x) in given {
        let Some(array) = arrays.get(name).filter(|_| allowed.contains(&name.as_str())) else {
            return Err(format!("{what} {name}: expected one of {}", allowed.join(", ")));
        };
        if array.shape != x.shape {
            return Err(format!("{what} {name}: expected shape {:?}, got {:?}", array.shape, x.shape));
        }
        if let Some(i) = x.data.iter().position(|x| !x.is_finite()) {
            return Err(format!("{what} {name}: expected finite numbers, got {} at entry {i}", x.data[i]));
        }
    }
    Ok(())
}

/// The arrays written by each stage, and the completed plan.
fn run_all(
    twin: &Twin,
    request: &Request<'_>,
    settings: Settings<'_>,
) -> Result<(Vec<Named<f64>>, Named<f64>), String> {
    let (mut pool, mut written) = (request.inputs.clone(), Vec::new());
    let mut plan = request.plan.cloned().unwrap_or_default();
    for (stage, run) in twin.stages.iter().enumerate() {
        let mut out = Out::new(None);
        (run.value)(&Call { arrays: &pool, settings, plan: Some(&plan), stage }, &mut out)?;
        let (arrays, decisions) = out.finish();
        pool.extend(arrays.clone());
        written.push(arrays);
        plan.extend(decisions);
    }
    Ok((written, plan))
}

fn results(twin: &Twin, written: &[Named<f64>], plan: Named<f64>) -> Results {
    let mut results = Results { plan, ..Results::default() };
    for (name, x) in written.iter().flatten() {
        let kind = if twin.signature.outputs.iter().any(|port| port.name == name) {
            &mut results.outputs
        } else {
            &mut results.intermediates
        };
        kind.insert(name.clone(), x.clone());
    }
    results
}

/// Outputs, intermediates and plan.
///
/// # Errors
/// When the operator, an input, a setting or the plan is invalid.
pub fn value(request: &Request<'_>) -> Result<Results, String> {
    let (twin, settings) = check(request)?;
    let (written, plan) = run_all(twin, request, settings)?;
    Ok(results(twin, &written, plan))
}

/// Results, and the tangents of the outputs for the given tangents of inputs (missing ones are 0).
///
/// # Errors
/// The same as [`value`]; also when a tangent does not fit, or the operator has no gradient.
pub fn jvp(request: &Request<'_>, tangents: &Named<f64>) -> Result<(Results, Named<f64>), String> {
    let (twin, settings) = check(request)?;
    let stages = smooth_stages(twin)?;
    check_directions("tangent", tangents, &twin.signature.smooth_inputs(), request.inputs)?;
    let (written, plan) = run_all(twin, request, settings)?;
    let mut pool: Named<Dual> = request
        .inputs
        .iter()
        .map(|(name, x)| {
            let mut dual = x.map(|&x| Dual::from_f64(x));
            if let Some(tangent) = tangents.get(name) {
                dual.data.iter_mut().zip(&tangent.data).for_each(|(x, &tangent)| x.tangent = tangent);
            }
            (name.clone(), dual)
        })
        .collect();
    for (stage, (run, _)) in stages.into_iter().enumerate() {
        let mut out = Out::new(None);
        run(&Call { arrays: &pool, settings, plan: Some(&plan), stage }, &mut out)?;
        pool.extend(out.finish().0);
    }
    let outputs = twin
        .signature
        .smooth_outputs()
        .into_iter()
        .filter_map(|name| Some((name.to_owned(), pool.get(name)?.map(|x| x.tangent))))
        .collect();
    Ok((results(twin, &written, plan), outputs))
}

/// Results, and the gradient of Σ output·cotangent by input name (missing cotangents are 0; inputs without
/// influence have a gradient of zeros).
///
/// # Errors
/// The same as [`value`]; also when a cotangent does not fit, or the operator has no gradient.
pub fn vjp(request: &Request<'_>, cotangents: &Named<f64>) -> Result<(Results, Named<f64>), String> {
    let (twin, settings) = check(request)?;
    let stages = smooth_stages(twin)?;
    let (written, plan) = run_all(twin, request, settings)?;
    let results = results(twin, &written, plan);
    check_directions("cotangent", cotangents, &twin.signature.smooth_outputs(), &results.outputs)?;
    let mut bars = cotangents.clone();
    for (stage, (_, run)) in stages.into_iter().enumerate().rev() {
        rev::clear();
        let pool = request.inputs.iter().chain(written[..stage].iter().flatten());
        let leaves: Named<Rev> = pool.map(|(name, x)| (name.clone(), rev::leaves(x))).collect();
        let mut out = Out::new(Some(&bars));
        run(&Call { arrays: &leaves, settings, plan: Some(&results.plan), stage }, &mut out)?;
        for (name, x) in &leaves {
            let adjoint = rev::adjoints(x);
            let bar = bars.entry(name.clone()).or_insert_with(|| Arr::filled(&x.shape, 0.0));
            bar.data.iter_mut().zip(&adjoint.data).for_each(|(bar, adjoint)| *bar += adjoint);
        }
    }
    rev::clear();
    let smooth = twin.signature.smooth_inputs();
    let gradient = smooth
        .into_iter()
        .filter(|&name| request.inputs.contains_key(name))
        .map(|name| {
            let zeros = || Arr::filled(&request.inputs[name].shape, 0.0);
            (name.to_owned(), bars.remove(name).unwrap_or_else(zeros))
        })
        .collect();
    Ok((results, gradient))
}

/// The differentiable stages of an operator.
fn smooth_stages(twin: &Twin) -> Result<Vec<SmoothRun>, String> {
    let stages: Option<Vec<_>> = twin.stages.iter().map(|stage| stage.smooth).collect();
    stages.ok_or_else(|| format!("operator {}: the operator has no gradient", twin.signature.name))
}

/// The amount of work in the unit of the operator: (Gaussian, pixel) pairs for blending, products for layers,
/// entries of the inputs where the twin defines no other unit. 0 for a request for which [`value`] returns an
/// error.
pub fn work(request: &Request<'_>) -> u64 {
    let count = || {
        let (twin, settings) = check(request)?;
        (twin.work)(&Call { arrays: request.inputs, settings, plan: request.plan, stage: 0 })
    };
    count().unwrap_or(0)
}
