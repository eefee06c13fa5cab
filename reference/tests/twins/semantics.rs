//! The rules of the profiles: visibility, order, cuts, caps, stops, clamps, footprints, plans.

use std::collections::BTreeMap;

use reference::array::{Arr, Named};
use reference::fd;
use reference::twins::{self, Request};

use crate::scenes::{frontal, gradient, named, normal, run, scene, settings};

fn without(inputs: &Named<f64>, names: &[&str]) -> Named<f64> {
    inputs
        .iter()
        .filter(|(name, _)| !names.contains(&name.as_str()))
        .map(|(n, x)| (n.clone(), x.clone()))
        .collect()
}

/// The value of the middle pixel of a 33×33 picture, whose centre is the principal point.
fn middle(answer: &twins::Answer) -> f64 {
    answer.outputs["image"].data[3 * (16 * 33 + 16)]
}

/// A Gaussian on the optical axis of a 33×33 picture.
fn on_axis(z: f64, opacity: f64, grey: f64) -> ([f64; 3], f64, f64, f64) {
    ([0.0, 0.0, z], 0.05, opacity, grey)
}

#[test]
fn visibility_includes_both_ends() {
    let near = 0.01;
    for (z, is_visible) in [
        (f64::from_bits(0.01_f64.to_bits() - 1), false),
        (near, true),
        (f64::from_bits(0.01_f64.to_bits() + 1), true),
        (1e-3, false),
        (1e-20, false),
        (-1.0, false),
        (1e10, true),
        (1.000_000_1e10, false),
    ] {
        let answer = run("splat.render", &frontal(&[on_axis(z, 0.5, 1.0)], 33, 33), &[]);
        assert_eq!(answer.plan["order"].data.len(), usize::from(is_visible), "z = {z:e}");
        let all = answer.outputs.values().chain(answer.intermediates.values());
        assert!(all.flat_map(|x| &x.data).all(|x| x.is_finite()), "z = {z:e}");
        if !is_visible {
            for name in ["means_px", "depths_z", "conics", "shape", "colors", "radii_px"] {
                assert!(answer.intermediates[name].data.iter().all(|&x| x == 0.0), "z = {z:e}: {name} is 0");
            }
        }
    }
    let mut nearer = frontal(&[on_axis(0.1, 0.5, 1.0)], 33, 33);
    assert_eq!(run("splat.render", &nearer, &[("profile", "inria")]).plan["order"].data.len(), 0);
    nearer.insert("near".to_owned(), Arr::scalar(0.05));
    assert_eq!(
        run("splat.render", &nearer, &[("profile", "inria")]).plan["order"].data.len(),
        1,
        "near overrides"
    );
}

#[test]
fn ties_in_depth_go_by_index() {
    let clones = |greys: [f64; 2]| {
        let inputs = frontal(&[on_axis(2.0, 0.5, greys[0]), on_axis(2.0, 0.5, greys[1])], 33, 33);
        run("splat.render", &inputs, &[])
    };
    let (a, b) = (clones([1.0, 0.0]), clones([0.0, 1.0]));
    assert_eq!(a.plan["order"].data, [0.0, 1.0]);
    // Swapping neighbours changes the picture by α1 α2 T (c1 − c2).
    assert!((middle(&a) - middle(&b) - 0.25).abs() < 1e-15);
}

