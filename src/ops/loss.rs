//! Losses between two images.

use super::call::{Checked, Ran};
use super::case::Draw;
use super::op::{Case, Op, Port, Width};
use crate::Result;
use crate::loss::{self, l1, mse, ssim};
use crate::tape::check::Prediction;
use crate::{Error, num::array::Arrays};

const INPUTS: &[Port] = &[
    Port::var("x", "H,W,3", "usually the render, sRGB-encoded"),
    Port::var("y", "H,W,3", "usually the photograph, sRGB-encoded"),
    Port::fixed("mask", "H,W", "0 left out, 1 kept; absent: all kept").or_absent(),
];
const OUTPUTS: &[Port] = &[Port::var("value", "", "mean over the kept values")];

const fn entry(name: &'static str, summary: &'static str) -> Op {
    Op {
        name,
        summary,
        inputs: INPUTS,
        outputs: OUTPUTS,
        intermediates: &[],
        plan: &[],
        companions: &[],
        settings: &[],
        stages: &[],
        adjoint: true,
        width: Width::F32,
        work_unit: "values",
        work_ns: [10.0, 100.0],
        check,
        run: run_l1,
        predict: left_out,
        cases: 2,
        case,
    }
}

/// `loss.l1`
pub(super) static L1: Op = Op { predict: left_out_or_equal, ..entry("loss.l1", "mean |x − y|") };
/// `loss.mse`
pub(super) static MSE: Op =
    Op { run: run_mse, predict: left_out_or_equal, ..entry("loss.mse", "mean (x − y)²") };
/// `loss.ssim`
pub(super) static SSIM: Op = Op {
    run: run_ssim,
    work_unit: "window products",
    work_ns: [5.0, 60.0],
    ..entry("loss.ssim", "mean structural similarity, 11×11 Gaussian window, 1 for equal images")
};

fn check(x: &Checked<'_>) -> Result<()> {
    x.rule("mask", "0 or 1", |m| m == 0.0 || m == 1.0)?;
    let kept = !x.has("mask") || x.f64s("mask").contains(&1.0);
    if !kept || x.dim("H") * x.dim("W") == 0 {
        return Err(Error::input("array 'mask'").expected("at least one kept pixel").got("none"));
    }
    Ok(())
}

/// Forward and adjoint of one loss through the same steps: value, then gradients of both images.
fn run<S>(
    x: &Checked<'_>,
    forward: impl Fn(&loss::In<'_>) -> Result<(f32, S)>,
    adjoint: impl Fn(&loss::In<'_>, &S, f32, &mut [f32], Option<&mut [f32]>),
) -> Result<Ran> {
    let (a, b, mask) = (x.f32s("x"), x.f32s("y"), x.f32s("mask"));
    let [height, width] = [x.dim("H"), x.dim("W")];
    let images = loss::In { x: &a, y: &b, mask: x.has("mask").then_some(&mask[..]), height, width };
    let (value, saved) = forward(&images)?;
    let mut ran = Ran { outputs: Arrays::new().with("value", &[], vec![value]), ..Ran::default() };
    if let Some(bar) = x.bar("value", &[])? {
        let (mut x_bar, mut y_bar) = (x.start("x", a.len()), x.start("y", b.len()));
        adjoint(&images, &saved, bar[0], &mut x_bar, Some(&mut y_bar));
        ran.gradients.put("x", &[height, width, 3], x_bar);
        ran.gradients.put("y", &[height, width, 3], y_bar);
    }
    Ok(ran)
}

fn run_l1(x: &Checked<'_>) -> Result<Ran> {
    run(x, l1::forward, l1::adjoint)
}

fn run_mse(x: &Checked<'_>) -> Result<Ran> {
    run(x, mse::forward, mse::adjoint)
}

fn run_ssim(x: &Checked<'_>) -> Result<Ran> {
    run(x, ssim::forward, ssim::adjoint)
}

fn zeros(x: &Checked<'_>, also: impl Fn(f64, f64) -> bool) -> Prediction {
    let (a, b, mask) = (x.f64s("x"), x.f64s("y"), x.f64s("mask"));
    let left_out = |i: usize| mask.get(i / 3) == Some(&0.0);
    let zero: Vec<bool> = (0..a.len()).map(|i| left_out(i) || also(a[i], b[i])).collect();
    Prediction {
        zeros: [("x".to_owned(), zero.clone()), ("y".to_owned(), zero)].into(),
        ..Prediction::default()
    }
}

fn left_out(x: &Checked<'_>, _: &Ran) -> Result<Prediction> {
    Ok(zeros(x, |_, _| false))
}

fn left_out_or_equal(x: &Checked<'_>, _: &Ran) -> Result<Prediction> {
    Ok(zeros(x, |a, b| a == b))
}

/// Two images that differ by noise; in case 1 with a mask.
fn case(case: usize) -> Case {
    let [h, w] = [[13, 11], [17, 22]][case];
    let n = h * w * 3;
    let x = Draw::new(20, case, 0).uniforms(n, 0.05, 0.95);
    // at least 0.03 apart, so that no derivative is taken near x = y
    let apart = |d: f32| if d < 0.0 { 0.1 * d - 0.03 } else { 0.1 * d + 0.03 };
    let y = x.iter().zip(Draw::new(20, case, 1).normals(n)).map(|(x, d)| x + apart(d)).collect();
    let mut made = Case::default();
    made.inputs.put("x", &[h, w, 3], x);
    made.inputs.put("y", &[h, w, 3], y);
    if case == 1 {
        made.inputs.put("mask", &[h, w], Draw::new(20, case, 2).flags(h * w, 0.8));
    }
    made
}
