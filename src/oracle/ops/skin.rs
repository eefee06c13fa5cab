//! Linear blend skinning.

use super::call::{RunResult, rows};
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width};
use crate::body::skin::{self, In, InBar, Out};
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// `body.skin`
pub(super) static SKIN: Op = Op {
    signature: &reference::body::skin::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [10.0, 100.0],
    check,
    run,
    predict: last_rows,
    cases: 2,
    case,
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("K") > 0 {
        return Ok(());
    }
    Err(Error::input("array 'transforms'").expected("at least one bone").got("none"))
}

fn flat<const K: usize>(rows: &[[f32; K]]) -> Vec<f32> {
    rows.as_flattened().to_vec()
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (p, k) = (x.dim("P"), x.dim("K"));
    let (points, weights, transforms) =
        (x.rows::<3>("points"), x.f32s("weights"), x.rows::<16>("transforms"));
    let factors = x.rows::<9>("factors");
    let input = In { points: &points, weights: &weights, transforms: &transforms, factors: &factors };
    let out = skin::forward(input);
    let mut ran = RunResult::default();
    ran.outputs.put("skinned", &[p, 3], flat(&out.skinned));
    if x.has("factors") {
        ran.outputs.put("skinned_factors", &[p, 3, 3], flat(&out.skinned_factors));
    }
    if x.lend() {
        let skinned = x.bar("skinned", &[p, 3])?.unwrap_or_else(|| vec![0.0; 3 * p]);
        let factors_bar = x.bar("skinned_factors", &[factors.len(), 3, 3])?.unwrap_or_default();
        let out_bar = Out { skinned: rows(&skinned), skinned_factors: rows(&factors_bar) };
        let mut bar = InBar {
            points: x.start_rows("points", p),
            weights: x.start("weights", p * k),
            transforms: x.start_rows("transforms", k),
            factors: x.start_rows("factors", factors.len()),
        };
        skin::adjoint(input, &out_bar, &mut bar);
        ran.gradients.put("points", &[p, 3], flat(&bar.points));
        ran.gradients.put("weights", &[p, k], bar.weights);
        ran.gradients.put("transforms", &[k, 4, 4], flat(&bar.transforms));
        if x.has("factors") {
            ran.gradients.put("factors", &[p, 3, 3], flat(&bar.factors));
        }
    }
    Ok(ran)
}

fn last_rows(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let last = (0..16 * x.dim("K")).map(|i| i % 16 >= 12).collect();
    Ok(Prediction { zeros: [("transforms".to_owned(), last)].into(), ..Prediction::default() })
}

/// Case 0: five bones, factors, more points than one block; case 1: three bones, no factors, each point
/// attached to two bones.
fn case(case: usize) -> Case {
    let [p, k] = [[300, 5], [19, 3]][case];
    let draw = |array| Draw::new(70, case, array);
    let mut weights = draw(0).uniforms(p * k, 0.05, 1.0);
    for (i, row) in weights.chunks_exact_mut(k).enumerate() {
        if case == 1 {
            row[i % k] = 0.0;
        }
        let sum = row.iter().fold(0.0, |sum, w| sum + w);
        row.iter_mut().for_each(|w| *w /= sum);
    }
    // nearly rigid: identity matrices with noise, and a translation
    let noise = draw(1).normals(16 * k);
    let transforms = (0..16 * k)
        .map(|i| match i % 16 {
            0 | 5 | 10 => 1.0 + 0.3 * noise[i],
            12..15 => 0.0,
            15 => 1.0,
            _ => 0.3 * noise[i],
        })
        .collect();
    let mut made = Case::default();
    made.inputs.put("points", &[p, 3], draw(2).normals(3 * p));
    made.inputs.put("weights", &[p, k], weights);
    made.inputs.put("transforms", &[k, 4, 4], transforms);
    if case == 0 {
        made.inputs.put("factors", &[p, 3, 3], draw(3).normals(9 * p));
    }
    made
}
