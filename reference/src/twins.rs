//! The list of twins, driven by name: values, directional derivatives, gradients.
//!
//! Integers, masks and plan arrays travel as `f64` exactly. A composite operator is a chain of stages that share one pool of
//! arrays; reverse mode runs them last to first, with every array of the pool a fresh leaf, so that the adjoints of one
//! stage's inputs seed the stage before. Derivatives are those of the smooth function on the plan of the values.

mod table;

use std::collections::BTreeMap;

use crate::array::{Arr, Named, Out};
use crate::body::{pose, skin};
use crate::causal::{acyclic, independence, intervene, mask, posterior, posterior_kl, scm_kl, structure};
use crate::dual::Dual;
use crate::geometry::trace;
use crate::loss::{groups, l1, lpips, mse, points, ssim};
use crate::nn::{act, conv, linear};
use crate::optim::{adam, adamw};
use crate::rev::{self, Rev};
use crate::scalar::Scalar;
use crate::scene::profile::Profile;
pub use crate::settings::Setting;
use crate::settings::Settings;
use crate::shade::{envmap, ggx};
use crate::splat::{activate, blend, color, covariance, project, render};
use table::{Stage, TWINS, Twin};

/// A call of an operator.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Name of the operator.
    pub op: &'a str,
    /// Inputs by name; sizes and degrees are 0-d.
    pub inputs: &'a Named<f64>,
    /// Settings by name.
    pub settings: &'a BTreeMap<String, Setting>,
    /// Decisions to obey; what it lacks is decided on the values.
    pub plan: Option<&'a Named<f64>>,
}

/// What an operator gives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    /// Outputs by name.
    pub outputs: Named<f64>,
    /// What was computed on the way.
    pub intermediates: Named<f64>,
    /// Every discrete decision.
    pub plan: Named<f64>,
}

const NAMES: [&str; TWINS.len()] = {
    let mut names = [""; TWINS.len()];
    let mut i = 0;
    while i < TWINS.len() {
        names[i] = TWINS[i].name;
        i += 1;
    }
    names
};

/// Names of all operators that have a twin.
pub fn names() -> &'static [&'static str] {
    &NAMES
}

/// Inputs of an operator that have a gradient, optional ones included; empty for one without gradient.
///
/// # Errors
/// When there is no such operator.
pub fn smooth_inputs(op: &str) -> Result<&'static [&'static str], String> {
    Ok(twin(op)?.smooth_inputs)
}

/// Outputs of an operator that take a cotangent; those of a mode that is off are among them.
///
/// # Errors
/// When there is no such operator.
pub fn smooth_outputs(op: &str) -> Result<&'static [&'static str], String> {
    Ok(twin(op)?.smooth_outputs)
}

fn twin(op: &str) -> Result<&'static Twin, String> {
    TWINS
        .iter()
        .find(|twin| twin.name == op)
        .ok_or_else(|| format!("operator {op}: there is no twin of that name"))
}

