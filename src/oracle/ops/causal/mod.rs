//! Causal structure, computed in f64.

mod edges;
mod independence;
mod posterior;
mod structure;

pub(super) use edges::{CODE, EDGES, HELD, LIMIT, PROBABILITY};
pub(super) use independence::INDEPENDENCE;
pub(super) use posterior::{POSTERIOR, POSTERIOR_KL, SCM_KL};
pub(super) use structure::{INTERVENE, STRUCTURE};

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width};
use crate::causal::{acyclic, mask};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::ports::Signature;
use reference::settings::Setting;

const fn entry(signature: &'static Signature) -> Op {
    Op { width: Width::F64, work_ns: [100.0, 1000.0], ..Op::new(signature, run_acyclic, case_acyclic) }
}

/// Checks that a setting is above 0.
fn positive(x: &CheckedCall<'_>, key: &'static str) -> Result<()> {
    match x.number(key) {
        Some(value) if !(value > 0.0) => {
            Err(Error::input(format!("setting {key}")).expected("a number above 0").got(value.to_string()))
        }
        _ => Ok(()),
    }
}

/// `causal.acyclic`
pub(super) static ACYCLIC: Op = Op {
    check: |x| x.rule("alpha", "a number above 0", |alpha| alpha > 0.0),
    ..entry(&reference::causal::acyclic::SIGNATURE)
};

fn run_acyclic(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (n, a, alpha) = (x.dim("N"), x.f64s("a"), x.inputs.scalar("alpha")?);
    let (value, saved) = acyclic::forward(&a, n, alpha);
    let mut ran = RunResult::default();
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
    check: |x| {
        x.rule("uniform", "a number between 0 and 1, both excluded", |u| u > 0.0 && u < 1.0)?;
        x.rule("allowed", "0 or 1", |l| l == 0.0 || l == 1.0)?;
        positive(x, "tau")
    },
    run: run_mask,
    predict: allowed_edges,
    cases: 3,
    case: case_mask,
    ..entry(&reference::causal::mask::SIGNATURE)
};

fn run_mask(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (n, logits, uniform) = (x.dim("N"), x.f64s("logits"), x.f64s("uniform"));
    let allowed = x.has("allowed").then(|| x.f64s("allowed"));
    let tau = x.number("tau").unwrap_or(0.2);
    let input = mask::In { logits: &logits, uniform: &uniform, allowed: allowed.as_deref(), n, tau };
    let mut ran = RunResult::default();
    ran.outputs.put("mask", &[n, n], mask::forward(&input));
    if let Some(bar) = x.bar_f64("mask", &[n, n])? {
        let mut logits_bar = x.start_f64("logits", n * n);
        mask::adjoint(&input, &bar, &mut logits_bar);
        ran.gradients.put("logits", &[n, n], logits_bar);
    }
    Ok(ran)
}

fn no_loops(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(Prediction { zeros: [("logits".to_owned(), diagonal(x.dim("N")))].into(), ..Prediction::default() })
}

/// Edges that are not allowed and the diagonal have no gradient.
fn allowed_edges(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let mut zeros = diagonal(x.dim("N"));
    if x.has("allowed") {
        zeros.iter_mut().zip(x.f64s("allowed")).for_each(|(zero, allowed)| *zero |= allowed == 0.0);
    }
    Ok(Prediction { zeros: [("logits".to_owned(), zeros)].into(), ..Prediction::default() })
}

/// Checks that logarithms of variances are at most 700, so that variances are in the range of f64.
fn bounded(x: &CheckedCall<'_>) -> Result<()> {
    x.rule("logvar", "a number of at most 700", |l| l <= 700.0)
}

/// True on the diagonal of an (n, n) matrix.
fn diagonal(n: usize) -> Vec<bool> {
    (0..n * n).map(|at| at / n == at % n).collect()
}

/// Case 0: the default temperature; case 1: a higher one; case 2: only edges along an order of the nodes.
fn case_mask(case: usize) -> Case {
    let n = [4, 5, 4][case];
    let mut made = Case::default();
    let small = Draw::new(61, case, 0).normals(n * n).into_iter().map(|u| 0.3 * u).collect();
    made.inputs.put("logits", &[n, n], small);
    made.inputs.put("uniform", &[n, n], Draw::new(61, case, 1).uniforms(n * n, 0.3, 0.7));
    if case == 1 {
        made.settings.insert("tau".to_owned(), Setting::Number(1.5));
    }
    if case == 2 {
        let place = [2, 0, 3, 1];
        let before = |at: usize| f64::from(u8::from(place[at / n] < place[at % n]));
        made.inputs.put("allowed", &[n, n], (0..n * n).map(before).collect());
    }
    made
}
