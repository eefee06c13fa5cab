//! `oracle run | compare | mint | list` and `gradcheck` on files: golden arrays of other programs, plans that freeze, the
//! first operator at which two files part, bytes that do not move, and input that is refused.

use crate::common::golden;
use lastlight::num::array::{Array, Arrays};
use lastlight::ops::{self, Call, Compare, Op, Setting};
use lastlight::oracle::run::Precision;
use lastlight::oracle::{compare, list, mint, run};
use lastlight::{Error, io::npz};

/// A file's arrays as a call.
fn sorted(op: &'static Op, arrays: &Arrays, profile: Option<&str>) -> Call {
    let mut sorted = run::sort(op, arrays.clone()).unwrap_or_else(|e| panic!("{e}"));
    run::add_settings(op, &mut sorted.call.settings, profile, &[]).unwrap_or_else(|e| panic!("{e}"));
    Call { dump: true, ..sorted.call }
}

fn run_file(op: &'static Op, arrays: &Arrays, profile: Option<&str>, precision: Precision) -> Arrays {
    let call = sorted(op, arrays, profile);
    run::gather(&run::call(op, &call, precision).unwrap_or_else(|e| panic!("{e}")))
}

/// Bounds on the relative L2 of outputs (and intermediates) and of gradients, for f64 and for f32.
struct Bounds {
    f64: [f64; 2],
    f32: [f64; 2],
}

const SPLAT: Bounds = Bounds { f64: [1e-10, 1e-8], f32: [2e-6, 2e-5] };
const OTHER: Bounds = Bounds { f64: [1e-12, 1e-12], f32: [2e-6, 2e-6] };
/// Computed in f64 in runs of either precision; a run in f32 rounds what it reads and what it writes, each once.
const CAUSAL: Bounds = Bounds { f64: [1e-12, 1e-10], f32: [6e-8, 6e-8] };
/// Thirteen convolutions in f32: an output near 0 may pass in one precision and not in the other.
const LPIPS: Bounds = Bounds { f64: [1e-12, 1e-10], f32: [2e-6, 2e-5] };
const SHADE: Bounds = Bounds { f64: [1e-12, 1e-10], f32: [2e-6, 2e-5] };

fn check_golden(name: &str, op: &str, profile: Option<&str>, bounds: &Bounds) {
    let Some(theirs) = golden(name) else { return };
    let op = ops::find(op).expect("on the list");
    let mut runs = vec![
        ("F64", run_file(op, &theirs, profile, Precision::F64), bounds.f64),
        ("F32", run_file(op, &theirs, profile, Precision::F32), bounds.f32),
    ];
    if op.width == ops::Width::F64 {
        // the shipped operator by itself, from inputs in f64
        let call = sorted(op, &theirs, profile);
        let checked = ops::Checked::new(op, &call, false).unwrap_or_else(|e| panic!("{e}"));
        runs.push((
            "shipped",
            run::gather(&(op.run)(&checked).unwrap_or_else(|e| panic!("{e}"))),
            bounds.f64,
        ));
    }
    for (precision, ours, [values, gradients]) in runs {
        let single = |a: &Array| matches!(a, Array::F32(_));
        if precision == "F32" {
            let wide: Vec<_> = ours.0.iter().filter(|(_, a)| a.is_float() && !single(a)).collect();
            assert!(wide.is_empty(), "{name}: f32 runs give f32 arrays, not {wide:?}");
        }
        let report = compare::arrays(&theirs, &ours, Some(op.name), f64::INFINITY).expect("names in common");
        let mut compared = 0;
        for a in &report.arrays {
            let bound = if a.name.ends_with("_bar") { gradients } else { values };
            println!(
                "{name} {precision} {:<14} relative L2 {:.2e} (at most {bound:.0e}), worst {} ulp",
                a.name, a.relative_l2, a.worst_ulp
            );
            assert_eq!(a.verdict, compare::Verdict::Agrees, "{name} {precision} {}: {:?}", a.name, a.worst);
            // an array compared in its zeros only has no relative L2 to speak of
            let pattern = op.port(&a.name).is_some_and(|p| p.compare == Compare::ZeroPattern);
            assert!(
                pattern || a.relative_l2 <= bound,
                "{name} {precision} {}: {:.3e} > {bound:e}",
                a.name,
                a.relative_l2
            );
            compared += 1;
        }
        // everything the file has that is not an input, a setting or a cotangent was compared
        let is_result = |n: &str| {
            let is = |ports: &[ops::Port], n: &str| ports.iter().any(|p| p.name == n);
            let bar = n.strip_suffix("_bar");
            if bar.is_some_and(|y| is(op.outputs, y)) {
                return false; // a cotangent
            }
            is(op.outputs, n)
                || is(op.intermediates, n)
                || bar.is_some_and(|x| op.inputs.iter().any(|p| p.name == x && p.differentiable))
        };
        assert_eq!(
            compared,
            theirs.0.keys().filter(|n| is_result(n)).count(),
            "{name}: arrays of {:?}",
            theirs.0.keys()
        );
    }
}

