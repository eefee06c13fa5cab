//! Causal structure; all of it in f64.

use super::call::{Checked, Ran};
use super::case::Draw;
use super::op::{Case, Kind, Op, Port, SettingSpec, Width, no_rule, no_zeros};
use crate::causal::structure::{Mechanism, Networks};
use crate::causal::{acyclic, mask, posterior, posterior_kl, structure};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

const fn entry(name: &'static str, summary: &'static str) -> Op {
    Op {
        name,
        summary,
        inputs: &[],
        outputs: &[],
        intermediates: &[],
        plan: &[],
        companions: &[],
        settings: &[],
        stages: &[],
        adjoint: true,
        width: Width::F64,
        work_unit: "entries",
        work_ns: [100.0, 1000.0],
        check: no_rule,
        run: run_acyclic,
        predict: no_zeros,
        cases: 2,
        case: case_acyclic,
    }
}

const fn number(key: &'static str, default: &'static str, doc: &'static str) -> SettingSpec {
    SettingSpec { key, kind: Kind::Number, default, doc }
}

fn positive(x: &Checked<'_>, key: &'static str) -> Result<()> {
    match x.number(key) {
        Some(value) if !(value > 0.0) => {
            Err(Error::input(format!("setting {key}")).expected("a number above 0").got(value.to_string()))
        }
        _ => Ok(()),
    }
}

/// `causal.acyclic`
pub(super) static ACYCLIC: Op = Op {
    inputs: &[Port::var("a", "N,N", "edges i → j"), Port::fixed("alpha", "", "above 0; 1 for N up to 8")],
    outputs: &[Port::var("value", "", "0 without cycles, positive otherwise")],
    check: |x| x.rule("alpha", "a number above 0", |alpha| alpha > 0.0),
    ..entry("causal.acyclic", "how far a weighted graph is from having no cycle: tr((I + αA∘A)ⁿ) − n")
};

fn run_acyclic(x: &Checked<'_>) -> Result<Ran> {
    let (n, a, alpha) = (x.dim("N"), x.f64s("a"), x.inputs.scalar("alpha")?);
    let (value, saved) = acyclic::forward(&a, n, alpha);
    let mut ran = Ran::default();
    ran.outputs.put("value", &[], vec![value]);
    if let Some(bar) = x.bar_f64("value", &[])? {
        let mut a_bar = x.start_f64("a", n * n);
        acyclic::adjoint(&a, n, alpha, &saved, bar[0], &mut a_bar);
        ran.gradients.put("a", &[n, n], a_bar);
    }
    Ok(ran)
}

/// Case 0: four nodes; case 1: six nodes and another α.
fn case_acyclic(case: usize) -> Case {
    let (n, alpha) = [(4, 1.0_f32), (6, 0.25)][case];
    let mut made = Case::default();
    made.inputs.put("a", &[n, n], Draw::new(60, case, 0).uniforms(n * n, 0.1, 0.9));
    made.inputs.put("alpha", &[], vec![alpha]);
    made
}

/// `causal.mask`
pub(super) static MASK: Op = Op {
    inputs: &[
        Port::var("logits", "N,N", "of the edges i → j; the diagonal is ignored"),
        Port::fixed("uniform", "N,N", "noise between 0 and 1; 0.5 everywhere gives probabilities"),
    ],
    outputs: &[Port::var("mask", "N,N", "soft edges, zero diagonal")],
    settings: &[number("tau", "0.2", "temperature")],
    check: |x| {
        x.rule("uniform", "a number between 0 and 1, both excluded", |u| u > 0.0 && u < 1.0)?;
        positive(x, "tau")
    },
    run: run_mask,
    predict: no_loops,
    case: case_mask,
    ..entry("causal.mask", "soft samples of the edges of a graph")
};

fn run_mask(x: &Checked<'_>) -> Result<Ran> {
    let (n, logits, uniform) = (x.dim("N"), x.f64s("logits"), x.f64s("uniform"));
    let tau = x.number("tau").unwrap_or(0.2);
    let mut ran = Ran::default();
    ran.outputs.put("mask", &[n, n], mask::forward(&logits, &uniform, n, tau));
    if let Some(bar) = x.bar_f64("mask", &[n, n])? {
        let mut logits_bar = x.start_f64("logits", n * n);
        mask::adjoint(&logits, &uniform, n, tau, &bar, &mut logits_bar);
        ran.gradients.put("logits", &[n, n], logits_bar);
    }
    Ok(ran)
}

