//! Footprints, tile lists and plans that are passed in.

use super::{middle, on_axis};
use crate::scenes::{frontal, run, scene, settings};
use reference::array::Named;
use reference::twins::{self, Request};
use std::collections::BTreeMap;

#[test]
fn inrias_footprint_follows_the_tile_grid() {
    // A large opaque Gaussian in the centre of pixel (24, 24): square of half-width ceil(3√λ).
    let mut inputs =
        frontal(&[(([24.5 - 40.0, 24.5 - 40.0, 0.0]).map(|x| x / 100.0 * 2.0), 0.08, 1.0, 1.0)], 80, 80);
    inputs.get_mut("means").expect("means").data[2] = 2.0;
    let inria = run("splat.render", &inputs, &[("profile", "inria")]);
    let whole = run("splat.render", &inputs, &[("profile", "inria"), ("footprint", "alpha")]);
    let radius = inria.intermediates["radii_px"].data[0];
    // u − 0.5 = 24: tiles floor((24 − r)/16) to floor((24 + r + 15)/16), the last one excluded.
    let low = ((24.0 - radius) / 16.0).floor().abs() as usize * usize::from(radius <= 24.0);
    let high = ((24.0 + radius + 15.0) / 16.0).floor() as usize;
    let tiles: Vec<usize> =
        (0..25).filter(|t| (low..high).contains(&(t % 5)) && (low..high).contains(&(t / 5))).collect();
    let listed: Vec<usize> = inria.plan["tile_start"]
        .data
        .windows(2)
        .enumerate()
        .filter(|(_, w)| w[0] < w[1])
        .map(|(t, _)| t)
        .collect();
    assert_eq!(listed, tiles, "radius {radius}");
    let mut clipped: f64 = 0.0;
    for (a, b) in inria.outputs["image"].data.iter().zip(&whole.outputs["image"].data) {
        clipped = if b - a > clipped { b - a } else { clipped };
    }
    assert!(clipped <= 0.0111, "e^−4.5 of the opacity at most: {clipped}");
}

#[test]
fn tile_lists_hold_exactly_the_tiles_with_a_visible_pixel() {
    let inputs = scene(20, 50, 35);
    let answer = run("splat.render", &inputs, &[("stop", "never")]);
    let (plan, start) = (&answer.plan, &answer.plan["tile_start"].data);
    assert_eq!(start.len(), 2 * 3 * 4 + 1);
    let mut slots = vec![false; plan["entry_slot"].data.len()];
    for (entry, slot) in plan["entry_slot"].data.iter().enumerate() {
        assert!(
            plan["alpha_mask"].data[32 * entry..32 * (entry + 1)].iter().any(|&byte| byte != 0.0),
            "entry {entry}"
        );
        slots[*slot as usize] = true;
    }
    assert!(slots.into_iter().all(|hit| hit), "slots are a permutation");
    // Slot order is by camera, Gaussian, tile.
    let mut emitted = vec![(0, 0.0, 0); plan["entry_slot"].data.len()];
    for tile in 0..start.len() - 1 {
        for entry in start[tile] as usize..start[tile + 1] as usize {
            emitted[plan["entry_slot"].data[entry] as usize] =
                (tile / 12, plan["tile_entry"].data[entry], tile);
        }
    }
    assert!(emitted.windows(2).all(|w| w[0] < w[1]));
    // Bits set are contributions counted.
    let bits = plan["alpha_mask"].data.iter().fold(0, |n, &byte| n + (byte as u8).count_ones());
    assert_eq!(f64::from(bits), answer.intermediates["counts"].data.iter().fold(0.0, |n, c| n + c));
}

#[test]
fn a_plan_takes_precedence_over_the_values() {
    let inputs = frontal(&[on_axis(2.0, 0.5, 1.0), on_axis(3.0, 0.5, 0.0)], 33, 33);
    let none = BTreeMap::new();
    let request = Request { op: "splat.render", inputs: &inputs, settings: &none, plan: None };
    let natural = twins::value(&request).expect("a render").plan;
    let with = |change: &dyn Fn(&mut Named<f64>)| {
        let mut plan = natural.clone();
        change(&mut plan);
        twins::value(&Request { plan: Some(&plan), ..request })
    };
    let reversed = |plan: &mut Named<f64>| {
        for start in plan["tile_start"].data.clone().windows(2) {
            plan.get_mut("tile_entry").expect("entries").data[start[0] as usize..start[1] as usize].reverse();
        }
    };
    assert_eq!(middle(&with(&reversed).expect("a render")), 0.25, "order of the lists");
    let dropped = |plan: &mut Named<f64>| plan.get_mut("alpha_mask").expect("a mask").data.fill(0.0);
    assert_eq!(middle(&with(&dropped).expect("a render")), 0.0, "what the mask leaves out is skipped");
    let first = |plan: &mut Named<f64>| plan.get_mut("last_index").expect("indices").data.fill(-1.0);
    assert_eq!(middle(&with(&first).expect("a render")), 0.0, "last index");
    let capped = |plan: &mut Named<f64>| plan.get_mut("cap_mask").expect("a mask").data.fill(255.0);
    assert!((middle(&with(&capped).expect("a render")) - 0.99).abs() < 1e-15, "cap");
    let partial = |plan: &mut Named<f64>| {
        plan.remove("alpha_mask");
        plan.remove("cap_mask");
    };
    assert_eq!(with(&partial).expect("a render").plan, natural, "masks follow from the rest");
    let pivoted = |plan: &mut Named<f64>| plan.get_mut("pivot").expect("pivots").data.fill(1.0);
    let answer = with(&pivoted).expect("a render");
    assert_eq!(answer.intermediates["axis"].data, [1.0, 1.0]);
    assert!((middle(&answer) - 0.5).abs() < 1e-15, "either axis gives the same ellipse");
}

#[test]
fn plans_that_do_not_fit_are_refused() {
    let inputs = frontal(&[on_axis(2.0, 0.5, 1.0), on_axis(3.0, 0.5, 0.0)], 33, 33);
    let none = BTreeMap::new();
    let request = Request { op: "splat.render", inputs: &inputs, settings: &none, plan: None };
    let natural = twins::value(&request).expect("a render").plan;
    for name in natural.keys().filter(|name| *name != "entry_slot") {
        let mut plan = natural.clone();
        plan.get_mut(name).expect("listed").data[0] = 1e6;
        let message = twins::value(&Request { plan: Some(&plan), ..request }).expect_err("a bad plan");
        assert!(message.contains(name.as_str()), "{name}: {message}");
    }
}

#[test]
fn work_counts_pairs() {
    let (inputs, none) = (scene(20, 50, 35), BTreeMap::new());
    let request = Request { op: "splat.render", inputs: &inputs, settings: &none, plan: None };
    let contributing =
        twins::value(&request).expect("a render").intermediates["counts"].data.iter().fold(0.0, |n, c| n + c);
    let pairs = twins::work(&request) as f64;
    assert!(
        pairs >= contributing && pairs <= 2.0 * 20.0 * 50.0 * 35.0,
        "{pairs} pairs, {contributing} contribute"
    );
    let unlimited = settings(&[("profile", "unlimited")]);
    assert_eq!(twins::work(&Request { settings: &unlimited, ..request }), 2 * 20 * 50 * 35);
}