#[test]
fn stops_include_or_exclude_the_last_gaussian() {
    // α = 0.99, then 0.9901 uncapped: T = 0.01, then 0.01·0.0099 = 9.9e-5.
    let inputs =
        frontal(&[on_axis(2.0, 0.99, 0.0), on_axis(3.0, 0.9901, 1.0), on_axis(4.0, 0.5, 1.0)], 33, 33);
    let with = |stop: &str| run("splat.render", &inputs, &[("alpha_max", "0.999"), ("stop", stop)]);
    let second = 0.01 * 0.9901;
    let third = 0.01 * (1.0 - 0.9901) * 0.5;
    assert!((middle(&with("after")) - second).abs() < 1e-15);
    assert_eq!(middle(&with("before")), 0.0);
    assert_eq!(middle(&with("before_strict")), 0.0);
    assert!((middle(&with("never")) - second - third).abs() < 1e-15);
    let last = |stop: &str| with(stop).plan["last_index"].data[16 * 33 + 16];
    assert_eq!(["after", "before", "never"].map(last), [1.0, 0.0, 2.0]);
    // At equality only the strict rule goes on: α = ½ twice against t_stop = ¼.
    let halves = frontal(&[on_axis(2.0, 0.5, 0.0), on_axis(3.0, 0.5, 1.0), on_axis(4.0, 0.5, 1.0)], 33, 33);
    let with = |stop: &str| middle(&run("splat.render", &halves, &[("t_stop", "0.25"), ("stop", stop)]));
    assert_eq!(with("after"), 0.25);
    assert_eq!(with("before"), 0.0);
    assert_eq!(with("before_strict"), 0.25, "the third would bring T to 1/8");
}

#[test]
fn the_cap_stops_the_gradient_but_not_in_inrias_backward() {
    let bars = named([("alpha", {
        let mut bar = Arr::filled(&[1, 33, 33], 0.0);
        bar.data[16 * 33 + 16] = 1.0;
        bar
    })]);
    let opacity_bar = |opacity: f64, with: &[(&str, &str)]| {
        gradient("splat.render", &frontal(&[on_axis(2.0, opacity, 1.0)], 33, 33), with, &bars)["opacities"]
            .data[0]
    };
    assert_eq!(opacity_bar(1.0, &[]), 0.0, "above the cap");
    assert_eq!(opacity_bar(1.0, &[("inria_bwd", "1")]), 1.0, "Inria passes it through");
    assert_eq!(opacity_bar(0.99, &[]), 1.0, "at the cap the unclamped branch");
    assert_eq!(opacity_bar(0.98, &[]), 1.0);
    let capped = run("splat.render", &frontal(&[on_axis(2.0, 1.0, 1.0)], 33, 33), &[]);
    assert_eq!(middle(&capped), 0.99);
}

#[test]
fn alpha_below_the_cut_is_skipped_and_at_it_kept() {
    let cut = 1.0 / 255.0;
    let count = |opacity: f64| {
        run("splat.render", &frontal(&[on_axis(2.0, opacity, 1.0)], 33, 33), &[]).intermediates["counts"].data
            [16 * 33 + 16]
    };
    assert_eq!(count(cut), 1.0);
    assert_eq!(count(cut - 1e-12), 0.0);
    assert_eq!(
        run("splat.render", &frontal(&[on_axis(2.0, 1e-30, 1.0)], 33, 33), &[("profile", "unlimited")])
            .intermediates["counts"]
            .data,
        [1.0; 33 * 33],
        "no cut, no stop: every pixel"
    );
}

#[test]
fn dark_channels_are_clamped_without_gradient() {
    let mut inputs = without(&frontal(&[on_axis(2.0, 0.5, 0.0)], 33, 33), &["rgb"]);
    let c0 = 0.282_094_791_773_878_14;
    inputs.insert("sh".to_owned(), Arr::new(&[1, 1, 3], vec![-1.0 / c0, -0.5 / c0, 0.5 / c0]));
    inputs.insert("sh_degree".to_owned(), Arr::scalar(0.0));
    let answer = run("splat.render", &inputs, &[]);
    let mask = &answer.plan["color_mask"].data;
    assert_eq!((mask[0], mask[2]), (0.0, 1.0));
    assert_eq!(answer.intermediates["colors"].data[0], 0.0);
    let bars = named([("image", Arr::filled(&[1, 33, 33, 3], 1.0))]);
    let bar = &gradient("splat.render", &inputs, &[], &bars)["sh"].data;
    assert!(bar[0] == 0.0 && bar[2] > 0.0, "{bar:?}");
}

