//! The renderer: threads and chunks, its plan, and the plan of its twin.

use super::made::{Made, flat};
use crate::chains::assert_same_bits;
use lastlight::check::{On, Subject};
use lastlight::field::normal::Stencil;
use lastlight::field::render::{Rule, forward};
use lastlight::num::array::Arrays;
use lastlight::num::par;
use lastlight::ops::{self, Call, OpSubject};

fn scenes() -> [Made; 4] {
    let mut embedded = Made::embedded(300, 35);
    embedded.settings.rule = Rule::Analytic;
    embedded.settings.numerical_normals = Some((Stencil::Forward, 0.0625));
    let mut summed = Made::random(300, 36).summed();
    summed.settings.early_stop = Some(0.125);
    let mut pruned = Made::embedded(300, 33);
    pruned.settings.rule = Rule::Analytic;
    (pruned.settings.early_stop, pruned.settings.least_weight) = (Some(0.125), Some(0.03125));
    [Made::random(300, 28), embedded, summed, pruned]
}

#[test]
fn neither_threads_nor_chunks_change_a_bit() {
    for made in scenes() {
        let run = |chunk: usize| {
            let (out, plan) = made.render();
            let gradients = flat(&mut made.gradients(&out, &plan, chunk));
            (out, gradients)
        };
        let (out, gradients) = par::with_threads(1, || run(4096)).expect("a thread starts");
        for threads in [1, 2, 3, 7] {
            for chunk in [64, 256, 4096, 1, 100] {
                let (again, ours) = par::with_threads(threads, || run(chunk)).expect("threads start");
                assert!(again == out, "outputs with {threads} threads");
                assert_same_bits(&ours, &gradients, "gradients");
            }
        }
    }
}

#[test]
fn a_plan_given_back_changes_nothing() {
    for mut made in scenes() {
        let (out, plan) = made.render();
        let before = flat(&mut made.gradients(&out, &plan, 256));
        let mut given = plan.clone();
        // the number of samples that a ray takes is in the plan, and which of them have values
        made.settings.early_stop = None;
        made.settings.least_weight = made.settings.least_weight.map(|_| 1e-6);
        let again = made.with(|scene| forward(scene, &mut given));
        assert!(again == out && given == plan, "the same outputs and plan");
        assert_same_bits(&flat(&mut made.gradients(&again, &given, 256)), &before, "gradients");
    }
}

fn call(case: usize) -> (&'static ops::Op, Call) {
    let op = ops::find("field.render").expect("on the list");
    let made = (op.case)(case);
    (op, Call { inputs: made.inputs, settings: made.settings, ..Call::default() })
}

/// Refuses the plan of a case after a change of one of its arrays.
fn refuses(case: usize, name: &str, how: &dyn Fn(&mut Vec<i64>)) {
    let (op, call) = call(case);
    let mut plan = ops::run_f64(op, &call).expect("it runs").plan;
    let (shape, mut values) = match plan.get(name) {
        Some(array) => (array.shape().to_vec(), array.to_i64().expect("whole")),
        None => (vec![0], Vec::new()),
    };
    how(&mut values);
    let shape = if shape.len() == 1 { vec![values.len()] } else { shape };
    plan.put(name, &shape, values);
    let frozen = Call { plan: Some(plan), ..call };
    for e in [ops::run(op, &frozen), ops::run_f64(op, &frozen)].map(|ran| ran.expect_err("refused")) {
        assert!(e.to_string().contains("plan") && e.to_string().contains(name), "{name}: {e}");
    }
}

#[test]
fn a_plan_that_contradicts_itself_is_refused() {
    let refused = |name: &str, how: &dyn Fn(&mut Vec<i64>)| refuses(1, name, how);
    refused("start", &|v| v[1] = 1000);
    refused("start", &|v| v[0] = 1);
    refused("index", &|v| v[0] = -1);
    refused("taken", &|v| v[0] += 1);
    refused("panorama", &|v| v[0] = 4);
    refused("panorama", &|v| v[2] = 1);
    // decoded samples are those of steps, and there are some where there is a least weight
    refuses(4, "shaded", &|v| v.truncate(1));
    refuses(1, "shaded", &|v| v.push(1));
}