fn no_loops(x: &Checked<'_>, _: &Ran) -> Result<Prediction> {
    let n = x.dim("N");
    let diagonal = (0..n * n).map(|at| at / n == at % n).collect();
    Ok(Prediction { zeros: [("logits".to_owned(), diagonal)].into(), ..Prediction::default() })
}

/// Case 0: the usual temperature; case 1: a warm one.
fn case_mask(case: usize) -> Case {
    let n = [4, 5][case];
    let mut made = Case::default();
    let small = Draw::new(61, case, 0).normals(n * n).into_iter().map(|u| 0.3 * u).collect();
    made.inputs.put("logits", &[n, n], small);
    made.inputs.put("uniform", &[n, n], Draw::new(61, case, 1).uniforms(n * n, 0.3, 0.7));
    if case == 1 {
        made.settings.insert("tau".to_owned(), Setting::Number(1.5));
    }
    made
}

/// `causal.structure`
pub(super) static STRUCTURE: Op = Op {
    inputs: &[
        Port::var("eps", "B,N,K", "causes; in mode abduct the factors"),
        Port::var("mask", "N,N", "edges i → j"),
        Port::var("weight", "N,N", "linear mechanism: a number per edge").or_absent(),
        Port::var("w0", "N,H,D", "networks: first layer over D = N·K inputs").or_absent(),
        Port::var("b0", "N,H", "").or_absent(),
        Port::var("w1", "N,H,H", "second layer").or_absent(),
        Port::var("b1", "N,H", "").or_absent(),
        Port::var("w2", "N,K,H", "last layer").or_absent(),
        Port::fixed("b2", "N,K", "cancels: every network is centred; accepted and not used").or_absent(),
    ],
    outputs: &[Port::var("z", "B,N,K", "factors; in mode abduct the causes")],
    settings: &[
        SettingSpec {
            key: "mode",
            kind: Kind::Choice(&["nonlinear", "linear", "abduct"]),
            default: "nonlinear",
            doc: "networks, weights, or the way back through whichever of them is given",
        },
        number("slope", "0.05", "of the leaky ReLU at 0 and below"),
        number("sweeps", "N, in mode linear N − 1", "passes over all nodes"),
    ],
    work_unit: "entries",
    work_ns: [2000.0, 20000.0],
    check: check_structure,
    run: run_structure,
    cases: 4,
    case: case_structure,
    ..entry("causal.structure", "from independent causes to factors along a graph, and back")
};

const NETWORK: [&str; 5] = ["w0", "b0", "w1", "b1", "w2"];

fn check_structure(x: &Checked<'_>) -> Result<()> {
    let mode = x.word("mode").unwrap_or("nonlinear");
    let given = |name: &&str| x.has(name);
    let (weights, networks) = (x.has("weight"), NETWORK.iter().any(|name| x.has(name)));
    let fits = match mode {
        "linear" => weights && !networks,
        "nonlinear" => !weights && NETWORK.iter().all(|name| given(name)),
        _ => weights != networks && (weights || NETWORK.iter().all(|name| given(name))),
    };
    if !fits {
        return Err(Error::input("mechanism")
            .expected("'weight' for mode linear, 'w0 b0 w1 b1 w2' for nonlinear, one of the two for abduct")
            .got(format!("mode {mode} with other arrays")));
    }
    if networks && x.dim("D") != x.dim("N") * x.dim("K") {
        return Err(Error::input("array 'w0'")
            .expected(format!("{} inputs, factors times numbers of a factor", x.dim("N") * x.dim("K")))
            .got(x.dim("D").to_string()));
    }
    match x.number("sweeps") {
        Some(s) if !(s >= 0.0 && s <= 1e4 && s.fract() == 0.0) => {
            Err(Error::input("setting sweeps").expected("a whole number, 0 to 10000").got(s.to_string()))
        }
        _ => Ok(()),
    }
}

