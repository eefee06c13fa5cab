//! Building blocks of gradient checks: random directions, inner products, finite differences, error measures.
//!
//! Everything is f64 and serial; sums are left folds over the names in order and the entries in order.

use super::report::Entry;
use crate::num::order;
use crate::num::rng::Rng;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Named arrays as flat f64 values; their shapes are not stored.
pub type Values = BTreeMap<String, Vec<f64>>;

/// Rounding unit of f64, 2⁻⁵³.
pub const UNIT: f64 = 1.0 / 9_007_199_254_740_992.0;

/// Purpose word of the draws made here (see `num::rng`).
const PURPOSE: u16 = 0x6763; // "gc"

/// Normal draws, one per entry: item = entry, step = index of the array, draw = `stream`.
pub fn normals(seed: u64, step: u32, stream: u16, len: usize) -> Vec<f64> {
    let rng = Rng::new(seed);
    (0..len).map(|i| rng.normal_f64(i as u64, step, PURPOSE, stream)).collect()
}

/// One of ±1 per entry.
pub fn signs(seed: u64, step: u32, stream: u16, len: usize) -> Vec<f64> {
    let rng = Rng::new(seed);
    let draw = |i| rng.uniform_f64(i as u64, step, PURPOSE, stream);
    (0..len).map(|i| if draw(i) < 0.5 { -1.0 } else { 1.0 }).collect()
}

/// Random values with the names and lengths of `like`: normals for even streams, ±1 for odd ones.
pub fn direction(seed: u64, stream: u16, like: &Values) -> Values {
    let drawn = |k: usize, len| {
        let step = k as u32;
        if stream.is_multiple_of(2) {
            normals(seed, step, stream, len)
        } else {
            signs(seed, step, stream, len)
        }
    };
    like.iter().enumerate().map(|(k, (name, v))| (name.clone(), drawn(k, v.len()))).collect()
}

/// At most `count` entries of an array of `len`, one from each of `count` equal stretches.
pub fn sample(seed: u64, step: u32, len: usize, count: usize) -> Vec<usize> {
    if len <= count {
        return (0..len).collect();
    }
    let pick = |j: usize| {
        let (start, end) = (j * len / count, (j + 1) * len / count);
        let u = Rng::new(seed).uniform_f64(j as u64, step, PURPOSE, 0xffff);
        start + (u * (end - start) as f64) as usize
    };
    (0..count).map(pick).collect()
}

/// Σ a·b over all names and entries present in both.
pub fn dot(a: &Values, b: &Values) -> f64 {
    let mut sum = 0.0;
    for (name, x) in a {
        let Some(y) = b.get(name) else { continue };
        for (x, y) in x.iter().zip(y) {
            sum += x * y;
        }
    }
    sum
}

/// √Σ a².
pub fn norm(a: &Values) -> f64 {
    dot(a, a).sqrt()
}

/// Zeros with the names and lengths of `like`.
pub fn zeros(like: &Values) -> Values {
    like.iter().map(|(name, v)| (name.clone(), vec![0.0; v.len()])).collect()
}

/// x + h·v for the names of `v`; the others are `x`.
pub fn moved(x: &Values, v: &Values, h: f64) -> Values {
    let mut out = x.clone();
    for (name, v) in v {
        let Some(x) = out.get_mut(name) else { continue };
        for (x, v) in x.iter_mut().zip(v) {
            *x += h * v;
        }
    }
    out
}

/// Scale of a finite-difference step: perturbations are steps in the natural space of the parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// h·max(1, |θ|)
    Plain,
    /// h·|θ|: a step in log θ, for positive quantities
    Log,
    /// h·θ(1−θ): a step in logit θ, for quantities in 0..1 (1e-3 at the ends, to avoid a zero step)
    Logit,
}

impl Step {
    /// Length of a step of relative size 1 at θ.
    pub fn scale(self, theta: f64) -> f64 {
        match self {
            Self::Plain => order::max(1.0, theta.abs()),
            Self::Log => theta.abs(),
            Self::Logit => order::max(1e-3, theta * (1.0 - theta)),
        }
    }
}

/// One evaluation of the function under test.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// outputs by name
    pub outputs: Values,
    /// digest of the decision log; equal logs mean the same smooth piece
    pub log: u64,
}

/// ⟨w, f(θ+hv) − f(θ−hv)⟩ / 2h.
struct Difference {
    /// the difference quotient
    value: f64,
    /// h
    h: f64,
    /// Σ |w| |f| over the entries that differ between the two points
    moved: f64,
    /// rounding noise of `value`
    noise: f64,
    /// whether both logs equal the expected one
    same_log: bool,
}

/// Assumed rounding error of one output entry in differences, in units of its own rounding unit.
const NOISE_UNITS: f64 = 64.0;

