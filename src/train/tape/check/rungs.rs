//! The five rungs.

use super::subject::{
    ACCUMULATION_UNITS, BIAS, COSINE, DOT_CHAIN, DOT_OPERATOR, FROZEN, LIVE, NULL_UNITS, OUTPUT_F32,
    OUTPUT_F64, On, Options, Prediction, SHIPPED_F32, SHIPPED_F64, SKIPPED, SMALL, Subject, UNIT_VECTORS,
    Variable,
};
use crate::Result;
use crate::num::order;
use crate::tape::probe::{self, Derivative, UNIT, Values, direction, dot, norm};
use crate::tape::report::{Entry, Rung};
use std::collections::BTreeMap;

fn is_constant(outputs: &Values) -> bool {
    let single = outputs.values().all(|v| v.len() <= 1);
    !single && outputs.values().all(|v| v.iter().all(|x| *x == v[0]))
}

pub(super) fn sane(
    rung: &mut Rung,
    outputs: &Values,
    variables: &[Variable],
    inputs: &Values,
    grads: &Values,
    known: &Prediction,
) {
    for (name, v) in outputs {
        let none = known.infinite.contains(name);
        if let Some(i) = v.iter().position(|&x| !(x.is_finite() || (none && x == f64::INFINITY))) {
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
        let unread = known.unread.contains(name);
        let predicted = |i: usize| unread || known.zeros.get(name).is_some_and(|mask| mask[i]);
        let broken = (0..g.len()).filter(|&i| predicted(i) && g[i] != 0.0).count();
        let silent = (0..g.len()).filter(|&i| !predicted(i) && g[i] == 0.0).count();
        rung.hold(format!("entries of {name}_bar that must be 0 but are not"), broken as f64, 0.0);
        rung.hold(format!("entries of {name}_bar that are unexpectedly 0"), silent as f64, 0.0);
        if g.iter().all(|x| *x == 0.0) && !unread {
            rung.fail(format!("gradient of {name} is zero everywhere: there is nothing to check"));
        }
    }
}

pub(super) fn r0(subject: &dyn Subject) -> Result<Rung> {
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
                worst = order::max(worst, along.abs() / (d2 * g2).sqrt());
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

pub(super) fn r1(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung = Rung::new("R1", "twin: dual numbers against the reverse tape");
    let inputs = subject.inputs();
    let mut worst = 0.0;
    let mut compare = |v: &Values, w: &Values, jtw: &Values| -> Result<()> {
        let jv = subject.jvp(v, On::Frozen)?;
        let scale = norm(&jv) * norm(w) + norm(v) * norm(jtw);
        let gap = (dot(&jv, w) - dot(v, jtw)).abs();
        if gap != 0.0 {
            worst = order::max(worst, gap / scale);
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
        // one variable at a time, so that a large one does not mask a small one
        let only: Values = [(name.clone(), probe::normals(options.seed, 0, 1, x.len()))].into();
        let part: Values =
            jtw.iter().filter(|(n, _)| *n == name).map(|(n, v)| (n.clone(), v.clone())).collect();
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

/// One derivative to compute: a variable, a direction, and the entry that it perturbs.
pub(super) struct Probe {
    pub(super) variable: String,
    pub(super) index: usize,
    pub(super) v: Values,
}

pub(super) fn probes(variables: &[Variable], inputs: &Values, options: &Options) -> Vec<Probe> {
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

/// Summary of the derivatives of a rung.
#[derive(Default)]
pub(super) struct Differences {
    /// Largest relative difference and relative rounding noise, reported without a bound.
    difference: f64,
    noise: f64,
    /// Largest [`excess`], which has a bound.
    worst: f64,
}

impl Differences {
    /// Adds one derivative; an excess beyond `bound` is listed among the worst entries.
    pub(super) fn add(
        &mut self,
        rung: &mut Rung,
        p: &Probe,
        fd: &Derivative,
        [exact, largest, bound]: [f64; 3],
    ) {
        let scale = order::max(exact.abs(), SMALL * largest);
        if scale > 0.0 {
            self.difference = order::max(self.difference, (fd.value - exact).abs() / scale);
            self.noise = order::max(self.noise, fd.noise / scale);
        }
        let e = excess(fd, exact, largest);
        if !(e <= bound) {
            rung.worst.push(Entry {
                array: p.variable.clone(),
                index: p.index,
                ours: exact,
                reference: fd.value,
            });
        }
        self.worst = order::max(self.worst, e);
    }

    /// Reports the number of derivatives and compares the worst of them with `bound`.
    pub(super) fn report(&self, rung: &mut Rung, taken: usize, bound: f64) {
        rung.worst.truncate(WORST);
        rung.note("derivatives taken", taken as f64);
        rung.note("largest relative difference", self.difference);
        rung.note("largest relative rounding noise", self.noise);
        rung.hold("relative difference beyond rounding noise", self.worst, bound);
    }
}

/// Relative excess of |FD − AD| over its rounding noise, relative to the largest derivative for small ones.
fn excess(fd: &Derivative, exact: f64, largest: f64) -> f64 {
    let beyond = (fd.value - exact).abs() - fd.noise;
    if beyond <= 0.0 {
        return 0.0;
    }
    let scale = order::max(exact.abs(), SMALL * largest);
    if scale == 0.0 { f64::INFINITY } else { beyond / scale }
}

/// Largest |derivative| per variable.
pub(super) fn largest(probes: &[Probe], exact: &[f64]) -> BTreeMap<String, f64> {
    let mut out = BTreeMap::new();
    for (p, e) in probes.iter().zip(exact) {
        let slot = out.entry(p.variable.clone()).or_insert(0.0);
        *slot = order::max(*slot, e.abs());
    }
    out
}

pub(super) fn r2(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung = Rung::new("R2", "twin on the frozen plan: finite differences against dual numbers")
        .labelled(["dual numbers", "finite difference"]);
    let (inputs, w) = (subject.inputs(), subject.cotangents());
    let probes = probes(subject.variables(), inputs, options);
    let exact =
        probes.iter().map(|p| Ok(dot(&subject.jvp(&p.v, On::Frozen)?, w))).collect::<Result<Vec<_>>>()?;
    let largest = largest(&probes, &exact);
    let (mut lowest, mut ordered, mut unsettled) = (f64::INFINITY, 0, 0);
    let mut f = |x: &Values| subject.value(x, On::Frozen);
    let mut differences = Differences::default();
    for (p, &exact) in probes.iter().zip(&exact) {
        let fd = probe::ladder(&mut f, inputs, &p.v, w, UNIT, exact)?;
        differences.add(&mut rung, p, &fd, [exact, largest[&p.variable], FROZEN]);
        let scale = order::max(exact.abs(), SMALL * largest[&p.variable]);
        unsettled += usize::from(!(fd.spread <= 10.0 * FROZEN * scale + 4.0 * fd.noise));
        if let Some(order) = fd.order {
            ordered += 1;
            lowest = order::min(lowest, order);
        }
    }
    differences.report(&mut rung, probes.len(), FROZEN);
    rung.hold("derivatives whose two finest values disagree", unsettled as f64, 0.0);
    rung.note("derivatives whose order could be observed", f64::from(ordered));
    if ordered > 0 {
        rung.hold("observed order below 2 by", 2.0 - lowest, 0.2);
    }
    Ok(rung)
}

/// Number of worst entries that are reported.
const WORST: usize = 10;

pub(super) fn r3(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung =
        Rung::new("R3", "twin on the live plan: finite differences where the decision logs are equal")
            .labelled(["dual numbers", "finite difference"]);
    let (inputs, w) = (subject.inputs(), subject.cotangents());
    let probes = probes(subject.variables(), inputs, options);
    let log = subject.value(inputs, On::Live)?.log;
    let exact =
        probes.iter().map(|p| Ok(dot(&subject.jvp(&p.v, On::Live)?, w))).collect::<Result<Vec<_>>>()?;
    let largest = largest(&probes, &exact);
    let (mut skipped, mut mass) = (0, 0.0);
    let mut differences = Differences::default();
    for (p, &exact) in probes.iter().zip(&exact) {
        let fd = probe::live(&mut |x| subject.value(x, On::Live), inputs, &p.v, w, UNIT, log)?;
        if !fd.same_log {
            skipped += 1;
            let frozen = probe::live(&mut |x| subject.value(x, On::Frozen), inputs, &p.v, w, UNIT, 0)?;
            mass += (fd.value - frozen.value).abs() * probe::live_width();
            continue;
        }
        differences.add(&mut rung, p, &fd, [exact, largest[&p.variable], LIVE]);
    }
    differences.report(&mut rung, probes.len(), LIVE);
    // for a few probes a percentage is meaningless: one may always be skipped
    let allowed = order::max(1.0, SKIPPED * probes.len() as f64);
    rung.hold("skipped because a decision changed", f64::from(skipped), allowed);
    rung.note("discontinuity mass of the skipped ones", mass);
    Ok(rung)
}

pub(super) fn r4(subject: &dyn Subject, options: &Options) -> Result<Rung> {
    let mut rung = Rung::new("R4", "shipped adjoint against the twin's reverse tape, on the same plan")
        .labelled(["shipped", "twin"]);
    let single = subject.unit() > UNIT;
    let outputs = subject.shipped()?;
    let twin = subject.value(subject.inputs(), On::Frozen)?.outputs;
    for (name, ours) in &outputs {
        let Some(theirs) = twin.get(name) else {
            rung.fail(format!("the twin has no output {name}"));
            continue;
        };
        let d = probe::distance(ours, theirs);
        rung.hold(
            format!("relative L2 of output {name}"),
            d.relative_l2,
            if single { OUTPUT_F32 } else { OUTPUT_F64 },
        );
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
        rung.hold(
            format!("relative L2 of {name}"),
            d.relative_l2,
            if single { SHIPPED_F32 } else { SHIPPED_F64 },
        );
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

/// adjoint(2ȳ) = 2·adjoint(ȳ), adjoint(0) = 0, and the same onto a non-zero x̄, in bits; and that adding onto
/// x̄ adds.
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
    let onto_twice =
        subject.shipped_adjoint(&scaled(subject.cotangents(), 2.0), Some(&scaled(&start, 2.0)))?;
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
            worst = order::max(worst, (off / size).sqrt());
        }
    }
    rung.hold("accumulation against start + gradient", worst, ACCUMULATION_UNITS * subject.unit());
    Ok(())
}
