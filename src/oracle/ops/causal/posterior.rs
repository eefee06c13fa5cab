//! `causal.posterior`, `causal.posterior_kl`, `causal.scm_kl`.

use super::{bounded, diagonal, entry};
use crate::causal::{posterior, posterior_kl, scm_kl};
use crate::ops::call::RunResult;
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `causal.posterior_kl`
pub(crate) static POSTERIOR_KL: Op = Op {
    check: some_sample,
    run: run_posterior_kl,
    case: case_posterior_kl,
    ..entry(&reference::causal::posterior_kl::SIGNATURE)
};

/// Checks that the batch is not empty and that variances are bounded.
fn some_sample(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("B") == 0 {
        return Err(Error::input("array 'logvar'").expected("at least one sample").got("none"));
    }
    bounded(x)
}

fn run_posterior_kl(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (batch, mu, logvar) = (x.dim("B"), x.f64s("mu"), x.f64s("logvar"));
    let mut ran = RunResult::default();
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
pub(crate) static POSTERIOR: Op = Op {
    run: run_posterior,
    predict: beyond_limits,
    case: case_posterior,
    ..entry(&reference::causal::posterior::SIGNATURE)
};

fn run_posterior(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (mu, logvar, eta) = (x.f64s("mu"), x.f64s("logvar"), x.f64s("eta"));
    let shape = x.shape("mu");
    let mut ran = RunResult::default();
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

fn beyond_limits(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
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

/// `causal.scm_kl`
pub(crate) static SCM_KL: Op = Op {
    check: check_scm_kl,
    run: run_scm_kl,
    predict: predict_scm_kl,
    cases: 4,
    case: case_scm_kl,
    ..entry(&reference::causal::scm_kl::SIGNATURE)
};

fn is_linear(x: &CheckedCall<'_>) -> bool {
    x.word("mode") == Some("linear")
}

fn check_scm_kl(x: &CheckedCall<'_>) -> Result<()> {
    some_sample(x)?;
    let of_linear = ["mu", "mask", "weight"];
    let wanted = if is_linear(x) { &of_linear[..] } else { &["eps"] };
    let others = if is_linear(x) { &["eps"] } else { &of_linear[..] };
    if !wanted.iter().all(|name| x.has(name)) || others.iter().any(|name| x.has(name)) {
        return Err(Error::input("setting mode")
            .expected("'eps' for mode sampled, 'mu mask weight' for mode linear")
            .got("other arrays"));
    }
    x.rule("kept", "0 or 1", |kept| kept == 0.0 || kept == 1.0)
}

fn run_scm_kl(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (batch, n, k) = (x.dim("B"), x.dim("N"), x.dim("K"));
    let [eps, mu, logvar] = ["eps", "mu", "logvar"].map(|name| x.f64s(name));
    let [mask, weight, kept] = ["mask", "weight", "kept"].map(|name| x.f64s(name));
    let kept = x.has("kept").then_some(&kept[..]);
    let start = |name: &str| x.start_f64(name, x.f64s(name).len());
    let bar = x.bar_f64("value", &[])?;
    let mut ran = RunResult::default();
    let mut put = |name: &str, values: Vec<f64>| ran.gradients.put(name, &x.shape(name), values);
    let value = if is_linear(x) {
        let input =
            scm_kl::Linear { mu: &mu, logvar: &logvar, mask: &mask, weight: &weight, kept, batch, n, k };
        if let Some(bar) = bar {
            let [mu, logvar] = ["mu", "logvar"].map(start);
            let mut all = scm_kl::LinearBar { mu, logvar, mask: start("mask"), weight: start("weight") };
            scm_kl::linear_adjoint(&input, bar[0], &mut all);
            let named = [("mu", all.mu), ("logvar", all.logvar), ("mask", all.mask), ("weight", all.weight)];
            named.into_iter().for_each(|(name, values)| put(name, values));
        }
        scm_kl::linear(&input)
    } else {
        let input = scm_kl::Sampled { eps: &eps, logvar: &logvar, kept, batch, n, k };
        if let Some(bar) = bar {
            let mut all = scm_kl::SampledBar { eps: start("eps"), logvar: start("logvar") };
            scm_kl::sampled_adjoint(&input, bar[0], &mut all);
            put("eps", all.eps);
            put("logvar", all.logvar);
        }
        scm_kl::sampled(&input)
    };
    ran.outputs.put("value", &[], vec![value]);
    Ok(ran)
}

/// Diagonals, and in mode sampled the omitted factors; in mode linear, the mean of an omitted factor may
/// still affect its kept children.
fn predict_scm_kl(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let mut zeros = std::collections::BTreeMap::new();
    if is_linear(x) {
        for name in ["mask", "weight"] {
            zeros.insert(name.to_owned(), diagonal(x.dim("N")));
        }
    } else if x.has("kept") {
        let (kept, k) = (x.f64s("kept"), x.dim("K"));
        let omitted: Vec<bool> = (0..kept.len() * k).map(|at| kept[at / k] == 0.0).collect();
        zeros.insert("eps".to_owned(), omitted.clone());
        zeros.insert("logvar".to_owned(), omitted);
    }
    Ok(Prediction { zeros, ..Prediction::default() })
}

/// Cases 0 and 1: a sample; cases 2 and 3: the closed form; 1 and 3 with factors omitted.
fn case_scm_kl(case: usize) -> Case {
    let shape = [[5, 4, 4], [3, 2, 7], [4, 3, 2], [3, 4, 3]][case];
    let [batch, n, k] = shape;
    let len = batch * n * k;
    let mut made = Case::default();
    made.inputs.put("logvar", &shape, Draw::new(66, case, 1).uniforms(len, -2.5, 1.5));
    if case >= 2 {
        made.inputs.put("mu", &shape, Draw::new(66, case, 0).normals(len));
        made.inputs.put("mask", &[n, n], Draw::new(66, case, 2).uniforms(n * n, 0.2, 0.9));
        made.inputs.put("weight", &[n, n], Draw::new(66, case, 3).normals(n * n));
        made.settings.insert("mode".to_owned(), Setting::Text("linear".to_owned()));
    } else {
        made.inputs.put("eps", &shape, Draw::new(66, case, 0).normals(len));
    }
    if case % 2 == 1 {
        let kept = |row: usize| if row / n == row % n { 0.0_f32 } else { 1.0 };
        made.inputs.put("kept", &[batch, n], (0..batch * n).map(kept).collect());
    }
    made
}
