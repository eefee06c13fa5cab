//! The losses of groups with a shared intervention.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width};
use crate::loss::groups::{self, In, InBar, Out};
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// `loss.groups`
pub(super) static GROUPS: Op = Op {
    signature: &reference::loss::groups::SIGNATURE,
    adjoint: true,
    width: Width::F64,
    work_unit: "entries",
    work_ns: [10.0, 100.0],
    check,
    run,
    predict,
    cases: 3,
    case,
};

/// Inputs with gradients.
const NAMES: [&str; 4] = ["after", "eps", "eps_after", "given"];

/// The arrays of a call.
struct Arrays {
    values: [Vec<f64>; 3],
    target: Vec<usize>,
    variance: Vec<f64>,
    given: Option<Vec<f64>>,
    sizes: [usize; 3],
}

impl Arrays {
    fn of(x: &CheckedCall<'_>) -> Result<Self> {
        x.rule("target", "a factor, 0 or more", |i| i >= 0.0)?;
        Ok(Self {
            values: ["after", "eps", "eps_after"].map(|name| x.f64s(name)),
            target: x.f64s("target").into_iter().map(|i| i as usize).collect(),
            variance: x.f64s("variance"),
            given: x.has("given").then(|| x.f64s("given")),
            sizes: ["M", "N", "K"].map(|letter| x.dim(letter)),
        })
    }

    fn input(&self) -> In<'_> {
        let [after, eps, eps_after] = &self.values;
        let [members, factors, size] = self.sizes;
        let (target, variance, given) = (&self.target, &self.variance, self.given.as_deref());
        In { after, eps, eps_after, target, variance, given, members, factors, size }
    }
}

fn check(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("G") == 0 {
        return Err(Error::input("array 'target'").expected("at least one group").got("none"));
    }
    Arrays::of(x)?.input().check()
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let arrays = Arrays::of(x)?;
    let input = arrays.input();
    let out = groups::forward(&input)?;
    let shape = [x.dim("G"), x.dim("K")];
    let mut ran = RunResult::default();
    for (name, value) in [("equal", out.equal), ("invariant", out.invariant), ("spread", out.spread)] {
        ran.outputs.put(name, &[], vec![value]);
    }
    ran.outputs.put("shared", &shape, out.shared.clone());
    if x.lend() {
        let one = |name: &str| Ok::<f64, Error>(x.bar_f64(name, &[])?.map_or(0.0, |bar| bar[0]));
        let out_bar = Out {
            equal: one("equal")?,
            invariant: one("invariant")?,
            spread: one("spread")?,
            shared: x.bar_f64("shared", &shape)?.unwrap_or_else(|| vec![0.0; out.shared.len()]),
        };
        let [after, eps, eps_after, given] = NAMES.map(|name| x.start_f64(name, x.f64s(name).len()));
        let mut bar = InBar { after, eps, eps_after, given };
        groups::adjoint(&input, &out, &out_bar, &mut bar);
        let all = [bar.after, bar.eps, bar.eps_after, bar.given];
        for (name, values) in NAMES.into_iter().zip(all).filter(|(name, _)| x.has(name)) {
            ran.gradients.put(name, &x.shape(name), values);
        }
    }
    Ok(ran)
}

/// Factors that were not set do not affect the codes; factors that were set do not affect the causes.
fn predict(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let target = x.f64s("target");
    let [m, n, k] = ["M", "N", "K"].map(|letter| x.dim(letter));
    let is_set = |i: usize| target[i / (m * n * k)] == (i / k % n) as f64;
    let all = 0..x.f64s("after").len();
    let others: Vec<bool> = all.clone().map(|i| !is_set(i)).collect();
    let set: Vec<bool> = all.map(is_set).collect();
    let zeros = [("after", others), ("eps", set.clone()), ("eps_after", set)];
    Ok(Prediction {
        zeros: zeros.map(|(name, mask)| (name.to_owned(), mask)).into(),
        ..Prediction::default()
    })
}

/// Case 0: every factor set by two groups, the values of one factor close together, a variance below the
/// floor; case 1: one factor set by a single group, one by none; case 2: given codes.
fn case(case: usize) -> Case {
    let (target, [m, n, k]): (&[i32], _) =
        [(&[0, 1, 2, 0, 1, 2][..], [3, 3, 2]), (&[2, 0, 2, 2], [2, 4, 3]), (&[1, 2, 0, 2, 1], [2, 3, 2])]
            [case];
    let g = target.len();
    let draw = |array, len| Draw::new(65, case, array).normals(len);
    // far apart, except for factor 2: near ±0.1
    let wide: Vec<f32> = draw(0, g * m * n * k)
        .into_iter()
        .enumerate()
        .map(|(i, x)| {
            let (group, factor) = (i / (m * n * k), i / k % n);
            let size = if factor == 2 { 0.1 } else { 1.5 };
            0.2 * x + if group < g / 2 { size } else { -size }
        })
        .collect();
    let variance =
        [vec![0.8_f32, 3e-5, 0.3], vec![0.6_f32, 0.9, 0.05, 1.3], vec![1.1_f32, 0.7, 0.4]][case].clone();
    let mut made = Case::default();
    made.inputs.put("after", &[g, m, n, k], wide);
    made.inputs.put("eps", &[g, m, n, k], draw(1, g * m * n * k));
    made.inputs.put("eps_after", &[g, m, n, k], draw(2, g * m * n * k));
    made.inputs.put("target", &[g], target.to_vec());
    made.inputs.put("variance", &[n], variance);
    if case == 2 {
        // the values of factor 1 close together, those of factor 2 far apart
        let codes: Vec<f32> = draw(3, g * k)
            .iter()
            .enumerate()
            .map(|(i, x)| if target[i / k] == 1 { 0.1 * x } else { 2.0 * x })
            .collect();
        made.inputs.put("given", &[g, k], codes);
    }
    made
}
