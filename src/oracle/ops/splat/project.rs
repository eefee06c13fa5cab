//! `splat.project`

use super::scene::Scene;
use super::{cameras, check_common, check_shape, check_sizes, flatten, plan, profile};
use crate::num::array::Arrays;

use crate::num::array::entries;
use crate::ops::call::{RunResult, rows};
use crate::ops::op::{Case, CheckedCall, Op, Width};
use crate::scene::camera::Camera;
use crate::scene::profile::Profile;
use crate::splat::covariance;
use crate::splat::project::{self, Lens, Row, RowBar};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `splat.project`
pub(in crate::ops) static OP: Op = Op {
    signature: &reference::splat::project::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [100.0, 3000.0],
    check,
    run,
    predict,
    cases: 4,
    case,
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_sizes(x)?;
    check_shape(x)?;
    check_common(x)?;
    cameras(x)?;
    if profile(x)?.antialiased && !x.has("opacities") {
        return Err(Error::input("array 'opacities'").expected("to be present in antialiased mode"));
    }
    Ok(())
}

/// The given factors, or those of quats and scales.
pub(super) fn factors(x: &CheckedCall<'_>) -> Vec<[f32; 9]> {
    if x.has("factors") {
        return x.rows("factors");
    }
    let mut factors = vec![[0.0; 9]; x.dim("N")];
    covariance::forward(&x.rows("quats"), &x.rows("scales"), &mut factors);
    factors
}

/// Arrays (C, N, …) of projected rows, under their public names.
pub(super) fn put_rows(rows: &[Row], n: usize, profile: &Profile, of: &[Camera], into: &mut Arrays) {
    let cameras = of.len();
    let pick = |f: &dyn Fn(&Row) -> Vec<f32>| rows.iter().flat_map(f).collect::<Vec<f32>>();
    into.put("means_px", &[cameras, n, 2], pick(&|r| r.mean_px.to_vec()));
    into.put("depths_z", &[cameras, n], pick(&|r| vec![r.z]));
    into.put("conics", &[cameras, n, 3], pick(&|r| conic(r).to_vec()));
    into.put("shape", &[cameras, n, 3], pick(&|r| r.shape.to_vec()));
    into.put("radii_px", &[cameras, n, 2], rows.iter().flat_map(|r| r.radii).collect::<Vec<i32>>());
    into.put("axis", &[cameras, n], rows.iter().map(|r| r.axis).collect::<Vec<u8>>());
    if profile.antialiased {
        into.put("compensation", &[cameras, n], pick(&|r| vec![r.compensation]));
    }
}

/// xx, xy, yy of Σ'⁻¹ = k1² p·pᵀ + k2² w·wᵀ with w = q − s·p.
fn conic(row: &Row) -> [f32; 3] {
    let [s, k1, k2] = row.shape;
    let (q2, sq) = (k2 * k2, s * k2);
    let (pp, pq) = (k1 * k1 + sq * sq, -(s * q2));
    if row.axis == 0 { [pp, pq, q2] } else { [q2, pq, pp] }
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (n, profile, cameras) = (x.dim("N"), profile(x)?, cameras(x)?);
    let c = cameras.len();
    let (means, factors) = (x.rows::<3>("means"), factors(x));
    let opacities = if x.has("opacities") { x.f32s("opacities") } else { vec![1.0; n] };
    let frozen = x.call.plan.as_ref().map(|p| plan::decisions(p, c, n)).transpose()?;
    let lenses: Vec<Lens> = cameras.iter().map(|camera| Lens::new(camera, &profile)).collect();
    let gaussians = |lens| project::In {
        means: &means,
        factors: &factors,
        opacities: &opacities,
        lens,
        profile: &profile,
    };
    let mut made = vec![Row::default(); c * n];
    for (i, lens) in lenses.iter().enumerate() {
        let span = i * n..(i + 1) * n;
        let given = frozen.as_ref().map(|d| &d[span.clone()]);
        project::forward(&gaussians(lens), given, &mut made[span]);
    }
    super::check_range(&made, n)?;
    let mut ran = RunResult::default();
    put_rows(&made, n, &profile, &cameras, &mut ran.outputs);
    plan::put_rows(&made, c, n, &mut ran.plan);
    match &x.call.plan {
        Some(given) => plan::keep(given, &["order", "camera_start"], &mut ran.plan)?,
        None => plan::put_order(&made, c, n, &mut ran.plan),
    }
    if x.lend() {
        let bars = bars(x, c, n)?;
        let mut means_bar = x.start_rows::<3>("means", n);
        let mut factors_bar = vec![[0.0; 9]; n];
        for (i, lens) in lenses.iter().enumerate() {
            let span = i * n..(i + 1) * n;
            let (rows, bars) = (&made[span.clone()], &bars[span]);
            let x_bar = project::InBar { means: &mut means_bar, factors: &mut factors_bar };
            project::adjoint(&gaussians(lens), rows, bars, x_bar);
        }
        ran.gradients.put("means", &[n, 3], flatten(&means_bar));
        put_shape_bars(x, &factors_bar, &mut ran.gradients);
    }
    Ok(ran)
}

