//! `oracle compare`: measures, results, and the first stage that differs.

use super::full_call;
use lastlight::num::array::Arrays;
use lastlight::ops;
use lastlight::oracle::compare;
use lastlight::oracle::run::{self, Precision};

/// `reference` with entries of some arrays multiplied by 1.01.
fn spoiled(reference: &Arrays, names: &[&str]) -> Arrays {
    let mut yours = reference.clone();
    for name in names {
        let a = reference.need(name).expect("there");
        yours.put(name, a.shape(), a.to_f64().into_iter().map(|x| 1.01 * x).collect());
    }
    yours
}

#[test]
fn compare_names_the_first_operator_that_differs() {
    let op = ops::find("splat.render").expect("on the list");
    let reference = run::gather(&run::call(op, &full_call(op, 0), Precision::F64).expect("runs"));
    let stage = |names: &[&str]| {
        let report = compare::arrays(&spoiled(&reference, names), &reference, None, compare::TOLERANCE)
            .expect("compares");
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
    let report =
        compare::arrays(&spoiled(&reference, &["quats_bar"]), &reference, None, 1e-5).expect("compares");
    let quats = report.array("quats_bar").expect("compared");
    assert!((quats.relative_l2() - 0.01).abs() < 1e-9 && quats.worst.len() == 10, "{report}");
    assert_eq!(quats.note.as_deref(), Some("yours = 1.01 × reference"), "a multiple is named");
}

#[test]
fn compare_measures_what_it_says() {
    let yours = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, 2.0, -4.0]);
    let next = f32::from_bits(1.0_f32.to_bits() + 3);
    let reference = Arrays::new().with("y", &[2, 2], vec![next, 0.0, 2.0, -4.0]);
    let report = compare::arrays(&yours, &reference, None, 1e-5).expect("compares");
    let y = report.array("y").expect("compared");
    let m = y.measures.as_ref().expect("measured");
    assert_eq!((m.worst_ulp, m.mean_ulp), (3, 0.75), "three steps in one of four");
    assert_eq!(m.zeros.both, 1, "one zero in both");
    assert_eq!(y.worst[0].index, [0, 0], "where");
    let agreement = |yours: &Arrays, reference: &Arrays| {
        let report = compare::arrays(yours, reference, None, 1e-5).expect("compares");
        assert!(!report.passed, "{report}");
        report.arrays[0].agreement
    };
    let flat = Arrays::new().with("y", &[4], vec![1.0_f32, 0.0, 2.0, -4.0]);
    assert_eq!(agreement(&yours, &flat), compare::Agreement::ShapesDiffer, "shapes");
    let nan = Arrays::new().with("y", &[2, 2], vec![1.0_f32, f32::NAN, 2.0, -4.0]);
    assert_eq!(agreement(&yours, &nan), compare::Agreement::Nan, "NaN in reference");
    assert_eq!(agreement(&nan, &nan), compare::Agreement::Nan, "NaN in both is no match");
    let off = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, 2.0, -4.1]);
    assert_eq!(agreement(&yours, &off), compare::Agreement::Differs, "beyond the tolerance");
    assert!(
        compare::arrays(&yours, &Arrays::new().with("z", &[], vec![1.0]), None, 1e-5).is_err(),
        "nothing in common"
    );
}

#[test]
fn a_gradient_that_alone_differs_is_a_backward_pass_and_nans_are_counted() {
    let op = ops::find("nn.linear").expect("on the list");
    let reference = run::gather(&run::call(op, &full_call(op, 0), Precision::F64).expect("runs"));
    let report = compare::arrays(&spoiled(&reference, &["weight_bar"]), &reference, Some("nn.linear"), 1e-9)
        .expect("compares");
    let divergence = report.divergence.as_ref().expect("a stage");
    assert_eq!(
        (&*divergence.stage, &*divergence.outputs),
        ("nn.linear adjoint", &["weight_bar".to_owned()][..])
    );
    assert!(report.to_string().contains("first diverging stage: nn.linear, backward pass."), "{report}");

    let yours = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, f32::NAN, f32::NAN]);
    let reference = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, 2.0, f32::NAN]);
    let report = compare::arrays(&yours, &reference, None, 1e-5).expect("compares");
    let nans = report.arrays[0].nans.clone().expect("some");
    assert_eq!((nans.yours, nans.reference, nans.first), (2, 1, vec![1, 0]), "owner, count, index");
    assert!(report.to_string().contains("2 in yours, 1 in reference, first at [1, 0]"), "{report}");
}

/// Outputs and gradients of the first case of `nn.linear`.
fn linear() -> Arrays {
    let op = ops::find("nn.linear").expect("on the list");
    run::gather(&run::call(op, &full_call(op, 0), Precision::F64).expect("runs"))
}

