//! Dual numbers against the reverse tape, and both against finite differences on the frozen plan.

use std::collections::BTreeMap;

use reference::array::{Arr, Named};
use reference::fd;
use reference::twins::{self, Request, Setting};

use crate::npz::relative;
use crate::people;
use crate::scenes::{cameras, directions, dot, named, normal, scene, settings, uniform};

/// One operator with inputs.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) op: &'static str,
    pub(crate) inputs: Named<f64>,
    pub(crate) settings: BTreeMap<String, Setting>,
    pub(crate) smooth: &'static [&'static str],
    pub(crate) outputs: &'static [&'static str],
    /// Bound of the dot-product test.
    pub(crate) bound: f64,
}

fn without(mut inputs: Named<f64>, names: &[&str]) -> Named<f64> {
    names.iter().for_each(|&name| drop(inputs.remove(name)));
    inputs
}

fn factors(inputs: &Named<f64>) -> Named<f64> {
    let both = named([("quats", inputs["quats"].clone()), ("scales", inputs["scales"].clone())]);
    let request = Request { op: "splat.covariance", inputs: &both, settings: &BTreeMap::new(), plan: None };
    twins::value(&request).expect("covariances").outputs
}

fn pictures() -> Named<f64> {
    let mask = uniform(&[9, 13], [0.0, 1.0], 12).map(|&x| if x < 0.7 { 1.0 } else { 0.0 });
    named([
        ("x", uniform(&[9, 13, 3], [0.0, 1.0], 10)),
        ("y", uniform(&[9, 13, 3], [0.0, 1.0], 11)),
        ("mask", mask),
    ])
}

pub(crate) fn cases() -> Vec<Case> {
    let mut all = of_images_and_graphs();
    all.extend(people::cases());
    all
}

