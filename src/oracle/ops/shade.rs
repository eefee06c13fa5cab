//! Materials and light.

use super::call::{RunResult, rows};
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width};
use crate::num::array::Arrays;
use crate::shade::{envmap, ggx};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// `shade.ggx`
pub(super) static GGX: Op = Op {
    signature: &reference::shade::ggx::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [30.0, 300.0],
    check: check_ggx,
    run: run_ggx,
    predict: predict_ggx,
    cases: 1,
    case: case_ggx,
};

/// `shade.envmap`
pub(super) static ENVMAP: Op = Op {
    signature: &reference::shade::envmap::SIGNATURE,
    work_unit: "(point, texel) pairs",
    work_ns: [150.0, 1500.0],
    check: check_envmap,
    run: run_envmap,
    predict: predict_envmap,
    cases: 2,
    case: case_envmap,
    ..GGX
};

/// Checks that directions have unit length to 1e-3 and that material factors are 0 to 1; outside, K(c) has no
/// real root.
fn check_points(x: &CheckedCall<'_>, directions: &[&str]) -> Result<()> {
    let at = |name: &str, row: usize| Error::input("inputs").at(format!("array '{name}', row {row}"));
    for name in directions {
        let d = x.f64s(name);
        let square = |d: &[f64]| (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2];
        if let Some(i) = d.chunks(3).position(|d| !((square(d) - 1.0).abs() <= 2e-3)) {
            return Err(at(name, i).expected("a unit vector").got(format!("{:?}", &d[3 * i..3 * i + 3])));
        }
    }
    for (name, across) in [("albedo", 3), ("roughness", 1), ("metallic", 1)] {
        let factors = x.f64s(name);
        if let Some(i) = factors.iter().position(|f| !(0.0..=1.0).contains(f)) {
            return Err(at(name, i / across).expected("0 to 1").got(factors[i].to_string()));
        }
    }
    Ok(())
}

fn check_ggx(x: &CheckedCall<'_>) -> Result<()> {
    check_points(x, &["view", "light"])
}

fn check_envmap(x: &CheckedCall<'_>) -> Result<()> {
    check_points(x, &["view"])
}

/// Stores the gradients of the points in their arrays.
fn put_bar(ran: &mut RunResult, p: usize, bar: ggx::InBar) {
    ran.gradients.put("normal", &[p, 3], bar.normal.into_flattened());
    ran.gradients.put("albedo", &[p, 3], bar.albedo.into_flattened());
    ran.gradients.put("roughness", &[p], bar.roughness);
    ran.gradients.put("metallic", &[p], bar.metallic);
}

fn start_bar(x: &CheckedCall<'_>, p: usize) -> ggx::InBar {
    ggx::InBar {
        normal: x.start_rows("normal", p),
        albedo: x.start_rows("albedo", p),
        roughness: x.start("roughness", p),
        metallic: x.start("metallic", p),
    }
}

fn run_ggx(x: &CheckedCall<'_>) -> Result<RunResult> {
    let p = x.dim("P");
    let [normal, view, light, albedo] = ["normal", "view", "light", "albedo"].map(|name| x.rows::<3>(name));
    let (roughness, metallic) = (x.f32s("roughness"), x.f32s("metallic"));
    let input = ggx::In {
        normal: &normal,
        view: &view,
        light: &light,
        albedo: &albedo,
        roughness: &roughness,
        metallic: &metallic,
    };
    let mut brdf = vec![[0.0; 3]; p];
    ggx::forward(input, &mut brdf);
    let mut ran = RunResult::default();
    ran.outputs.put("brdf", &[p, 3], brdf.into_flattened());
    if let Some(bar) = x.bar("brdf", &[p, 3])? {
        let mut x_bar = start_bar(x, p);
        ggx::adjoint(input, &rows(&bar), &mut x_bar);
        put_bar(&mut ran, p, x_bar);
    }
    Ok(ran)
}

