//! Gradient checks: five rungs, cheap to expensive.
//!
//! | rung | compares | bound |
//! |---|---|---|
//! | R0 | the shipped operator with common sense: every gradient is there, finite, zero where predicted, not zero elsewhere | |
//! | R1 | the twin's `Dual` with the twin's `Rev`: ⟨Jv, w⟩ = ⟨v, Jᵀw⟩ | 1e-13 per operator, 1e-11 end to end |
//! | R2 | finite differences of the twin on the frozen plan with `Dual` | 1e-7 with Richardson, order 2 |
//! | R3 | the same on the live plan, where the decision logs are equal | 1e-6, at most 5 % skipped |
//! | R4 | the shipped hand-derived adjoint with `Rev` on the same plan | relative L2 2e-5 (1e-12 in f64), 1−cos 1e-9, bias 1e-6; linearity and accumulation in bits |
//!
//! A check that saw nothing (constant outputs, gradients all zero) fails. [`Sabotaged`] is the negative control: with
//! a sign flipped, a term dropped or 1 % added, R4 must fail.
//!
//! Anyone's function is checked by [`function`]:
//!
//! ```
//! use lastlight::check;
//! // f(x) = Σ x³ with its gradient 3x²
//! let report = check::function(
//!     "cubes",
//!     |x| Ok(vec![x["x"].iter().map(|x| x * x * x).fold(0.0, |a, b| a + b)]),
//!     |x, y_bar| Ok([("x".to_owned(), x["x"].iter().map(|x| 3.0 * x * x * y_bar[0]).collect())].into()),
//!     &[("x".to_owned(), vec![1.0, -2.0, 0.5])].into(),
//!     &check::Options::default(),
//! )?;
//! assert!(report.passed(), "{report}");
//! # Ok::<(), lastlight::Error>(())
//! ```

pub use super::probe::{Derivative, Distance, Evaluation, Step, UNIT, Values};
pub use super::report::{Entry, Measure, Report, Rung};
use super::probe::{self, direction, dot, norm};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// A differentiable input of a subject.
#[derive(Clone, Debug)]
pub struct Variable {
    /// name
    pub name: String,
    /// how finite differences move it
    pub step: Step,
}

/// Which decisions an evaluation of the twin takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum On {
    /// Those of the shipped forward at the inputs of the case.
    Frozen,
    /// Its own, anew at every point.
    Live,
}

/// Zeros of the gradient known beforehand.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// per variable: entries whose gradient is exactly 0; every other entry is expected not to be. A variable without
    /// a mask is expected to have none.
    pub zeros: BTreeMap<String, Vec<bool>>,
    /// per variable: row length and directions d with ⟨d, x̄⟩ = 0 row by row
    pub nulls: BTreeMap<String, (usize, Vec<f64>)>,
}

/// What the engine needs to know of an operator with its twin, at one set of inputs.
pub trait Subject {
    /// Shown in reports.
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
    /// What is known of the gradient's zeros.
    fn prediction(&self) -> Result<Prediction>;
}