#[test]
fn the_plan_of_the_twin_freezes_units_sides_and_cells() {
    let (op, call) = call(1);
    let first = ops::run_f64(op, &call).expect("it runs");
    let frozen = |plan: Arrays| {
        let call = Call { plan: Some(plan), ..call.clone() };
        ops::run_f64(op, &call).expect("it runs")
    };
    assert!(frozen(first.plan.clone()) == first, "its own plan changes nothing");
    let with = |name: &str, value: i32| {
        let mut plan = first.plan.clone();
        let array = plan.need(name).expect("in the plan");
        let (shape, len) = (array.shape().to_vec(), array.len());
        plan.put(name, &shape, vec![value; len]);
        frozen(plan)
    };
    // without active units every network is 0: a sphere of grey
    let grey = with("active", 0);
    let [color, opacity] =
        ["color", "opacity"].map(|name| grey.outputs.need(name).expect("an output").to_f64());
    for (rgb, o) in color.chunks_exact(3).zip(&opacity) {
        let expected = 0.5 * o + (1.0 - o);
        assert!(rgb.iter().all(|c| (c - expected).abs() < 1e-12), "{rgb:?} for {expected}");
    }
    for name in ["active", "side", "steep", "panorama"] {
        let other = with(name, 0);
        assert!(other.outputs != first.outputs, "{name} is used");
        let kept = other.plan.need(name).expect("kept").to_i64().expect("whole");
        // how many choices a step has depends on the first of them
        let given = if name == "side" { &kept[..1] } else { &kept };
        assert!(given.iter().all(|choice| *choice == 0), "{name} is kept");
    }
}

#[test]
fn differences_hold_what_carries_no_gradient() {
    let op = ops::find("field.render").expect("on the list");
    let subject = OpSubject::case(op, 1).expect("a case");
    let here = subject.inputs().clone();
    let mut moved = here.clone();
    moved.get_mut("normal_w3").expect("an input").iter_mut().for_each(|w| *w += 1e-3);
    let value = |x, on| subject.value(x, on).expect("a value");
    for on in [On::Frozen, On::Live] {
        let (a, b) = (value(&here, on), value(&moved, on));
        assert_eq!(a.outputs["color"], b.outputs["color"], "{on:?}: colours look up the normals of the case");
        assert!(a.outputs["normal"] != b.outputs["normal"], "{on:?}: normals move");
        assert_eq!(a.log, b.log, "{on:?}: no decision changes");
    }
    // without a plan the colours follow the normals
    let (_, mut free) = call(1);
    let before = ops::run_f64(op, &free).expect("it runs").outputs;
    let array = free.inputs.need("normal_w3").expect("an input");
    let (shape, values) =
        (array.shape().to_vec(), array.to_f64().iter().map(|w| (w + 1e-3) as f32).collect());
    free.inputs.put("normal_w3", &shape, values);
    let after = ops::run_f64(op, &free).expect("it runs").outputs;
    assert!(before.need("color").expect("an output") != after.need("color").expect("an output"), "they move");
}

#[test]
fn full_batches_and_long_rays_have_gradients() {
    for (n, samples, stencil) in
        [(80, 24, Stencil::Central), (2, 1200, Stencil::Central), (3, 3000, Stencil::Forward)]
    {
        let mut made = Made::random(n, 28);
        made.settings.samples = samples;
        made.settings.rule = Rule::Analytic;
        made.settings.numerical_normals = Some((stencil, 0.0625));
        let (out, plan) = made.render();
        let gradients = flat(&mut made.gradients(&out, &plan, 64));
        let is_good = gradients.iter().all(|g| g.is_finite()) && gradients.iter().any(|g| *g != 0.0);
        assert!(is_good, "{n} rays of {samples} samples");
    }
}