fn central(
    f: &mut dyn FnMut(&Values) -> Result<Evaluation>,
    at: &Values,
    v: &Values,
    w: &Values,
    h: f64,
    log: Option<u64>,
) -> Result<Difference> {
    let plus = f(&moved(at, v, h))?;
    let minus = f(&moved(at, v, -h))?;
    let (mut sum, mut touched) = (0.0, 0.0);
    for (name, w) in w {
        let (Some(p), Some(m)) = (plus.outputs.get(name), minus.outputs.get(name)) else {
            return Err(
                Error::input(format!("output '{name}'")).expected("to be present in every evaluation")
            );
        };
        if p.len() != w.len() || m.len() != w.len() {
            return Err(Error::input(format!("output '{name}'"))
                .expected(format!("{} entries in every evaluation", w.len()))
                .got(format!("{} and {}", p.len(), m.len())));
        }
        for ((w, p), m) in w.iter().zip(p).zip(m) {
            sum += w * (p - m);
            if p != m {
                touched += w.abs() * order::max(p.abs(), m.abs());
            }
        }
    }
    let same_log = log.is_none_or(|log| plus.log == log && minus.log == log);
    Ok(Difference { value: sum / (2.0 * h), h, moved: touched, noise: 0.0, same_log })
}

/// Noise of every difference of a ladder: that of the outputs that change at any step (a step lost in
/// rounding changes none), and that of θ ± h itself.
fn with_noise(mut d: Vec<Difference>, unit: f64) -> Vec<Difference> {
    let moved = d.iter().fold(0.0, |m, d| order::max(m, d.moved));
    let slope = d.iter().fold(0.0, |m, d| order::max(m, d.value.abs()));
    for d in &mut d {
        d.noise = NOISE_UNITS * unit * moved / (2.0 * d.h) + 2.0 * unit * slope / d.h;
    }
    d
}

/// A derivative by finite differences.
#[derive(Clone, Copy, Debug)]
pub struct Derivative {
    /// Richardson's value
    pub value: f64,
    /// difference of the two Richardson values that agree best
    pub spread: f64,
    /// rounding noise of `value`
    pub noise: f64,
    /// observed order: log of successive error ratios over log of the step ratio; `None` when every
    /// difference is at the noise floor already
    pub order: Option<f64>,
    /// whether the decision log was the same at every point used
    pub same_log: bool,
}

/// Ratio of successive steps.
const RATIO: f64 = 4.0;
/// Exponents of the steps 2⁻⁶, 2⁻⁸, …, 2⁻¹⁸ of a ladder.
const LADDER: [i32; 7] = [6, 8, 10, 12, 14, 16, 18];

fn power_of_two(exponent: i32) -> f64 {
    let mut h = 1.0;
    for _ in 0..exponent {
        h *= 0.5;
    }
    h
}

/// ⟨w, J v⟩ by a ladder of central differences with one Richardson step each; the step is chosen where
/// successive Richardson values agree best within their noise; `exact` is used only to measure the order.
///
/// # Errors
/// Errors of the function.
pub fn ladder(
    f: &mut dyn FnMut(&Values) -> Result<Evaluation>,
    at: &Values,
    v: &Values,
    w: &Values,
    unit: f64,
    exact: f64,
) -> Result<Derivative> {
    let mut d = Vec::with_capacity(LADDER.len());
    for k in LADDER {
        d.push(central(f, at, v, w, power_of_two(k), None)?);
    }
    let d = with_noise(d, unit);
    // Dh = D + c h² + O(h⁴)  ⇒  (16 D(h/4) − D(h)) / 15 = D + O(h⁴)
    let square = RATIO * RATIO;
    let richardson: Vec<f64> =
        d.windows(2).map(|p| (square * p[1].value - p[0].value) / (square - 1.0)).collect();
    let noise = |k: usize| d[k + 1].noise * (square + 1.0) / (square - 1.0);
    let mut best = (f64::INFINITY, 1);
    for (k, p) in richardson.windows(2).enumerate() {
        let uncertain = (p[1] - p[0]).abs() + noise(k + 1);
        if uncertain < best.0 {
            best = (uncertain, k + 1);
        }
    }
    let k = best.1;
    let spread = (richardson[k] - richardson[k - 1]).abs();
    let order = observed_order(&d, exact);
    Ok(Derivative { value: richardson[k], spread, noise: noise(k), order, same_log: true })
}

/// Slope of log|D(h) − exact| against log h, from the finest three steps whose errors are well above the
/// noise.
fn observed_order(d: &[Difference], exact: f64) -> Option<f64> {
    let error = |k: usize| (d[k].value - exact).abs();
    let clear = |k: usize| error(k) > 4.0 * d[k].noise;
    let k = (0..d.len() - 2).rev().find(|&k| clear(k) && clear(k + 1) && clear(k + 2))?;
    Some(0.5 * libm::log(error(k) / error(k + 2)) / libm::log(RATIO))
}

