//! Dual numbers against the reverse tape, and both against finite differences on the frozen plan.

use std::collections::BTreeMap;

use reference::array::{Arr, Named};
use reference::fd;
use reference::twins::{self, Request};

use crate::cases::{cases, picked};
use crate::npz::relative;
use crate::scenes::{cameras, directions, dot, named};

fn norm(x: &Named<f64>) -> f64 {
    dot(x, x).sqrt()
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
