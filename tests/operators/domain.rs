//! Where operators are defined: inputs that have no result are refused by name, in both precisions and by the
//! twin alone.

use lastlight::body::{pose, rest};
use lastlight::causal::code;
use lastlight::loss::{latent, prior};
use lastlight::nn::{mlp, softmax};
use lastlight::num::array::Arrays;
use lastlight::ops::{self, Call, Op};
use lastlight::oracle::run::{self, Precision};
use lastlight::shade::{diffuse, gain, over_black};
use reference::array::{Arr, Named};
use reference::twins;

/// A generated case with some of its arrays replaced.
fn call(op: &'static Op, case: usize, spoil: impl Fn(&mut Call)) -> Call {
    let made = (op.case)(case);
    let mut call = Call { inputs: made.inputs, settings: made.settings, ..Call::default() };
    assert!(ops::run(op, &call).is_ok(), "{} case {case} itself is in the domain", op.name);
    spoil(&mut call);
    call
}

fn named(arrays: &Arrays) -> Named<f64> {
    let wide = |a: &lastlight::num::array::Array| Arr { shape: a.shape().to_vec(), data: a.to_f64() };
    arrays.0.iter().map(|(name, a)| (name.clone(), wide(a))).collect()
}

/// Both precisions refuse the call and name the place.
fn refused(name: &str, case: usize, place: &str, spoil: impl Fn(&mut Call)) {
    let op = ops::find(name).expect("on the list");
    let call = call(op, case, spoil);
    for precision in [Precision::F32, Precision::F64] {
        let e = run::call(op, &call, precision).expect_err(place);
        assert_eq!(e.exit_code(), 2, "{name}: bad input");
        assert!(e.to_string().contains(place), "{name} {precision:?}: expected {place:?} in: {e}");
    }
}

/// As [`refused`], and so does the twin without the shipped check.
fn refused_by_both(name: &str, case: usize, place: &str, spoil: impl Fn(&mut Call) + Copy) {
    refused(name, case, place, spoil);
    let op = ops::find(name).expect("on the list");
    let call = call(op, case, spoil);
    let request =
        twins::Request { op: op.name, inputs: &named(&call.inputs), settings: &call.settings, plan: None };
    assert!(twins::value(&request).is_err(), "the twin of {name} has a value: {place}");
}

/// Entries of an array multiplied by a number.
fn scale(call: &mut Call, name: &str, entries: std::ops::Range<usize>, by: f32) {
    let a = call.inputs.need(name).expect("there");
    let (shape, mut values) = (a.shape().to_vec(), a.to_f32());
    values[entries].iter_mut().for_each(|x| *x *= by);
    call.inputs.put(name, &shape, values);
}

#[test]
fn captured_transforms_without_an_inverse_are_refused() {
    // the last joint has no child: nothing is divided by its determinant, and it is refused all the same
    for joint in [0, 4] {
        let place = format!("array 'captured', joint {joint}: expected a transform that has an inverse");
        let row = 12 * joint..12 * joint + 4;
        refused_by_both("body.pose", 2, &place, |c| scale(c, "captured", row.clone(), 0.0));
        refused_by_both("body.pose", 2, &place, |c| scale(c, "captured", row.clone(), 1e-13));
        refused_by_both("body.pose", 2, &place, |c| scale(c, "captured", row.clone(), 1e14));
    }
    // a reflection has one
    let op = ops::find("body.pose").expect("on the list");
    let mirrored = call(op, 2, |c| scale(c, "captured", 0..4, -1.0));
    ops::run(op, &mirrored).expect("a determinant below 0 is none that is too small");
    let flat = [[[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.0], [0.0; 4]]];
    let x = pose::In { pose: &[], captured: &flat, correction: None, joints: &[[0.0; 3]], parents: &[-1] };
    assert!(pose::forward(x).is_err(), "the library refuses it too");
}

