//! Densities and compositing along rays.

use super::check_sizes;
use crate::field::normal::{self, Stencil};
use crate::field::{composite, density, interval};
use crate::ops::call::{RunResult, rows};
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::{Error, Result};
use reference::settings::Setting;

/// `field.density`
pub(in crate::ops) static DENSITY: Op =
    Op { check: check_beta, ..Op::new(&reference::field::density::SIGNATURE, run_density, case_density) };

/// `field.interval`
pub(in crate::ops) static INTERVAL: Op = Op {
    work_ns: [50.0, 500.0],
    check: check_beta,
    ..Op::new(&reference::field::interval::SIGNATURE, run_interval, case_interval)
};

/// `field.composite`
pub(in crate::ops) static COMPOSITE: Op = Op {
    check: |x| check_sizes(x, "values", &["N", "S", "C"]),
    ..Op::new(&reference::field::composite::SIGNATURE, run_composite, case_composite)
};

/// `field.normal`
pub(in crate::ops) static NORMAL: Op =
    Op { check: check_normal, ..Op::new(&reference::field::normal::SIGNATURE, run_normal, case_normal) };

fn stencil(x: &CheckedCall<'_>) -> Stencil {
    if x.word("mode") == Some("central") { Stencil::Central } else { Stencil::Forward }
}

fn epsilon(x: &CheckedCall<'_>) -> Result<f32> {
    x.single("epsilon", 0.0041, |epsilon| epsilon > 0.0 && (2.0 * epsilon).is_finite(), "above 0")
}

fn check_normal(x: &CheckedCall<'_>) -> Result<()> {
    let width = x.shape("sdf")[1];
    if width != stencil(x).width() {
        return Err(Error::input("array 'sdf'")
            .expected(format!("{} values per point in this mode", stencil(x).width()))
            .got(width.to_string()));
    }
    epsilon(x).map(drop)
}

fn run_normal(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (sdf, stencil, epsilon) = (x.f32s("sdf"), stencil(x), epsilon(x)?);
    let (gradient, normal) = normal::forward(&sdf, stencil, epsilon);
    let shape = [gradient.len(), 3];
    let mut ran = RunResult::default();
    ran.outputs.put("gradient", &shape, gradient.into_flattened());
    ran.outputs.put("normal", &shape, normal.into_flattened());
    let bars = [x.bar("gradient", &shape)?, x.bar("normal", &shape)?];
    if bars.iter().any(Option::is_some) {
        let [of_gradient, of_normal] =
            bars.map(|bar| rows::<3>(&bar.unwrap_or_else(|| vec![0.0; 3 * shape[0]])));
        let mut sdf_bar = x.start("sdf", sdf.len());
        normal::adjoint(&sdf, stencil, epsilon, &of_gradient, &of_normal, &mut sdf_bar);
        ran.gradients.put("sdf", &x.shape("sdf"), sdf_bar);
    }
    Ok(ran)
}

fn check_beta(x: &CheckedCall<'_>) -> Result<()> {
    let beta = x.f64s("beta")[0];
    // 1/β² is a number of f32.
    if (1e-18..=1e18).contains(&beta) {
        return Ok(());
    }
    Err(Error::input("array 'beta'").expected("a number above 0, 1e-18 to 1e18").got(beta.to_string()))
}

fn run_density(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (sdf, beta) = (x.f32s("sdf"), x.f32s("beta")[0]);
    let n = sdf.len();
    let mut sigma = vec![0.0; n];
    density::forward(&sdf, beta, &mut sigma);
    let mut ran = RunResult::default();
    ran.outputs.put("sigma", &[n], sigma);
    if let Some(bar) = x.bar("sigma", &[n])? {
        let (mut sdf_bar, start) = (x.start("sdf", n), x.start("beta", 1)[0]);
        let beta_bar = density::adjoint(&sdf, beta, &bar, &mut sdf_bar);
        ran.gradients.put("sdf", &[n], sdf_bar);
        ran.gradients.put("beta", &[], vec![start + beta_bar]);
    }
    Ok(ran)
}

fn run_interval(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (sdf0, sdf1, beta) = (x.f32s("sdf0"), x.f32s("sdf1"), x.f32s("beta")[0]);
    let n = sdf0.len();
    let mut sigma = vec![0.0; n];
    interval::forward(&sdf0, &sdf1, beta, &mut sigma);
    let mut ran = RunResult::default();
    ran.outputs.put("sigma", &[n], sigma);
    if let Some(bar) = x.bar("sigma", &[n])? {
        let (mut bar0, mut bar1, start) = (x.start("sdf0", n), x.start("sdf1", n), x.start("beta", 1)[0]);
        let beta_bar = interval::adjoint([&sdf0, &sdf1], beta, &bar, [&mut bar0, &mut bar1]);
        ran.gradients.put("sdf0", &[n], bar0);
        ran.gradients.put("sdf1", &[n], bar1);
        ran.gradients.put("beta", &[], vec![start + beta_bar]);
    }
    Ok(ran)
}