/// Adds F̄ to the gradients of the call: of factors, or of quats and scales.
fn put_shape_bars(x: &CheckedCall<'_>, factors_bar: &[[f32; 9]], gradients: &mut Arrays) {
    let n = x.dim("N");
    if x.has("factors") {
        let mut bar = x.start("factors", 9 * n);
        for (sum, g) in bar.iter_mut().zip(factors_bar.iter().flatten()) {
            *sum += *g;
        }
        gradients.put("factors", &[n, 3, 3], bar);
        return;
    }
    let (mut quats_bar, mut scales_bar) = (x.start_rows::<4>("quats", n), x.start_rows::<3>("scales", n));
    covariance::adjoint(&x.rows("quats"), &x.rows("scales"), factors_bar, &mut quats_bar, &mut scales_bar);
    gradients.put("quats", &[n, 4], flatten(&quats_bar));
    gradients.put("scales", &[n, 3], flatten(&scales_bar));
}

fn bars(x: &CheckedCall<'_>, c: usize, n: usize) -> Result<Vec<RowBar>> {
    let of = |name: &str, shape: &[usize]| {
        Ok::<_, Error>(x.bar(name, shape)?.unwrap_or_else(|| vec![0.0; entries(shape)]))
    };
    let mean_px: Vec<[f32; 2]> = rows(&of("means_px", &[c, n, 2])?);
    let shape: Vec<[f32; 3]> = rows(&of("shape", &[c, n, 3])?);
    let z = of("depths_z", &[c, n])?;
    let compensation = of("compensation", &[c, n])?;
    let bar =
        |i: usize| RowBar { mean_px: mean_px[i], z: z[i], shape: shape[i], compensation: compensation[i] };
    Ok((0..c * n).map(bar).collect())
}

/// Gaussians that are visible in no camera; ⟨q, q̄⟩ = 0.
fn predict(x: &CheckedCall<'_>, ran: &RunResult) -> Result<Prediction> {
    let n = x.dim("N");
    let k1: Vec<f64> = ran.outputs.need("shape")?.to_f64();
    let seen: Vec<bool> = (0..n).map(|i| (0..x.dim("C")).any(|c| k1[3 * (c * n + i) + 1] != 0.0)).collect();
    Ok(plan::row_prediction(x, &["means", "quats", "scales", "factors"], |i| !seen[i]))
}

/// 0: pinhole, quats and scales, active limits of the tangents; 1: factors, orthographic; 2: fisheye; 3:
/// antialiased.
fn case(case: usize) -> Case {
    let mut scene = Scene::new(43, case, 9);
    let mut made = Case::default();
    let mut names = vec!["means", "view_from_world", "intrinsics", "width", "height"];
    names.extend(if case == 1 { &["factors"][..] } else { &["quats", "scales"] });
    let word = |text: &str| Setting::Text(text.to_owned());
    match case {
        0 => {
            scene.focal = [91.0, 67.0]; // a narrow view: several centres lie outside the tangent limits
            names.push("near");
        }
        1 => {
            scene.focal = [14.0, 11.0];
            made.settings.insert("camera".to_owned(), word("orthographic"));
        }
        2 => {
            made.settings.insert("camera".to_owned(), word("fisheye"));
        }
        _ => {
            scene.scale = [0.01, 0.06];
            names.push("opacities");
            made.settings.insert("antialiased".to_owned(), Setting::Number(1.0));
            made.settings.insert("profile".to_owned(), word("inria"));
        }
    }
    scene.put(&mut made.inputs, &names);
    made
}