#[test]
fn unused_bands_have_no_gradient() {
    let mut inputs = scene(5, 24, 18);
    inputs.insert("sh_degree".to_owned(), Arr::scalar(1.0));
    let bars = named([("image", normal(&[2, 18, 24, 3], 70))]);
    let bar = &gradient("splat.render", &inputs, &[], &bars)["sh"];
    for i in 0..5 {
        let row = &bar.data[48 * i..48 * (i + 1)];
        assert!(row[..12].iter().any(|&x| x != 0.0) && row[12..].iter().all(|&x| x == 0.0));
    }
}

#[test]
fn a_gaussian_in_the_camera_centre_has_direction_zero() {
    let mut inputs = named([
        ("means", Arr::filled(&[1, 3], 0.0)),
        ("sh", normal(&[1, 16, 3], 71)),
        ("sh_degree", Arr::scalar(3.0)),
    ]);
    inputs.insert("view_from_world".to_owned(), frontal(&[], 8, 8)["view_from_world"].clone());
    let answer = run("splat.color", &inputs, &[]);
    assert!(answer.outputs["colors"].data.iter().all(|x| x.is_finite()));
    let bars = named([("colors", Arr::filled(&[1, 1, 3], 1.0))]);
    assert_eq!(gradient("splat.color", &inputs, &[], &bars)["means"].data, [0.0; 3]);
}

/// One tilted Gaussian at x/z = `slope`; its Σ' entry xx as a function, and the gradient of it.
struct Tilted {
    slope: f64,
}

impl Tilted {
    fn inputs(&self, dz: f64) -> Named<f64> {
        let mut inputs = frontal(&[([3.0 * self.slope, 0.1, 3.0 + dz], 1.0, 0.5, 0.5)], 100, 80);
        inputs.insert("scales".to_owned(), Arr::new(&[1, 3], vec![0.2, 0.3, 0.9]));
        inputs.insert("quats".to_owned(), Arr::new(&[1, 4], vec![0.9, 0.1, 0.3, -0.2]));
        without(&inputs, &["rgb", "background", "opacities"])
    }
    fn conic(&self, dz: f64, with: &[(&str, &str)]) -> f64 {
        run("splat.project", &self.inputs(dz), with).outputs["conics"].data[0]
    }
    fn z_bar(&self, with: &[(&str, &str)]) -> f64 {
        let bars = named([("conics", Arr::new(&[1, 1, 3], vec![1.0, 0.0, 0.0]))]);
        gradient("splat.project", &self.inputs(0.0), with, &bars)["means"].data[2]
    }
}

#[test]
fn beyond_the_tangent_limit_the_gradient_is_that_of_the_limited_function() {
    // W = 100, f = 100: tan = ½. Inria limits |x/z| to 0.65, gsplat (centred) to ½ + 0.15 as well.
    for clamp in ["gsplat", "inria"] {
        let with = [("clamp", clamp)];
        for slope in [0.3, 0.75, -0.75] {
            let tilted = Tilted { slope };
            let difference = fd::richardson(|h| tilted.conic(h, &with), 1e-4);
            let exact = tilted.z_bar(&with);
            assert!(
                (difference - exact).abs() <= 1e-9 * exact.abs(),
                "{clamp} {slope}: {difference} against {exact}"
            );
        }
    }
}