#[test]
fn golden_splat_random() {
    check_golden("splat_random", "splat.render", Some("gsplat"), &SPLAT);
}

#[test]
fn golden_splat_hard() {
    check_golden("splat_hard", "splat.render", Some("gsplat"), &SPLAT);
}

#[test]
fn golden_splat_garden() {
    check_golden("splat_garden", "splat.render", Some("gsplat"), &SPLAT);
}

#[test]
fn golden_nn_linear() {
    check_golden("nn_linear", "nn.linear", None, &OTHER);
}

#[test]
fn golden_nn_leaky_relu() {
    check_golden("nn_leaky_relu", "nn.leaky_relu", None, &OTHER);
}

#[test]
fn golden_nn_conv() {
    check_golden("nn_conv", "nn.conv", None, &OTHER);
}

#[test]
fn golden_loss_ssim() {
    check_golden("loss_ssim", "loss.ssim", None, &OTHER);
}

#[test]
fn golden_causal_acyclic() {
    check_golden("causal_acyclic", "causal.acyclic", None, &CAUSAL);
}

#[test]
fn golden_causal_structure() {
    check_golden("causal_structure", "causal.structure", None, &CAUSAL);
}

#[test]
fn golden_causal_posterior_kl() {
    check_golden("causal_posterior_kl", "causal.posterior_kl", None, &CAUSAL);
}

#[test]
fn golden_causal_independence() {
    check_golden("causal_independence", "causal.independence", None, &CAUSAL);
}

#[test]
fn golden_loss_lpips() {
    check_golden("loss_lpips", "loss.lpips", None, &LPIPS);
}

#[test]
fn golden_optim_adamw() {
    check_golden("optim_adamw", "optim.adamw", None, &OTHER);
}

#[test]
fn golden_shade_ggx() {
    check_golden("shade_ggx", "shade.ggx", None, &SHADE);
}

#[test]
fn golden_shade_envmap() {
    check_golden("shade_envmap", "shade.envmap", None, &SHADE);
}

