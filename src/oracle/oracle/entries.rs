//! R3 of a user-supplied program: single entries of its gradient for the cotangents of `IN.npz`, against
//! finite differences.

use super::compare::factor_text;
use crate::Result;
use crate::num::order;
use crate::tape::check::{Entry, Evaluation, LIVE, Rung, Step, UNIT, Values};
use crate::tape::probe;

/// Number of wrong entries that are listed.
const WORST: usize = 10;
/// Derivatives below this fraction of the largest one of their input are compared relative to the largest.
const SMALL: f64 = 1e-6;
/// Largest relative rounding noise of finite differences with a common factor: that of f64, not of f32.
const NOISE: f64 = 1e-3;

/// The checked entries of all inputs.
pub(super) struct Entries {
    /// the result
    pub(super) rung: Rung,
    /// largest |yours − finite difference| / |finite difference|
    pub(super) difference: f64,
    /// inputs whose wrong gradient is a multiple of the finite difference, each as a sentence
    pub(super) factors: Vec<String>,
    /// whether such multiples are all that is wrong, and no kink makes them
    pub(super) is_explained: bool,
}

/// One checked entry.
struct Checked {
    index: usize,
    input: f64,
    yours: f64,
    /// the finite difference and its rounding noise
    derivative: f64,
    noise: f64,
}

/// Checks entries of `gradients`, the gradient of Σ y·ȳ, drawn as those of `check::function`. Differences are
/// relative to the finite difference.
///
/// # Errors
/// Errors of `value`.
pub(super) fn entries(
    value: &mut dyn FnMut(&Values) -> Result<Evaluation>,
    inputs: &Values,
    y_bar: &Values,
    gradients: &Values,
    rules: &crate::tape::check::Options,
) -> Result<Entries> {
    let rung = Rung::new("R3", "entries of the gradient").labelled(["yours", "finite difference"]);
    let mut found = Entries { rung, difference: 0.0, factors: Vec::new(), is_explained: true };
    let (mut taken, mut noise, mut worst) = (0, 0.0, 0.0);
    for (k, (name, x)) in inputs.iter().enumerate() {
        let mut checked = Vec::new();
        for index in probe::sample(rules.seed, k as u32, x.len(), rules.entries) {
            let step = Step::Plain.scale(x[index]);
            let mut v = vec![0.0; x.len()];
            v[index] = step;
            let (v, yours) = ([(name.clone(), v)].into(), gradients[name][index]);
            let fd = if rules.unit > UNIT {
                probe::ladder(value, inputs, &v, y_bar, rules.unit, yours * step)?
            } else {
                probe::live(value, inputs, &v, y_bar, rules.unit, 0)?
            };
            let [derivative, noise] = [fd.value, fd.noise].map(|x| x / step);
            checked.push(Checked { index, input: x[index], yours, derivative, noise });
        }
        taken += checked.len();
        let largest = checked.iter().fold(0.0, |m, c| order::max(m, c.derivative.abs()));
        let mut wrong = Vec::new();
        for c in &checked {
            let scale = order::max(c.derivative.abs(), SMALL * largest);
            let relative = |x: f64| if x <= 0.0 { 0.0 } else { x / scale };
            let gap = (c.yours - c.derivative).abs();
            found.difference = order::max(found.difference, relative(gap));
            noise = order::max(noise, relative(c.noise));
            let excess = relative(gap - c.noise);
            worst = order::max(worst, excess);
            if !(excess <= LIVE) {
                wrong.push(c);
            }
        }
        found.add(name, &checked, &wrong);
    }
    let rung = &mut found.rung;
    rung.worst.truncate(WORST);
    rung.note("derivatives taken", taken as f64);
    rung.note("largest relative difference", found.difference);
    rung.note("largest relative rounding noise", noise);
    rung.hold("relative difference beyond rounding noise", worst, LIVE);
    Ok(found)
}