fn of_images_and_graphs() -> Vec<Case> {
    let n = 24;
    let full = scene(n, 40, 28);
    let splat = |name, op, inputs: Named<f64>, with: &[(&str, &str)], smooth, outputs, bound| Case {
        name,
        op,
        inputs,
        settings: settings(with),
        smooth,
        outputs,
        bound,
    };
    let projected = |with: &[(&str, &str)]| {
        let request = Request { op: "splat.render", inputs: &full, settings: &settings(with), plan: None };
        twins::value(&request).expect("a render").intermediates
    };
    let mut blend = full.clone();
    blend.extend(projected(&[]));
    let blend: Named<f64> = blend
        .into_iter()
        .filter(|(name, _)| {
            ["means_px", "shape", "axis", "opacities", "colors", "depths_z", "background", "width", "height"]
                .contains(&name.as_str())
        })
        .collect();
    let project = without(full.clone(), &["sh", "sh_degree", "background"]);
    let mut skinned = without(project.clone(), &["quats", "scales"]);
    skinned.extend(factors(&full));
    let mut render_skinned = without(full.clone(), &["quats", "scales", "sh", "sh_degree"]);
    render_skinned.extend(factors(&full));
    render_skinned.insert("rgb".to_owned(), uniform(&[n, 3], [0.0, 1.0], 13));
    let colored: Named<f64> = full
        .iter()
        .filter(|(k, _)| ["means", "sh", "sh_degree", "view_from_world"].contains(&k.as_str()))
        .map(|(k, x)| (k.clone(), x.clone()))
        .collect();
    let stored = named([("scales_log", normal(&[n, 3], 6)), ("opacity_logits", normal(&[n], 7))]);
    let factored = named([("quats", normal(&[n, 4], 2)), ("scales", uniform(&[n, 3], [0.05, 0.3], 3))]);
    let layer =
        named([("x", normal(&[5, 7], 20)), ("weight", normal(&[4, 7], 21)), ("bias", normal(&[4], 22))]);
    let shape: &[&str] = &["means_px", "depths_z", "conics", "shape"];
    let shape_aa: &[&str] = &["means_px", "depths_z", "conics", "shape", "compensation"];
    let picture: &[&str] = &["image", "alpha", "depth"];
    let gaussian: &[&str] = &["means", "quats", "scales"];
    let all: &[&str] = &["means", "quats", "scales", "opacities", "sh", "background"];
    let xy: &[&str] = &["x", "y"];
    vec![
        splat(
            "activate",
            "splat.activate",
            stored,
            &[],
            &["scales_log", "opacity_logits"],
            &["scales", "opacities"],
            1e-13,
        ),
        splat("covariance", "splat.covariance", factored, &[], &["quats", "scales"], &["factors"], 1e-13),
        splat("project", "splat.project", project.clone(), &[], gaussian, shape, 1e-13),
        splat(
            "project inria",
            "splat.project",
            project.clone(),
            &[("profile", "inria")],
            gaussian,
            shape,
            1e-13,
        ),
        splat(
            "project antialiased",
            "splat.project",
            project.clone(),
            &[("antialiased", "1")],
            gaussian,
            shape_aa,
            1e-13,
        ),
        splat(
            "project orthographic",
            "splat.project",
            project.clone(),
            &[("camera", "orthographic")],
            gaussian,
            shape,
            1e-13,
        ),
        splat("project fisheye", "splat.project", project, &[("camera", "fisheye")], gaussian, shape, 1e-13),
        splat("project factors", "splat.project", skinned, &[], &["means", "factors"], shape, 1e-13),
        splat("color", "splat.color", colored, &[], &["means", "sh"], &["colors"], 1e-13),
        splat(
            "blend",
            "splat.blend",
            blend,
            &[],
            &["means_px", "shape", "opacities", "colors", "depths_z", "background"],
            picture,
            1e-13,
        ),
        splat("render exact", "splat.render", full.clone(), &[], all, picture, 1e-11),
        splat("render gsplat", "splat.render", full.clone(), &[("profile", "gsplat")], all, picture, 1e-11),
        splat("render inria", "splat.render", full.clone(), &[("profile", "inria")], all, picture, 1e-11),
        splat(
            "render unlimited",
            "splat.render",
            full.clone(),
            &[("profile", "unlimited")],
            all,
            picture,
            1e-11,
        ),
        splat(
            "render antialiased",
            "splat.render",
            full.clone(),
            &[("antialiased", "1")],
            all,
            picture,
            1e-11,
        ),
        splat("render fisheye", "splat.render", full.clone(), &[("camera", "fisheye")], all, picture, 1e-11),
        splat(
            "render factors rgb",
            "splat.render",
            render_skinned,
            &[],
            &["means", "factors", "opacities", "rgb", "background"],
            picture,
            1e-11,
        ),
        splat("linear", "nn.linear", layer, &[], &["x", "weight", "bias"], &["y"], 1e-13),
        splat(
            "conv",
            "nn.conv",
            named([
                ("x", normal(&[2, 6, 7, 2], 24)),
                ("weight", normal(&[3, 4, 3, 2], 25)),
                ("bias", normal(&[3], 26)),
            ]),
            &[("stride", "2"), ("pad", "1")],
            &["x", "weight", "bias"],
            &["y"],
            1e-13,
        ),
        splat(
            "groups",
            "loss.groups",
            named([
                ("after", normal(&[5, 3, 3, 2], 50)),
                ("eps", normal(&[5, 3, 3, 2], 51)),
                ("eps_after", normal(&[5, 3, 3, 2], 52)),
                ("target", Arr::new(&[5], vec![0.0, 2.0, 0.0, 1.0, 2.0])),
                ("variance", uniform(&[3], [0.5, 1.5], 53)),
            ]),
            &[],
            &["after", "eps", "eps_after"],
            &["equal", "invariant", "spread", "shared"],
            1e-13,
        ),
        splat(
            "groups given",
            "loss.groups",
            named([
                ("after", normal(&[5, 3, 3, 2], 50)),
                ("eps", normal(&[5, 3, 3, 2], 51)),
                ("eps_after", normal(&[5, 3, 3, 2], 52)),
                ("target", Arr::new(&[5], vec![0.0, 2.0, 0.0, 1.0, 2.0])),
                ("variance", uniform(&[3], [0.5, 1.5], 53)),
                ("given", uniform(&[5, 2], [-0.4, 0.4], 58)),
            ]),
            &[],
            &["after", "eps", "eps_after", "given"],
            &["equal", "invariant", "spread", "shared"],
            1e-13,
        ),
        splat(
            "skin",
            "body.skin",
            named([
                ("points", normal(&[7, 3], 54)),
                ("weights", uniform(&[7, 3], [0.0, 1.0], 55)),
                ("transforms", normal(&[3, 4, 4], 56)),
                ("factors", normal(&[7, 3, 3], 57)),
            ]),
            &[],
            &["points", "weights", "transforms", "factors"],
            &["skinned", "skinned_factors"],
            1e-13,
        ),
        splat(
            "points",
            "loss.points",
            named([("x", normal(&[2, 7, 6], 27)), ("y", normal(&[2, 7, 6], 28))]),
            &[],
            xy,
            &["value"],
            1e-13,
        ),
        splat(
            "points chamfer",
            "loss.points",
            named([("x", normal(&[2, 7, 6], 27)), ("y", normal(&[2, 9, 6], 29))]),
            &[("mode", "chamfer")],
            xy,
            &["value"],
            1e-13,
        ),
        splat(
            "leaky relu",
            "nn.leaky_relu",
            named([("x", apart(&[6, 5], 23))]),
            &[("slope", "0.2")],
            &["x"],
            &["y"],
            1e-13,
        ),
        splat(
            "ggx",
            "shade.ggx",
            lit(&["normal", "view", "light", "albedo", "roughness", "metallic"]),
            &[],
            &["normal", "albedo", "roughness", "metallic"],
            &["brdf"],
            1e-13,
        ),
        splat(
            "envmap",
            "shade.envmap",
            lit(&["normal", "view", "albedo", "roughness", "metallic", "env"]),
            &[],
            &["normal", "albedo", "roughness", "metallic", "env"],
            &["radiance"],
            1e-13,
        ),
        splat(
            "pose",
            "body.pose",
            skeleton(),
            &[],
            &["pose", "correction", "joints"],
            &["transforms"],
            1e-13,
        ),
        splat("lpips", "loss.lpips", slim(), &[], xy, &["value"], 1e-11),
        splat("acyclic", "causal.acyclic", graph(), &[], &["a"], &["value"], 1e-13),
        splat("mask", "causal.mask", edges(), &[], &["logits"], &["mask"], 1e-13),
        splat("structure", "causal.structure", mechanism(false), &[], NETWORKS, &["z"], 1e-13),
        splat("abduct", "causal.structure", mechanism(false), &[("mode", "abduct")], NETWORKS, &["z"], 1e-13),
        splat(
            "structure linear",
            "causal.structure",
            mechanism(true),
            &[("mode", "linear")],
            &["eps", "mask", "weight"],
            &["z"],
            1e-13,
        ),
        splat(
            "posterior kl",
            "causal.posterior_kl",
            beliefs(false),
            &[],
            &["mu", "logvar"],
            &["value"],
            1e-13,
        ),
        splat("posterior", "causal.posterior", beliefs(true), &[], &["mu", "logvar"], &["sample"], 1e-13),
        splat("scm kl", "causal.scm_kl", causes(), &[], &["eps", "logvar"], &["value"], 1e-13),
        splat(
            "scm kl linear",
            "causal.scm_kl",
            linear_beliefs(),
            &[("mode", "linear")],
            &["mu", "logvar", "mask", "weight"],
            &["value"],
            1e-13,
        ),
        splat("intervene", "causal.intervene", intervention(false), &[], INTERVENED, &["z"], 1e-13),
        splat(
            "intervene linear",
            "causal.intervene",
            intervention(true),
            &[],
            &["eps", "mask", "weight", "value"],
            &["z"],
            1e-13,
        ),
        splat("independence", "causal.independence", spread(), &[], &["mu", "logvar"], &["value"], 1e-13),
        splat(
            "independence total",
            "causal.independence",
            carried_spread(),
            &[("form", "total"), ("share", "0.6")],
            &["mu", "logvar", "mask", "weight"],
            &["value"],
            1e-13,
        ),
        splat("l1", "loss.l1", pictures(), &[], xy, &["value"], 1e-13),
        splat("mse", "loss.mse", pictures(), &[], xy, &["value"], 1e-13),
        splat("ssim", "loss.ssim", pictures(), &[], xy, &["value"], 1e-13),
    ]
}