/// A generated case as a call with cotangents and everything dumped.
fn full_call(op: &'static Op, case: usize) -> Call {
    let made = (op.case)(case);
    let mut call = Call { inputs: made.inputs, settings: made.settings, dump: true, ..Call::default() };
    let first = ops::run(op, &call).unwrap_or_else(|e| panic!("{e}"));
    if op.adjoint {
        call.cotangents = ops::draw_cotangents(op, &first.outputs);
    }
    call
}

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
fn either_precision_obeys_the_plan_of_the_other() {
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

#[test]
fn run_writes_outputs_plan_and_digests_and_the_digests_are_those_of_the_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str| folder.path().join(name);
    let op = ops::find("splat.render").expect("on the list");
    let mut arrays = mint::golden(op, 0).expect("a case");
    arrays.put("width", &[], vec![36.0_f32]); // integers may come as floats
    npz::write(&file("in.npz"), &arrays).expect("written");
    let mut options = run::Options {
        op: op.name.to_owned(),
        input: file("in.npz"),
        out: file("out.npz"),
        ..Default::default()
    };
    options.dump = true;
    let mut said = Vec::new();
    let report = run::run(&options, &mut |line| said.push(line.to_owned())).expect("runs");
    assert!(said.iter().any(|s| s == "ignored 'image': an output"), "notes: {said:?}");
    assert!(said.iter().any(|s| s == "ignored 'means_bar': the gradient of an input"), "notes: {said:?}");
    let (out, plan) =
        (npz::read(&file("out.npz")).expect("written"), npz::read(&file("out.plan.npz")).expect("written"));
    for name in [
        "image",
        "alpha",
        "depth",
        "means_bar",
        "quats_bar",
        "sh_bar",
        "background_bar",
        "counts",
        "conics",
        "colors",
    ] {
        let digest = lastlight::num::bits::digest(out.need(name).expect("there")).expect("no NaN");
        assert_eq!(report.arrays[name].digest, format!("{digest:016x}"), "{name}");
    }
    assert_eq!(plan.0.len(), 11, "every array of the plan: {:?}", plan.0.keys());
    let text = std::fs::read_to_string(file("out.digest.json")).expect("written");
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["digest"], report.digest, "the file says what the report says");
    // again, frozen, in f64 with the estimate said first
    options.plan = Some(file("out.plan.npz"));
    options.precision = Precision::F64;
    options.out = file("out64.npz");
    said.clear();
    run::run(&options, &mut |line| said.push(line.to_owned())).expect("runs");
    assert!(said.iter().any(|s| s.contains(" pairs, ")), "the estimate: {said:?}");
    assert!(
        matches!(npz::read(&file("out64.npz")).expect("written").get("image"), Some(Array::F64(_))),
        "f64 in, f64 out"
    );
    let both = compare::Options {
        theirs: file("out64.npz"),
        ours: file("out.npz"),
        op: None,
        tol: 2e-5,
        html: Some(file("c.html")),
    };
    let report = compare::compare(&both).expect("compares");
    assert!(report.passed && report.operator == Some("splat.render"), "{report}");
    let page = std::fs::read_to_string(file("c.html")).expect("written");
    assert!(
        page.contains("data:image/png;base64,") && !page.contains("http"),
        "self-contained, with pictures"
    );
}

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
        report.parting.map(|p| p.stage)
    };
    let after = ["image", "alpha", "means_bar", "quats_bar", "sh_bar", "opacities_bar"];
    let with = |first: &[&'static str]| first.iter().chain(&after).copied().collect::<Vec<_>>();
    assert_eq!(stage(&[]), None, "equal files");
    assert_eq!(stage(&with(&["conics"])), Some("splat.project"), "a wrong ellipse");
    assert_eq!(stage(&with(&["means_px", "colors"])), Some("splat.project"), "the earlier of two");
    assert_eq!(stage(&with(&["colors"])), Some("splat.color"), "a wrong colour");
    assert_eq!(stage(&after), Some("splat.blend"), "all inputs of blending agree");
    assert_eq!(stage(&after[2..]), Some("splat.blend adjoint"), "the picture agrees");
    assert_eq!(stage(&["sh_bar", "means_bar"]), Some("splat.color adjoint"), "opacities agree");
    assert_eq!(stage(&["quats_bar"]), Some("splat.project adjoint"), "everything else agrees");
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
    let verdict = |theirs: &Arrays, ours: &Arrays| {
        let report = compare::arrays(theirs, ours, None, 1e-5).expect("compares");
        assert!(!report.passed, "{report}");
        report.arrays[0].verdict.clone()
    };
    let flat = Arrays::new().with("y", &[4], vec![1.0_f32, 0.0, 2.0, -4.0]);
    assert_eq!(verdict(&theirs, &flat), compare::Verdict::ShapesDiffer, "shapes");
    let nan = Arrays::new().with("y", &[2, 2], vec![1.0_f32, f32::NAN, 2.0, -4.0]);
    assert_eq!(verdict(&theirs, &nan), compare::Verdict::Nan, "NaN in ours");
    assert_eq!(verdict(&nan, &nan), compare::Verdict::Nan, "NaN in both is no agreement");
    let off = Arrays::new().with("y", &[2, 2], vec![1.0_f32, 0.0, 2.0, -4.1]);
    assert_eq!(verdict(&theirs, &off), compare::Verdict::Differs, "beyond the tolerance");
    assert!(
        compare::arrays(&theirs, &Arrays::new().with("z", &[], vec![1.0]), None, 1e-5).is_err(),
        "nothing in common"
    );
}

#[test]
fn mint_gives_the_same_bytes_twice_and_its_files_can_be_fed_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    let first = mint::mint(&[], &a, &mut |_| {}).expect("minted");
    let second = mint::mint(&[], &b, &mut |_| {}).expect("minted");
    assert_eq!(first.files.len(), ops::LIST.iter().fold(0, |n, op| n + op.cases), "a file per case");
    for (x, y) in first.files.iter().zip(&second.files) {
        assert!(
            std::fs::read(x).expect("written") == std::fs::read(y).expect("written"),
            "{} differs",
            x.display()
        );
    }
    for op in ops::LIST {
        for case in 0..op.cases {
            let file = npz::read(&a.join(format!("{}_{case}.npz", op.name))).expect("minted");
            let double = run_file(op, &file, None, Precision::F64);
            let same = compare::arrays(&file, &double, Some(op.name), 0.0).expect("names");
            assert!(same.passed, "{} case {case}: f64 is what was minted\n{same}", op.name);
            let single =
                compare::arrays(&file, &run_file(op, &file, None, Precision::F32), Some(op.name), 2e-5)
                    .expect("names");
            assert!(single.passed, "{} case {case}: f32\n{single}", op.name);
        }
    }
}

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
        ("picture size", &|c| set(c, "width", 0, 0.0)),
        ("picture size", &|c| set(c, "height", 0, 1e6)),
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

#[test]
fn the_list_prints_and_serialises_every_operator() {
    let text = list::list().to_string();
    let json = serde_json::to_value(list::list()).expect("JSON");
    let shown = json["operators"].as_array().expect("a list");
    assert_eq!(shown.len(), ops::LIST.len(), "all of them");
    for (op, value) in ops::LIST.iter().zip(shown) {
        assert!(text.contains(op.name), "{} in the text", op.name);
        assert_eq!(value["name"], op.name, "in order");
        assert_eq!(value["inputs"].as_array().map(Vec::len), Some(op.inputs.len()), "{}", op.name);
    }
    assert!(text.contains("optim.adam  (no adjoint)"), "operators without adjoint say so");
}
