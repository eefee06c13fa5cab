//! Visibility, order, cuts, caps and stops of a pixel's walk.

use super::{middle, on_axis};
use crate::scenes::{frontal, gradient, named, normal, run, scene, settings};
use reference::array::{Arr, Named};
use reference::twins::{self, Request};

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
    // Swapping neighbours changes the image by α1 α2 T (c1 − c2).
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
fn blending_the_intermediates_gives_the_image() {
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