/// Checks names of inputs and settings and that every number is finite.
fn check(request: &Request<'_>) -> Result<&'static Twin, String> {
    let twin = twin(request.op)?;
    Settings(request.settings).only(twin.settings)?;
    for (name, x) in request.inputs {
        if !twin.inputs.contains(&name.as_str()) {
            return Err(format!("input {name}: unknown to {}; known: {}", twin.name, twin.inputs.join(", ")));
        }
        if let Some(i) = x.data.iter().position(|x| !x.is_finite()) {
            return Err(format!("input {name}: expected finite numbers, got {} at entry {i}", x.data[i]));
        }
    }
    Ok(twin)
}

/// Checks tangents or cotangents against the arrays they belong to.
fn check_directions(
    what: &str,
    given: &Named<f64>,
    allowed: &[&str],
    arrays: &Named<f64>,
) -> Result<(), String> {
    for (name, x) in given {
        let Some(array) = arrays.get(name).filter(|_| allowed.contains(&name.as_str())) else {
            return Err(format!("{what} {name}: expected one of {}", allowed.join(", ")));
        };
        if array.shape != x.shape {
            return Err(format!("{what} {name}: expected shape {:?}, got {:?}", array.shape, x.shape));
        }
        if let Some(i) = x.data.iter().position(|x| !x.is_finite()) {
            return Err(format!("{what} {name}: expected finite numbers, got {} at entry {i}", x.data[i]));
        }
    }
    Ok(())
}

/// Runs one stage on the pool.
fn run_stage<S: Scalar>(
    stage: Stage,
    pool: &Named<S>,
    settings: &Settings<'_>,
    plan: Option<&Named<f64>>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let profile = || Profile::from_settings(settings);
    match stage {
        Stage::Activate => activate::forward(pool, out),
        Stage::Covariance => covariance::forward(pool, out),
        Stage::Project => project::forward(pool, profile()?, plan, out),
        Stage::Color => color::forward(pool, plan, out),
        Stage::Blend => blend::forward(pool, "opacities", &profile()?, plan, out),
        Stage::RenderProject => render::project_and_color(pool, profile()?, plan, out),
        Stage::RenderBlend => render::blend(pool, &profile()?, plan, out),
        Stage::Linear => linear::forward(pool, out),
        Stage::LeakyRelu => act::leaky_relu(pool, settings, out),
        Stage::Conv => conv::forward(pool, settings, out),
        Stage::L1 => l1::forward(pool, out),
        Stage::Mse => mse::forward(pool, out),
        Stage::Ssim => ssim::forward(pool, out),
        Stage::Points => points::forward(pool, settings, plan, out),
        Stage::Groups => groups::forward(pool, out),
        Stage::Skin => skin::forward(pool, out),
        Stage::Ggx => ggx::forward(pool, out),
        Stage::Envmap => envmap::forward(pool, out),
        Stage::Acyclic => acyclic::forward(pool, out),
        Stage::Mask => mask::forward(pool, settings, out),
        Stage::Structure => structure::forward(pool, settings, out),
        Stage::PosteriorKl => posterior_kl::forward(pool, out),
        Stage::Posterior => posterior::forward(pool, out),
        Stage::ScmKl => scm_kl::forward(pool, settings, out),
        Stage::Intervene => intervene::forward(pool, settings, out),
        Stage::Independence => independence::forward(pool, settings, out),
        Stage::Lpips(k) => lpips::stage(pool, settings, k, plan, out),
        Stage::Pose => pose::forward(pool, out),
        Stage::Adam | Stage::Adamw | Stage::Trace => Err("this stage has no gradient".to_owned()),
    }
}

/// Runs one stage on values.
fn run_value(
    stage: Stage,
    pool: &Named<f64>,
    settings: &Settings<'_>,
    plan: Option<&Named<f64>>,
    out: &mut Out<f64>,
) -> Result<(), String> {
    match stage {
        Stage::Adam => adam::forward(pool, settings, out),
        Stage::Adamw => adamw::forward(pool, settings, out),
        Stage::Trace => trace::forward(pool, out),
        other => run_stage(other, pool, settings, plan, out),
    }
}

/// What each stage wrote, and the completed plan.
fn run_all(twin: &Twin, request: &Request<'_>) -> Result<(Vec<Named<f64>>, Named<f64>), String> {
    let (mut pool, mut written) = (request.inputs.clone(), Vec::new());
    let mut plan = request.plan.cloned().unwrap_or_default();
    for &stage in twin.stages {
        let mut out = Out::new(None);
        run_value(stage, &pool, &Settings(request.settings), Some(&plan), &mut out)?;
        let (arrays, decisions) = out.finish();
        pool.extend(arrays.clone());
        written.push(arrays);
        plan.extend(decisions);
    }
    Ok((written, plan))
}

fn answer(twin: &Twin, written: &[Named<f64>], plan: Named<f64>) -> Answer {
    let mut answer = Answer { plan, ..Answer::default() };
    for (name, x) in written.iter().flatten() {
        let kind = if twin.outputs.contains(&name.as_str()) {
            &mut answer.outputs
        } else {
            &mut answer.intermediates
        };
        kind.insert(name.clone(), x.clone());
    }
    answer
}

/// Outputs, intermediates and plan.
///
/// # Errors
/// When the operator, an input, a setting or the plan is not what it should be.
pub fn value(request: &Request<'_>) -> Result<Answer, String> {
    let twin = check(request)?;
    let (written, plan) = run_all(twin, request)?;
    Ok(answer(twin, &written, plan))
}

/// The answer, and the tangents of its outputs for the given tangents of inputs (missing ones are 0).
///
/// # Errors
/// As [`value`]; also when a tangent does not fit, or the operator has no gradient.
pub fn jvp(request: &Request<'_>, tangents: &Named<f64>) -> Result<(Answer, Named<f64>), String> {
    let twin = check(request)?;
    refuse_without_gradient(twin)?;
    check_directions("tangent", tangents, twin.smooth_inputs, request.inputs)?;
    let (written, plan) = run_all(twin, request)?;
    let mut pool: Named<Dual> = request
        .inputs
        .iter()
        .map(|(name, x)| {
            let mut dual = x.map(|&x| Dual::from_f64(x));
            if let Some(tangent) = tangents.get(name) {
                dual.data.iter_mut().zip(&tangent.data).for_each(|(x, &tangent)| x.tangent = tangent);
            }
            (name.clone(), dual)
        })
        .collect();
    for &stage in twin.stages {
        let mut out = Out::new(None);
        run_stage(stage, &pool, &Settings(request.settings), Some(&plan), &mut out)?;
        pool.extend(out.finish().0);
    }
    let outputs = twin
        .smooth_outputs
        .iter()
        .filter_map(|&name| Some((name.to_owned(), pool.get(name)?.map(|x| x.tangent))))
        .collect();
    Ok((answer(twin, &written, plan), outputs))
}

/// The answer, and the gradient of Σ output·cotangent by input name (missing cotangents are 0; inputs without influence get
/// zeros).
///
/// # Errors
/// As [`value`]; also when a cotangent does not fit, or the operator has no gradient.
pub fn vjp(request: &Request<'_>, cotangents: &Named<f64>) -> Result<(Answer, Named<f64>), String> {
    let twin = check(request)?;
    refuse_without_gradient(twin)?;
    let (written, plan) = run_all(twin, request)?;
    let answer = answer(twin, &written, plan);
    check_directions("cotangent", cotangents, twin.smooth_outputs, &answer.outputs)?;
    let mut bars = cotangents.clone();
    for (k, &stage) in twin.stages.iter().enumerate().rev() {
        rev::clear();
        let pool = request.inputs.iter().chain(written[..k].iter().flatten());
        let leaves: Named<Rev> = pool.map(|(name, x)| (name.clone(), rev::leaves(x))).collect();
        let mut out = Out::new(Some(&bars));
        run_stage(stage, &leaves, &Settings(request.settings), Some(&answer.plan), &mut out)?;
        for (name, x) in &leaves {
            let adjoint = rev::adjoints(x);
            let bar = bars.entry(name.clone()).or_insert_with(|| Arr::filled(&x.shape, 0.0));
            bar.data.iter_mut().zip(&adjoint.data).for_each(|(bar, adjoint)| *bar += adjoint);
        }
    }
    rev::clear();
    let present = twin.smooth_inputs.iter().filter(|&&name| request.inputs.contains_key(name));
    let gradient = present
        .map(|&name| {
            let zeros = || Arr::filled(&request.inputs[name].shape, 0.0);
            (name.to_owned(), bars.remove(name).unwrap_or_else(zeros))
        })
        .collect();
    Ok((answer, gradient))
}

fn refuse_without_gradient(twin: &Twin) -> Result<(), String> {
    if twin.smooth_outputs.is_empty() {
        return Err(format!("operator {}: it has no gradient", twin.name));
    }
    Ok(())
}

/// The amount of work: (Gaussian, pixel) pairs looked at for blending and rendering, products for `nn.linear` and `nn.conv`, (point, texel) pairs
/// for `shade.envmap`, pairs of points compared for `loss.points`, (ray, triangle) pairs for tracing, entries of the inputs elsewhere. 0 for a request that [`value`] would
/// refuse.
pub fn work(request: &Request<'_>) -> u64 {
    let entries = request.inputs.values().fold(0, |n, x| n + x.data.len() as u64);
    let rendered = || -> Result<u64, String> {
        let twin = check(request)?;
        let settings = Settings(request.settings);
        let profile = Profile::from_settings(&settings)?;
        let mut pool = request.inputs.clone();
        if twin.stages.len() > 1 {
            let mut out = Out::new(None);
            run_value(twin.stages[0], &pool, &settings, request.plan, &mut out)?;
            pool.extend(out.finish().0);
            return blend::pairs(&pool, render::opacities_name(&profile), &profile);
        }
        blend::pairs(&pool, "opacities", &profile)
    };
    match request.op {
        "splat.blend" | "splat.render" => rendered().unwrap_or(0),
        "nn.linear" => {
            let rows = request.inputs.get("x").and_then(|x| x.shape.first()).copied().unwrap_or(0) as u64;
            rows * request.inputs.get("weight").map_or(0, |weight| weight.data.len() as u64)
        }
        "nn.conv" => conv::products(request.inputs, &Settings(request.settings)).unwrap_or(0),
        "loss.points" => {
            let size =
                |name: &str, axis: usize| request.inputs.get(name).and_then(|x| x.shape.get(axis)).copied();
            let [b, p, q] =
                [("x", 0), ("x", 1), ("y", 1)].map(|(name, axis)| size(name, axis).unwrap_or(0) as u64);
            let is_chamfer =
                Settings(request.settings).text("mode", "ordered").is_ok_and(|mode| mode == "chamfer");
            if is_chamfer { 2 * b * p * q } else { b * p }
        }
        "shade.envmap" => {
            let points = request.inputs.get("normal").map_or(0, |normal| normal.data.len() as u64 / 3);
            points * request.inputs.get("env").map_or(0, |env| env.data.len() as u64 / 3)
        }
        "geometry.trace" => {
            let rows = |name: &str| request.inputs.get(name).map_or(0, |x| x.data.len() as u64 / 3);
            rows("origin") * rows("triangles")
        }
        "loss.lpips" => lpips::products(request.inputs).unwrap_or(0),
        "loss.ssim" => request.inputs.get("x").map_or(0, |x| 121 * x.data.len() as u64),
        _ => entries,
    }
}