fn run_envmap(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (p, h, w) = (x.dim("P"), x.dim("H"), x.dim("W"));
    let [normal, view, albedo, env] = ["normal", "view", "albedo", "env"].map(|name| x.rows::<3>(name));
    let (roughness, metallic) = (x.f32s("roughness"), x.f32s("metallic"));
    let input = envmap::In {
        normal: &normal,
        view: &view,
        albedo: &albedo,
        roughness: &roughness,
        metallic: &metallic,
        env: &env,
        height: h,
        width: w,
    };
    let mut radiance = vec![[0.0; 3]; p];
    envmap::forward(input, &mut radiance);
    let mut ran = RunResult::default();
    ran.outputs.put("radiance", &[p, 3], radiance.into_flattened());
    if let Some(bar) = x.bar("radiance", &[p, 3])? {
        let mut x_bar = start_bar(x, p);
        let mut env_bar = x.start_rows::<3>("env", h * w);
        envmap::adjoint(input, &rows(&bar), &mut x_bar, &mut env_bar);
        put_bar(&mut ran, p, x_bar);
        ran.gradients.put("env", &[h, w, 3], env_bar.into_flattened());
    }
    Ok(ran)
}

/// n·d > 0, where n need not be unit.
fn faces(n: &[f64], d: &[f64]) -> bool {
    (n[0] * d[0] + n[1] * d[1]) + n[2] * d[2] > 0.0
}

/// Zeros of the points' gradients: all where `dark`, that of roughness also where α is at its bound.
fn predict(x: &CheckedCall<'_>, dark: &[bool]) -> BTreeMap<String, Vec<bool>> {
    let smooth = x.f64s("roughness").iter().map(|r| r * r < f64::from(ggx::ALPHA_MIN)).collect::<Vec<_>>();
    let three: Vec<bool> = dark.iter().flat_map(|d| [*d; 3]).collect();
    [
        ("normal".to_owned(), three.clone()),
        ("albedo".to_owned(), three),
        ("roughness".to_owned(), dark.iter().zip(&smooth).map(|(d, s)| *d || *s).collect()),
        ("metallic".to_owned(), dark.to_vec()),
    ]
    .into()
}

fn predict_ggx(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let [n, v, l] = ["normal", "view", "light"].map(|name| x.f64s(name));
    let row = |a: &[f64], i: usize| [a[3 * i], a[3 * i + 1], a[3 * i + 2]];
    let dark: Vec<bool> = (0..x.dim("P"))
        .map(|i| !(faces(&row(&n, i), &row(&v, i)) && faces(&row(&n, i), &row(&l, i))))
        .collect();
    Ok(Prediction {
        zeros: predict(x, &dark),
        nulls: [("normal".to_owned(), (3, n))].into(),
        ..Prediction::default()
    })
}

fn predict_envmap(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let [n, v] = ["normal", "view"].map(|name| x.f64s(name));
    let seen: Vec<bool> = n.chunks(3).zip(v.chunks(3)).map(|(n, v)| faces(n, v)).collect();
    let (h, w) = (x.dim("H"), x.dim("W"));
    let unlit = (0..h * w).map(|t| {
        let l = reference::shade::envmap::direction(h, w, t / w, t % w);
        !n.chunks(3).zip(&seen).any(|(n, seen)| *seen && faces(n, &l))
    });
    let unlit: Vec<bool> = unlit.flat_map(|u| [u; 3]).collect();
    let mut zeros = predict(x, &seen.iter().map(|s| !s).collect::<Vec<_>>());
    zeros.insert("env".to_owned(), unlit);
    Ok(Prediction { zeros, nulls: [("normal".to_owned(), (3, n))].into(), ..Prediction::default() })
}

/// Materials of P points; every fifth has its α at the bound.
fn materials(into: &mut Arrays, seed: u64, case: usize, p: usize) {
    into.put("albedo", &[p, 3], Draw::new(seed, case, 3).uniforms(3 * p, 0.05, 0.95));
    let mut roughness = Draw::new(seed, case, 4).uniforms(p, 0.15, 0.95);
    roughness.iter_mut().skip(2).step_by(5).for_each(|r| *r *= 0.02);
    into.put("roughness", &[p], roughness);
    into.put("metallic", &[p], Draw::new(seed, case, 5).uniforms(p, 0.05, 0.95));
}