/// ⟨w, J v⟩ by two central differences of relative step 2⁻¹⁸ and 2⁻²⁰ and one Richardson step, whatever the
/// decisions at the points; `same_log` is set if all decision logs equal `log`.
///
/// # Errors
/// Errors of the function.
pub fn live(
    f: &mut dyn FnMut(&Values) -> Result<Evaluation>,
    at: &Values,
    v: &Values,
    w: &Values,
    unit: f64,
    log: u64,
) -> Result<Derivative> {
    let mut d = Vec::with_capacity(2);
    for k in [LIVE_EXPONENT, LIVE_EXPONENT + 2] {
        d.push(central(f, at, v, w, power_of_two(k), Some(log))?);
    }
    let d = with_noise(d, unit);
    let (coarse, fine) = (&d[0], &d[1]);
    let square = RATIO * RATIO;
    Ok(Derivative {
        value: (square * fine.value - coarse.value) / (square - 1.0),
        spread: (fine.value - coarse.value).abs(),
        noise: fine.noise * (square + 1.0) / (square - 1.0),
        order: None,
        same_log: coarse.same_log && fine.same_log,
    })
}

/// Relative step of [`live`]: 2⁻¹⁸ ≈ 4e-6.
const LIVE_EXPONENT: i32 = 18;

/// The width 2h of the widest difference [`live`] takes, relative to the step scale.
pub fn live_width() -> f64 {
    2.0 * power_of_two(LIVE_EXPONENT)
}

/// Distance of an array from a reference array.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Distance {
    /// ‖a − b‖ / ‖b‖; 0 if both are zero, ∞ if only the reference is
    pub relative_l2: f64,
    /// 1 − a·b / (‖a‖‖b‖), from ½‖a/‖a‖ − b/‖b‖‖², which does not cancel
    pub one_minus_cosine: f64,
    /// Σ(a − b) / Σ|b|
    pub signed_bias: f64,
    /// number of entries that are zero in only one of them
    pub zero_mismatch: usize,
}

/// Measures the distance of `a` from the reference `b`.
pub fn distance(a: &[f64], b: &[f64]) -> Distance {
    let (mut diff2, mut a2, mut b2, mut diff, mut absolute) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut zero_mismatch = 0;
    // An infinity means "none": it equals itself only.
    if a.iter().zip(b).any(|(a, b)| a != b && (a.is_infinite() || b.is_infinite())) {
        let zero_mismatch = a.iter().zip(b).filter(|(a, b)| (**a == 0.0) != (**b == 0.0)).count();
        return Distance {
            relative_l2: f64::INFINITY,
            one_minus_cosine: 1.0,
            signed_bias: f64::INFINITY,
            zero_mismatch,
        };
    }
    let both = || a.iter().zip(b).filter(|(a, _)| !a.is_infinite());
    for (&a, &b) in both() {
        let d = a - b;
        diff2 += d * d;
        a2 += a * a;
        b2 += b * b;
        diff += d;
        absolute += b.abs();
        zero_mismatch += usize::from((a == 0.0) != (b == 0.0));
    }
    let ratio = |num: f64, den: f64| if num == 0.0 { 0.0 } else { num / den };
    let mut angle2 = 0.0;
    let (na, nb) = (a2.sqrt(), b2.sqrt());
    let one_minus_cosine = if na == 0.0 || nb == 0.0 {
        if na == nb { 0.0 } else { 1.0 }
    } else {
        for (&a, &b) in both() {
            let d = a / na - b / nb;
            angle2 += d * d;
        }
        0.5 * angle2
    };
    Distance {
        relative_l2: ratio(diff2.sqrt(), nb),
        one_minus_cosine,
        signed_bias: ratio(diff, absolute),
        zero_mismatch,
    }
}

/// The `count` entries that differ most, in absolute terms, largest first, ties by index.
pub fn worst_entries(name: &str, ours: &[f64], theirs: &[f64], count: usize) -> Vec<Entry> {
    let mut order: Vec<usize> = (0..ours.len().min(theirs.len())).filter(|&i| ours[i] != theirs[i]).collect();
    order.sort_by(|&i, &j| {
        let (a, b) = ((ours[i] - theirs[i]).abs(), (ours[j] - theirs[j]).abs());
        b.total_cmp(&a).then(i.cmp(&j))
    });
    order.truncate(count);
    let entry = |i: usize| Entry { array: name.to_owned(), index: i, ours: ours[i], reference: theirs[i] };
    order.into_iter().map(entry).collect()
}
