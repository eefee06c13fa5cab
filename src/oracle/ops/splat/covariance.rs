//! `splat.covariance`

use super::{check_common, flatten};
use crate::Result;
use crate::ops::call::{RunResult, rows};
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op, Width};
use crate::splat::covariance;
use crate::tape::check::Prediction;

/// `splat.covariance`
pub(in crate::ops) static OP: Op = Op {
    signature: &reference::splat::covariance::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [50.0, 500.0],
    check: check_common,
    run,
    predict,
    cases: 1,
    case,
};

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let n = x.dim("N");
    let (quats, scales) = (x.rows::<4>("quats"), x.rows::<3>("scales"));
    let mut factors = vec![[0.0; 9]; n];
    covariance::forward(&quats, &scales, &mut factors);
    let mut ran = RunResult::default();
    ran.outputs.put("factors", &[n, 3, 3], flatten(&factors));
    if let Some(bar) = x.bar("factors", &[n, 3, 3])? {
        let (mut quats_bar, mut scales_bar) = (x.start_rows::<4>("quats", n), x.start_rows::<3>("scales", n));
        covariance::adjoint(&quats, &scales, &rows(&bar), &mut quats_bar, &mut scales_bar);
        ran.gradients.put("quats", &[n, 4], flatten(&quats_bar));
        ran.gradients.put("scales", &[n, 3], flatten(&scales_bar));
    }
    Ok(ran)
}

/// ⟨q, q̄⟩ = 0.
fn predict(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(Prediction { nulls: [("quats".to_owned(), (4, x.f64s("quats")))].into(), ..Prediction::default() })
}

fn case(case: usize) -> Case {
    let n = 19;
    let mut made = Case::default();
    made.inputs.put("quats", &[n, 4], Draw::new(41, case, 0).normals(4 * n));
    made.inputs.put("scales", &[n, 3], Draw::new(41, case, 1).uniforms(3 * n, 0.02, 1.5));
    made
}
