//! Operators that a light fitted with a field needs, and the smoothness of maps and planes.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::loss::variation::{self, Columns};
use crate::nn::softplus;
use crate::shade::{decode, encode};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `nn.softplus`
pub(super) static SOFTPLUS: Op = Op::new(
    &reference::nn::softplus::SIGNATURE,
    |x| run_each(x, ["x", "y"], softplus::forward, softplus::adjoint),
    |case| case_each("x", &Draw::new(90, case, 0).uniforms([11, 200][case], -9.0, 9.0)),
);

/// `shade.encode`
pub(super) static ENCODE: Op = Op {
    predict: predict_encode,
    ..Op::new(
        &reference::shade::encode::SIGNATURE,
        |x| run_each(x, ["linear", "encoded"], encode::forward, encode::adjoint),
        |case| {
            let drawn = Draw::new(91, case, 0).uniforms([12, 200][case], -0.2, 1.2);
            case_each("linear", &away(&drawn, &[0.0, 0.003_13, 1.0]))
        },
    )
};

/// Limited values have no gradient.
fn predict_encode(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let limited = x.f32s("linear").iter().map(|x| !(0.0..=1.0).contains(x)).collect();
    Ok(Prediction { zeros: [("linear".to_owned(), limited)].into(), ..Prediction::default() })
}

/// `shade.decode`
pub(super) static DECODE: Op = Op {
    check: |x| x.rule("encoded", "0 or more", |y| y >= 0.0),
    ..Op::new(
        &reference::shade::decode::SIGNATURE,
        |x| run_each(x, ["encoded", "linear"], decode::forward, decode::adjoint),
        |case| {
            case_each(
                "encoded",
                &away(&Draw::new(92, case, 0).uniforms([12, 200][case], 0.005, 1.0), &[0.040_45]),
            )
        },
    )
};

/// Runs an operator that maps every value by itself.
fn run_each(
    x: &CheckedCall<'_>,
    [input, output]: [&str; 2],
    forward: impl Fn(&[f32], &mut [f32]),
    adjoint: impl Fn(&[f32], &[f32], &mut [f32]),
) -> Result<RunResult> {
    let (values, shape) = (x.f32s(input), x.shape(input));
    let mut mapped = vec![0.0; values.len()];
    forward(&values, &mut mapped);
    let mut ran = RunResult::default();
    ran.outputs.put(output, &shape, mapped);
    if let Some(bar) = x.bar(output, &shape)? {
        let mut gradient = x.start(input, values.len());
        adjoint(&values, &bar, &mut gradient);
        ran.gradients.put(input, &shape, gradient);
    }
    Ok(ran)
}

/// Moves values that are close to a kink away from it.
fn away(values: &[f32], kinks: &[f32]) -> Vec<f32> {
    let moved = |x: f32| if kinks.iter().any(|k| (x - k).abs() < 2e-3) { x + 4e-3 } else { x };
    values.iter().map(|x| moved(*x)).collect()
}

fn case_each(name: &str, values: &[f32]) -> Case {
    let mut made = Case::default();
    made.inputs.put(name, &[values.len()], values.to_vec());
    made
}

/// `loss.variation`
pub(super) static VARIATION: Op = Op {
    check: |x| match x.f64s("planes").len() {
        0 => Err(Error::input("array 'planes'").expected("at least one entry").got("none")),
        _ => Ok(()),
    },
    ..Op::new(&reference::loss::variation::SIGNATURE, run_variation, case_variation)
};

fn run_variation(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (planes, shape) = (x.f32s("planes"), x.shape("planes"));
    let columns = if x.word("columns") == Some("periodic") { Columns::Periodic } else { Columns::Open };
    let input = variation::In { planes: &planes, shape: std::array::from_fn(|k| shape[k]), columns };
    let mut ran = RunResult::default();
    ran.outputs.put("value", &[], vec![variation::forward(&input)]);
    if let Some(bar) = x.bar("value", &[])? {
        let mut planes_bar = x.start("planes", planes.len());
        variation::adjoint(&input, bar[0], &mut planes_bar);
        ran.gradients.put("planes", &shape, planes_bar);
    }
    Ok(ran)
}

/// Two small planes; a map with periodic columns.
fn case_variation(case: usize) -> Case {
    let shape = [[2, 4, 5, 3], [1, 16, 32, 3]][case];
    let n = shape[0] * shape[1] * shape[2] * shape[3];
    let mut made = Case::default();
    made.inputs.put("planes", &shape, Draw::new(93, case, 0).normals(n));
    if case == 1 {
        made.settings.insert("columns".to_owned(), Setting::Text("periodic".to_owned()));
    }
    made
}