#[test]
fn inrias_backward_doubles_the_derivative_of_the_jacobian_beyond_the_limit() {
    let (inside, beyond) = (Tilted { slope: 0.3 }, Tilted { slope: 0.75 });
    // Only the 1e-7 in det² is left inside.
    let (a, b) =
        (inside.z_bar(&[("clamp", "inria")]), inside.z_bar(&[("clamp", "inria"), ("inria_bwd", "1")]));
    assert!(((a - b) / a).abs() < 1e-7, "{a} against {b}");
    // Beyond: conic_xx as a function of J02 alone, at J02 = −f·lim/z; the true slope of J02 in z is f·lim/z², Inria's twice it.
    let (exact, theirs) =
        (beyond.z_bar(&[("clamp", "inria")]), beyond.z_bar(&[("clamp", "inria"), ("inria_bwd", "1")]));
    let (z, limit) = (3.0, 0.65);
    let conic = |j02: f64| {
        // Σ' from J written out, Σ from the covariance operator.
        let both = named([
            ("quats", Arr::new(&[1, 4], vec![0.9, 0.1, 0.3, -0.2])),
            ("scales", Arr::new(&[1, 3], vec![0.2, 0.3, 0.9])),
        ]);
        let f: [f64; 9] = run("splat.covariance", &both, &[]).outputs["factors"].row(0);
        let j = [[100.0 / z, 0.0, j02], [0.0, 100.0 / z, -100.0 * 0.1 / (z * z)]];
        let v = |i: usize, k: usize| j[i][0] * f[k] + j[i][1] * f[3 + k] + j[i][2] * f[6 + k];
        let sum = |a: usize, b: usize| (0..3).fold(0.0, |s, k| s + v(a, k) * v(b, k));
        let (a, b, c) = (sum(0, 0) + 0.3, sum(0, 1), sum(1, 1) + 0.3);
        c / (a * c - b * b)
    };
    let j02 = -100.0 * limit / z;
    assert!((conic(j02) - beyond.conic(0.0, &[("clamp", "inria")])).abs() < 1e-12 * conic(j02));
    let slope = fd::richardson(|h| conic(j02 + h), 1e-3);
    let extra = slope * 100.0 * limit / (z * z);
    assert!((theirs - exact - extra).abs() <= 1e-6 * exact.abs(), "{theirs} − {exact} against {extra}");
    assert!(extra.abs() > 1e-3 * exact.abs(), "the deviation is no rounding");
}

#[test]
fn inrias_backward_damps_the_conic_by_det() {
    // Without a blur a tiny ellipse has det ≈ 1e-4; the factor is det²/(det² + 1e-7).
    let mut inputs = frontal(&[on_axis(2.0, 0.5, 0.5)], 33, 33);
    inputs.insert("scales".to_owned(), Arr::filled(&[1, 3], 0.002));
    let inputs = without(&inputs, &["rgb", "background", "opacities"]);
    let bars = named([("conics", Arr::new(&[1, 1, 3], vec![1.0, 0.5, 0.25]))]);
    let bar = |with: &[(&str, &str)]| gradient("splat.project", &inputs, with, &bars)["scales"].data[0];
    let (exact, theirs) = (bar(&[("blur_px2", "0")]), bar(&[("blur_px2", "0"), ("inria_bwd", "1")]));
    let det = (0.1_f64 * 0.1) * (0.1 * 0.1);
    let factor = det * det / (det * det + 1e-7);
    assert!((theirs / exact - factor).abs() < 1e-12, "{theirs} / {exact} against {factor}");
}

