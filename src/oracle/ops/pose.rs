//! Transforms of joints.

use super::call::{RunResult, rows};
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width, no_zeros};
use crate::Result;
use crate::body::pose;

/// `body.pose`
pub(super) static POSE: Op = Op {
    signature: &reference::body::pose::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [100.0, 2000.0],
    check: check_pose,
    run: run_pose,
    predict: no_zeros,
    cases: 3,
    case: case_pose,
};

struct Arrays {
    pose: Vec<[f32; 3]>,
    captured: Vec<pose::Affine>,
    correction: Option<Vec<[f32; 3]>>,
    joints: Vec<[f32; 3]>,
    parents: Vec<i32>,
}

impl Arrays {
    fn of(x: &CheckedCall<'_>) -> Self {
        Self {
            pose: x.rows("pose"),
            captured: x.f32s("captured").as_chunks().0.as_chunks().0.to_vec(),
            correction: x.has("correction").then(|| x.rows("correction")),
            joints: x.rows("joints"),
            parents: x.f64s("parents").into_iter().map(|p| p as i32).collect(),
        }
    }

    fn input(&self) -> pose::In<'_> {
        pose::In {
            pose: &self.pose,
            captured: &self.captured,
            correction: self.correction.as_deref(),
            joints: &self.joints,
            parents: &self.parents,
        }
    }
}

fn check_pose(x: &CheckedCall<'_>) -> Result<()> {
    Arrays::of(x).input().check()
}

fn run_pose(x: &CheckedCall<'_>) -> Result<RunResult> {
    let arrays = Arrays::of(x);
    let (input, n) = (arrays.input(), x.dim("J"));
    let (transforms, saved) = pose::forward(input)?;
    let mut ran = RunResult::default();
    ran.outputs.put("transforms", &[n, 3, 4], transforms.as_flattened().as_flattened().to_vec());
    if let Some(bar) = x.bar("transforms", &[n, 3, 4])? {
        let rows: Vec<[f32; 4]> = rows(&bar);
        let mut x_bar = pose::InBar {
            pose: if x.has("pose") { x.start_rows("pose", n) } else { Vec::new() },
            correction: if x.has("correction") { x.start_rows("correction", n) } else { Vec::new() },
            joints: x.start_rows("joints", n),
        };
        pose::adjoint(input, &saved, rows.as_chunks().0, &mut x_bar);
        if x.has("pose") {
            ran.gradients.put("pose", &[n, 3], x_bar.pose.as_flattened().to_vec());
        }
        ran.gradients.put("joints", &[n, 3], x_bar.joints.as_flattened().to_vec());
        if x.has("correction") {
            ran.gradients.put("correction", &[n, 3], x_bar.correction.as_flattened().to_vec());
        }
    }
    Ok(ran)
}

/// A branching skeleton with small and large angles; case 1 has two roots and no correction; case 2 has
/// transforms of a capture with corrections.
fn case_pose(case: usize) -> Case {
    let parents: &[i32] = [&[-1, 0, 1, 1, 3, 0, 5][..], &[-1, 0, -1, 2], &[-1, 0, 0, -1, 2]][case];
    let n = parents.len();
    let draw = |array| Draw::new(70, case, array);
    let mut pose = draw(0).normals(3 * n);
    // below and near the threshold of the series
    pose[3..6].iter_mut().for_each(|x| *x *= 2e-5);
    pose[6..9].iter_mut().for_each(|x| *x *= 1e-3);
    let mut made = Case::default();
    if case == 2 {
        let noise = draw(3).normals(12 * n);
        let unit = |i: usize| f32::from(u8::from(matches!(i % 12, 0 | 5 | 10)));
        made.inputs.put("captured", &[n, 3, 4], (0..12 * n).map(|i| unit(i) + 0.2 * noise[i]).collect());
    } else {
        made.inputs.put("pose", &[n, 3], pose);
    }
    if case != 1 {
        let mut correction: Vec<f32> = draw(1).normals(3 * n).iter().map(|x| 0.1 * x).collect();
        correction[9..12].iter_mut().for_each(|x| *x *= 1e-4);
        made.inputs.put("correction", &[n, 3], correction);
    }
    made.inputs.put("joints", &[n, 3], draw(2).normals(3 * n));
    made.inputs.put("parents", &[n], parents.to_vec());
    made
}