impl Entries {
    /// Adds the wrong entries of an input.
    fn add(&mut self, name: &str, checked: &[Checked], wrong: &[&Checked]) {
        if wrong.is_empty() {
            return;
        }
        self.rung.worst.extend(wrong.iter().map(|c| Entry {
            array: name.to_owned(),
            index: c.index,
            ours: c.yours,
            reference: c.derivative,
        }));
        let Some(factor) = factor(checked) else {
            self.is_explained = false;
            return;
        };
        let text = factor_text(factor);
        self.factors.push(format!("{name}: yours = {text} × finite difference in all checked entries"));
        // max(0, x) at 0: the slope 1 is twice the finite difference.
        let is_same = wrong.iter().all(|c| c.input == wrong[0].input);
        self.is_explained &= !(is_same && (factor - 2.0).abs() < 1e-3);
    }
}

/// The factor of the finite differences that gives every entry, if there is one. With one entry, only a ratio
/// of small integers counts.
fn factor(checked: &[Checked]) -> Option<f64> {
    let (mut ab, mut bb) = (0.0, 0.0);
    for c in checked {
        ab += c.yours * c.derivative;
        bb += c.derivative * c.derivative;
    }
    let factor = ab / bb;
    let parts = 24.0 * factor;
    let whole = (parts + 0.5_f64.copysign(parts)) as i64;
    let is_simple = (parts - whole as f64).abs() < 1e-4;
    let fits = |c: &Checked| {
        let expected = factor * c.derivative;
        let is_clear = c.noise <= NOISE * c.derivative.abs();
        is_clear && (c.yours - expected).abs() <= (factor * c.noise).abs() + LIVE * expected.abs()
    };
    (factor.is_finite() && factor != 0.0 && (checked.len() > 1 || is_simple) && checked.iter().all(fits))
        .then_some(factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::check::Options;

    /// Checks `gradient` as the gradient of y = f(x) entry by entry, for a cotangent of 3.
    fn check(x: &[f64], f: fn(f64) -> f64, gradient: fn(f64) -> f64) -> Entries {
        let named = |name: &str, v: Vec<f64>| -> Values { [(name.to_owned(), v)].into() };
        let mut value = |x: &Values| {
            Ok(Evaluation { outputs: named("y", x["x"].iter().map(|x| f(*x)).collect()), log: 0 })
        };
        let gradients = named("x", x.iter().map(|x| 3.0 * gradient(*x)).collect());
        let y_bar = named("y", vec![3.0; x.len()]);
        entries(&mut value, &named("x", x.to_vec()), &y_bar, &gradients, &Options::default())
            .expect("no error of the function")
    }

    #[test]
    fn factors_are_named_and_differences_are_relative_to_the_finite_difference() {
        let square = |x| x * x;
        let right = check(&[1.0, -7.0, 0.5], square, |x| 2.0 * x);
        assert!(right.rung.passed() && right.factors.is_empty(), "{:?}", right.rung);
        let half = check(&[1.0, -7.0, 0.5], square, |x| x);
        assert_eq!(half.factors, ["x: yours = 0.5 × finite difference in all checked entries"]);
        assert!(half.is_explained && !half.rung.passed(), "{:?}", half.rung);
        assert!((half.difference - 0.5).abs() < 1e-6, "{}", half.difference);
        let worst = &half.rung.worst[1];
        assert_eq!(worst.ours, -21.0, "the entry of the gradient, also where the step is not 1");
        assert!((worst.reference + 42.0).abs() < 1e-6, "{worst:?}");
        let other = check(&[1.0, -7.0, 0.5], square, |_| 1.0);
        assert!(other.factors.is_empty() && !other.is_explained, "no factor");
        let relu = |x: f64| if x > 0.0 { x } else { 0.0 };
        assert!(!check(&[0.0, 0.0], relu, |_| 1.0).is_explained, "a kink");
    }
}
