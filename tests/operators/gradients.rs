//! Gradient checks of every operator of the list: rungs R0 to R4 on every generated case; negative controls;
//! checks of functions given as closures; checks that have nothing to check.

use lastlight::check::{self, Evaluation, Options, Sabotage, Sabotaged, Subject, Values};
use lastlight::ops::{self, OpSubject};
use lastlight::{Error, Result};

fn subject(op: &'static ops::Op, case: usize) -> OpSubject {
    OpSubject::case(op, case).unwrap_or_else(|e| panic!("{} case {case}: {e}", op.name))
}

#[test]
fn every_operator_passes_every_rung_on_every_case() {
    let mut failed = Vec::new();
    for op in ops::LIST {
        for case in 0..op.cases {
            let report = check::run(&subject(op, case), &Options::default())
                .unwrap_or_else(|e| panic!("{}: {e}", op.name));
            let rungs: Vec<_> = report.rungs.iter().map(|r| r.name).collect();
            let expected: &[&str] = if op.adjoint { &["R0", "R1", "R2", "R3", "R4"] } else { &["R0", "R4"] };
            assert_eq!(rungs, expected, "{}: the rungs that ran", op.name);
            println!("{report}");
            if !report.passed() {
                failed.push(report.to_string());
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn every_operator_is_tested_and_has_a_twin() {
    for op in ops::LIST {
        assert!(op.cases > 0, "{} has no generated case", op.name);
        assert!(reference::twins::names().contains(&op.name), "{} has no twin", op.name);
        let mut seen = std::collections::BTreeSet::new();
        for case in (0..op.cases).filter(|_| op.adjoint) {
            seen.extend(subject(op, case).variables().iter().map(|v| v.name.clone()));
        }
        for port in op.inputs.iter().filter(|p| op.adjoint && p.differentiable) {
            assert!(seen.contains(port.name), "{}: no case differentiates by {}", op.name, port.name);
        }
    }
    for name in reference::twins::names() {
        assert!(ops::find(name).is_ok(), "twin {name} has no operator");
    }
}

#[test]
fn a_sabotaged_adjoint_fails_r4_for_every_operator_and_every_input() {
    let only_r4 = Options { rungs: [false, false, false, false, true], ..Options::default() };
    let (mut controls, mut inputs) = (0, 0);
    for op in ops::LIST.iter().filter(|op| op.adjoint) {
        let mut left: Vec<&str> = op.inputs.iter().filter(|p| p.differentiable).map(|p| p.name).collect();
        inputs += left.len();
        for case in 0..op.cases {
            let honest = subject(op, case);
            let known = honest.prediction().expect("it predicts");
            for variable in honest.variables() {
                // a gradient of 0 throughout cannot be broken by a factor
                if known.unread.contains(&variable.name) {
                    continue;
                }
                let Some(place) = left.iter().position(|name| *name == variable.name) else { continue };
                left.swap_remove(place);
                for how in Sabotage::ALL {
                    let sabotaged = Sabotaged { inner: &honest, variable: &variable.name, how };
                    let report = check::run(&sabotaged, &only_r4).expect("the run itself works");
                    assert!(!report.passed(), "not caught: {}", sabotaged.name());
                    controls += 1;
                }
            }
        }
        assert!(left.is_empty(), "{}: no control of {left:?}", op.name);
    }
    println!("{controls} sabotaged adjoints caught");
    assert_eq!(controls, 3 * inputs, "three for every differentiable input of every operator");
}

/// f(x, a) = Σ a² sin x, as a user would write it.
fn waves(x: &Values) -> Result<Vec<f64>> {
    let a = x["a"][0];
    Ok(x["x"].iter().map(|x| a * a * libm::sin(*x)).collect())
}

fn waves_vjp(x: &Values, y_bar: &[f64]) -> Result<Values> {
    let a = x["a"][0];
    let by_x = x["x"].iter().zip(y_bar).map(|(x, g)| g * a * a * libm::cos(*x)).collect();
    let by_a = x["x"].iter().zip(y_bar).fold(0.0, |s, (x, g)| s + g * 2.0 * a * libm::sin(*x));
    Ok([("x".to_owned(), by_x), ("a".to_owned(), vec![by_a])].into())
}

fn waves_inputs() -> Values {
    [("x".to_owned(), vec![0.3, -1.1, 2.2, 0.9]), ("a".to_owned(), vec![1.7])].into()
}

#[test]
fn a_users_function_with_the_right_gradient_passes() {
    let report =
        check::function("waves", waves, waves_vjp, &waves_inputs(), &Options::default()).expect("it runs");
    assert!(report.passed(), "{report}");
    assert_eq!(
        report.rungs.iter().map(|r| r.name).collect::<Vec<_>>(),
        ["R0", "R1", "R3"],
        "the rungs of a closure"
    );
}

#[test]
fn a_users_function_with_a_wrong_gradient_fails() {
    let wrong = |how: fn(&mut Values)| {
        let vjp = move |x: &Values, y_bar: &[f64]| {
            let mut grads = waves_vjp(x, y_bar)?;
            how(&mut grads);
            Ok(grads)
        };
        check::function("waves", waves, vjp, &waves_inputs(), &Options::default()).expect("it runs")
    };
    type Case = (&'static str, fn(&mut Values));
    let cases: [Case; 5] = [
        ("one sign", |g| g.get_mut("x").unwrap()[2] *= -1.0),
        ("a millionth", |g| g.get_mut("a").unwrap()[0] *= 1.000_01),
        ("a forgotten factor", |g| g.get_mut("x").unwrap().iter_mut().for_each(|x| *x /= 1.7)),
        ("a missing input", |g| drop(g.remove("a"))),
        ("a NaN", |g| g.get_mut("x").unwrap()[0] = f64::NAN),
    ];
    for (what, how) in cases {
        let report = wrong(how);
        assert!(!report.passed(), "{what} was not caught:\n{report}");
    }
}

#[test]
fn differences_are_taken_only_where_decisions_are_equal() {
    // f = x where x < 1, else x + 1: smooth on either side of a jump that sits in the middle of the second
    // entry's step
    let jump = 1.0 + 1e-9;
    let value = |x: &Values| {
        let x = &x["x"];
        let decide = |x: f64| u64::from(x >= jump);
        let outputs = x.iter().map(|x| x + decide(*x) as f64).collect();
        let log = x.iter().fold(0, |log, x| 2 * log + decide(*x));
        Ok(Evaluation { outputs: [("y".to_owned(), outputs)].into(), log })
    };
    let vjp = |_: &Values, y_bar: &Values| Ok([("x".to_owned(), y_bar["y"].clone())].into());
    let mut inputs: Values = [("x".to_owned(), vec![0.25; 30])].into();
    inputs.get_mut("x").unwrap()[1] = 1.0;
    let options = Options { entries: 30, directions: 0, ..Options::default() };
    let report = check::function_with_log("step", value, vjp, &inputs, &options).expect("it runs");
    let r3 = report.rung("R3").expect("the rung ran");
    let skipped = r3.measures.iter().find(|m| m.what.starts_with("skipped")).expect("it counts");
    assert_eq!(skipped.value, 1.0, "the entry at the jump:\n{report}");
    assert!(r3.passed(), "the others agree:\n{report}");
}

#[test]
fn a_check_that_sees_nothing_fails() {
    let inputs: Values = [("x".to_owned(), vec![1.0, 2.0])].into();
    let zero = |x: &Values, _: &[f64]| Ok([("x".to_owned(), vec![0.0; x["x"].len()])].into());
    let flat = check::function("flat", |_| Ok(vec![0.5, 0.5, 0.5]), zero, &inputs, &Options::default());
    assert!(!flat.expect("it runs").passed(), "a constant function has no gradient to check");
    // an empty image: all Gaussians behind the camera
    let op = ops::find("splat.render").expect("it is on the list");
    let ops::Case { mut inputs, settings } = (op.case)(0);
    let n = inputs.get("means").expect("an input").shape()[0];
    inputs.put("means", &[n, 3], [0.1_f32, 0.2, -30.0].repeat(n));
    let empty = OpSubject::new(op, "empty image".to_owned(), inputs, settings, Default::default())
        .expect("valid input");
    let report = check::run(&empty, &Options::default()).expect("it runs");
    assert!(!report.rung("R0").expect("the rung ran").passed(), "nothing was drawn:\n{report}");
    // all-zero cotangents
    let op = ops::find("nn.linear").expect("it is on the list");
    let ops::Case { inputs, settings } = (op.case)(0);
    let zeros = lastlight::num::array::Arrays::new().with("y", &[3, 2], vec![0.0_f32; 6]);
    let silent =
        OpSubject::new(op, "zero cotangent".to_owned(), inputs, settings, zeros).expect("valid input");
    assert!(!check::run(&silent, &Options::default()).expect("it runs").passed(), "all gradients are zero");
}

#[test]
fn an_error_of_a_users_function_comes_back() {
    let bad = |_: &Values| Err(Error::input("mine").got("no"));
    let e =
        check::function("mine", bad, waves_vjp, &waves_inputs(), &Options::default()).expect_err("it fails");
    assert_eq!(e.to_string(), "mine: no", "unchanged");
}