#[test]
fn points_that_have_no_place_at_rest_are_refused() {
    let place = "point 17: expected a blend of canonical transforms that has an inverse";
    refused_by_both("body.rest", 0, place, |c| scale(c, "weights", 51..54, 0.0));
    refused_by_both("body.rest", 0, place, |c| scale(c, "weights", 51..54, 1e-5));
    refused_by_both("body.rest", 0, place, |c| scale(c, "weights", 51..54, 1e5));
    let flat = "point 0: expected a blend of canonical transforms that has an inverse";
    refused_by_both("body.rest", 0, flat, |c| {
        (0..3).for_each(|b| scale(c, "canonical", 12 * b..12 * b + 4, 0.0))
    });
    for with in [true, false] {
        refused_by_both("body.rest", 0, "array 'weights': expected at least one joint", |c| {
            c.inputs.put("weights", &[280, 0], Vec::<f32>::new());
            match with {
                true => c.inputs.put("canonical", &[0, 3, 4], Vec::<f32>::new()),
                false => drop(c.inputs.0.remove("canonical")),
            };
        });
    }
    let one = [[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]];
    let x = rest::In {
        points: &[[1.0; 3]],
        factors: &[[0.0; 9]],
        weights: &[1.0],
        canonical: Some(&one),
        offsets: None,
    };
    assert!(x.check().is_ok(), "the identity has an inverse");
    for x in [
        rest::In { weights: &[0.0], ..x },
        rest::In { weights: &[], ..x },
        rest::In { weights: &[], canonical: Some(&[]), ..x },
    ] {
        assert!(x.check().is_err(), "{x:?}");
    }
    assert!(rest::In { canonical: None, ..x }.check().is_ok(), "where rest is canonical nothing is inverted");
}

fn set(call: &mut Call, key: &str, value: f64) {
    call.settings.insert(key.to_owned(), ops::Setting::Number(value));
}

#[test]
fn weights_of_0_mask_entries_and_rows_of_a_softmax() {
    // the largest logit has no weight: before, both exponentials were divided by a sum of 0
    for (logits, base, want) in [
        ([200.0_f32, 0.0], [0.0_f32, 1.0], [0.0, 1.0]),
        ([-200.0, 0.0], [0.5, 0.0], [1.0, 0.0]),
        ([200.0, 200.0], [0.25, 0.75], [0.25, 0.75]),
        // no entry has a weight: 0, and no gradient
        ([200.0, -200.0], [0.0, 0.0], [0.0, 0.0]),
    ] {
        let op = ops::find("nn.softmax").expect("on the list");
        let inputs = Arrays::new().with("x", &[1, 2], logits.to_vec()).with("base", &[1, 2], base.to_vec());
        let mut call = Call { inputs, ..Call::default() };
        call.cotangents.put("y", &[1, 2], vec![1.0_f32, -1.0]);
        for ran in [ops::run(op, &call), ops::run_f64(op, &call)].map(|ran| ran.expect("it runs")) {
            assert_eq!(ran.outputs.need("y").expect("there").to_f64(), want, "{logits:?} with {base:?}");
            let bar = ran.gradients.need("x").expect("there").to_f64();
            let slope = 2.0 * want[0] * want[1];
            assert_eq!(bar, [slope, -slope], "{logits:?} with {base:?}");
        }
    }
    refused("nn.softmax", 0, "array 'base': entry 6", |c| scale(c, "base", 6..7, -1.0));
    refused("nn.softmax", 0, "array 'base': row 0", |c| scale(c, "base", 0..3, 3e38));
    refused("nn.softmax", 0, "setting floor", |c| set(c, "floor", -0.5));
    refused("nn.softmax", 0, "setting floor", |c| set(c, "floor", 1e39));
    refused("nn.softmax", 0, "array 'x': expected at least one column", |c| {
        ["x", "base"].iter().for_each(|name| c.inputs.put(name, &[21, 0], Vec::<f32>::new()));
    });
}

#[test]
fn settings_are_numbers_in_f32() {
    for (key, values) in [
        ("reach", [0.0, 1e-60, 1e39]),
        ("radius", [0.0, 1e-30, 1e20]),
        ("color", [-1.0, 1e39, -1e-3]),
        ("solid", [-1.0, 1e39, -1e-3]),
    ] {
        for value in values {
            refused("loss.prior", 0, &format!("setting {key}"), |c| set(c, key, value));
        }
    }
    refused("loss.presence", 0, "setting scale_weight", |c| set(c, "scale_weight", 1e39));
    refused("loss.presence", 0, "'scales_log': entry 4", |c| {
        c.inputs.put("scales_log", &[21, 3], (0..63).map(|i| if i == 4 { 89.0_f32 } else { 0.5 }).collect());
    });
    refused("shade.gain", 0, "'gain': entry 1", |c| c.inputs.put("gain", &[3], vec![0.0_f32, 89.0, 0.0]));
}

