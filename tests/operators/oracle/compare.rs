//! `oracle compare`: measures, results, and the first stage that differs.

use super::full_call;
use lastlight::num::array::Arrays;
use lastlight::ops;
use lastlight::oracle::compare;
use lastlight::oracle::run::{self, Precision};

/// `ours` with entries of some arrays multiplied by 1.01.
fn spoiled(ours: &Arrays, names: &[&str]) -> Arrays {
    let mut theirs = ours.clone();
    for name in names {
        let a = ours.need(name).expect("there");
        theirs.put(name, a.shape(), a.to_f64().into_iter().map(|x| 1.01 * x).collect());
    }
    theirs
}

#[test]
fn compare_names_the_first_operator_that_differs() {
    let op = ops::find("splat.render").expect("on the list");
    let ours = run::gather(&run::call(op, &full_call(op, 0), Precision::F64).expect("runs"));
    let stage = |names: &[&str]| {
        let report =
            compare::arrays(&spoiled(&ours, names), &ours, None, compare::TOLERANCE).expect("compares");
        assert_eq!(report.passed, names.is_empty(), "{report}");
        let divergence = report.divergence?;
        let text = divergence.to_string();
        assert!(!text.contains(" adjoint") && text.contains("Differs: "), "{text}");
        assert_eq!(divergence.stage.ends_with(" adjoint"), text.contains(", backward pass."), "{text}");
        Some(divergence.stage)
    };
    let after = ["image", "alpha", "means_bar", "quats_bar", "sh_bar", "opacities_bar"];
    let with = |first: &[&'static str]| first.iter().chain(&after).copied().collect::<Vec<_>>();
    assert_eq!(stage(&[]).as_deref(), None, "equal files");
    assert_eq!(stage(&with(&["conics"])).as_deref(), Some("splat.project"), "a wrong ellipse");
    assert_eq!(stage(&with(&["means_px", "colors"])).as_deref(), Some("splat.project"), "the earlier of two");
    assert_eq!(stage(&with(&["colors"])).as_deref(), Some("splat.color"), "a wrong colour");
    assert_eq!(stage(&after).as_deref(), Some("splat.blend"), "all inputs of blending agree");
    assert_eq!(stage(&after[2..]).as_deref(), Some("splat.blend adjoint"), "the picture agrees");
    assert_eq!(stage(&["sh_bar", "means_bar"]).as_deref(), Some("splat.color adjoint"), "opacities agree");
    assert_eq!(stage(&["quats_bar"]).as_deref(), Some("splat.project adjoint"), "everything else agrees");
    let report = compare::arrays(&spoiled(&ours, &["quats_bar"]), &ours, None, 1e-5).expect("compares");
    let quats = report.array("quats_bar").expect("compared");
    assert!((quats.relative_l2 - 0.01 / 1.01).abs() < 1e-9 && quats.worst.len() == 10, "{report}");
}

#[test]
fn compare_measures_what_it_says() {
    let theirs = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, 2.0, -4.0]);
    let next = f32::from_bits(1.0_f32.to_bits() + 3);
    let ours = Arrays::new().with("y", &[2, 2], vec![next, 0.0, 2.0, -4.0]);
    let report = compare::arrays(&theirs, &ours, None, 1e-5).expect("compares");
    let y = report.array("y").expect("compared");
    assert_eq!((y.worst_ulp, y.mean_ulp), (3, 0.75), "three steps in one of four");
    assert_eq!(y.zeros.both, 1, "one zero in both");
    assert_eq!(y.worst[0].index, [0, 0], "where");
    let agreement = |theirs: &Arrays, ours: &Arrays| {
        let report = compare::arrays(theirs, ours, None, 1e-5).expect("compares");
        assert!(!report.passed, "{report}");
        report.arrays[0].agreement.clone()
    };
    let flat = Arrays::new().with("y", &[4], vec![1.0_f32, 0.0, 2.0, -4.0]);
    assert_eq!(agreement(&theirs, &flat), compare::Agreement::ShapesDiffer, "shapes");
    let nan = Arrays::new().with("y", &[2, 2], vec![1.0_f32, f32::NAN, 2.0, -4.0]);
    assert_eq!(agreement(&theirs, &nan), compare::Agreement::Nan, "NaN in ours");
    assert_eq!(agreement(&nan, &nan), compare::Agreement::Nan, "NaN in both is no agreement");
    let off = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, 2.0, -4.1]);
    assert_eq!(agreement(&theirs, &off), compare::Agreement::Differs, "beyond the tolerance");
    assert!(
        compare::arrays(&theirs, &Arrays::new().with("z", &[], vec![1.0]), None, 1e-5).is_err(),
        "nothing in common"
    );
}

#[test]
fn a_gradient_that_alone_differs_is_a_backward_pass_and_nans_are_counted() {
    let op = ops::find("nn.linear").expect("on the list");
    let ours = run::gather(&run::call(op, &full_call(op, 0), Precision::F64).expect("runs"));
    let report =
        compare::arrays(&spoiled(&ours, &["weight_bar"]), &ours, Some("nn.linear"), 1e-9).expect("compares");
    let divergence = report.divergence.as_ref().expect("a stage");
    assert_eq!(
        (&*divergence.stage, &*divergence.outputs),
        ("nn.linear adjoint", &["weight_bar".to_owned()][..])
    );
    assert!(report.to_string().contains("first diverging stage: nn.linear, backward pass."), "{report}");

    let theirs = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, f32::NAN, f32::NAN]);
    let ours = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, 2.0, f32::NAN]);
    let report = compare::arrays(&theirs, &ours, None, 1e-5).expect("compares");
    let nans = report.arrays[0].nans.clone().expect("some");
    assert_eq!((nans.theirs, nans.ours, nans.first), (2, 1, vec![1, 0]), "owner, count, index");
    assert!(report.to_string().contains("2 in theirs, 1 in ours, first at [1, 0]"), "{report}");
}