fn run_structure(x: &Checked<'_>) -> Result<Ran> {
    let (batch, n, k) = (x.dim("B"), x.dim("N"), x.dim("K"));
    let (eps, mask, weight) = (x.f64s("eps"), x.f64s("mask"), x.f64s("weight"));
    let [w0, b0, w1, b1, w2] = NETWORK.map(|name| x.f64s(name));
    let linear = x.has("weight");
    let mechanism = if linear {
        Mechanism::Linear { weight: &weight }
    } else {
        let slope = x.number("slope").unwrap_or(0.05);
        Mechanism::Networks(Networks {
            w0: &w0,
            b0: &b0,
            w1: &w1,
            b1: &b1,
            w2: &w2,
            hidden: x.dim("H"),
            slope,
        })
    };
    let default = if linear { n.saturating_sub(1) } else { n };
    let sweeps = x.number("sweeps").map_or(default, |s| s as usize);
    let input = structure::In { eps: &eps, mask: &mask, mechanism, batch, n, k, sweeps };
    let abduct = x.word("mode") == Some("abduct");
    let (z, saved) = if abduct {
        (structure::abduct(&input), None)
    } else {
        let (z, saved) = structure::forward(&input);
        (z, Some(saved))
    };
    let mut ran = Ran::default();
    ran.outputs.put("z", &[batch, n, k], z);
    if let Some(z_bar) = x.bar_f64("z", &[batch, n, k])? {
        let start = |name: &str| x.start_f64(name, x.f64s(name).len());
        let [w0, b0, w1, b1, w2] = NETWORK.map(start);
        let mechanism = structure::MechanismBar { weight: start("weight"), w0, b0, w1, b1, w2 };
        let mut bar = structure::InBar { eps: start("eps"), mask: start("mask"), mechanism };
        match &saved {
            Some(saved) => structure::adjoint(&input, saved, &z_bar, &mut bar),
            None => structure::abduct_adjoint(&input, &z_bar, &mut bar),
        }
        let m = bar.mechanism;
        let all = [("eps", bar.eps), ("mask", bar.mask), ("weight", m.weight)];
        let networks = [("w0", m.w0), ("b0", m.b0), ("w1", m.w1), ("b1", m.b1), ("w2", m.w2)];
        for (name, values) in all.into_iter().chain(networks).filter(|(name, _)| x.has(name)) {
            ran.gradients.put(name, &x.shape(name), values);
        }
    }
    Ok(ran)
}

/// Cases 0 to 3: networks, weights, back through networks, back through weights.
fn case_structure(case: usize) -> Case {
    let (batch, n, k, h) = (3, 3, 2, 4);
    let draw = |array, len, scale: f32| -> Vec<f32> {
        Draw::new(62, case, array).normals(len).into_iter().map(|x| scale * x).collect()
    };
    let mut made = Case::default();
    made.inputs.put("eps", &[batch, n, k], draw(0, batch * n * k, 1.0));
    made.inputs.put("mask", &[n, n], Draw::new(62, case, 1).uniforms(n * n, 0.2, 0.9));
    if case % 2 == 0 {
        made.inputs.put("w0", &[n, h, n * k], draw(2, n * h * n * k, 0.4));
        made.inputs.put("b0", &[n, h], draw(3, n * h, 0.5));
        made.inputs.put("w1", &[n, h, h], draw(4, n * h * h, 0.5));
        made.inputs.put("b1", &[n, h], draw(5, n * h, 0.5));
        made.inputs.put("w2", &[n, k, h], draw(6, n * k * h, 0.5));
    } else {
        made.inputs.put("weight", &[n, n], draw(7, n * n, 0.8));
    }
    let mode = ["nonlinear", "linear", "abduct", "abduct"][case];
    made.settings.insert("mode".to_owned(), Setting::Text(mode.to_owned()));
    made
}

const MEAN: Port = Port::var("mu", "B,N,K", "mean");
const LOGVAR: Port = Port::var("logvar", "B,N,K", "ln of the variance");