/// What to run and how thoroughly.
#[derive(Clone, Debug)]
pub struct Options {
    /// seed of directions and samples
    pub seed: u64,
    /// which of R0 … R4
    pub rungs: [bool; 5],
    /// random directions of dot-product tests
    pub directions: u16,
    /// entries per variable whose derivative is taken one by one
    pub entries: usize,
    /// rounding unit of the function under test, for [`function`]: the noise of differences follows from it
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
/// Bound of R4 on ‖adjoint onto start − (start + gradient)‖, in rounding units: an adjoint may add its terms one by one.
pub const ACCUMULATION_UNITS: f64 = 8.0;
/// Derivatives smaller than this share of their variable's largest one are held against the largest.
const SMALL: f64 = 1e-6;
/// Up to this many input entries, R1 also walks through all unit vectors.
const UNIT_VECTORS: usize = 64;

/// Runs the chosen rungs in order.
///
/// # Errors
/// What the subject returns; a failed rung is not an error but a report that did not pass.
pub fn run(subject: &dyn Subject, options: &Options) -> Result<Report> {
    let mut rungs = Vec::new();
    let differentiable = !subject.variables().is_empty();
    if options.rungs[0] {
        rungs.push(r0(subject)?);
    }
    if differentiable {
        if options.rungs[1] {
            rungs.push(r1(subject, options)?);
        }
        if options.rungs[2] {
            rungs.push(r2(subject, options)?);
        }
        if options.rungs[3] {
            rungs.push(r3(subject, options)?);
        }
    }
    if options.rungs[4] {
        rungs.push(r4(subject, options)?);
    }
    Ok(Report { subject: subject.name(), rungs })
}

fn is_constant(outputs: &Values) -> bool {
    let single = outputs.values().all(|v| v.len() <= 1);
    !single && outputs.values().all(|v| v.iter().all(|x| *x == v[0]))
}

fn sane(rung: &mut Rung, outputs: &Values, variables: &[Variable], inputs: &Values, grads: &Values, known: &Prediction) {
    for (name, v) in outputs {
        if let Some(i) = v.iter().position(|x| !x.is_finite()) {
            rung.fail(format!("output {name}[{i}] is {}", v[i]));
        }
    }
    if is_constant(outputs) {
        rung.fail("every output is constant: there is nothing to check");
    }
    for variable in variables {
        let name = &variable.name;
        let Some(g) = grads.get(name) else {
            rung.fail(format!("no gradient of {name}"));
            continue;
        };
        if g.len() != inputs[name].len() {
            rung.fail(format!("gradient of {name}: {} entries for {} inputs", g.len(), inputs[name].len()));
            continue;
        }
        if let Some(i) = g.iter().position(|x| !x.is_finite()) {
            rung.fail(format!("gradient of {name}[{i}] is {}", g[i]));
            continue;
        }
        let predicted = |i: usize| known.zeros.get(name).is_some_and(|mask| mask[i]);
        let broken = (0..g.len()).filter(|&i| predicted(i) && g[i] != 0.0).count();
        let silent = (0..g.len()).filter(|&i| !predicted(i) && g[i] == 0.0).count();
        rung.hold(format!("predicted zeros of {name} that are not"), broken as f64, 0.0);
        rung.hold(format!("other entries of {name} that are zero"), silent as f64, 0.0);
        let expected = (0..g.len()).any(|i| !predicted(i));
        if expected && g.iter().all(|x| *x == 0.0) {
            rung.fail(format!("gradient of {name} is zero everywhere: there is nothing to check"));
        }
    }
    let silent = |g: &Vec<f64>| g.iter().all(|x| *x == 0.0);
    if !variables.is_empty() && grads.values().all(silent) {
        rung.fail("every gradient is zero: there is nothing to check");
    }
}

fn r0(subject: &dyn Subject) -> Result<Rung> {
    let mut rung = Rung::new("R0", "shipped operator: complete, finite, zero where predicted, not vacuous");
    let outputs = subject.shipped()?;
    let grads = if subject.variables().is_empty() {
        Values::new()
    } else {
        subject.shipped_adjoint(subject.cotangents(), None)?
    };
    let known = subject.prediction()?;
    sane(&mut rung, &outputs, subject.variables(), subject.inputs(), &grads, &known);
    for (name, (row, d)) in &known.nulls {
        let Some(g) = grads.get(name) else { continue };
        let mut worst = 0.0;
        for (d, g) in d.chunks(*row).zip(g.chunks(*row)) {
            let (mut along, mut d2, mut g2) = (0.0, 0.0, 0.0);
            for (d, g) in d.iter().zip(g) {
                along += d * g;
                d2 += d * d;
                g2 += g * g;
            }
            if along != 0.0 {
                worst = crate::num::order::max(worst, along.abs() / (d2 * g2).sqrt());
            }
        }
        rung.hold(format!("gradient of {name} along its null direction"), worst, NULL_UNITS * subject.unit());
    }
    Ok(rung)
}

fn one_hot(name: &str, len: usize, i: usize, h: f64) -> Values {
    let mut v = vec![0.0; len];
    v[i] = h;
    [(name.to_owned(), v)].into()
}

fn r1(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung = Rung::new("R1", "twin: dual numbers against the reverse tape");
    let inputs = subject.inputs();
    let mut worst = 0.0;
    let mut compare = |v: &Values, w: &Values, jtw: &Values| -> Result<()> {
        let jv = subject.jvp(v, On::Frozen)?;
        let scale = norm(&jv) * norm(w) + norm(v) * norm(jtw);
        let gap = (dot(&jv, w) - dot(v, jtw)).abs();
        if gap != 0.0 {
            worst = crate::num::order::max(worst, gap / scale);
        }
        Ok(())
    };
    for k in 0..options.directions {
        let w = direction(options.seed, 2 * k, subject.cotangents());
        let jtw = subject.vjp(&w)?;
        compare(&direction(options.seed, 2 * k + 1, inputs), &w, &jtw)?;
        compare(&direction(options.seed, 2 * k + 2, inputs), &w, &jtw)?;
    }
    let w = subject.cotangents();
    let jtw = subject.vjp(w)?;
    for (name, x) in inputs {
        // one variable at a time, so that a large one hides no small one
        let only: Values = [(name.clone(), probe::normals(options.seed, 0, 1, x.len()))].into();
        let part: Values = jtw.iter().filter(|(n, _)| *n == name).map(|(n, v)| (n.clone(), v.clone())).collect();
        compare(&only, w, &part)?;
    }
    let total = inputs.values().fold(0, |n, v| n + v.len());
    if total <= UNIT_VECTORS {
        for (name, x) in inputs {
            for i in 0..x.len() {
                compare(&one_hot(name, x.len(), i, 1.0), w, &jtw)?;
            }
        }
    }
    let bound = if subject.end_to_end() { DOT_CHAIN } else { DOT_OPERATOR };
    rung.hold("dot-product test", worst, bound);
    Ok(rung)
}

/// One derivative to be taken: a variable, a direction in it, and the entry if it is a single one.
struct Probe {
    variable: String,
    index: usize,
    v: Values,
}

fn probes(variables: &[Variable], inputs: &Values, options: &Options) -> Vec<Probe> {
    let mut out = Vec::new();
    for (k, variable) in variables.iter().enumerate() {
        let x = &inputs[&variable.name];
        for i in probe::sample(options.seed, k as u32, x.len(), options.entries) {
            let v = one_hot(&variable.name, x.len(), i, variable.step.scale(x[i]));
            out.push(Probe { variable: variable.name.clone(), index: i, v });
        }
    }
    out
}

/// Relative excess of |FD − AD| over its rounding noise, with small derivatives held against the largest one.
fn excess(fd: &Derivative, exact: f64, largest: f64) -> f64 {
    let beyond = (fd.value - exact).abs() - fd.noise;
    if beyond <= 0.0 {
        return 0.0;
    }
    let scale = crate::num::order::max(exact.abs(), SMALL * largest);
    if scale == 0.0 { f64::INFINITY } else { beyond / scale }
}

/// Largest |derivative| per variable.
fn largest(probes: &[Probe], exact: &[f64]) -> BTreeMap<String, f64> {
    let mut out = BTreeMap::new();
    for (p, e) in probes.iter().zip(exact) {
        let slot = out.entry(p.variable.clone()).or_insert(0.0);
        *slot = crate::num::order::max(*slot, e.abs());
    }
    out
}

fn r2(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung = Rung::new("R2", "twin on the frozen plan: finite differences against dual numbers");
    let (inputs, w) = (subject.inputs(), subject.cotangents());
    let probes = probes(subject.variables(), inputs, options);
    let exact = probes.iter().map(|p| Ok(dot(&subject.jvp(&p.v, On::Frozen)?, w))).collect::<Result<Vec<_>>>()?;
    let largest = largest(&probes, &exact);
    let (mut worst, mut lowest, mut ordered, mut unsettled) = (0.0, f64::INFINITY, 0, 0);
    let mut f = |x: &Values| subject.value(x, On::Frozen);
    for (p, &exact) in probes.iter().zip(&exact) {
        let fd = probe::ladder(&mut f, inputs, &p.v, w, UNIT, exact)?;
        let e = excess(&fd, exact, largest[&p.variable]);
        if !(e <= FROZEN) {
            rung.worst.push(Entry { array: p.variable.clone(), index: p.index, ours: exact, reference: fd.value });
        }
        worst = crate::num::order::max(worst, e);
        let scale = crate::num::order::max(exact.abs(), SMALL * largest[&p.variable]);
        unsettled += usize::from(!(fd.spread <= 10.0 * FROZEN * scale + 4.0 * fd.noise));
        if let Some(order) = fd.order {
            ordered += 1;
            lowest = crate::num::order::min(lowest, order);
        }
    }
    rung.worst.truncate(WORST);
    rung.note("derivatives taken", probes.len() as f64);
    rung.hold("relative difference beyond rounding noise", worst, FROZEN);
    rung.hold("derivatives whose two finest values disagree", unsettled as f64, 0.0);
    rung.note("derivatives whose order could be observed", f64::from(ordered));
    if ordered > 0 {
        rung.hold("observed order below 2 by", 2.0 - lowest, 0.2);
    }
    Ok(rung)
}

/// How many of the entries that differ most are kept.
const WORST: usize = 10;

fn r3(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung = Rung::new("R3", "twin on the live plan: finite differences where the decision logs are equal");
    let (inputs, w) = (subject.inputs(), subject.cotangents());
    let probes = probes(subject.variables(), inputs, options);
    let log = subject.value(inputs, On::Live)?.log;
    let exact = probes.iter().map(|p| Ok(dot(&subject.jvp(&p.v, On::Live)?, w))).collect::<Result<Vec<_>>>()?;
    let largest = largest(&probes, &exact);
    let (mut worst, mut skipped, mut mass) = (0.0, 0, 0.0);
    for (p, &exact) in probes.iter().zip(&exact) {
        let fd = probe::live(&mut |x| subject.value(x, On::Live), inputs, &p.v, w, UNIT, log)?;
        if !fd.same_log {
            skipped += 1;
            let frozen = probe::live(&mut |x| subject.value(x, On::Frozen), inputs, &p.v, w, UNIT, 0)?;
            mass += (fd.value - frozen.value).abs() * probe::live_width();
            continue;
        }
        let e = excess(&fd, exact, largest[&p.variable]);
        if !(e <= LIVE) {
            rung.worst.push(Entry { array: p.variable.clone(), index: p.index, ours: exact, reference: fd.value });
        }
        worst = crate::num::order::max(worst, e);
    }
    rung.worst.truncate(WORST);
    rung.note("derivatives taken", probes.len() as f64);
    rung.hold("relative difference beyond rounding noise", worst, LIVE);
    // a handful of probes has no meaningful percentage: one may always be skipped
    let allowed = crate::num::order::max(1.0, SKIPPED * probes.len() as f64);
    rung.hold("skipped because a decision changed", f64::from(skipped), allowed);
    rung.note("discontinuity mass of the skipped ones", mass);
    Ok(rung)
}

fn r4(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung = Rung::new("R4", "shipped adjoint against the twin's reverse tape, on the same plan");
    let single = subject.unit() > UNIT;
    let outputs = subject.shipped()?;
    let twin = subject.value(subject.inputs(), On::Frozen)?.outputs;
    for (name, ours) in &outputs {
        let Some(theirs) = twin.get(name) else {
            rung.fail(format!("the twin has no output {name}"));
            continue;
        };
        let d = probe::distance(ours, theirs);
        rung.hold(format!("relative L2 of output {name}"), d.relative_l2, if single { OUTPUT_F32 } else { OUTPUT_F64 });
    }
    if subject.variables().is_empty() {
        return Ok(rung);
    }
    let out_bar = subject.cotangents();
    let grads = subject.shipped_adjoint(out_bar, None)?;
    let reverse = subject.vjp(out_bar)?;
    let mut worst = Vec::new();
    for variable in subject.variables() {
        let name = &variable.name;
        let (Some(ours), Some(theirs)) = (grads.get(name), reverse.get(name)) else {
            rung.fail(format!("no gradient of {name}"));
            continue;
        };
        if ours.len() != theirs.len() {
            rung.fail(format!("gradient of {name}: {} entries, the twin has {}", ours.len(), theirs.len()));
            continue;
        }
        let d = probe::distance(ours, theirs);
        rung.hold(format!("relative L2 of {name}"), d.relative_l2, if single { SHIPPED_F32 } else { SHIPPED_F64 });
        rung.hold(format!("1 - cosine of {name}"), d.one_minus_cosine, COSINE);
        rung.hold(format!("signed bias of {name}"), d.signed_bias.abs(), BIAS);
        rung.note(format!("zeros of {name} in one of them only"), d.zero_mismatch as f64);
        worst.extend(probe::worst_entries(name, ours, theirs, WORST));
    }
    worst.sort_by(|a, b| (b.ours - b.reference).abs().total_cmp(&(a.ours - a.reference).abs()));
    worst.truncate(WORST);
    rung.worst = worst;
    bits(subject, options, &grads, &mut rung)?;
    Ok(rung)
}

/// adjoint(2ȳ) = 2·adjoint(ȳ), adjoint(0) = 0, and the same onto a non-zero x̄, in bits; and that adding onto x̄ adds.
fn bits(subject: &dyn Subject, options: &Options, grads: &Values, rung: &mut Rung) -> Result<()> {
    let scaled = |values: &Values, s: f64| -> Values {
        values.iter().map(|(n, v)| (n.clone(), v.iter().map(|x| s * x).collect())).collect()
    };
    let differing = |a: &Values, b: &Values| {
        let pairs = a.iter().flat_map(|(n, a)| a.iter().zip(&b[n]));
        pairs.filter(|(a, b)| a != b).count() as f64
    };
    let twice = subject.shipped_adjoint(&scaled(subject.cotangents(), 2.0), None)?;
    rung.hold("entries where adjoint(2y) is not 2 adjoint(y)", differing(&scaled(grads, 2.0), &twice), 0.0);
    let none = subject.shipped_adjoint(&probe::zeros(subject.cotangents()), None)?;
    rung.hold("entries where adjoint(0) is not 0", differing(&probe::zeros(grads), &none), 0.0);
    let single = subject.unit() > UNIT;
    let mut start = direction(options.seed, 0, grads);
    for x in start.values_mut().flatten() {
        *x = if single { f64::from(*x as f32) } else { *x };
    }
    let onto = subject.shipped_adjoint(subject.cotangents(), Some(&start))?;
    let onto_twice = subject.shipped_adjoint(&scaled(subject.cotangents(), 2.0), Some(&scaled(&start, 2.0)))?;
    rung.hold("entries where accumulation is not linear", differing(&scaled(&onto, 2.0), &onto_twice), 0.0);
    let mut worst = 0.0;
    for (name, onto) in &onto {
        let (start, g) = (&start[name], &grads[name]);
        let (mut off, mut size) = (0.0, 0.0);
        for i in 0..onto.len() {
            let d = onto[i] - (start[i] + g[i]);
            off += d * d;
            size += start[i] * start[i] + g[i] * g[i];
        }
        if off > 0.0 {
            worst = crate::num::order::max(worst, (off / size).sqrt());
        }
    }
    rung.hold("accumulation against start + gradient", worst, ACCUMULATION_UNITS * subject.unit());
    Ok(())
}

/// A way to break an adjoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sabotage {
    /// x̄ ← −x̄
    FlipSign,
    /// x̄ ← what every second entry of the cotangents contributes
    DropTerm,
    /// x̄ ← 1.01 x̄
    OnePercent,
}