fn run_composite(x: &CheckedCall<'_>) -> Result<RunResult> {
    let [sigma, delta, values, background] =
        ["sigma", "delta", "values", "background"].map(|name| x.f32s(name));
    let [n, samples, channels] = ["N", "S", "C"].map(|letter| x.dim(letter));
    let input =
        composite::In { sigma: &sigma, delta: &delta, values: &values, background: &background, samples };
    let out = composite::forward(&input);
    let mut ran = RunResult::default();
    ran.outputs.put("value", &[n, channels], out.value.clone());
    ran.outputs.put("opacity", &[n], out.opacity.clone());
    ran.outputs.put("weights", &[n, samples], out.weights.clone());
    let (value_bar, opacity_bar) = (x.bar("value", &[n, channels])?, x.bar("opacity", &[n])?);
    if value_bar.is_some() || opacity_bar.is_some() {
        let value_bar = value_bar.unwrap_or_else(|| vec![0.0; n * channels]);
        let opacity_bar = opacity_bar.unwrap_or_else(|| vec![0.0; n]);
        let mut bar = composite::InBar {
            sigma: x.start("sigma", sigma.len()),
            delta: x.start("delta", delta.len()),
            values: x.start("values", values.len()),
            background: x.start("background", channels),
        };
        composite::adjoint(&input, &out, &value_bar, &opacity_bar, &mut bar);
        ran.gradients.put("sigma", &[n, samples], bar.sigma);
        ran.gradients.put("delta", &[n, samples], bar.delta);
        ran.gradients.put("values", &[n, samples, channels], bar.values);
        ran.gradients.put("background", &[channels], bar.background);
    }
    Ok(ran)
}

/// Distances of both signs within a few β, none closer to 0 than a tenth of β.
fn distances(draw: &Draw, n: usize, beta: f32) -> Vec<f32> {
    let apart = |d: f32| beta * if d > 0.0 { d + 0.1 } else { d - 0.1 };
    draw.uniforms(n, -4.0, 4.0).into_iter().map(apart).collect()
}

/// A large and a small β.
fn case_density(case: usize) -> Case {
    let (n, beta) = [(41, 0.125), (203, 0.008)][case];
    let mut made = Case::default();
    made.inputs.put("sdf", &[n], distances(&Draw::new(62, case, 0), n, beta));
    made.inputs.put("beta", &[], vec![beta]);
    made
}

/// Intervals outside, inside and across the surface, in both directions; some of them short.
fn case_interval(case: usize) -> Case {
    let (n, beta) = [(47, 0.125), (203, 0.008)][case];
    let [s0, other] = [0, 1].map(|array| distances(&Draw::new(63, case, array), n, beta));
    let lengths = Draw::new(63, case, 2).uniforms(n, 0.01, 0.05);
    let s1 = (0..n).map(|i| if i % 3 == 1 { s0[i] + beta * lengths[i] } else { other[i] }).collect();
    let mut made = Case::default();
    made.inputs.put("sdf0", &[n], s0);
    made.inputs.put("sdf1", &[n], s1);
    made.inputs.put("beta", &[], vec![beta]);
    made
}

/// Case 0: few rays; case 1: more rays than one task has, with samples that no light reaches.
fn case_composite(case: usize) -> Case {
    let ([n, s, channels], most) = [([5, 7, 3], 4.0), ([37, 12, 2], 12.0)][case];
    let mut made = Case::default();
    let draw = |array| Draw::new(64, case, array);
    made.inputs.put("sigma", &[n, s], draw(0).uniforms(n * s, 0.125, most));
    made.inputs.put("delta", &[n, s], draw(1).uniforms(n * s, 0.05, 0.25));
    made.inputs.put("values", &[n, s, channels], draw(2).normals(n * s * channels));
    made.inputs.put("background", &[channels], draw(3).normals(channels));
    made
}

/// Case 0: forward differences, one point in seven with a gradient below the least length; case 1: central.
fn case_normal(case: usize) -> Case {
    let (n, width, epsilon) = [(22, 4, 0.0625), (601, 6, 0.125)][case];
    let mut sdf = Draw::new(67, case, 0).uniforms(n * width, -0.25, 0.25);
    for row in sdf.chunks_exact_mut(width).skip(3).step_by(7).filter(|_| case == 0) {
        let first = row[0];
        row[1..].iter_mut().for_each(|s| *s = first + 1e-5 * *s);
    }
    let mut made = Case::default();
    made.inputs.put("sdf", &[n, width], sdf);
    made.settings.insert("epsilon".to_owned(), Setting::Number(epsilon));
    if case == 1 {
        made.settings.insert("mode".to_owned(), Setting::Text("central".to_owned()));
    }
    made
}