/// Normal numbers moved 0.05 away from 0.
fn apart(shape: &[usize], purpose: u16) -> Arr<f64> {
    normal(shape, purpose).map(|&x| if x > 0.0 { x + 0.05 } else { x - 0.05 })
}

/// Two pictures under the network of `loss.lpips` with few channels.
fn slim() -> Named<f64> {
    let places = [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28];
    let channels = [3, 4, 4, 5, 5, 4, 6, 5, 5, 6, 5, 5, 6];
    let mut all =
        named([("x", uniform(&[16, 17, 3], [0.0, 1.0], 50)), ("y", uniform(&[16, 17, 3], [0.0, 1.0], 51))]);
    let mut inputs = 3;
    for (k, (place, outputs)) in places.into_iter().zip(channels).enumerate() {
        let bound = (6.0 / (9.0 * inputs as f64)).sqrt();
        let purpose = 52 + 2 * k as u16;
        let weight = uniform(&[outputs, inputs, 3, 3], [-bound, bound], purpose);
        all.insert(format!("features.{place}.weight"), weight);
        all.insert(format!("features.{place}.bias"), uniform(&[outputs], [0.0, 0.3], purpose + 1));
        inputs = outputs;
    }
    for (j, tap) in [1, 3, 6, 9, 12].into_iter().enumerate() {
        let head = uniform(&[1, channels[tap], 1, 1], [0.1, 1.0], 80 + j as u16);
        all.insert(format!("lin{j}.model.1.weight"), head);
    }
    all
}