/// `causal.posterior_kl`
pub(super) static POSTERIOR_KL: Op = Op {
    inputs: &[MEAN, LOGVAR],
    outputs: &[Port::var("value", "", "nats; sum over factors and their numbers, mean over the batch")],
    check: some_sample,
    run: run_posterior_kl,
    case: case_posterior_kl,
    ..entry("causal.posterior_kl", "divergence of diagonal Gaussians from the standard normal prior")
};

fn some_sample(x: &Checked<'_>) -> Result<()> {
    if x.dim("B") == 0 {
        return Err(Error::input("array 'mu'").expected("at least one sample").got("none"));
    }
    Ok(())
}

fn run_posterior_kl(x: &Checked<'_>) -> Result<Ran> {
    let (batch, mu, logvar) = (x.dim("B"), x.f64s("mu"), x.f64s("logvar"));
    let mut ran = Ran::default();
    ran.outputs.put("value", &[], vec![posterior_kl::forward(&mu, &logvar, batch)]);
    if let Some(bar) = x.bar_f64("value", &[])? {
        let mut mu_bar = x.start_f64("mu", mu.len());
        let mut logvar_bar = x.start_f64("logvar", mu.len());
        posterior_kl::adjoint(&mu, &logvar, batch, bar[0], &mut mu_bar, &mut logvar_bar);
        ran.gradients.put("mu", &x.shape("mu"), mu_bar);
        ran.gradients.put("logvar", &x.shape("mu"), logvar_bar);
    }
    Ok(ran)
}

fn case_posterior_kl(case: usize) -> Case {
    let shape = [[5, 4, 4], [3, 2, 7]][case];
    let len = shape[0] * shape[1] * shape[2];
    let mut made = Case::default();
    made.inputs.put("mu", &shape, Draw::new(63, case, 0).normals(len));
    made.inputs.put("logvar", &shape, Draw::new(63, case, 1).uniforms(len, -2.5, 1.5));
    made
}

/// `causal.posterior`
pub(super) static POSTERIOR: Op = Op {
    inputs: &[MEAN, LOGVAR, Port::fixed("eta", "B,N,K", "standard normal numbers; 0 gives the mean")],
    outputs: &[Port::var("sample", "B,N,K", "")],
    run: run_posterior,
    predict: beyond_limits,
    case: case_posterior,
    ..entry("causal.posterior", "a sample of a diagonal Gaussian, differentiable in mean and variance")
};

fn run_posterior(x: &Checked<'_>) -> Result<Ran> {
    let (mu, logvar, eta) = (x.f64s("mu"), x.f64s("logvar"), x.f64s("eta"));
    let shape = x.shape("mu");
    let mut ran = Ran::default();
    ran.outputs.put("sample", &shape, posterior::forward(&mu, &logvar, &eta));
    if let Some(bar) = x.bar_f64("sample", &shape)? {
        let mut mu_bar = x.start_f64("mu", mu.len());
        let mut logvar_bar = x.start_f64("logvar", mu.len());
        posterior::adjoint(&logvar, &eta, &bar, &mut mu_bar, &mut logvar_bar);
        ran.gradients.put("mu", &shape, mu_bar);
        ran.gradients.put("logvar", &shape, logvar_bar);
    }
    Ok(ran)
}

fn beyond_limits(x: &Checked<'_>, _: &Ran) -> Result<Prediction> {
    let [low, high] = posterior::LOGVAR;
    let beyond = x.f64s("logvar").into_iter().map(|l| l < low || l > high).collect();
    Ok(Prediction { zeros: [("logvar".to_owned(), beyond)].into(), ..Prediction::default() })
}

/// Case 0: within the limits; case 1: some beyond them.
fn case_posterior(case: usize) -> Case {
    let mut made = case_posterior_kl(case);
    let shape = [[5, 4, 4], [3, 2, 7]][case];
    let len = shape[0] * shape[1] * shape[2];
    made.inputs.put("eta", &shape, Draw::new(64, case, 2).normals(len));
    if case == 1 {
        made.inputs.put("logvar", &shape, Draw::new(64, case, 1).uniforms(len, -12.0, 8.0));
    }
    made
}
