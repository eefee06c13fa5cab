//! `splat.activate`

use super::flatten;
use crate::Result;
use crate::ops::call::{RunResult, rows};
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op, Width, no_zeros};
use crate::splat::activate;

/// `splat.activate`
pub(in crate::ops) static OP: Op = Op {
    signature: &reference::splat::activate::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [50.0, 200.0],
    check,
    run,
    predict: no_zeros,
    cases: 1,
    case,
};

/// Checks that exp neither overflows nor underflows.
fn check(x: &CheckedCall<'_>) -> Result<()> {
    x.rule("scales_log", "−80 to 80", |s| (-80.0..=80.0).contains(&s))
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let n = x.dim("N");
    let (logs, logits) = (x.rows::<3>("scales_log"), x.f32s("opacity_logits"));
    let (mut scales, mut opacities) = (vec![[0.0; 3]; n], vec![0.0; n]);
    activate::forward(&logs, &logits, &mut scales, &mut opacities);
    let mut ran = RunResult::default();
    if x.lend() {
        let scales_bar = rows(&x.bar("scales", &[n, 3])?.unwrap_or_else(|| vec![0.0; 3 * n]));
        let opacities_bar = x.bar("opacities", &[n])?.unwrap_or_else(|| vec![0.0; n]);
        let (mut logs_bar, mut logits_bar) =
            (x.start_rows::<3>("scales_log", n), x.start("opacity_logits", n));
        activate::adjoint(&scales, &opacities, &scales_bar, &opacities_bar, &mut logs_bar, &mut logits_bar);
        ran.gradients.put("scales_log", &[n, 3], flatten(&logs_bar));
        ran.gradients.put("opacity_logits", &[n], logits_bar);
    }
    ran.outputs.put("scales", &[n, 3], flatten(&scales));
    ran.outputs.put("opacities", &[n], opacities);
    Ok(ran)
}

fn case(case: usize) -> Case {
    let n = 21;
    let mut made = Case::default();
    made.inputs.put("scales_log", &[n, 3], Draw::new(40, case, 0).uniforms(3 * n, -6.0, 1.0));
    made.inputs.put("opacity_logits", &[n], Draw::new(40, case, 1).uniforms(n, -6.0, 6.0));
    made
}