/// Five joints with large, small and tiny angles.
fn skeleton() -> Named<f64> {
    let mut pose = normal(&[5, 3], 40);
    pose.data[3..6].iter_mut().for_each(|x| *x *= 1e-3);
    pose.data[6..9].iter_mut().for_each(|x| *x *= 2e-5);
    named([
        ("pose", pose),
        ("correction", normal(&[5, 3], 41)),
        ("joints", normal(&[5, 3], 42)),
        ("parents", Arr::new(&[5], vec![-1.0, 0.0, 1.0, 1.0, 0.0])),
    ])
}

const NETWORKS: &[&str] = &["eps", "mask", "w0", "b0", "w1", "b1", "w2"];

fn graph() -> Named<f64> {
    named([("a", uniform(&[4, 4], [0.1, 0.9], 40)), ("alpha", Arr::scalar(1.0))])
}

fn edges() -> Named<f64> {
    named([("logits", uniform(&[4, 4], [-0.5, 0.5], 41)), ("uniform", uniform(&[4, 4], [0.3, 0.7], 42))])
}

/// Three factors of two numbers, by weights or by networks of five hidden units.
fn mechanism(linear: bool) -> Named<f64> {
    let mut all = named([("eps", normal(&[3, 3, 2], 43)), ("mask", uniform(&[3, 3], [0.1, 0.9], 44))]);
    if linear {
        all.extend(named([("weight", normal(&[3, 3], 45))]));
    } else {
        all.extend(named([
            ("w0", uniform(&[3, 5, 6], [-0.6, 0.6], 46)),
            ("b0", normal(&[3, 5], 47)),
            ("w1", uniform(&[3, 5, 5], [-0.6, 0.6], 48)),
            ("b1", normal(&[3, 5], 49)),
            ("w2", uniform(&[3, 2, 5], [-0.6, 0.6], 50)),
        ]));
    }
    all
}

fn beliefs(noise: bool) -> Named<f64> {
    let mut all = named([("mu", normal(&[3, 2, 4], 51)), ("logvar", uniform(&[3, 2, 4], [-2.0, 1.0], 52))]);
    if noise {
        all.extend(named([("eta", normal(&[3, 2, 4], 53))]));
    }
    all
}

const INTERVENED: &[&str] = &["eps", "mask", "w0", "b0", "w1", "b1", "w2", "value"];

/// A mechanism whose three samples are held at their second factor, at their third, and not at all.
fn intervention(linear: bool) -> Named<f64> {
    let mut all = mechanism(linear);
    all.extend(named([("target", Arr::new(&[3], vec![1.0, 2.0, -1.0])), ("value", normal(&[3, 2], 54))]));
    all
}

fn causes() -> Named<f64> {
    named([
        ("eps", normal(&[3, 2, 4], 55)),
        ("logvar", uniform(&[3, 2, 4], [-2.0, 1.0], 52)),
        ("kept", Arr::new(&[3, 2], vec![1.0, 1.0, 0.0, 1.0, 1.0, 0.0])),
    ])
}

fn linear_beliefs() -> Named<f64> {
    named([
        ("mu", normal(&[2, 3, 2], 51)),
        ("logvar", uniform(&[2, 3, 2], [-2.0, 1.0], 52)),
        ("mask", uniform(&[3, 3], [0.1, 0.9], 44)),
        ("weight", normal(&[3, 3], 45)),
        ("kept", Arr::new(&[2, 3], vec![1.0, 1.0, 1.0, 1.0, 0.0, 1.0])),
    ])
}

fn spread() -> Named<f64> {
    named([("mu", normal(&[9, 3, 2], 56)), ("logvar", uniform(&[9, 3, 2], [-2.0, 1.0], 57))])
}

