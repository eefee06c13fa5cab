//! Input that is refused, and settings that are left out.

use super::full_call;
use lastlight::Error;
use lastlight::num::array::Arrays;
use lastlight::ops::{self, Call, Setting};
use lastlight::oracle::run::{self, Precision};

#[test]
fn bad_input_is_refused_with_its_place() {
    let render = ops::find("splat.render").expect("on the list");
    let good = (render.case)(0);
    let call = |spoil: &dyn Fn(&mut Call)| {
        let mut call =
            Call { inputs: good.inputs.clone(), settings: good.settings.clone(), ..Call::default() };
        spoil(&mut call);
        let single = ops::run(render, &call).expect_err("f32 refuses it");
        let double = ops::run_f64(render, &call).expect_err("f64 refuses it");
        assert_eq!(single.to_string(), double.to_string(), "both refuse alike");
        assert_eq!(single.exit_code(), 2, "bad input");
        single.to_string()
    };
    let set = |call: &mut Call, name: &str, i: usize, x: f64| {
        let a = call.inputs.need(name).expect("there");
        let (shape, mut values) = (a.shape().to_vec(), a.to_f64());
        values[i] = x;
        call.inputs.put(name, &shape, values);
    };
    type Case<'a> = (&'static str, &'a dyn Fn(&mut Call));
    let cases: &[Case<'_>] = &[
        ("'means': index [1, 2]", &|c| set(c, "means", 5, f64::NAN)),
        ("'means': index [0, 0]", &|c| set(c, "means", 0, f64::INFINITY)),
        ("'means'", &|c| c.inputs.put("means", &[3, 4], vec![0.0_f32; 12])),
        ("'quats'", &|c| c.inputs.put("quats", &[2, 4], vec![1.0_f32; 8])),
        ("row 2", &|c| (8..12).for_each(|i| set(c, "quats", i, 0.0))),
        ("'opacities': entry 3", &|c| set(c, "opacities", 3, 1.5)),
        ("'scales': entry 4", &|c| set(c, "scales", 4, -0.125)),
        ("'width'", &|c| set(c, "width", 0, 36.5)),
        ("image size", &|c| set(c, "width", 0, 0.0)),
        ("image size", &|c| set(c, "height", 0, 1e6)),
        ("focal length", &|c| set(c, "intrinsics", 0, -1.0)),
        ("'near'", &|c| set(c, "near", 0, -1.0)),
        ("sh_degree", &|c| set(c, "sh_degree", 0, 3.0)),
        ("'background'", &|c| drop(c.inputs.0.remove("background"))),
        ("quats and scales, or factors", &|c| drop(c.inputs.0.remove("scales"))),
        ("sh and sh_degree, or rgb", &|c| drop(c.inputs.0.remove("sh_degree"))),
        ("'colour'", &|c| c.inputs.put("colour", &[], vec![1.0])),
        ("setting alpha_max", &|c| drop(c.settings.insert("alpha_max".into(), ops::Setting::Number(1.0)))),
        ("setting camera", &|c| {
            drop(c.settings.insert("camera".into(), ops::Setting::Text("panini".into())))
        }),
        ("setting colour", &|c| drop(c.settings.insert("colour".into(), ops::Setting::Number(1.0)))),
        ("'color_bar'", &|c| c.cotangents.put("color", &[], vec![1.0])),
    ];
    for (place, spoil) in cases {
        let text = call(spoil);
        assert!(text.contains(place), "expected {place:?} in: {text}");
    }
    let unknown =
        run::sort(render, Arrays::new().with("colour", &[], vec![1.0])).expect_err("an unknown name");
    assert!(unknown.to_string().contains("'colour'"), "{unknown}");
    assert!(
        ops::find("splat.rendr").is_err() && ops::choose(&["x".to_owned()]).is_err(),
        "unknown operators"
    );
}