#[test]
fn missing_and_unknown_arrays_fail_and_are_named() {
    let reference = linear();
    let renamed = |names: &[(&str, &str)]| {
        let mut yours = reference.clone();
        for (from, to) in names {
            let array = yours.0.remove(*from).expect("there");
            if !to.is_empty() {
                yours.0.insert((*to).to_owned(), array);
            }
        }
        yours
    };
    let report =
        |names: &[(&str, &str)]| compare::arrays(&renamed(names), &reference, None, 1e-9).expect("compares");
    let missing = report(&[("weight_bar", "")]);
    assert!(!missing.passed && missing.missing.yours == ["weight_bar"], "{missing}");
    assert!(missing.to_string().contains("missing in yours: weight_bar"), "{missing}");
    assert_eq!(missing.summary(), "1 missing", "in a few words");
    for name in ["w_bar", "dW", "grad_weight", "Weight_bar", "weigth_bar"] {
        let unknown = report(&[("weight_bar", name)]);
        assert!(!unknown.passed && unknown.unknown.len() == 1, "{unknown}");
        let text = format!("unknown name in yours: {name} (did you mean weight_bar?)");
        assert!(unknown.to_string().contains(&text), "{unknown}");
    }
    // The operator is found although its only output has another name.
    let output = report(&[("y", "out")]);
    assert!(!output.passed && output.operator == Some("nn.linear"), "{output}");
    assert_eq!(output.unknown[0].did_you_mean.as_deref(), Some("y"), "the only one that is missing");
    // The other way round, and without an operator.
    let reverse = compare::arrays(&reference, &renamed(&[("y", "")]), None, 1e-9).expect("compares");
    assert!(!reverse.passed && reverse.missing.reference == ["y"], "{reverse}");
    let [a, b] = [&["p"][..], &["p", "q"]]
        .map(|names| names.iter().fold(Arrays::new(), |a, name| a.with(name, &[1], vec![1.0])));
    let plain = compare::arrays(&a, &b, None, 1e-9).expect("compares");
    assert!(!plain.passed && plain.missing.yours == ["q"] && plain.operator.is_none(), "{plain}");
    // Inputs, cotangents and settings may be in one file only.
    let op = ops::find("nn.linear").expect("on the list");
    let golden = lastlight::oracle::mint::golden(op, 0).expect("a case");
    let whole = compare::arrays(&golden, &reference, Some("nn.linear"), 1e-9).expect("compares");
    assert!(whole.passed && whole.only_yours.contains(&"x".to_owned()), "{whole}");
}

#[test]
fn what_cannot_be_measured_is_null_with_a_reason() {
    let reference = linear();
    let weight = reference.need("weight_bar").expect("there");
    let [rows, columns] = *weight.shape() else { panic!("a matrix") };
    let values = weight.to_f64();
    let transposed = (0..columns).flat_map(|c| (0..rows).map(move |r| r * columns + c)).map(|i| values[i]);
    let mut y = reference.need("y").expect("there").to_f64();
    y[3] = f64::NAN;
    let mut yours = reference.clone();
    yours.put("weight_bar", &[columns, rows], transposed.collect());
    yours.put("y", &[3, 2], y);
    let report = compare::arrays(&yours, &reference, None, 1e-9).expect("compares");
    let json = serde_json::to_value(&report).expect("JSON");
    let find = |name: &str| {
        let arrays = json["arrays"].as_array().expect("a list");
        arrays.iter().find(|a| a["name"] == name).expect("compared").clone()
    };
    let (y, weight) = (find("y"), find("weight_bar"));
    assert!(y["measures"].is_null() && y["agreement"] == "nan", "{y}");
    assert_eq!(y["nans"]["first"], serde_json::json!([1, 1]), "where");
    assert_eq!(y["reason"], "1 in yours, 0 in reference, first at [1, 1]", "why");
    assert!(weight["measures"].is_null() && weight["agreement"] == "shapes_differ", "{weight}");
    assert_eq!(weight["note"], "yours is the transpose of the reference", "what it is");
    assert_eq!(find("x_bar")["measures"]["relative_l2"], 0.0, "the others are measured");
}

#[test]
fn errors_are_yours_minus_reference_relative_to_the_reference() {
    let of = |values: Vec<f64>| Arrays::new().with("y", &[3], values);
    let report = compare::arrays(&of(vec![4.0, 0.0, 3.0]), &of(vec![1.0, 0.0, 2.0]), None, 1e-5);
    let report = report.expect("compares");
    let m = report.arrays[0].measures.as_ref().expect("measured");
    assert_eq!(m.signed_bias, 4.0 / 3.0, "Σ(yours − reference) / Σ|reference|");
    assert!((m.relative_l2 - 2.0_f64.sqrt()).abs() < 1e-15, "√10 / √5: {}", m.relative_l2);
    assert!(report.to_string().contains("[0]: yours 4e0, reference 1e0, 9.007e15 ulp"), "{report}");
}

#[test]
fn differing_inputs_are_named_where_no_stage_can_be() {
    let op = ops::find("nn.linear").expect("on the list");
    let reference = lastlight::oracle::mint::golden(op, 0).expect("a case");
    let report =
        compare::arrays(&spoiled(&reference, &["x", "y"]), &reference, None, 1e-9).expect("compares");
    assert!(report.divergence.is_none() && report.differing_inputs == ["x"], "{report}");
    assert!(
        report.to_string().contains("The inputs differ: x. Run both programs on the same inputs"),
        "{report}"
    );
}
