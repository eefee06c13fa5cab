//! The loss between two sets of points.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width};
use crate::loss::points::{self, In, Plan, Sigmas};
use crate::num::array::Arrays;
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `loss.points`
pub(super) static POINTS: Op = Op {
    signature: &reference::loss::points::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "pairs of points",
    work_ns: [10.0, 100.0],
    check,
    run,
    predict: colours_without_target,
    cases: 5,
    case,
};

fn input<'a>(x: &CheckedCall<'_>, a: &'a [f32], b: &'a [f32]) -> In<'a> {
    let default = Sigmas::default();
    let sigmas = Sigmas {
        xyz: x.number("sigma_x").unwrap_or(default.xyz),
        rgb: x.number("sigma_c").unwrap_or(default.rgb),
    };
    In { x: a, y: b, batch: x.dim("B"), channels: [x.dim("D"), x.dim("E")], sigmas }
}

fn is_chamfer(x: &CheckedCall<'_>) -> bool {
    x.word("mode") == Some("chamfer")
}

fn check(x: &CheckedCall<'_>) -> Result<()> {
    let (a, b) = (x.f32s("x"), x.f32s("y"));
    let [p, q] = input(x, &a, &b).check()?;
    if is_chamfer(x) || p == q {
        return Ok(());
    }
    Err(Error::input("array 'y'")
        .expected(format!("{p} points, as many as in x"))
        .got(q.to_string())
        .hint("for points without a common order use --set mode=chamfer"))
}

fn plan_of(arrays: &Arrays, batch: usize, p: usize, q: usize) -> Result<Plan> {
    let rows = |name: &str, n: usize| {
        let array = arrays.need(name).map_err(|e| e.within("plan"))?;
        let what = || Error::input(format!("plan: array '{name}'"));
        if array.shape() != [batch, n] {
            return Err(what()
                .expected(format!("shape [{batch}, {n}]"))
                .got(format!("shape {:?}", array.shape())));
        }
        let whole = array.to_i64().ok_or_else(|| what().expected("whole numbers"))?;
        let narrow = |k: i64| i32::try_from(k).map_err(|_| what().expected("an index").got(k.to_string()));
        whole.into_iter().map(narrow).collect::<Result<Vec<i32>>>()
    };
    Ok(Plan { nearest_x: rows("nearest_x", p)?, nearest_y: rows("nearest_y", q)? })
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (a, b) = (x.f32s("x"), x.f32s("y"));
    let (points, [p, q]) = (input(x, &a, &b), [x.dim("P"), x.dim("Q")]);
    let plan = match (is_chamfer(x), x.call.plan.as_ref()) {
        (false, _) => None,
        (true, Some(given)) => Some(plan_of(given, points.batch, p, q)?),
        (true, None) => Some(points::plan(&points)?),
    };
    let value = match &plan {
        None => points::ordered(&points)?,
        Some(plan) => points::chamfer(&points, plan)?,
    };
    let mut ran =
        RunResult { outputs: Arrays::new().with("value", &[], vec![value]), ..RunResult::default() };
    if let Some(bar) = x.bar("value", &[])? {
        let (mut x_bar, mut y_bar) = (x.start("x", a.len()), x.start("y", b.len()));
        points::adjoint(&points, plan.as_ref(), bar[0], &mut x_bar, Some(&mut y_bar))?;
        ran.gradients.put("x", &x.shape("x"), x_bar);
        ran.gradients.put("y", &x.shape("y"), y_bar);
    }
    if let Some(plan) = plan {
        ran.plan.put("nearest_x", &[points.batch, p], plan.nearest_x);
        ran.plan.put("nearest_y", &[points.batch, q], plan.nearest_y);
    }
    Ok(ran)
}

/// Colours without a target colour have no gradient.
fn colours_without_target(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let [d, e] = [x.dim("D"), x.dim("E")];
    let zeros = (0..x.f32s("x").len()).map(|i| i % d >= e).collect();
    Ok(Prediction { zeros: [("x".to_owned(), zeros)].into(), ..Prediction::default() })
}

/// Mode ordered with colours, without colours, and with colours only in x; mode chamfer between sets of
/// different sizes, and with targets without colours.
fn case(case: usize) -> Case {
    let [b, p, q, d, e] =
        [[2, 9, 9, 6, 6], [3, 5, 5, 3, 3], [2, 7, 7, 6, 3], [2, 8, 11, 6, 6], [1, 10, 6, 6, 3]][case];
    let mut made = Case::default();
    made.inputs.put("x", &[b, p, d], Draw::new(21, case, 0).normals(b * p * d));
    made.inputs.put("y", &[b, q, e], Draw::new(21, case, 1).normals(b * q * e));
    if case == 1 {
        made.settings.insert("sigma_x".to_owned(), Setting::Number(0.5));
    }
    if case >= 3 {
        made.settings.insert("mode".to_owned(), Setting::Text("chamfer".to_owned()));
    }
    made
}
