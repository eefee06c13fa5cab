//! Losses of surfaces and their albedo.

use super::call::{RunResult, rows};
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::loss::{albedo, eikonal};
use crate::num::elem;
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// `loss.eikonal`
pub(super) static EIKONAL: Op = Op {
    check: |x| match x.dim("N") {
        0 => Err(Error::input("array 'gradient'").expected("at least one row").got("none")),
        _ => Ok(()),
    },
    ..Op::new(&reference::loss::eikonal::SIGNATURE, run_eikonal, case_eikonal)
};

fn run_eikonal(x: &CheckedCall<'_>) -> Result<RunResult> {
    let gradient = x.rows::<3>("gradient");
    let mut ran = RunResult::default();
    ran.outputs.put("value", &[], vec![eikonal::forward(&gradient)]);
    if let Some(bar) = x.bar("value", &[])? {
        let mut gradient_bar = x.start_rows::<3>("gradient", gradient.len());
        eikonal::adjoint(&gradient, bar[0], &mut gradient_bar);
        ran.gradients.put("gradient", &x.shape("gradient"), gradient_bar.into_flattened());
    }
    Ok(ran)
}

/// Gradients of about unit length, more of them than one chunk of the sum has lanes.
fn case_eikonal(case: usize) -> Case {
    let n = [13, 1500][case];
    let mut made = Case::default();
    let drawn = rows::<3>(&Draw::new(70, case, 0).normals(3 * n));
    made.inputs.put("gradient", &[n, 3], drawn.into_iter().flat_map(|g| g.map(|x| 0.75 * x)).collect());
    made
}

/// `loss.albedo`
pub(super) static ALBEDO: Op = Op {
    check: check_albedo,
    predict: predict_albedo,
    ..Op::new(&reference::loss::albedo::SIGNATURE, run_albedo, case_albedo)
};

fn check_albedo(x: &CheckedCall<'_>) -> Result<()> {
    let (prediction, opacity) = (x.f64s("prediction").len(), x.f64s("opacity").len());
    if prediction == 0 || prediction != 3 * opacity {
        return Err(Error::input("array 'opacity'")
            .expected("one value per pixel, and at least one pixel")
            .got(opacity.to_string()));
    }
    x.rule("prediction", "0 or more", |p| p >= 0.0)?;
    x.rule("opacity", "0 to 1", |o| (0.0..=1.0).contains(&o))?;
    x.rule("scale", "a number above 0", |s| s > 0.0)
}

fn run_albedo(x: &CheckedCall<'_>) -> Result<RunResult> {
    let [prediction, truth, opacity, scale] =
        ["prediction", "truth", "opacity", "scale"].map(|name| x.f32s(name));
    let input = albedo::In { prediction: &prediction, truth: &truth, opacity: &opacity, scale: scale[0] };
    let (value, saved) = albedo::forward(&input);
    let shape = x.shape("prediction");
    let mut ran = RunResult::default();
    let bars = [x.bar("value", &[])?, x.bar("adjusted", &shape)?];
    if bars.iter().any(Option::is_some) {
        let [value_bar, adjusted_bar] = bars.map(Option::unwrap_or_default);
        let value_bar = value_bar.first().copied().unwrap_or(0.0);
        let mut prediction_bar = x.start("prediction", prediction.len());
        let mut opacity_bar = x.start("opacity", opacity.len());
        albedo::adjoint(&input, &saved, value_bar, &adjusted_bar, &mut prediction_bar, &mut opacity_bar);
        ran.gradients.put("prediction", &shape, prediction_bar);
        ran.gradients.put("opacity", &x.shape("opacity"), opacity_bar);
    }
    ran.outputs.put("value", &[], vec![value]);
    ran.outputs.put("adjusted", &shape, saved.adjusted);
    Ok(ran)
}

/// Whether the linear value of an entry is limited.
fn limited(x: &CheckedCall<'_>) -> Vec<bool> {
    let [prediction, opacity, scale] = ["prediction", "opacity", "scale"].map(|name| x.f64s(name));
    let linear = |(i, p): (usize, &f64)| elem::f64::pow(*p, 2.2) * scale[0] + (1.0 - opacity[i / 3]);
    prediction.iter().enumerate().map(linear).map(|l| !(1e-4..=1.0).contains(&l)).collect()
}

fn predict_albedo(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let limited = limited(x);
    let opacity = limited.chunks_exact(3).map(|l| l.iter().all(|l| *l)).collect();
    let zeros = [("prediction".to_owned(), limited), ("opacity".to_owned(), opacity)];
    Ok(Prediction { zeros: zeros.into(), ..Prediction::default() })
}

/// Case 0: rows; case 1: an image. Some values are above the upper bound. None is below the lower one: steps of
/// finite differences in the opacity are larger than its width.
fn case_albedo(case: usize) -> Case {
    let (shape, scale): (&[usize], f32) = [(&[31][..], 1.25), (&[9, 7], 0.75)][case];
    let n = crate::num::array::entries(shape);
    let three: Vec<usize> = shape.iter().copied().chain([3]).collect();
    let draw = |array| Draw::new(71, case, array);
    let mut opacity = draw(2).uniforms(n, 0.6, 0.95);
    let mut prediction = draw(0).uniforms(3 * n, 0.1, 0.6);
    for i in (4..n).step_by(5) {
        prediction[3 * i + 1] = 0.9375;
        opacity[i] = 0.5625;
    }
    let mut made = Case::default();
    made.inputs.put("prediction", &three, prediction);
    made.inputs.put("truth", &three, draw(1).uniforms(3 * n, 0.2, 0.9));
    made.inputs.put("opacity", shape, opacity);
    made.inputs.put("scale", &[], vec![scale]);
    made
}
