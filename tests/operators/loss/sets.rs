//! Points and groups.

use lastlight::loss::groups::{self, SPREAD, VARIANCE_FLOOR};
use lastlight::loss::points::{self, Plan, Sigmas};

const UNIT: Sigmas = Sigmas { xyz: 1.0, rgb: 0.5 };

fn pair<'a>(x: &'a [f32], y: &'a [f32], batch: usize, channels: [usize; 2]) -> points::In<'a> {
    points::In { x, y, batch, channels, sigmas: UNIT }
}

#[test]
fn ordered_points_cost_their_mean_weighted_square() {
    // 3² + 4² in space; a quarter in one colour, in units of a half
    let (x, y) = ([3.0, 0.0, 4.0, 0.5, 0.5, 0.75], [0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
    assert_eq!(points::ordered(&pair(&x, &y, 1, [6, 6])).expect("a value"), 25.25, "both parts");
    assert_eq!(points::ordered(&pair(&x, &y[..3], 1, [6, 3])).expect("a value"), 25.0, "no colours");
    let twice: Vec<f32> = x.iter().chain(&y).copied().collect();
    let targets: Vec<f32> = y.iter().chain(&y).copied().collect();
    assert_eq!(points::ordered(&pair(&twice, &targets, 2, [6, 6])).expect("a value"), 12.625, "two items");
    let mut bar = [1.0_f32; 6];
    points::adjoint(&pair(&x, &y[..3], 1, [6, 3]), None, 2.0, &mut bar, None).expect("gradients");
    assert_eq!(bar, [13.0, 1.0, 17.0, 1.0, 1.0, 1.0], "added to what is there; none for colours");
}

#[test]
fn equally_near_points_go_to_the_lowest_index() {
    let x = [0.0, 0.0, 0.0, 5.0, 0.0, 0.0];
    let y = [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let sets = pair(&x, &y, 1, [3, 3]);
    let plan = points::plan(&sets).expect("a plan");
    assert_eq!(plan, Plan { nearest_x: vec![0, 1], nearest_y: vec![0, 0, 0] }, "nearest");
    // (1 + 16)/2 + (1 + 1 + 1)/3
    assert_eq!(points::chamfer(&sets, &plan).expect("a value"), 9.5, "value");
    let e = points::ordered(&sets).expect_err("numbers differ").to_string();
    assert!(e.contains("Chamfer"), "{e}");
    let wrong = Plan { nearest_x: vec![0, 3], ..plan };
    let e = points::chamfer(&sets, &wrong).expect_err("no such row").to_string();
    assert!(e.contains("nearest_x"), "{e}");
}

#[test]
fn points_that_cannot_be_compared_are_refused() {
    for channels in [[3, 6], [4, 4], [6, 4]] {
        let e = points::ordered(&pair(&[0.0; 12], &[0.0; 12], 1, channels)).expect_err("refused");
        assert!(e.to_string().contains("3 or 6"), "{channels:?}: {e}");
    }
    let e = points::ordered(&pair(&[0.0; 7], &[0.0; 6], 1, [3, 3])).expect_err("refused");
    assert!(e.to_string().contains("'x'"), "{e}");
    for xyz in [0.0, -1.0, f64::NAN, 1e-30] {
        let sets = points::In { sigmas: Sigmas { xyz, rgb: 1.0 }, ..pair(&[0.0; 3], &[0.0; 3], 1, [3, 3]) };
        let e = points::ordered(&sets).expect_err("refused").to_string();
        assert!(e.contains("sigma_x"), "{xyz}: {e}");
    }
    assert!(points::ordered(&pair(&[f32::NAN, 0.0, 0.0], &[0.0; 3], 1, [3, 3])).is_err(), "no number");
}

/// Two groups for factor 0, one for factor 1; two members, two factors of one number.
fn three(after: &[f64; 12]) -> groups::In<'_> {
    groups::In {
        after,
        eps: &[0.5; 12],
        eps_after: &[0.5; 12],
        target: &[0, 1, 0],
        variance: &[0.0, 4.0],
        given: None,
        members: 2,
        factors: 2,
        size: 1,
    }
}

#[test]
fn groups_by_hand() {
    // values of the groups: 0.5, 3, 1.5; factor 0 spreads by ½, more than a quarter
    let after = [0.0, 9.0, 1.0, 9.0, 9.0, 2.0, 9.0, 4.0, 1.5, 9.0, 1.5, 9.0];
    let out = groups::forward(&three(&after)).expect("losses");
    assert_eq!(out.shared, [0.5, 3.0, 1.5], "values");
    assert_eq!(out.invariant, 0.0, "no cause changed");
    assert_eq!(out.spread, 0.0, "factor 1 has one group and is left out");
    let floor = VARIANCE_FLOOR;
    assert_eq!(out.equal, (0.5 / floor + 2.0 / 4.0) / 6.0, "the floor of the variance holds");
    // closer together: V = (0.2)²/2
    let after = [0.5, 9.0, 0.5, 9.0, 9.0, 2.0, 9.0, 4.0, 0.7, 9.0, 0.7, 9.0];
    let x = three(&after);
    let out = groups::forward(&x).expect("losses");
    assert!((out.spread - (SPREAD - 0.02)).abs() < 1e-15, "lacking spread: {}", out.spread);
    let mut bar = groups::InBar::zeros_like(&x);
    let only_spread = groups::Out { spread: 1.0, shared: vec![0.0; 3], ..groups::Out::default() };
    groups::adjoint(&x, &out, &only_spread, &mut bar);
    // dV/dv = ±0.2, shared by two members, drives the values apart
    let want = [0.1, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, -0.1, 0.0, -0.1, 0.0];
    for (i, (got, want)) in bar.after.iter().zip(want).enumerate() {
        assert!((got - want).abs() < 1e-15, "entry {i}: {got}");
    }
}

#[test]
fn given_values_are_what_members_are_held_to() {
    let after = [0.0, 9.0, 1.0, 9.0, 9.0, 2.0, 9.0, 4.0, 1.5, 9.0, 1.5, 9.0];
    let given = [0.25, 3.0, 0.25];
    let x = groups::In { given: Some(&given), ..three(&after) };
    let x = groups::In { variance: &[1.0, 4.0], ..x };
    let out = groups::forward(&x).expect("losses");
    assert_eq!(out.shared, given, "not the means 0.5, 3, 1.5");
    // (0.25² + 0.75²) + 2·1.25² in the units of factor 0, (1 + 1)/4 of factor 1
    assert_eq!(out.equal, (0.0625 + 0.5625 + 3.125 + 0.5) / 6.0, "distances from what was given");
    assert_eq!(out.spread, SPREAD, "two equal values do not vary");
    let mut bar = groups::InBar::zeros_like(&x);
    let cotangent = groups::Out { equal: 3.0, shared: vec![0.0, 0.0, 7.0], ..groups::Out::default() };
    groups::adjoint(&x, &out, &cotangent, &mut bar);
    let want = [-0.25, 0.0, 0.75, 0.0, 0.0, -0.25, 0.0, 0.25, 1.25, 0.0, 1.25, 0.0];
    assert_eq!(bar.after, want, "towards what was given; nothing of the value's own gradient");
    assert_eq!(bar.given, [-0.5, 0.0, -2.5 + 7.0], "the opposite, and the value's own");
    let e = groups::forward(&groups::In { given: Some(&[1.0]), ..x }).expect_err("too few").to_string();
    assert!(e.contains("'given'"), "{e}");
}

#[test]
fn one_factor_has_no_others() {
    let x = groups::In {
        after: &[1.0, 2.0],
        eps: &[0.0, 0.0],
        eps_after: &[3.0, 4.0],
        target: &[0, 0],
        variance: &[1.0],
        given: None,
        members: 1,
        factors: 1,
        size: 1,
    };
    let out = groups::forward(&x).expect("losses");
    assert_eq!((out.invariant, out.equal, out.spread), (0.0, 0.0, 0.0), "nothing to compare");
    let mut bar = groups::InBar::zeros_like(&x);
    let ones = groups::Out { equal: 1.0, invariant: 1.0, spread: 1.0, shared: vec![0.0; 2] };
    groups::adjoint(&x, &out, &ones, &mut bar);
    assert_eq!(bar, groups::InBar::zeros_like(&x), "no gradient");
    let e = groups::forward(&groups::In { target: &[0, 1], ..x }).expect_err("no such factor").to_string();
    assert!(e.contains("entry 1"), "{e}");
    let e = groups::forward(&groups::In { target: &[], ..x }).expect_err("empty").to_string();
    assert!(e.contains("at least one group"), "{e}");
}
