//! Priors for Gaussians.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width, no_zeros};
use crate::loss::{presence, prior};
use crate::num::array::Arrays;
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// Number of nearest neighbours of each Gaussian.
const NEAR: usize = 6;

/// `loss.prior`
pub(super) static PRIOR: Op = Op {
    signature: &reference::loss::prior::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [50.0, 500.0],
    check: check_prior,
    run: run_prior,
    predict: no_bands,
    cases: 2,
    case: case_prior,
};

fn weights(x: &CheckedCall<'_>) -> prior::Weights {
    let of = |key: &str| x.number(key).unwrap_or(0.0) as f32;
    prior::Weights {
        color: of("color"),
        opacity: of("opacity"),
        scale: of("scale"),
        round: of("round"),
        fill: of("fill"),
        reach: x.number("reach").unwrap_or(1.0) as f32,
        anchor: of("anchor"),
        solid: of("solid"),
    }
}

fn check_prior(x: &CheckedCall<'_>) -> Result<()> {
    for key in ["color", "opacity", "scale", "round", "fill", "anchor", "solid"] {
        x.single(key, 0.0, |w| w >= 0.0, "not negative")?;
    }
    x.single("reach", 1.0, |reach| reach > 0.0, "above 0")?;
    let radius = x.number("radius").unwrap_or(1.0);
    let square = (radius * radius) as f32;
    if !(radius > 0.0 && square > 0.0 && square.is_finite()) {
        return Err(Error::input("setting radius")
            .expected("above 0, its square in the range of f32")
            .got(format!("{radius:e}")));
    }
    if x.dim("N") == 0 || x.dim("C") == 0 {
        return Err(Error::input("array 'sh'")
            .expected("at least one Gaussian and one coefficient")
            .got("none"));
    }
    let n = x.dim("N") as f64;
    x.rule("near", "-1, or the index of a Gaussian", |i| (-1.0..n).contains(&i))
}

fn run_prior(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (means, scales_log, anchors) =
        (x.rows::<3>("means"), x.rows::<3>("scales_log"), x.rows::<3>("anchors"));
    let [logits, sh, gap] = ["opacity_logits", "sh", "gap"].map(|name| x.f32s(name));
    let near: Vec<u32> =
        x.f64s("near").into_iter().map(|i| u32::try_from(i as i64).unwrap_or(u32::MAX)).collect();
    let input = prior::In::<NEAR> {
        means: &means,
        scales_log: &scales_log,
        opacity_logits: &logits,
        sh: &sh,
        coefficients: x.dim("C"),
        near: near.as_chunks().0,
        gap: &gap,
        anchors: &anchors,
        radius: x.number("radius").unwrap_or(1.0),
    };
    let w = weights(x);
    let value = prior::forward(&w, &input) as f32;
    let mut ran =
        RunResult { outputs: Arrays::new().with("value", &[], vec![value]), ..RunResult::default() };
    if let Some(bar) = x.bar("value", &[])? {
        let n = means.len();
        let (mut m, mut s) = (x.start_rows::<3>("means", n), x.start_rows::<3>("scales_log", n));
        let (mut l, mut c) = (x.start("opacity_logits", n), x.start("sh", sh.len()));
        let mut x_bar =
            prior::InBar { means: &mut m, scales_log: &mut s, opacity_logits: &mut l, sh: &mut c };
        prior::adjoint(&w, &input, bar[0], &mut x_bar);
        ran.gradients.put("means", &[n, 3], m.into_flattened());
        ran.gradients.put("scales_log", &[n, 3], s.into_flattened());
        ran.gradients.put("opacity_logits", &[n], l);
        ran.gradients.put("sh", &x.shape("sh"), c);
    }
    Ok(ran)
}

/// Only the constant coefficients have a gradient.
fn no_bands(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let bands = (0..x.f32s("sh").len()).map(|i| i / 3 % x.dim("C") > 0).collect();
    Ok(Prediction { zeros: [("sh".to_owned(), bands)].into(), ..Prediction::default() })
}

/// All terms, some Gaussians with fewer neighbours, four colour coefficients.
fn case_prior(case: usize) -> Case {
    let [n, c] = [[13, 1], [8, 4]][case];
    let draw = |array| Draw::new(22, case, array);
    let mut made = Case::default();
    made.inputs.put("means", &[n, 3], draw(0).normals(3 * n));
    made.inputs.put("scales_log", &[n, 3], draw(1).normals(3 * n));
    made.inputs.put("opacity_logits", &[n], draw(2).normals(n));
    made.inputs.put("sh", &[n, c, 3], draw(3).normals(3 * c * n));
    let near = (0..n * NEAR).map(|at| {
        let (i, slot) = (at / NEAR, at % NEAR);
        if i % 5 == 2 && slot > 2 { -1 } else { ((i + 1 + 2 * slot) % n) as i32 }
    });
    made.inputs.put("near", &[n, NEAR], near.collect());
    made.inputs.put("gap", &[n], draw(4).normals(n));
    made.inputs.put("anchors", &[n, 3], draw(5).normals(3 * n));
    let settings = [
        ("color", 1.5),
        ("opacity", 0.25),
        ("scale", 0.75),
        ("round", 0.5),
        ("fill", 2.0),
        ("reach", 1.25),
        ("anchor", 3.0),
        ("solid", 0.625),
        ("radius", 0.75),
    ];
    made.settings = settings.map(|(key, value)| (key.to_owned(), Setting::Number(value))).into();
    made
}

/// `loss.presence`
pub(super) static PRESENCE: Op = Op {
    signature: &reference::loss::presence::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [20.0, 200.0],
    check: check_presence,
    run: run_presence,
    predict: no_zeros,
    cases: 2,
    case: case_presence,
};

fn check_presence(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("N") == 0 {
        return Err(Error::input("array 'opacity_logits'").expected("at least one Gaussian").got("none"));
    }
    for key in ["opacity_weight", "scale_weight"] {
        x.single(key, 0.01, |w| w >= 0.0, "not negative")?;
    }
    x.rule("scales_log", "a number of at most 88, whose exponential is in the range of f32", |s| s <= 88.0)
}

fn run_presence(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (logits, scales, n) = (x.f32s("opacity_logits"), x.rows::<3>("scales_log"), x.dim("N"));
    let of = |key: &str| x.number(key).unwrap_or(0.01);
    let w = presence::Weights { opacity: of("opacity_weight"), scale: of("scale_weight") };
    let (value, saved) = presence::forward(&w, &logits, &scales);
    let mut ran =
        RunResult { outputs: Arrays::new().with("value", &[], vec![value as f32]), ..RunResult::default() };
    if let Some(bar) = x.bar("value", &[])? {
        let (mut l, mut s) = (x.start("opacity_logits", n), x.start_rows::<3>("scales_log", n));
        presence::adjoint(&w, &saved, f64::from(bar[0]), &mut l, &mut s);
        ran.gradients.put("opacity_logits", &[n], l);
        ran.gradients.put("scales_log", &[n, 3], s.into_flattened());
    }
    Ok(ran)
}

/// Case 0: the default weights; case 1: others.
fn case_presence(case: usize) -> Case {
    let n = [21, 6][case];
    let mut made = Case::default();
    made.inputs.put("opacity_logits", &[n], Draw::new(23, case, 0).normals(n));
    made.inputs.put("scales_log", &[n, 3], Draw::new(23, case, 1).normals(3 * n));
    if case == 1 {
        made.settings.insert("opacity_weight".to_owned(), Setting::Number(0.5));
        made.settings.insert("scale_weight".to_owned(), Setting::Number(2.0));
    }
    made
}
