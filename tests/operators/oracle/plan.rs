//! Plans that are passed in.

use super::full_call;
use lastlight::ops::{self, Call};
use lastlight::oracle::compare;
use lastlight::oracle::run::{self, Precision};

#[test]
fn a_plan_given_back_changes_no_bit() {
    let mut with_plan = 0;
    for op in ops::LIST {
        for case in 0..op.cases {
            let call = full_call(op, case);
            for precision in [Precision::F32, Precision::F64] {
                let free = run::call(op, &call, precision).expect("a generated case runs");
                let frozen = Call { plan: Some(free.plan.clone()), ..call.clone() };
                let again = run::call(op, &frozen, precision)
                    .unwrap_or_else(|e| panic!("{} case {case}: {e}", op.name));
                assert_eq!(free, again, "{} case {case} {precision:?}", op.name);
                with_plan += usize::from(!free.plan.0.is_empty());
            }
        }
    }
    assert!(with_plan >= 20, "some operators have plans: {with_plan}");
}

#[test]
fn either_precision_uses_the_plan_of_the_other() {
    for op in ops::LIST {
        for case in 0..op.cases {
            let call = full_call(op, case);
            let double = run::call(op, &call, Precision::F64).expect("runs");
            let frozen = Call { plan: Some(double.plan.clone()), ..call.clone() };
            let single = run::call(op, &frozen, Precision::F32)
                .unwrap_or_else(|e| panic!("{} case {case}: {e}", op.name));
            let report = compare::arrays(&run::gather(&double), &run::gather(&single), Some(op.name), 2e-5)
                .expect("names");
            assert!(report.passed, "{} case {case}\n{report}", op.name);
        }
    }
}

#[test]
fn a_plan_that_contradicts_itself_is_refused() {
    let op = ops::find("splat.render").expect("on the list");
    let call = full_call(op, 0);
    let plan = ops::run(op, &call).expect("runs").plan;
    let spoil = |name: &str, how: &dyn Fn(&mut Vec<i64>)| {
        let mut plan = plan.clone();
        let array = plan.need(name).expect("in the plan");
        let (shape, mut values) = (array.shape().to_vec(), array.to_i64().expect("whole"));
        how(&mut values);
        plan.put(name, &shape, values);
        ops::run(op, &Call { plan: Some(plan), ..call.clone() })
    };
    type Case<'a> = (&'static str, &'a dyn Fn(&mut Vec<i64>));
    let cases: [Case<'_>; 8] = [
        ("order", &|v| v[0] = 1000),
        ("order", &|v| v[0] = v[1]),
        ("camera_start", &|v| v[1] = 1000),
        ("tile_start", &|v| v[1] = -1),
        ("tile_entry", &|v| v[0] = -1),
        ("entry_slot", &|v| v[0] = v[1]),
        ("t_clamp", &|v| v[0] = 2),
        ("alpha_mask", &|v| v[0] = 256),
    ];
    for (name, how) in cases {
        let e = spoil(name, how).expect_err("it contradicts itself");
        assert!(e.to_string().contains(name), "{e}");
    }
    let mut short = plan.clone();
    short.0.remove("last_index");
    assert!(ops::run(op, &Call { plan: Some(short), ..call.clone() }).is_err(), "a plan has all its arrays");
}