#[test]
fn a_prior_of_nothing_is_0() {
    let w =
        prior::Weights { color: 1.0, round: 1.0, fill: 1.0, anchor: 1.0, solid: 1.0, ..prior::Weights::NONE };
    let none = prior::In::<6> {
        means: &[],
        scales_log: &[],
        opacity_logits: &[],
        sh: &[],
        coefficients: 1,
        near: &[],
        gap: &[],
        anchors: &[],
        radius: 1.0,
    };
    assert_eq!(prior::forward(&w, &none), 0.0, "no Gaussian");
    let alone = prior::In::<0> {
        means: &[[1.0, 0.0, 0.0]],
        scales_log: &[[0.0; 3]],
        opacity_logits: &[0.0],
        sh: &[0.5; 3],
        coefficients: 1,
        near: &[[]],
        gap: &[0.0],
        anchors: &[[0.0; 3]],
        radius: 1.0,
    };
    assert_eq!(prior::forward(&w, &alone), 0.5, "no neighbour: 1² of the anchor less ½ of the opacity");
}

#[test]
fn what_is_not_a_number_stays_none() {
    let layers =
        [mlp::Layer { weight: &[1.0], bias: &[f32::NAN] }, mlp::Layer { weight: &[1.0], bias: &[0.0] }];
    let x = mlp::In { x: &[1.0], layers: &layers, m: 1, skip: None };
    let (y, saved) = mlp::forward(&x);
    assert!(y[0].is_nan(), "a hidden unit that is NaN: {y:?}");
    let mut bar = mlp::InBar::of_layers(&x);
    mlp::adjoint(&x, &saved, &[1.0], &mut bar);
    assert!(bar.layers[1][0][0].is_nan(), "{bar:?}");
    let x = diffuse::In { sh: &[0.0; 3], normals: &[[f32::NAN; 3]], toward: [1.0; 3] };
    let (colors, shades) = diffuse::forward(&x);
    assert!(shades[0].is_nan() && colors[0].iter().all(|c| c.is_nan()), "{shades:?} {colors:?}");
    let y = softmax::forward(&softmax::In { x: &[f32::NAN, 0.0], base: &[], floor: 0.0, k: 2 });
    assert!(y.iter().all(|y| y.is_nan()), "{y:?}");
}

#[test]
fn empty_and_endless_shapes_are_refused() {
    for (h, w) in [(5, 0), (0, 7)] {
        refused("shade.gain", 0, "array 'image': expected at least one pixel", |c| {
            c.inputs.put("image", &[h, w, 3], Vec::<f32>::new());
            c.inputs.put("alpha", &[h, w], Vec::<f32>::new());
        });
    }
    refused("nn.conv", 0, "array 'x': expected at least one channel", |c| {
        c.inputs.put("x", &[2, 8, 10, 0], Vec::<f32>::new());
        c.inputs.put("weight", &[5, 4, 4, 0], Vec::<f32>::new());
    });
    refused("causal.held", 0, "array 'members'", |c| c.inputs.put("members", &[], vec![i32::MAX]));
}

#[test]
#[should_panic(expected = "three channels per pixel")]
fn a_coverage_of_another_size_is_no_coverage() {
    over_black::forward(&[1.0; 3], [0.5; 3], &mut [0.0; 12]);
}

#[test]
#[should_panic(expected = "three channels per pixel")]
fn a_cotangent_of_another_size_is_no_cotangent() {
    over_black::alpha_adjoint([0.5; 3], &[0.0; 12], &mut [0.0; 3]);
}

#[test]
#[should_panic(expected = "complete rows")]
fn rows_of_no_pixels_make_up_no_image() {
    let x = gain::In { alpha: &[1.0; 2], background: [0.5; 3], gain: [0.0; 3] };
    gain::adjoint(&x, &[0.0; 6], 0, &mut [0.0; 6], &mut [0.0; 2]);
}

#[test]
#[should_panic(expected = "all arrays have the same length")]
fn halves_of_other_lengths_are_no_halves() {
    latent::forward(&[latent::Half { x: &[1.0, 2.0], real: &[1.0], spread: &[1.0, 1.0] }]);
}

#[test]
#[should_panic(expected = "one label per group")]
fn groups_without_a_label_have_no_code() {
    code::forward(&code::In { labels: &[1.0], target: &[0, 0], values: &[1.0], k: 1 });
}

#[test]
#[should_panic(expected = "skip is a layer after the first")]
fn the_first_layer_does_not_take_the_input_again() {
    let layers = [mlp::Layer { weight: &[1.0, 1.0], bias: &[0.0] }];
    mlp::forward(&mlp::In { x: &[1.0], layers: &layers, m: 1, skip: Some(0) });
}
