//! `causal.probability`, `causal.edges`, `causal.limit`, `causal.code`, `causal.held`.

use super::{diagonal, entry, no_loops, positive};
use crate::causal::{code, edges, held, limit, posterior, probability};
use crate::ops::call::RunResult;
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `causal.probability`
pub(crate) static PROBABILITY: Op = Op {
    check: |x| positive(x, "tau"),
    run: run_probability,
    predict: no_loops,
    case: case_probability,
    ..entry(&reference::causal::probability::SIGNATURE)
};

fn run_probability(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (n, logits, tau) = (x.dim("N"), x.f64s("logits"), x.number("tau").unwrap_or(0.2));
    let p = probability::forward(&logits, n, tau);
    let mut ran = RunResult::default();
    if let Some(bar) = x.bar_f64("probabilities", &[n, n])? {
        let mut logits_bar = x.start_f64("logits", n * n);
        probability::adjoint(&p, n, tau, &bar, &mut logits_bar);
        ran.gradients.put("logits", &[n, n], logits_bar);
    }
    ran.outputs.put("probabilities", &[n, n], p);
    Ok(ran)
}

/// Case 0: the default temperature; case 1: a higher one.
fn case_probability(case: usize) -> Case {
    let n = [4, 5][case];
    let mut made = Case::default();
    let small = Draw::new(65, case, 0).normals(n * n).into_iter().map(|u| 0.3 * u).collect();
    made.inputs.put("logits", &[n, n], small);
    if case == 1 {
        made.settings.insert("tau".to_owned(), Setting::Number(1.5));
    }
    made
}

/// `causal.edges`
pub(crate) static EDGES: Op = Op {
    run: run_edges,
    predict: |x, _| {
        let zeros = [("probabilities".to_owned(), diagonal(x.dim("N")))].into();
        Ok(Prediction { zeros, ..Prediction::default() })
    },
    case: case_edges,
    ..entry(&reference::causal::edges::SIGNATURE)
};

fn run_edges(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (n, p, before) = (x.dim("N"), x.f64s("probabilities"), x.f64s("before"));
    let w = edges::Weights {
        sparsity: x.number("sparsity").unwrap_or(0.002),
        anchor: x.number("anchor").unwrap_or(0.0),
    };
    let mut ran = RunResult::default();
    ran.outputs.put("value", &[], vec![edges::forward(&w, &p, &before, n)]);
    if let Some(bar) = x.bar_f64("value", &[])? {
        let mut p_bar = x.start_f64("probabilities", n * n);
        edges::adjoint(&w, &p, &before, n, bar[0], &mut p_bar);
        ran.gradients.put("probabilities", &[n, n], p_bar);
    }
    Ok(ran)
}

/// Case 0: sparsity alone; case 1: both terms.
fn case_edges(case: usize) -> Case {
    let n = [4, 5][case];
    let mut made = Case::default();
    made.inputs.put("probabilities", &[n, n], Draw::new(66, case, 0).uniforms(n * n, 0.05, 0.95));
    made.inputs.put("before", &[n, n], Draw::new(66, case, 1).uniforms(n * n, 0.05, 0.95));
    if case == 1 {
        made.settings.insert("anchor".to_owned(), Setting::Number(0.75));
    }
    made
}

/// `causal.limit`
pub(crate) static LIMIT: Op =
    Op { run: run_limit, predict: beyond, case: case_limit, ..entry(&reference::causal::limit::SIGNATURE) };

fn run_limit(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (logvar, shape) = (x.f64s("logvar"), x.shape("logvar"));
    let mut ran = RunResult::default();
    ran.outputs.put("limited", &shape, limit::forward(&logvar));
    if let Some(bar) = x.bar_f64("limited", &shape)? {
        let mut logvar_bar = x.start_f64("logvar", logvar.len());
        limit::adjoint(&logvar, &bar, &mut logvar_bar);
        ran.gradients.put("logvar", &shape, logvar_bar);
    }
    Ok(ran)
}

fn beyond(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let beyond = x.f64s("logvar").into_iter().map(|l| !posterior::within(l)).collect();
    Ok(Prediction { zeros: [("logvar".to_owned(), beyond)].into(), ..Prediction::default() })
}

/// Numbers within and beyond the limits.
fn case_limit(case: usize) -> Case {
    let shape: &[usize] = [&[5, 4, 4][..], &[7, 6]][case];
    let len = crate::num::array::entries(shape);
    let mut made = Case::default();
    made.inputs.put("logvar", shape, Draw::new(67, case, 0).uniforms(len, -12.0, 8.0));
    made
}

/// `causal.code`
pub(crate) static CODE: Op = Op {
    check: check_code,
    run: run_code,
    predict: unlabelled,
    case: case_code,
    ..entry(&reference::causal::code::SIGNATURE)
};

fn targets(x: &CheckedCall<'_>) -> Vec<usize> {
    x.f64s("target").into_iter().map(|i| i as usize).collect()
}

/// Checks that targets are factors below `n`.
fn are_factors(x: &CheckedCall<'_>, n: usize) -> Result<()> {
    x.rule("target", "the index of a factor", |i| i >= 0.0 && i < n as f64)
}