fn carried_spread() -> Named<f64> {
    let mut all = spread();
    let unit = |at: usize| if at / 6 == at % 6 { 0.4 } else { 0.02 };
    all.extend(named([
        ("mask", uniform(&[3, 3], [0.1, 0.9], 44)),
        ("weight", normal(&[3, 3], 45)),
        ("carried", Arr::new(&[6, 6], (0..36).map(unit).collect())),
    ]));
    all
}

/// Points under light, eye and light within 60° of +z and the normal near it; a map of 4 × 6.
fn lit(names: &[&str]) -> Named<f64> {
    const POINTS: usize = 9;
    let upper = |purpose: u16| {
        let mut d = uniform(&[POINTS, 3], [-0.6, 0.6], purpose);
        for p in d.data.chunks_exact_mut(3) {
            p[2] = (1.0 - p[0] * p[0] - p[1] * p[1]).sqrt();
        }
        d
    };
    let mut normal = uniform(&[POINTS, 3], [-0.2, 0.2], 30);
    normal.data.chunks_exact_mut(3).for_each(|p| p[2] += 1.3);
    let all = named([
        ("normal", normal),
        ("view", upper(31)),
        ("light", upper(32)),
        ("albedo", uniform(&[POINTS, 3], [0.1, 0.9], 33)),
        ("roughness", uniform(&[POINTS], [0.3, 0.9], 34)),
        ("metallic", uniform(&[POINTS], [0.1, 0.9], 35)),
        ("env", uniform(&[4, 6, 3], [0.2, 2.0], 36)),
    ]);
    picked(&all, names)
}

fn norm(x: &Named<f64>) -> f64 {
    dot(x, x).sqrt()
}

fn picked(from: &Named<f64>, names: &[&str]) -> Named<f64> {
    names.iter().map(|&name| (name.to_owned(), from[name].clone())).collect()
}

#[test]
fn every_operator_is_in_a_case() {
    let cases = cases();
    let without = ["optim.", "geometry."]; // no gradient
    for name in twins::names().iter().filter(|name| !without.iter().any(|group| name.starts_with(group))) {
        assert!(cases.iter().any(|case| case.op == *name), "{name} has no gradient test");
        let reached =
            |smooth: &str| cases.iter().any(|case| case.op == *name && case.smooth.contains(&smooth));
        let inputs = twins::smooth_inputs(name).expect("a twin");
        assert!(inputs.iter().all(|smooth| reached(smooth)), "{name}: every smooth input is in a case");
        let given =
            |smooth: &str| cases.iter().any(|case| case.op == *name && case.outputs.contains(&smooth));
        let outputs = twins::smooth_outputs(name).expect("a twin");
        assert!(outputs.iter().all(|smooth| given(smooth)), "{name}: every smooth output is in a case");
    }
}

#[test]
fn dual_and_reverse_are_transposes() {
    for case in cases() {
        let request = Request { op: case.op, inputs: &case.inputs, settings: &case.settings, plan: None };
        let mut worst = 0.0;
        for trial in 0..8 {
            let v = directions(&case.inputs, case.smooth, 1000 + 10 * trial);
            assert_eq!(v.len(), case.smooth.len(), "{}: every smooth input has a direction", case.name);
            let (answer, jv) = twins::jvp(&request, &v).expect("a tangent");
            let outputs = picked(&answer.outputs, case.outputs);
            let w = directions(&outputs, case.outputs, 5000 + 10 * trial);
            let (again, jtw) = twins::vjp(&request, &w).expect("a gradient");
            assert_eq!(answer, again, "{}: one forward", case.name);
            let size = norm(&jv) * norm(&w) + norm(&v) * norm(&jtw);
            assert!(size > 0.0, "{}: nothing was tested", case.name);
            for (name, x) in &jtw {
                let moves = x.data.iter().any(|&x| x != 0.0);
                assert!(moves, "{}: the gradient of {name} is all zero", case.name);
            }
            let error = (dot(&w, &jv) - dot(&v, &jtw)).abs() / size;
            if error > worst {
                worst = error;
            }
        }
        eprintln!("{}: {worst:.1e}", case.name);
        assert!(worst <= case.bound, "{}: {worst:e}", case.name);
    }
}

/// x + h·v for the arrays that have a direction.
fn moved(x: &Named<f64>, v: &Named<f64>, h: f64) -> Named<f64> {
    let mut x = x.clone();
    for (name, v) in v {
        let x = x.get_mut(name).expect("a direction belongs to an input");
        x.data.iter_mut().zip(&v.data).for_each(|(x, v)| *x += h * v);
    }
    x
}