impl Sabotage {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::FlipSign, Self::DropTerm, Self::OnePercent];
}

/// A subject whose shipped adjoint is broken in one variable.
pub struct Sabotaged<'a> {
    /// the honest subject
    pub inner: &'a dyn Subject,
    /// which gradient is broken
    pub variable: &'a str,
    /// how
    pub how: Sabotage,
}

impl Subject for Sabotaged<'_> {
    fn name(&self) -> String {
        format!("{} with {:?} of {}", self.inner.name(), self.how, self.variable)
    }
    fn end_to_end(&self) -> bool {
        self.inner.end_to_end()
    }
    fn unit(&self) -> f64 {
        self.inner.unit()
    }
    fn variables(&self) -> &[Variable] {
        self.inner.variables()
    }
    fn inputs(&self) -> &Values {
        self.inner.inputs()
    }
    fn cotangents(&self) -> &Values {
        self.inner.cotangents()
    }
    fn shipped(&self) -> Result<Values> {
        self.inner.shipped()
    }
    fn shipped_adjoint(&self, out_bar: &Values, start: Option<&Values>) -> Result<Values> {
        let mut grads = self.inner.shipped_adjoint(out_bar, start)?;
        let broken = match self.how {
            Sabotage::FlipSign => grads[self.variable].iter().map(|x| -x).collect(),
            Sabotage::OnePercent => grads[self.variable].iter().map(|x| 1.01 * x).collect(),
            Sabotage::DropTerm => {
                let mut part = out_bar.clone();
                for v in part.values_mut() {
                    for x in v.iter_mut().step_by(2) {
                        *x = 0.0;
                    }
                }
                let mut grads = self.inner.shipped_adjoint(&part, start)?;
                grads.remove(self.variable).unwrap_or_default()
            }
        };
        grads.insert(self.variable.to_owned(), broken);
        Ok(grads)
    }
    fn value(&self, x: &Values, on: On) -> Result<Evaluation> {
        self.inner.value(x, on)
    }
    fn jvp(&self, x_dot: &Values, on: On) -> Result<Values> {
        self.inner.jvp(x_dot, on)
    }
    fn vjp(&self, out_bar: &Values) -> Result<Values> {
        self.inner.vjp(out_bar)
    }
    fn prediction(&self) -> Result<Prediction> {
        self.inner.prediction()
    }
}