#[test]
fn bad_causal_input_is_refused_with_its_place() {
    type Spoil = fn(&mut Call);
    let cases: &[(&str, usize, &str, Spoil)] = &[
        ("causal.acyclic", 0, "'alpha'", |c| c.inputs.put("alpha", &[], vec![0.0])),
        ("causal.mask", 0, "'uniform': entry 3", |c| c.inputs.put("uniform", &[4, 4], near_one())),
        ("causal.structure", 0, "w0 b0 w1 b1 w2", |c| drop(c.inputs.0.remove("w1"))),
        ("causal.structure", 1, "setting mode", |c| drop(c.settings.remove("mode"))),
        ("causal.structure", 0, "'w0'", |c| c.inputs.put("w0", &[3, 4, 5], vec![0.5; 60])),
        ("causal.posterior_kl", 0, "'logvar': entry 0", |c| {
            c.inputs.put("logvar", &[5, 4, 4], vec![701.0; 80])
        }),
        ("causal.scm_kl", 0, "setting mode", |c| drop(c.inputs.0.remove("eps"))),
        ("causal.scm_kl", 1, "'kept': entry 0", |c| c.inputs.put("kept", &[3, 2], vec![0.5; 6])),
        ("causal.intervene", 0, "'target': entry 0", |c| c.inputs.put("target", &[8], vec![3_i32; 8])),
        ("causal.independence", 0, "setting ridge", |c| {
            drop(c.settings.insert("ridge".into(), ops::Setting::Number(-1.0)));
        }),
        ("causal.independence", 2, "'mask' and 'weight'", |c| drop(c.inputs.0.remove("mask"))),
        ("causal.independence", 1, "positive definite", |c| {
            let indefinite = |at: usize| if at / 8 == at % 8 { -9.0 } else { 0.0 };
            c.inputs.put("carried", &[8, 8], (0..64).map(indefinite).collect());
        }),
    ];
    for (name, case, place, spoil) in cases {
        let op = ops::find(name).expect("on the list");
        let mut call = full_call(op, *case);
        spoil(&mut call);
        for precision in [Precision::F32, Precision::F64] {
            let e = run::call(op, &call, precision).expect_err(place);
            assert_eq!(e.exit_code(), 2, "{name}: bad input");
            assert!(e.to_string().contains(place), "{name} {precision:?}: expected {place:?} in: {e}");
        }
    }
}

/// A matrix whose entry 3 is no noise between 0 and 1.
fn near_one() -> Vec<f64> {
    (0..16).map(|at| if at == 3 { 1.0 } else { 0.5 }).collect()
}

#[test]
fn a_cotangent_must_have_the_shape_of_its_output() {
    for op in ops::LIST.iter().filter(|op| op.adjoint) {
        let mut call = full_call(op, 0);
        let name = call.cotangents.0.keys().next().expect("an output").clone();
        call.cotangents.put(&name, &[1, 2, 3, 4, 5], vec![0.0_f32; 120]);
        for precision in [Precision::F32, Precision::F64] {
            let e: Error = run::call(op, &call, precision).expect_err("the shape is wrong");
            assert!(e.to_string().contains(&name), "{e}");
        }
    }
}

#[test]
fn both_sides_have_the_defaults_of_the_signature() {
    let mut defaults = 0;
    for op in ops::LIST {
        for spec in op.settings.iter().filter(|spec| !spec.default.contains(' ')) {
            // the first case that the default suits
            let without = |case: usize| {
                let made = (op.case)(case);
                let mut call = Call { inputs: made.inputs, settings: made.settings, ..Call::default() };
                call.settings.remove(spec.key);
                ops::run(op, &call).is_ok().then_some(call)
            };
            let mut call = (0..op.cases).find_map(without).expect("some case runs with the default");
            let of =
                |call: &Call| [ops::run(op, call), ops::run_f64(op, call)].map(|ran| ran.expect("it runs"));
            let without = of(&call);
            let default =
                spec.default.parse().map_or(Setting::Text(spec.default.to_owned()), Setting::Number);
            call.settings.insert(spec.key.to_owned(), default);
            assert!(of(&call) == without, "{}: the default of {} is not {}", op.name, spec.key, spec.default);
            defaults += 1;
        }
    }
    assert!(defaults > 30, "{defaults} defaults were compared");
}