fn check_code(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("K") == 0 {
        return Err(Error::input("array 'values'").expected("factors of at least one dimension").got("none"));
    }
    are_factors(x, x.dim("N"))
}

fn run_code(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (labels, target, values, k) = (x.f64s("labels"), targets(x), x.f64s("values"), x.dim("K"));
    let input = code::In { labels: &labels, target: &target, values: &values, k };
    let shape = [labels.len(), k];
    let mut ran = RunResult::default();
    ran.outputs.put("codes", &shape, code::forward(&input));
    if let Some(bar) = x.bar_f64("codes", &shape)? {
        let mut values_bar = x.start_f64("values", values.len());
        code::adjoint(&input, &bar, &mut values_bar);
        ran.gradients.put("values", &x.shape("values"), values_bar);
    }
    Ok(ran)
}

/// The first entry of a code is 1; a factor that no group sets has no gradient.
fn unlabelled(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let (target, k) = (targets(x), x.dim("K"));
    let zeros = (0..x.dim("N") * k).map(|at| at % k == 0 || !target.contains(&(at / k))).collect();
    Ok(Prediction { zeros: [("values".to_owned(), zeros)].into(), ..Prediction::default() })
}

/// Case 0: every factor is set; case 1: one of them is not.
fn case_code(case: usize) -> Case {
    let (target, [n, k]) = [(&[2, 0, 1, 2, 3][..], [4, 3]), (&[1, 0, 1], [3, 2])][case];
    let mut made = Case::default();
    made.inputs.put("labels", &[target.len()], Draw::new(68, case, 0).normals(target.len()));
    made.inputs.put("target", &[target.len()], target.to_vec());
    made.inputs.put("values", &[n, k], Draw::new(68, case, 1).normals(n * k));
    made
}

/// `causal.held`
pub(crate) static HELD: Op = Op {
    check: check_held,
    run: run_held,
    predict: not_set,
    case: case_held,
    ..entry(&reference::causal::held::SIGNATURE)
};

/// Maximum number of held values: 512 MiB.
const MOST: usize = 1 << 26;

fn check_held(x: &CheckedCall<'_>) -> Result<()> {
    let (members, groups) = (x.whole("members")?, x.dim("G"));
    if groups.saturating_mul(members).saturating_mul(x.dim("K")) > MOST {
        return Err(Error::input("array 'members'")
            .expected(format!("at most {MOST} numbers in all groups"))
            .got(format!("{groups} groups of {members} pairs of {} dimensions", x.dim("K"))));
    }
    let pairs = !x.has("factors") || x.dim("P") == groups * members;
    if x.has("shared") == x.has("factors") || members == 0 || !pairs || x.dim("K") == 0 {
        return Err(Error::input("array 'factors'")
            .expected("'shared' for every group, or 'factors' for every pair of every group")
            .got(format!("{groups} groups of {members} pairs, {} pairs", x.dim("P"))));
    }
    are_factors(x, if x.has("factors") { x.dim("N") } else { usize::MAX })
}

fn run_held(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (target, members, k) = (targets(x), x.whole("members")?, x.dim("K"));
    let name = if x.has("shared") { "shared" } else { "factors" };
    let values = x.f64s(name);
    let from = if x.has("shared") { held::From::Shared(&values) } else { held::From::Own(&values) };
    let input = held::In { from, target: &target, members, n: x.dim("N"), k };
    let shape = [target.len() * members, k];
    let mut ran = RunResult::default();
    ran.outputs.put("held", &shape, held::forward(&input));
    if let Some(bar) = x.bar_f64("held", &shape)? {
        let mut from_bar = x.start_f64(name, values.len());
        held::adjoint(&input, &bar, &mut from_bar);
        ran.gradients.put(name, &x.shape(name), from_bar);
    }
    Ok(ran)
}

/// Factors that are not set have no gradient.
fn not_set(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    if !x.has("factors") {
        return Ok(Prediction::default());
    }
    let (target, members, [n, k]) = (targets(x), x.whole("members")?, [x.dim("N"), x.dim("K")]);
    let zeros = (0..x.dim("P") * n * k).map(|at| target[at / (n * k) / members] != at / k % n).collect();
    Ok(Prediction { zeros: [("factors".to_owned(), zeros)].into(), ..Prediction::default() })
}

/// Case 0: values shared by groups; case 1: a value of its own for each pair.
fn case_held(case: usize) -> Case {
    let (target, members, [n, k]) = [(&[2, 0, 1][..], 4, [3, 2]), (&[1, 3], 3, [4, 3])][case];
    let mut made = Case::default();
    let draw = |len| Draw::new(69, case, 0).normals(len);
    match case {
        0 => made.inputs.put("shared", &[target.len(), k], draw(target.len() * k)),
        _ => {
            made.inputs.put("factors", &[target.len() * members, n, k], draw(target.len() * members * n * k))
        }
    };
    made.inputs.put("target", &[target.len()], target.to_vec());
    made.inputs.put("members", &[], vec![members as i32]);
    made
}
