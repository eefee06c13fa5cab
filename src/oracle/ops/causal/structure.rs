//! `causal.structure` and `causal.intervene`.

use super::entry;
use crate::causal::structure::{In, InBar, Mechanism, MechanismBar, Networks};
use crate::causal::{intervene, structure};
use crate::ops::call::RunResult;
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op, no_zeros};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `causal.structure`
pub(crate) static STRUCTURE: Op = Op {
    work_unit: "entries",
    work_ns: [2000.0, 20000.0],
    check: check_structure,
    run: run_structure,
    predict: no_zeros,
    cases: 5,
    case: case_structure,
    ..entry(&reference::causal::structure::SIGNATURE)
};

const NETWORK: [&str; 5] = ["w0", "b0", "w1", "b1", "w2"];

fn check_structure(x: &CheckedCall<'_>) -> Result<()> {
    let given = (x.has("weight"), NETWORK.iter().any(|name| x.has(name)));
    let fits = match x.word("mode").unwrap_or("nonlinear") {
        "linear" => given == (true, false),
        "nonlinear" => given == (false, true),
        "printed" => given == (true, true),
        _ => given != (true, true),
    };
    if !fits {
        return Err(Error::input("setting mode")
            .expected(
                "'weight' in mode linear, networks in mode nonlinear, both in printed, either in abduct",
            )
            .got(format!("mode {} with other arrays", x.word("mode").unwrap_or("nonlinear"))));
    }
    check_mechanism(x)
}

/// Checks that weights, networks or both are present with the right sizes.
fn check_mechanism(x: &CheckedCall<'_>) -> Result<()> {
    let count = NETWORK.iter().filter(|name| x.has(name)).count();
    if !matches!((x.has("weight"), count), (true, 0) | (_, 5)) {
        return Err(Error::input("mechanism")
            .expected("'weight', all of w0 b0 w1 b1 w2, or both")
            .got(format!("{}{count} layers of networks", if x.has("weight") { "weight and " } else { "" })));
    }
    if ["N", "K", "H"].iter().any(|axis| x.dims.get(axis) == Some(0)) {
        return Err(Error::input("mechanism")
            .expected("at least one factor, dimension and hidden unit")
            .got("an empty axis"));
    }
    if count > 0 && x.dim("D") != x.dim("N") * x.dim("K") {
        return Err(Error::input("array 'w0'")
            .expected(format!("{} inputs, factors times dimensions of a factor", x.dim("N") * x.dim("K")))
            .got(x.dim("D").to_string()));
    }
    match x.number("sweeps") {
        Some(s) if !((0.0..=1e4).contains(&s) && s.fract() == 0.0) => {
            Err(Error::input("setting sweeps").expected("a whole number, 0 to 10000").got(s.to_string()))
        }
        _ => Ok(()),
    }
}

/// Arrays of a mechanism and its causes.
struct Arguments {
    eps: Vec<f64>,
    mask: Vec<f64>,
    weight: Vec<f64>,
    layers: [Vec<f64>; 5],
}

impl Arguments {
    fn new(x: &CheckedCall<'_>) -> Self {
        let [eps, mask, weight] = ["eps", "mask", "weight"].map(|name| x.f64s(name));
        Self { eps, mask, weight, layers: NETWORK.map(|name| x.f64s(name)) }
    }

