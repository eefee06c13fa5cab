//! Per-frame lighting, and renders without their background.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::shade::{diffuse, gain, over_black};
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// An input of three numbers.
fn three(x: &CheckedCall<'_>, name: &str) -> [f32; 3] {
    x.rows::<3>(name)[0]
}

/// `shade.diffuse`
pub(super) static DIFFUSE: Op = Op {
    predict: unlit,
    cases: 3,
    ..Op::new(&reference::shade::diffuse::SIGNATURE, run_diffuse, case_diffuse)
};

fn run_diffuse(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (sh, normals, n) = (x.f32s("sh"), x.rows::<3>("normals"), x.dim("N"));
    let input = diffuse::In { sh: &sh, normals: &normals, toward: three(x, "toward") };
    let (colors, shades) = diffuse::forward(&input);
    let mut ran = RunResult::default();
    ran.outputs.put("colors", &[n, 3], colors.into_flattened());
    if let Some(bar) = x.bar("colors", &[n, 3])? {
        let mut x_bar = diffuse::InBar { sh: x.start("sh", sh.len()), toward: x.start_rows("toward", 1)[0] };
        diffuse::adjoint(&input, &shades, bar.as_chunks().0, &mut x_bar);
        ran.gradients.put("sh", &[n, 3], x_bar.sh);
        ran.gradients.put("toward", &[3], x_bar.toward.to_vec());
    }
    Ok(ran)
}

/// Colours below their lower limit have no gradient.
fn unlit(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let black = x.f32s("sh").into_iter().map(|c| !diffuse::is_lit(c)).collect();
    Ok(Prediction { zeros: [("sh".to_owned(), black)].into(), ..Prediction::default() })
}

/// Colours and shading factors on both sides of their limits, not near them; weak light; a Gaussian without a
/// normal.
fn case_diffuse(case: usize) -> Case {
    let n = [19, 7, 6][case];
    let draw = |array| Draw::new(80, case, array);
    let mut made = Case::default();
    let apart = |c: f32| if c < -1.5 { c - 1.0 } else { c };
    made.inputs.put("sh", &[n, 3], draw(0).normals(3 * n).into_iter().map(apart).collect());
    // some unlit: 1 + n·d well below ¼
    let unit = |[x, y, z]: [f32; 3]| {
        let length = (x * x + y * y + z * z).sqrt();
        [x, y, z].map(|x| x / length)
    };
    let around = draw(1).normals(3 * n);
    let side = |i: usize| if i % 4 == 1 { -4.0 } else { 4.0 };
    let normals =
        around.as_chunks::<3>().0.iter().enumerate().flat_map(|(i, v)| unit([v[0], v[1], v[2] + side(i)]));
    let none = |i: usize| case == 2 && i / 3 == 2;
    let normals = normals.enumerate().map(|(i, x)| if none(i) { 0.0 } else { x });
    made.inputs.put("normals", &[n, 3], normals.collect());
    made.inputs.put(
        "toward",
        &[3],
        [[0.25_f32, -0.5, 1.75], [0.25, 0.125, -0.25], [-0.125, 0.25, 0.5]][case].to_vec(),
    );
    made
}

/// `shade.gain`
pub(super) static GAIN: Op =
    Op { check: check_gain, ..Op::new(&reference::shade::gain::SIGNATURE, run_gain, case_image) };

fn check_gain(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("H") * x.dim("W") == 0 {
        return Err(Error::input("array 'image'").expected("at least one pixel").got("none"));
    }
    x.rule("gain", "a number of at most 88, whose exponential is in the range of f32", |g| g <= 88.0)
}

fn run_gain(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (alpha, shape) = (x.f32s("alpha"), x.shape("image"));
    let input = gain::In { alpha: &alpha, background: three(x, "background"), gain: three(x, "gain") };
    let mut lit = x.f32s("image");
    gain::forward(&input, &mut lit);
    let mut ran = RunResult::default();
    if let Some(mut bar) = x.bar("lit", &shape)? {
        let mut alpha_bar = x.start("alpha", alpha.len());
        let by_gain = gain::adjoint(&input, &lit, x.dim("W"), &mut bar, &mut alpha_bar);
        ran.gradients.put("image", &shape, added(x.start("image", bar.len()), &bar));
        ran.gradients.put("alpha", &x.shape("alpha"), alpha_bar);
        ran.gradients.put("gain", &[3], added(x.start("gain", 3), &by_gain));
    }
    ran.outputs.put("lit", &shape, lit);
    Ok(ran)
}

fn added(mut start: Vec<f32>, what: &[f32]) -> Vec<f32> {
    start.iter_mut().zip(what).for_each(|(start, x)| *start += x);
    start
}

/// A render of few pixels.
fn case_image(case: usize) -> Case {
    let [h, w] = [[5, 7], [4, 3]][case];
    let draw = |array| Draw::new(81, case, array);
    let mut made = Case::default();
    made.inputs.put("image", &[h, w, 3], draw(0).uniforms(3 * h * w, 0.05, 0.95));
    made.inputs.put("alpha", &[h, w], draw(1).uniforms(h * w, 0.05, 0.95));
    made.inputs.put("background", &[3], draw(2).uniforms(3, 0.125, 0.875));
    made.inputs.put("gain", &[3], draw(3).normals(3).into_iter().map(|g| 0.4 * g).collect());
    made
}

/// `shade.over_black`
pub(super) static OVER_BLACK: Op =
    Op::new(&reference::shade::over_black::SIGNATURE, run_over_black, case_over_black);

fn run_over_black(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (alpha, shape, background) = (x.f32s("alpha"), x.shape("image"), three(x, "background"));
    let mut image = x.f32s("image");
    over_black::forward(&alpha, background, &mut image);
    let mut ran = RunResult::default();
    if let Some(bar) = x.bar("over_black", &shape)? {
        let mut alpha_bar = x.start("alpha", alpha.len());
        over_black::alpha_adjoint(background, &bar, &mut alpha_bar);
        ran.gradients.put("image", &shape, added(x.start("image", bar.len()), &bar));
        ran.gradients.put("alpha", &x.shape("alpha"), alpha_bar);
    }
    ran.outputs.put("over_black", &shape, image);
    Ok(ran)
}

fn case_over_black(case: usize) -> Case {
    let mut made = case_image(case);
    made.inputs.0.remove("gain");
    made
}