#[test]
fn differences_on_the_frozen_plan_agree_with_dual() {
    for case in cases().into_iter().filter(|case| case.name != "l1") {
        let request = Request { op: case.op, inputs: &case.inputs, settings: &case.settings, plan: None };
        let plan = twins::value(&request).expect("a value").plan;
        let frozen = Request { plan: Some(&plan), ..request };
        let mut worst = 0.0;
        for trial in 0..3 {
            // Each direction moves one group of inputs, and one moves all of them.
            let groups = case.smooth.iter().map(|name| vec![*name]).chain([case.smooth.to_vec()]);
            for group in groups {
                let v = directions(&case.inputs, &group, 2000 + 10 * trial);
                let (answer, jv) = twins::jvp(&frozen, &v).expect("a tangent");
                let w = directions(&picked(&answer.outputs, case.outputs), case.outputs, 6000 + 10 * trial);
                let derivative = dot(&w, &jv);
                let value_at = |h: f64| {
                    let inputs = moved(&case.inputs, &v, h);
                    twins::value(&Request { inputs: &inputs, ..frozen }).expect("a value").outputs
                };
                let f = |h: f64| dot(&w, &value_at(h));
                let h = 1e-4;
                let [wide, narrow] = [h, 0.5 * h].map(|h| (value_at(h), value_at(-h), 2.0 * h));
                for (name, tangent) in &jv {
                    let central = |(up, down, width): &(Named<f64>, Named<f64>, f64), i: usize| {
                        (up[name].data[i] - down[name].data[i]) / width
                    };
                    let difference: Vec<f64> = (0..tangent.data.len())
                        .map(|i| fd::extrapolate(central(&wide, i), central(&narrow, i)))
                        .collect();
                    let error = relative(&difference, &tangent.data);
                    if error > worst {
                        worst = error;
                    }
                }
                if trial == 0 && group.len() > 1 {
                    let order = fd::order(f, derivative, &[2e-4, 1e-4, 5e-5], 1e-9 * derivative.abs());
                    if let Some(order) = order {
                        assert!((order - 2.0).abs() <= 0.2, "{}: order {order}", case.name);
                    }
                }
            }
        }
        eprintln!("{}: {worst:.1e}", case.name);
        assert!(worst <= 1e-7, "{}: {worst:e}", case.name);
    }
}

#[test]
fn a_plan_that_is_given_back_changes_nothing() {
    for case in cases() {
        let request = Request { op: case.op, inputs: &case.inputs, settings: &case.settings, plan: None };
        let answer = twins::value(&request).expect("a value");
        let again = twins::value(&Request { plan: Some(&answer.plan), ..request }).expect("a value");
        assert!(again == answer, "{}", case.name);
    }
}

#[test]
fn optimisers_say_that_they_have_no_gradient() {
    let inputs = named([("param", Arr::new(&[1], vec![1.0])), ("grads", Arr::new(&[1, 1], vec![1.0]))]);
    let request = Request { op: "optim.adam", inputs: &inputs, settings: &BTreeMap::new(), plan: None };
    assert!(twins::vjp(&request, &Named::new()).is_err_and(|message| message.contains("no gradient")));
    assert!(twins::jvp(&request, &Named::new()).is_err_and(|message| message.contains("no gradient")));
}

#[test]
fn inputs_without_influence_get_zeros() {
    let mut inputs = cameras(16, 16);
    inputs.extend(named([
        ("means", Arr::new(&[1, 3], vec![0.0, 0.0, -50.0])),
        ("quats", Arr::new(&[1, 4], vec![1.0, 0.0, 0.0, 0.0])),
        ("scales", Arr::new(&[1, 3], vec![0.1; 3])),
        ("opacities", Arr::new(&[1], vec![0.5])),
        ("rgb", Arr::new(&[1, 3], vec![0.5; 3])),
        ("background", Arr::new(&[3], vec![0.5; 3])),
    ]));
    let request = Request { op: "splat.render", inputs: &inputs, settings: &BTreeMap::new(), plan: None };
    let bars = named([("image", Arr::filled(&[2, 16, 16, 3], 1.0))]);
    let (_, gradient) = twins::vjp(&request, &bars).expect("a gradient");
    for name in ["means", "quats", "scales", "opacities", "rgb"] {
        assert_eq!(gradient[name], Arr::filled(&inputs[name].shape, 0.0), "{name}: behind both cameras");
    }
    assert_eq!(gradient["background"].data, vec![512.0; 3]);
}
