//! Checks of user-supplied functions, given as closures.

use super::rungs::{Differences, largest, probes, sane};
use super::subject::{FROZEN, LIVE, Options, Prediction, SKIPPED, Variable};
use crate::num::order;
use crate::tape::probe::Step;
use crate::tape::probe::{self, Evaluation, UNIT, Values, direction, dot, norm};
use crate::tape::report::{Report, Rung};
use crate::{Error, Result};

/// Checks a user-supplied function: R0, the dot product against Richardson differences, and R3.
///
/// `value` returns the outputs at named inputs, `vjp` the gradients of ⟨outputs, cotangent⟩ by input name;
/// every input is assumed to be differentiable. Steps are h·max(1, |x|). A function that takes discrete
/// decisions is checked by
/// [`function_with_log`].
///
/// # Errors
/// Errors of the closures.
pub fn function(
    name: &str,
    value: impl Fn(&Values) -> Result<Vec<f64>>,
    vjp: impl Fn(&Values, &[f64]) -> Result<Values>,
    inputs: &Values,
    options: &Options,
) -> Result<Report> {
    let value = |x: &Values| Ok(Evaluation { outputs: [(OUT.to_owned(), value(x)?)].into(), log: 0 });
    function_with_log(name, value, |x, y_bar| vjp(x, &y_bar[OUT]), inputs, options)
}

/// Name of the single output of a function given as a closure.
const OUT: &str = "value";

/// [`function`] for several named outputs and a digest of its decisions: differences are taken only where
/// the digests are equal.
///
/// # Errors
/// Errors of the closures.
pub fn function_with_log(
    name: &str,
    value: impl Fn(&Values) -> Result<Evaluation>,
    vjp: impl Fn(&Values, &Values) -> Result<Values>,
    inputs: &Values,
    options: &Options,
) -> Result<Report> {
    if inputs.is_empty() {
        return Err(Error::input(name).expected("at least one input to differentiate with respect to"));
    }
    let variables: Vec<Variable> =
        inputs.keys().map(|n| Variable { name: n.clone(), step: Step::Plain }).collect();
    let here = value(inputs)?;
    let w = direction(options.seed, 0, &here.outputs);
    let grads = vjp(inputs, &w)?;
    let mut rungs = Vec::new();
    let mut sanity = Rung::new("R0", "function: complete, finite, not vacuous");
    sanity_of_function(&mut sanity, &here.outputs, &variables, inputs, &grads);
    let complete = sanity.passed();
    rungs.push(sanity);
    if !complete {
        return Ok(Report { subject: name.to_owned(), rungs });
    }

    let mut f = |x: &Values| value(x);
    let mut rung = Rung::new("R1", "dot product: Richardson differences against the vector-Jacobian product");
    let mut worst = 0.0;
    for k in 0..options.directions {
        let w = direction(options.seed, 2 * k + 2, &here.outputs);
        let drawn = direction(options.seed, 2 * k + 1, inputs);
        // a step of relative size h in every entry
        let v: Values = drawn
            .iter()
            .map(|(n, v)| {
                (n.clone(), v.iter().zip(&inputs[n]).map(|(v, x)| v * Step::Plain.scale(*x)).collect())
            })
            .collect();
        let jtw = vjp(inputs, &w)?;
        let exact = dot(&v, &jtw);
        let fd = probe::ladder(&mut f, inputs, &v, &w, options.unit, exact)?;
        let gap = (fd.value - exact).abs() - fd.noise;
        if gap > 0.0 {
            worst = order::max(worst, gap / (norm(&v) * norm(&jtw)));
        }
    }
    rung.hold("dot-product test beyond rounding noise", worst, FROZEN);
    rungs.push(rung);

    let mut rung = Rung::new("R3", "entry by entry: finite differences where the decision logs are equal")
        .labelled(["yours", "finite difference"]);
    let probes = probes(&variables, inputs, options);
    let exact: Vec<f64> = probes.iter().map(|p| dot(&p.v, &grads)).collect();
    let largest = largest(&probes, &exact);
    let (mut skipped, mut differences) = (0, Differences::default());
    for (p, &exact) in probes.iter().zip(&exact) {
        let fd = if options.unit > UNIT {
            probe::ladder(&mut f, inputs, &p.v, &w, options.unit, exact)?
        } else {
            probe::live(&mut f, inputs, &p.v, &w, options.unit, here.log)?
        };
        if !fd.same_log {
            skipped += 1;
            continue;
        }
        differences.add(&mut rung, p, &fd, [exact, largest[&p.variable], LIVE]);
    }
    differences.report(&mut rung, probes.len(), LIVE);
    let allowed = order::max(1.0, SKIPPED * probes.len() as f64);
    rung.hold("skipped because a decision changed", f64::from(skipped), allowed);
    rungs.push(rung);
    Ok(Report { subject: name.to_owned(), rungs })
}

/// R0 of a function without predicted zeros: single zeros are allowed, a variable without any gradient is
/// not.
fn sanity_of_function(
    rung: &mut Rung,
    outputs: &Values,
    variables: &[Variable],
    inputs: &Values,
    grads: &Values,
) {
    let mut known = Prediction::default();
    for variable in variables {
        if let Some(g) = grads.get(&variable.name) {
            known.zeros.insert(variable.name.clone(), g.iter().map(|x| *x == 0.0).collect());
        }
    }
    sane(rung, outputs, variables, inputs, grads, &known);
}