/// Checks somebody's function: R0, the dot product against Richardson differences, and R3.
///
/// `value` returns the outputs at named inputs, `vjp` the gradients of ⟨outputs, cotangent⟩ by input name; every input
/// is taken to be differentiable. Steps are h·max(1, |x|). A function that takes discrete decisions is checked by
/// [`function_with_log`].
///
/// # Errors
/// What the closures return.
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

/// Name of the one output of a function given as a closure.
const OUT: &str = "value";

/// [`function`] for several named outputs and a digest of the decisions behind them: differences are taken only where
/// the digests are equal.
///
/// # Errors
/// What the closures return.
pub fn function_with_log(
    name: &str,
    value: impl Fn(&Values) -> Result<Evaluation>,
    vjp: impl Fn(&Values, &Values) -> Result<Values>,
    inputs: &Values,
    options: &Options,
) -> Result<Report> {
    if inputs.is_empty() {
        return Err(Error::input(name).expected("at least one input to differentiate by"));
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
            .map(|(n, v)| (n.clone(), v.iter().zip(&inputs[n]).map(|(v, x)| v * Step::Plain.scale(*x)).collect()))
            .collect();
        let jtw = vjp(inputs, &w)?;
        let exact = dot(&v, &jtw);
        let fd = probe::ladder(&mut f, inputs, &v, &w, options.unit, exact)?;
        let gap = (fd.value - exact).abs() - fd.noise;
        if gap > 0.0 {
            worst = crate::num::order::max(worst, gap / (norm(&v) * norm(&jtw)));
        }
    }
    rung.hold("dot-product test beyond rounding noise", worst, FROZEN);
    rungs.push(rung);

    let mut rung = Rung::new("R3", "entry by entry: finite differences where the decision logs are equal");
    let probes = probes(&variables, inputs, options);
    let exact: Vec<f64> = probes.iter().map(|p| dot(&p.v, &grads)).collect();
    let largest = largest(&probes, &exact);
    let (mut worst, mut skipped) = (0.0, 0);
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
        let e = excess(&fd, exact, largest[&p.variable]);
        if !(e <= LIVE) {
            rung.worst.push(Entry { array: p.variable.clone(), index: p.index, ours: exact, reference: fd.value });
        }
        worst = crate::num::order::max(worst, e);
    }
    rung.worst.truncate(WORST);
    rung.note("derivatives taken", probes.len() as f64);
    rung.hold("relative difference beyond rounding noise", worst, LIVE);
    let allowed = crate::num::order::max(1.0, SKIPPED * probes.len() as f64);
    rung.hold("skipped because a decision changed", f64::from(skipped), allowed);
    rungs.push(rung);
    Ok(Report { subject: name.to_owned(), rungs })
}

/// R0 of a function nobody predicted zeros for: single zeros are legal, a variable without any gradient is not.
fn sanity_of_function(rung: &mut Rung, outputs: &Values, variables: &[Variable], inputs: &Values, grads: &Values) {
    let mut known = Prediction::default();
    for variable in variables {
        if let Some(g) = grads.get(&variable.name) {
            let some = g.iter().any(|x| *x != 0.0);
            known.zeros.insert(variable.name.clone(), g.iter().map(|x| some && *x == 0.0).collect());
        }
    }
    sane(rung, outputs, variables, inputs, grads, &known);
}
