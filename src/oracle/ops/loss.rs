//! Losses between two images.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::Result;
use crate::loss::{self, l1, mse, ssim};
use crate::tape::check::Prediction;
use crate::{Error, num::array::Arrays};
use reference::ports::Signature;
use reference::settings::Setting;

const fn entry(signature: &'static Signature) -> Op {
    Op { work_unit: "values", check, predict: left_out, ..Op::new(signature, run_l1, case) }
}

/// `loss.l1`
pub(super) static L1: Op = Op { predict: left_out_or_equal, ..entry(&reference::loss::l1::SIGNATURE) };
/// `loss.mse`
pub(super) static MSE: Op = Op {
    check: check_mse,
    run: run_mse,
    predict: left_out_or_equal,
    case: case_mse,
    cases: 4,
    ..entry(&reference::loss::mse::SIGNATURE)
};
/// `loss.ssim`
pub(super) static SSIM: Op = Op {
    run: run_ssim,
    work_unit: "window products",
    work_ns: [5.0, 60.0],
    ..entry(&reference::loss::ssim::SIGNATURE)
};

/// The divisor of `loss.mse`.
fn over(x: &CheckedCall<'_>) -> mse::Over {
    if x.word("over") == Some("all") { mse::Over::All } else { mse::Over::Kept }
}

fn check_mse(x: &CheckedCall<'_>) -> Result<()> {
    if over(x) == mse::Over::Kept {
        check(x)?;
    }
    if x.dim("C") * x.dim("H") * x.dim("W") > 0 {
        return check_mask(x);
    }
    Err(Error::input("array 'x'").expected("a pixel and a channel").got("none"))
}

fn check_mask(x: &CheckedCall<'_>) -> Result<()> {
    x.rule("mask", "0 or 1", |m| m == 0.0 || m == 1.0)
}

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_mask(x)?;
    let kept = !x.has("mask") || x.f64s("mask").contains(&1.0);
    if !kept || x.dim("H") * x.dim("W") == 0 {
        return Err(Error::input("array 'mask'").expected("at least one kept pixel").got("none"));
    }
    Ok(())
}

/// Forward and adjoint of one loss through the same steps: value, then gradients of both images.
fn run<S>(
    x: &CheckedCall<'_>,
    forward: impl Fn(&loss::In<'_>) -> Result<(f32, S)>,
    adjoint: impl Fn(&loss::In<'_>, &S, f32, &mut [f32], Option<&mut [f32]>),
) -> Result<RunResult> {
    let (a, b, mask) = (x.f32s("x"), x.f32s("y"), x.f32s("mask"));
    let [height, width] = [x.dim("H"), x.dim("W")];
    let images = loss::In { x: &a, y: &b, mask: x.has("mask").then_some(&mask[..]), height, width };
    let (value, saved) = forward(&images)?;
    let mut ran =
        RunResult { outputs: Arrays::new().with("value", &[], vec![value]), ..RunResult::default() };
    if let Some(bar) = x.bar("value", &[])? {
        let (mut x_bar, mut y_bar) = (x.start("x", a.len()), x.start("y", b.len()));
        adjoint(&images, &saved, bar[0], &mut x_bar, Some(&mut y_bar));
        ran.gradients.put("x", &x.shape("x"), x_bar);
        ran.gradients.put("y", &x.shape("y"), y_bar);
    }
    Ok(ran)
}

fn run_l1(x: &CheckedCall<'_>) -> Result<RunResult> {
    run(x, l1::forward, l1::adjoint)
}

fn run_mse(x: &CheckedCall<'_>) -> Result<RunResult> {
    run(x, |images| mse::forward_over(images, over(x)), mse::adjoint)
}

fn run_ssim(x: &CheckedCall<'_>) -> Result<RunResult> {
    run(x, ssim::forward, ssim::adjoint)
}

fn zeros(x: &CheckedCall<'_>, also: impl Fn(f64, f64) -> bool) -> Prediction {
    let (a, b, mask) = (x.f64s("x"), x.f64s("y"), x.f64s("mask"));
    let channels = a.len() / (x.dim("H") * x.dim("W"));
    let left_out = |i: usize| mask.get(i / channels) == Some(&0.0);
    let zero: Vec<bool> = (0..a.len()).map(|i| left_out(i) || also(a[i], b[i])).collect();
    Prediction {
        zeros: [("x".to_owned(), zero.clone()), ("y".to_owned(), zero)].into(),
        ..Prediction::default()
    }
}

fn left_out(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(zeros(x, |_, _| false))
}

fn left_out_or_equal(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(zeros(x, |a, b| a == b))
}

/// As [`case`]; case 3 as case 2, with all values as divisor.
fn case_mse(number: usize) -> Case {
    let mut made = case(Ord::min(number, 2));
    if number == 3 {
        made.settings.insert("over".to_owned(), Setting::Text("all".to_owned()));
    }
    made
}

/// Two images that differ by noise; case 1 with a mask, case 2 with a mask and one channel.
fn case(case: usize) -> Case {
    let [h, w, channels] = [[13, 11, 3], [17, 22, 3], [6, 19, 1]][case];
    let n = h * w * channels;
    let x = Draw::new(20, case, 0).uniforms(n, 0.05, 0.95);
    // at least 0.03 apart, so that no derivative is taken near x = y
    let apart = |d: f32| if d < 0.0 { 0.1 * d - 0.03 } else { 0.1 * d + 0.03 };
    let y = x.iter().zip(Draw::new(20, case, 1).normals(n)).map(|(x, d)| x + apart(d)).collect();
    let mut made = Case::default();
    made.inputs.put("x", &[h, w, channels], x);
    made.inputs.put("y", &[h, w, channels], y);
    if case > 0 {
        made.inputs.put("mask", &[h, w], Draw::new(20, case, 2).flags(h * w, 0.8));
    }
    made
}