/// Unit directions, rounded to f32.
fn directions(draw: &Draw, n: usize) -> Vec<[f32; 3]> {
    rows::<3>(&draw.normals(3 * n)).into_iter().map(|d| crate::shade::vector::unit(d).0).collect()
}

/// Normals of other lengths than 1 whose cosine with each of `against(i)` differs from 0 by more than
/// `margin`: the first `p` of a long list of candidates, with their indices in it.
fn normals(draw: &Draw, p: usize, keep: impl Fn(usize, [f32; 3]) -> bool) -> Vec<(usize, [f32; 3])> {
    let candidates = directions(draw, 64 * p).into_iter().enumerate();
    let kept: Vec<_> = candidates.filter(|(i, n)| keep(*i, *n)).take(p).collect();
    assert_eq!(kept.len(), p, "enough candidates away from the kinks");
    kept.into_iter().map(|(i, n)| (i, n.map(|x| x * (0.5 + (i % 7) as f32 * 0.25)))).collect()
}

/// Seven points in eight are visible and lit, from all sides; enough points that no single one near its
/// specular peak dominates the bias.
fn case_ggx(case: usize) -> Case {
    let p = 1001;
    let (views, lights) =
        (directions(&Draw::new(50, case, 1), 64 * p), directions(&Draw::new(50, case, 2), 64 * p));
    let cosine = |a: [f32; 3], b: [f32; 3]| (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2];
    let kept = normals(&Draw::new(50, case, 0), p, |i, n| {
        let least = crate::num::order::min(cosine(n, views[i]), cosine(n, lights[i]));
        if i % 8 == 0 { least < -0.05 } else { least > 0.05 }
    });
    let mut made = Case::default();
    let put =
        |into: &mut Arrays, name: &str, rows: Vec<[f32; 3]>| into.put(name, &[p, 3], rows.into_flattened());
    put(&mut made.inputs, "normal", kept.iter().map(|(_, n)| *n).collect());
    put(&mut made.inputs, "view", kept.iter().map(|(i, _)| views[*i]).collect());
    put(&mut made.inputs, "light", kept.iter().map(|(i, _)| lights[*i]).collect());
    materials(&mut made.inputs, 50, case, p);
    made
}

/// In case 0 the map is 4×6 and lights 9 points, in case 1 it is 5×8 and lights 70 (more than a block of
/// them).
fn case_envmap(case: usize) -> Case {
    let [p, h, w] = [[9, 4, 6], [70, 5, 8]][case];
    let views = directions(&Draw::new(51, case, 1), 64 * p);
    let cosine = |a: [f32; 3], b: [f32; 3]| (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2];
    let texels: Vec<[f32; 3]> =
        (0..h * w).map(|t| crate::shade::environment::texel_center(w, h, t / w, t % w)).collect();
    let kept = normals(&Draw::new(51, case, 0), p, |i, n| {
        let seen = cosine(n, views[i]);
        let clear = texels.iter().all(|l| cosine(n, *l).abs() > 0.01);
        clear && if i % 8 == 0 { seen < -0.1 } else { seen > 0.1 }
    });
    let mut made = Case::default();
    let put =
        |into: &mut Arrays, name: &str, rows: Vec<[f32; 3]>| into.put(name, &[p, 3], rows.into_flattened());
    put(&mut made.inputs, "normal", kept.iter().map(|(_, n)| *n).collect());
    put(&mut made.inputs, "view", kept.iter().map(|(i, _)| views[*i]).collect());
    materials(&mut made.inputs, 51, case, p);
    made.inputs.put("env", &[h, w, 3], Draw::new(51, case, 6).uniforms(3 * h * w, 0.1, 3.0));
    made
}
