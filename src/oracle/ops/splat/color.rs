//! `splat.color`

use super::{check_sizes, flatten, scene::Scene, sh_degree};
use crate::num::array::Arrays;
use crate::ops::call::{RunResult, rows};
use crate::ops::op::{Case, CheckedCall, Op, Width};
use crate::scene::camera::{Camera, Model};
use crate::splat::color::{self, Sh};
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// `splat.color`
pub(in crate::ops) static OP: Op = Op {
    signature: &reference::splat::color::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [50.0, 1000.0],
    check,
    run,
    predict,
    cases: 2,
    case,
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_sizes(x)?;
    sh_degree(x).map(|_| ())
}

/// Camera centres; the other camera parameters are not used.
fn centers(x: &CheckedCall<'_>) -> Vec<[f32; 3]> {
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let views = x.f32s("view_from_world");
    views.chunks_exact(16).map(|v| Camera::from_matrices(v, &unit, 1, 1, Model::Pinhole).center()).collect()
}

/// The rows of `color_mask` in a plan.
pub(super) fn mask_rows(plan: &Arrays, cameras: usize, n: usize) -> Result<Vec<[u8; 3]>> {
    let array = plan.need("color_mask").map_err(|e| e.within("plan"))?;
    let values = array.to_i64().unwrap_or_default();
    if array.shape() != [cameras, n, 3] || !values.iter().all(|m| *m == 0 || *m == 1) {
        return Err(Error::input("plan: array 'color_mask'")
            .expected(format!("zeros and ones of shape [{cameras}, {n}, 3]"))
            .got(format!("shape {:?}", array.shape())));
    }
    Ok(values.chunks_exact(3).map(|m| [m[0] as u8, m[1] as u8, m[2] as u8]).collect())
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let n = x.dim("N");
    let (means, values) = (x.rows::<3>("means"), x.f32s("sh"));
    let sh = Sh { values: &values, coefficients: x.dim("K"), degree: sh_degree(x)? };
    let centers = centers(x);
    let c = centers.len();
    let frozen = x.call.plan.as_ref().map(|plan| mask_rows(plan, c, n)).transpose()?;
    let (mut colors, mut mask) = (vec![[0.0; 3]; c * n], vec![[0; 3]; c * n]);
    for (i, center) in centers.iter().enumerate() {
        let span = i * n..(i + 1) * n;
        let given = frozen.as_ref().map(|m| &m[span.clone()]);
        color::forward(&means, sh, *center, given, &mut colors[span.clone()], &mut mask[span]);
    }
    let mut ran = RunResult::default();
    ran.outputs.put("colors", &[c, n, 3], flatten(&colors));
    ran.plan.put("color_mask", &[c, n, 3], mask.iter().flatten().copied().collect());
    if let Some(bar) = x.bar("colors", &[c, n, 3])? {
        let bar: Vec<[f32; 3]> = rows(&bar);
        let (mut means_bar, mut sh_bar) = (x.start_rows::<3>("means", n), x.start("sh", values.len()));
        for (i, center) in centers.iter().enumerate() {
            let span = i * n..(i + 1) * n;
            color::adjoint(&means, sh, *center, &mask[span.clone()], &bar[span], &mut means_bar, &mut sh_bar);
        }
        ran.gradients.put("means", &[n, 3], flatten(&means_bar));
        ran.gradients.put("sh", &x.shape("sh"), sh_bar);
    }
    Ok(ran)
}

/// Bands above the degree, and channels clamped at 0 in every camera.
fn predict(x: &CheckedCall<'_>, ran: &RunResult) -> Result<Prediction> {
    let mask = mask_rows(&ran.plan, x.dim("C"), x.dim("N"))?;
    let seen = |i: usize, channel: usize| (0..x.dim("C")).any(|c| mask[c * x.dim("N") + i][channel] == 1);
    let mut known = Prediction::default();
    known.zeros.insert("sh".to_owned(), sh_zeros(x, sh_degree(x)?, seen));
    let flat = sh_degree(x)? == 0;
    let means = (0..3 * x.dim("N")).map(|e| flat || !(0..3).any(|channel| seen(e / 3, channel))).collect();
    known.zeros.insert("means".to_owned(), means);
    Ok(known)
}

/// Mask (N, K, 3) of coefficients without gradient: bands above `degree`, and channels clamped in every
/// camera.
pub(super) fn sh_zeros(x: &CheckedCall<'_>, degree: usize, seen: impl Fn(usize, usize) -> bool) -> Vec<bool> {
    let (n, k) = (x.dim("N"), x.dim("K"));
    let used = (degree + 1) * (degree + 1);
    (0..n * k * 3).map(|e| e / 3 % k >= used || !seen(e / (3 * k), e % 3)).collect()
}

/// Case 0: degree 3 of 16 coefficients; case 1: degree 1 of 9, so that there are bands above the degree.
fn case(case: usize) -> Case {
    let scene = Scene::new(42, case, [13, 9][case]);
    let mut made = Case::default();
    scene.put(&mut made.inputs, &["means", "view_from_world"]);
    scene.put_sh(&mut made.inputs, [16, 9][case], [3, 1][case]);
    made
}
