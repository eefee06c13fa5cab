//! Bodies in the rest pose.

use super::call::{RunResult, rows};
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::body::pose::Affine;
use crate::body::rest::{self, In, InBar, Out};
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// `body.rest`
pub(super) static REST: Op =
    Op { check, predict: unread, cases: 3, ..Op::new(&reference::body::rest::SIGNATURE, run, case) };

struct Arguments {
    points: Vec<[f32; 3]>,
    factors: Vec<[f32; 9]>,
    weights: Vec<f32>,
    canonical: Option<Vec<Affine>>,
    offsets: Option<Vec<[f32; 3]>>,
}

impl Arguments {
    fn of(x: &CheckedCall<'_>) -> Self {
        let canonical = || x.f32s("canonical").as_chunks().0.as_chunks().0.to_vec();
        Self {
            points: x.rows("points"),
            factors: x.rows("factors"),
            weights: x.f32s("weights"),
            canonical: x.has("canonical").then(canonical),
            offsets: x.has("offsets").then(|| x.rows("offsets")),
        }
    }

    fn input(&self) -> In<'_> {
        In {
            points: &self.points,
            factors: &self.factors,
            weights: &self.weights,
            canonical: self.canonical.as_deref(),
            offsets: self.offsets.as_deref(),
        }
    }
}

fn check(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("K") == 0 {
        return Err(Error::input("array 'weights'").expected("at least one joint").got("none"));
    }
    Arguments::of(x).input().check()
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let given = Arguments::of(x);
    let (input, p) = (given.input(), given.points.len());
    let (out, saved) = rest::forward(&input);
    let mut ran = RunResult::default();
    ran.outputs.put("rest_points", &[p, 3], out.points.into_flattened());
    ran.outputs.put("rest_factors", &[p, 3, 3], out.factors.into_flattened());
    if x.lend() {
        let points_bar = x.bar("rest_points", &[p, 3])?.unwrap_or_else(|| vec![0.0; 3 * p]);
        let factors_bar = x.bar("rest_factors", &[p, 3, 3])?.unwrap_or_else(|| vec![0.0; 9 * p]);
        let out_bar = Out { points: rows(&points_bar), factors: rows(&factors_bar) };
        let mut x_bar = InBar {
            points: x.start_rows("points", p),
            factors: x.start_rows("factors", p),
            weights: x.start("weights", given.weights.len()),
        };
        rest::adjoint(&input, &saved, &out_bar, &mut x_bar);
        ran.gradients.put("points", &[p, 3], x_bar.points.into_flattened());
        ran.gradients.put("factors", &[p, 3, 3], x_bar.factors.into_flattened());
        ran.gradients.put("weights", &x.shape("weights"), x_bar.weights);
    }
    Ok(ran)
}

/// Without `canonical`, the weights are not read.
fn unread(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let unread = (!x.has("canonical")).then(|| "weights".to_owned());
    Ok(Prediction { unread: unread.into_iter().collect(), ..Prediction::default() })
}

/// Case 0: nearly rigid bones with offsets, more points than one block; case 1: the rest pose is canonical,
/// so the operator copies; case 2: bones without offsets.
fn case(case: usize) -> Case {
    let [p, k] = [[280, 3], [9, 2], [7, 4]][case];
    let draw = |array| Draw::new(71, case, array);
    let mut weights = draw(0).uniforms(p * k, 0.05, 1.0);
    for row in weights.chunks_exact_mut(k) {
        let sum = row.iter().fold(0.0, |sum, w| sum + w);
        row.iter_mut().for_each(|w| *w /= sum);
    }
    let noise = draw(3).normals(12 * k);
    let unit = |i: usize| f32::from(u8::from(matches!(i % 12, 0 | 5 | 10)));
    let bones = (0..12 * k).map(|i| unit(i) + 0.15 * noise[i]).collect();
    let mut made = Case::default();
    made.inputs.put("points", &[p, 3], draw(1).normals(3 * p));
    made.inputs.put("factors", &[p, 3, 3], draw(2).normals(9 * p));
    made.inputs.put("weights", &[p, k], weights);
    if case != 1 {
        made.inputs.put("canonical", &[k, 3, 4], bones);
    }
    if case == 0 {
        made.inputs.put("offsets", &[p, 3], draw(4).normals(3 * p));
    }
    made
}
