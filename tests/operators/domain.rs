//! Where operators are defined: inputs that have no result are refused by name, in both precisions and by the twin alone.

use lastlight::body::{pose, rest};
use lastlight::num::array::Arrays;
use lastlight::ops::{self, Call, Op};
use lastlight::oracle::run::{self, Precision};
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