#[test]
fn the_compensation_is_the_ratio_of_areas_and_has_a_floor() {
    let project = |scale: f64| {
        let mut inputs = frontal(&[on_axis(2.0, 0.5, 0.5)], 33, 33);
        inputs.insert("scales".to_owned(), Arr::filled(&[1, 3], scale));
        without(&inputs, &["rgb", "background"])
    };
    let with = [("antialiased", "1")];
    let compensation =
        |scale: f64| run("splat.project", &project(scale), &with).outputs["compensation"].data[0];
    let variance = (0.02_f64 * 50.0) * (0.02 * 50.0);
    assert!((compensation(0.02) - variance / (variance + 0.3)).abs() < 1e-15);
    assert_eq!(compensation(1e-6), 0.005);
    let bars = named([("compensation", Arr::filled(&[1, 1], 1.0))]);
    let bar = |scale: f64| gradient("splat.project", &project(scale), &with, &bars)["scales"].data[0];
    assert_eq!(bar(1e-6), 0.0, "flat below the floor");
    assert!(bar(0.02) > 0.0);
    let mut inputs = frontal(&[on_axis(2.0, 0.5, 0.5)], 33, 33);
    inputs.insert("scales".to_owned(), Arr::filled(&[1, 3], 0.02));
    let picture = middle(&run("splat.render", &inputs, &with));
    assert!((picture - 0.25 * variance / (variance + 0.3)).abs() < 1e-15, "the opacity is compensated");
}

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
fn a_plan_is_obeyed_against_the_values() {
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
fn the_fisheye_is_smooth_across_its_axis_and_its_series() {
    let at = |x: f64, with: &[(&str, &str)]| {
        let mut inputs = frontal(&[([x, 0.5 * x, 2.0], 1.0, 0.5, 0.5)], 64, 64);
        inputs.insert("scales".to_owned(), Arr::new(&[1, 3], vec![0.2, 0.3, 0.9]));
        inputs.insert("quats".to_owned(), Arr::new(&[1, 4], vec![0.9, 0.1, 0.3, -0.2]));
        let inputs = without(&inputs, &["rgb", "background", "opacities"]);
        run("splat.project", &inputs, with).outputs
    };
    let fisheye = [("camera", "fisheye")];
    // ρ²/z² = 1.25 x²/4 crosses 0.01, where the series hands over, at x = 0.1789.
    let switch = (0.04_f64 / 1.25).sqrt();
    for (name, tolerance) in [("means_px", 1e-13), ("conics", 1e-11), ("shape", 1e-11)] {
        let (below, above) = (at(switch * (1.0 - 1e-15), &fisheye), at(switch * (1.0 + 1e-15), &fisheye));
        for (a, b) in below[name].data.iter().zip(&above[name].data) {
            assert!((a - b).abs() <= tolerance * b.abs(), "{name}: {a} against {b}");
        }
    }
    // On the axis it is the pinhole.
    let (fish, pin) = (at(0.0, &fisheye), at(0.0, &[]));
    for name in ["means_px", "conics", "shape"] {
        for (a, b) in fish[name].data.iter().zip(&pin[name].data) {
            assert!((a - b).abs() <= 1e-14 * b.abs(), "{name}: {a} against {b}");
        }
    }
    // At 45° the angle is π/4.
    let mut inputs = frontal(&[([2.0, 0.0, 2.0], 0.1, 0.5, 0.5)], 64, 64);
    inputs = without(&inputs, &["rgb", "background", "opacities"]);
    let u = run("splat.project", &inputs, &fisheye).outputs["means_px"].data[0];
    assert!((u - 32.0 - 100.0 * std::f64::consts::FRAC_PI_4).abs() < 1e-12, "{u}");
}

#[test]
fn the_orthographic_picture_does_not_depend_on_depth() {
    let at = |z: f64| {
        let inputs = without(
            &frontal(&[([0.1, 0.05, z], 0.04, 0.5, 0.5)], 64, 64),
            &["rgb", "background", "opacities"],
        );
        run("splat.project", &inputs, &[("camera", "orthographic")]).outputs
    };
    let (a, b) = (at(1.0), at(7.0));
    assert_eq!(a["means_px"].data, [42.0, 37.0]);
    assert_eq!(a["conics"], b["conics"]);
    assert!((a["conics"].data[0] - 1.0 / 16.3).abs() < 1e-15);
}

#[test]
fn factors_and_quaternions_give_one_picture() {
    let inputs = scene(10, 24, 20);
    let both = named([("quats", inputs["quats"].clone()), ("scales", inputs["scales"].clone())]);
    let mut skinned = without(&inputs, &["quats", "scales"]);
    skinned.extend(run("splat.covariance", &both, &[]).outputs);
    assert_eq!(run("splat.render", &skinned, &[]).outputs, run("splat.render", &inputs, &[]).outputs);
}

#[test]
fn blending_the_intermediates_gives_the_picture() {
    for with in [&[][..], &[("profile", "inria")], &[("profile", "gsplat"), ("antialiased", "1")]] {
        let inputs = scene(15, 40, 24);
        let render = run("splat.render", &inputs, with);
        let mut blend: Named<f64> = ["means_px", "shape", "axis", "colors", "depths_z"]
            .iter()
            .map(|&name| (name.to_owned(), render.intermediates[name].clone()))
            .collect();
        for name in ["background", "width", "height"] {
            blend.insert(name.to_owned(), inputs[name].clone());
        }
        let opacities = render.intermediates.get("opacities_px").unwrap_or(&inputs["opacities"]);
        blend.insert("opacities".to_owned(), opacities.clone());
        let blended = run("splat.blend", &blend, with);
        assert_eq!(blended.outputs, render.outputs, "{with:?}");
        for name in
            ["order", "tile_start", "tile_entry", "entry_slot", "last_index", "alpha_mask", "cap_mask"]
        {
            assert_eq!(blended.plan[name], render.plan[name], "{with:?}: {name}");
        }
    }
}

#[test]
fn whole_pixels_shift_the_exact_picture() {
    // Means whose projections move by exactly 5 pixels when the principal point does.
    let mut inputs = frontal(&[on_axis(2.0, 0.9, 1.0), on_axis(2.5, 0.4, 0.3)], 48, 48);
    let still = run("splat.render", &inputs, &[]).outputs["alpha"].clone();
    inputs.get_mut("intrinsics").expect("intrinsics").data[2] += 5.0;
    let shifted = run("splat.render", &inputs, &[]).outputs["alpha"].clone();
    for y in 0..48 {
        for x in 5..48 {
            assert_eq!(shifted.data[48 * y + x], still.data[48 * y + x - 5], "pixel {x}, {y}");
        }
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

#[test]
fn no_gaussians_give_the_background() {
    let mut inputs = frontal(&[], 20, 10);
    inputs.insert("background".to_owned(), Arr::new(&[3], vec![0.1, 0.2, 0.3]));
    for profile in ["exact", "gsplat", "inria", "unlimited"] {
        let answer = run("splat.render", &inputs, &[("profile", profile)]);
        assert!(answer.outputs["image"].data.chunks(3).all(|c| c == [0.1, 0.2, 0.3]));
        assert!(answer.outputs["alpha"].data.iter().all(|&a| a == 0.0));
        assert!(answer.plan["last_index"].data.iter().all(|&last| last == -1.0));
    }
}

#[test]
fn many_opaque_layers_have_finite_gradients() {
    // 64 coincident Gaussians at the cap and no stop: T sinks to 1e-128, and nothing divides by it.
    let inputs = frontal(&vec![on_axis(2.0, 0.99, 0.7); 64], 33, 33);
    let unlimited = settings(&[("profile", "unlimited")]);
    let request = Request { op: "splat.render", inputs: &inputs, settings: &unlimited, plan: None };
    let bars = named([("image", normal(&[1, 33, 33, 3], 80)), ("depth", normal(&[1, 33, 33], 81))]);
    let (_, gradient) = twins::vjp(&request, &bars).expect("a gradient");
    assert!(gradient.values().flat_map(|x| &x.data).all(|x| x.is_finite()));
    let v = named([("means", normal(&[64, 3], 82)), ("opacities", normal(&[64], 83))]);
    let (_, tangent) = twins::jvp(&request, &v).expect("a tangent");
    let over = |a: &Named<f64>, b: &Named<f64>, names: &[&str]| {
        let pairs = names.iter().flat_map(|&name| a[name].data.iter().zip(&b[name].data));
        pairs.fold(0.0, |sum, (a, b)| sum + a * b)
    };
    let (forward, reverse) =
        (over(&tangent, &bars, &["image", "depth"]), over(&v, &gradient, &["means", "opacities"]));
    assert!((forward - reverse).abs() <= 1e-12 * forward.abs(), "{forward} against {reverse}");
}
