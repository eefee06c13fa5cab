//! `oracle run`, `mint` and `list`: what they write and print.

use super::run_file;
use lastlight::io::npz;
use lastlight::num::array::Array;
use lastlight::ops;
use lastlight::oracle::run::{self, Precision};
use lastlight::oracle::{compare, list, mint};

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
    let notes: Vec<&String> = said.iter().filter(|s| s.starts_with("ignored")).collect();
    assert!(notes.len() == 1 && notes[0].contains("outputs alpha, depth, image"), "one line: {said:?}");
    assert!(notes[0].contains("gradients ") && notes[0].contains("means_bar"), "gradients: {said:?}");
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
    assert_eq!(json["digest"], report.digest, "the file matches the report");
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
        yours: file("out.npz"),
        reference: file("out64.npz"),
        op: None,
        tol: 2e-5,
        present_only: false,
    };
    let report = compare::compare(&both).expect("compares").report;
    assert!(report.passed && report.operator == Some("splat.render"), "{report}");
}

#[test]
fn mint_gives_the_same_bytes_twice_and_its_files_can_be_fed_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    let first =
        mint::mint(&mint::Options { out: a.clone(), ..Default::default() }, &mut |_| {}).expect("minted");
    let second =
        mint::mint(&mint::Options { out: b.clone(), ..Default::default() }, &mut |_| {}).expect("minted");
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
fn the_list_prints_and_serialises_every_operator() {
    let text = list::show(&[]).expect("all").to_string();
    let json = serde_json::to_value(list::list(&[]).expect("all")).expect("JSON");
    let shown = json["operators"].as_array().expect("a list");
    assert_eq!(shown.len(), ops::LIST.len(), "all of them");
    for (op, value) in ops::LIST.iter().zip(shown) {
        assert!(text.contains(op.name), "{} in the text", op.name);
        assert_eq!(value["name"], op.name, "in order");
        assert_eq!(value["inputs"].as_array().map(Vec::len), Some(op.inputs.len()), "{}", op.name);
    }
    assert!(text.contains("optim.adam  (no adjoint)"), "operators without adjoint are marked");
    let lines = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
        list::list(&names).map(|list| list.to_string().lines().count())
    };
    assert_eq!(lines(&[]).expect("all"), ops::LIST.len(), "one line each");
    assert_eq!(lines(&["nn.linear", "loss.l1"]).expect("two"), 2, "by name");
    let of_optim = ops::LIST.iter().filter(|op| op.name.starts_with("optim.")).count();
    assert_eq!(lines(&["optim"]).expect("a group"), of_optim, "by group");
    assert!(lines(&["opt"]).is_err(), "neither a name nor a group");
}