    fn input(&self, x: &CheckedCall<'_>) -> In<'_> {
        let linear = !x.has("w0");
        let (batch, n, k) = (x.dim("B"), x.dim("N"), x.dim("K"));
        let networks = || {
            let [w0, b0, w1, b1, w2] = &self.layers;
            let slope = x.number("slope").unwrap_or(0.05);
            Networks { w0, b0, w1, b1, w2, hidden: x.dim("H"), slope }
        };
        let weight = &self.weight[..];
        let mechanism = match (x.has("weight"), linear) {
            (_, true) => Mechanism::Linear { weight },
            (false, false) => Mechanism::Networks(networks()),
            (true, false) => Mechanism::Printed { weight, networks: networks() },
        };
        let sweeps = x.number("sweeps").map_or(if linear { n - 1 } else { n }, |s| s as usize);
        In { eps: &self.eps, mask: &self.mask, mechanism, batch, n, k, sweeps }
    }
}

/// Gradients to accumulate into.
fn start(x: &CheckedCall<'_>) -> InBar {
    let start = |name: &str| x.start_f64(name, x.f64s(name).len());
    let [w0, b0, w1, b1, w2] = NETWORK.map(start);
    let mechanism = MechanismBar { weight: start("weight"), w0, b0, w1, b1, w2 };
    InBar { eps: start("eps"), mask: start("mask"), mechanism }
}

/// Gradients by name.
fn put(x: &CheckedCall<'_>, bar: InBar, ran: &mut RunResult) {
    let m = bar.mechanism;
    let all = [("eps", bar.eps), ("mask", bar.mask), ("weight", m.weight)];
    let networks = [("w0", m.w0), ("b0", m.b0), ("w1", m.w1), ("b1", m.b1), ("w2", m.w2)];
    for (name, values) in all.into_iter().chain(networks).filter(|(name, _)| x.has(name)) {
        ran.gradients.put(name, &x.shape(name), values);
    }
}

fn run_structure(x: &CheckedCall<'_>) -> Result<RunResult> {
    let given = Arguments::new(x);
    let input = given.input(x);
    let abduct = x.word("mode") == Some("abduct");
    let (z, saved) = if abduct {
        (structure::abduct(&input), None)
    } else {
        let (z, saved) = structure::forward(&input);
        (z, Some(saved))
    };
    let mut ran = RunResult::default();
    ran.outputs.put("z", &x.shape("eps"), z);
    if let Some(z_bar) = x.bar_f64("z", &x.shape("eps"))? {
        let mut bar = start(x);
        match &saved {
            Some(saved) => structure::adjoint(&input, saved, &z_bar, &mut bar),
            None => structure::abduct_adjoint(&input, &z_bar, &mut bar),
        }
        put(x, bar, &mut ran);
    }
    Ok(ran)
}

/// Number of samples of a case, enough for every hidden unit to be on both sides of its kink; otherwise the
/// gradients of its bias through g(x) and g(0) cancel.
const BATCH: usize = 8;

/// Causes, mask, and networks or weights of a case. The seeds are chosen such that no argument of an
/// activation is within the step of a finite difference of the kink at 0.
fn mechanism(seed: u64, case: usize, [weight, networks]: [bool; 2]) -> Case {
    let (batch, n, k, h) = (BATCH, 3, 2, 4);
    let draw = |array, len, scale: f32| -> Vec<f32> {
        Draw::new(seed, case, array).normals(len).into_iter().map(|x| scale * x).collect()
    };
    let mut made = Case::default();
    made.inputs.put("eps", &[batch, n, k], draw(0, batch * n * k, 1.0));
    made.inputs.put("mask", &[n, n], Draw::new(seed, case, 1).uniforms(n * n, 0.2, 0.9));
    if weight {
        made.inputs.put("weight", &[n, n], draw(7, n * n, 0.8));
    }
    if networks {
        made.inputs.put("w0", &[n, h, n * k], draw(2, n * h * n * k, 0.6));
        made.inputs.put("b0", &[n, h], draw(3, n * h, 0.15));
        made.inputs.put("w1", &[n, h, h], draw(4, n * h * h, 0.6));
        made.inputs.put("b1", &[n, h], draw(5, n * h, 0.15));
        made.inputs.put("w2", &[n, k, h], draw(6, n * k * h, 0.5));
    }
    made
}

/// Cases 0 to 4: networks, weights, abduction through networks, abduction through weights, weights and then
/// networks.
fn case_structure(case: usize) -> Case {
    let (seed, draw) = [(181, 0), (62, 1), (226, 1), (62, 3), (200, 4)][case];
    let linear = case == 1 || case == 3;
    let mut made = mechanism(seed, draw, [linear || case == 4, !linear]);
    let mode = ["nonlinear", "linear", "abduct", "abduct", "printed"][case];
    made.settings.insert("mode".to_owned(), Setting::Text(mode.to_owned()));
    made
}

/// `causal.intervene`
pub(crate) static INTERVENE: Op = Op {
    work_unit: "entries",
    work_ns: [2000.0, 20000.0],
    check: check_intervene,
    run: run_intervene,
    predict: predict_intervene,
    case: case_intervene,
    ..entry(&reference::causal::intervene::SIGNATURE)
};

fn check_intervene(x: &CheckedCall<'_>) -> Result<()> {
    check_mechanism(x)?;
    if x.has("weight") && x.has("w0") {
        return Err(Error::input("mechanism").expected("'weight' or networks").got("both"));
    }
    let n = x.dim("N") as f64;
    x.rule("target", "a factor, or -1", |target| target >= -1.0 && target < n)
}

fn targets(x: &CheckedCall<'_>) -> Vec<Option<usize>> {
    x.f64s("target").into_iter().map(|target| (target >= 0.0).then_some(target as usize)).collect()
}

fn run_intervene(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (given, target, value) = (Arguments::new(x), targets(x), x.f64s("value"));
    let input = intervene::In { given: given.input(x), target: &target, value: &value };
    let (z, saved) = intervene::forward(&input);
    let mut ran = RunResult::default();
    ran.outputs.put("z", &x.shape("eps"), z);
    if let Some(z_bar) = x.bar_f64("z", &x.shape("eps"))? {
        let mut bar = intervene::InBar { given: start(x), value: x.start_f64("value", value.len()) };
        intervene::adjoint(&input, &saved, &z_bar, &mut bar);
        put(x, bar.given, &mut ran);
        ran.gradients.put("value", &x.shape("value"), bar.value);
    }
    Ok(ran)
}

/// Causes of factors that are set, and values of samples without target.
fn predict_intervene(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let (n, k, target) = (x.dim("N"), x.dim("K"), targets(x));
    let set = (0..target.len() * n * k).map(|at| target[at / (n * k)] == Some(at / k % n)).collect();
    let unused = (0..target.len() * k).map(|at| target[at / k].is_none()).collect();
    Ok(Prediction {
        zeros: [("eps".to_owned(), set), ("value".to_owned(), unused)].into(),
        ..Prediction::default()
    })
}

/// Targets of both cases of `causal.intervene`.
const TARGETS: [[i32; BATCH]; 2] = [[1, 2, -1, 0, 2, 1, 0, -1], [0, -1, 2, 1, 1, -1, 2, 0]];

/// Case 0: networks; case 1: weights. Every factor is a target, and some samples have none.
fn case_intervene(case: usize) -> Case {
    let mut made = mechanism(174, case, [case == 1, case == 0]);
    made.inputs.put("target", &[BATCH], TARGETS[case].to_vec());
    made.inputs.put("value", &[BATCH, 2], Draw::new(174, case, 8).normals(2 * BATCH));
    made
}
