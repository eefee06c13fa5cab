//! The distance between the factors of two images.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width, no_zeros};
use crate::loss::latent::{self, Half};
use crate::{Error, Result};

/// `loss.latent`
pub(super) static LATENT: Op = Op {
    signature: &reference::loss::latent::SIGNATURE,
    adjoint: true,
    width: Width::F64,
    work_unit: "entries",
    work_ns: [50.0, 500.0],
    check,
    run,
    predict: no_zeros,
    cases: 2,
    case,
};

const NOISE: [&str; 3] = ["noise", "noise_real", "noise_spread"];

fn check(x: &CheckedCall<'_>) -> Result<()> {
    let given = NOISE.map(|name| x.has(name));
    if given != [given[0]; 3] {
        return Err(Error::input("array 'noise'").expected(format!("all of {} or none", NOISE.join(", "))));
    }
    if x.dim("D") == 0 {
        return Err(Error::input("array 'factors'").expected("at least one number").got("none"));
    }
    x.rule("factors_spread", "above 0", |s| s > 0.0)?;
    x.rule("noise_spread", "above 0", |s| s > 0.0)
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let factors = ["factors", "factors_real", "factors_spread"].map(|name| x.f64s(name));
    let noise = NOISE.map(|name| x.f64s(name));
    fn half([x, real, spread]: &[Vec<f64>; 3]) -> Half<'_> {
        Half { x, real, spread }
    }
    let halves = [half(&factors), half(&noise)];
    let halves = if x.has("noise") { &halves[..] } else { &halves[..1] };
    let mut ran = RunResult::default();
    ran.outputs.put("value", &[], vec![latent::forward(halves)]);
    if let Some(bar) = x.bar_f64("value", &[])? {
        for (which, name) in ["factors", "noise"].into_iter().enumerate().take(halves.len()) {
            let mut x_bar = x.start_f64(name, x.dim("D"));
            latent::adjoint(halves, which, bar[0], &mut x_bar);
            ran.gradients.put(name, &[x.dim("D")], x_bar);
        }
    }
    Ok(ran)
}

/// Case 0: both terms; case 1: the first only.
fn case(case: usize) -> Case {
    let d = [16, 5][case];
    let draw = |array| Draw::new(24, case, array);
    let mut made = Case::default();
    for (at, name) in ["factors", "noise"].into_iter().enumerate().take(2 - case) {
        let at = 3 * at as u16;
        made.inputs.put(name, &[d], draw(at).normals(d));
        made.inputs.put(&format!("{name}_real"), &[d], draw(at + 1).normals(d));
        made.inputs.put(&format!("{name}_spread"), &[d], draw(at + 2).uniforms(d, 0.25, 1.5));
    }
    made
}
