//! `oracle` and `gradcheck` from the shell: exit codes, and the program of another person.

use lastlight::io::npz;
use lastlight::num::array::Arrays;
use lastlight::oracle::gradcheck;
use std::path::Path;
use std::process::Command;

fn lastlight(args: &[&str]) -> (i32, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_lastlight")).args(args).output().expect("the binary starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

#[test]
fn the_command_line_reports_the_same_with_its_exit_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (code, out, _) = lastlight(&["oracle", "list", "--json"]);
    assert!(code == 0 && serde_json::from_str::<serde_json::Value>(&out).is_ok(), "list: {code}");
    assert_eq!(lastlight(&["oracle", "mint", "nn.linear", "loss.l1", "--out", &path("g")]).0, 0, "mint");
    let file = path("g/nn.linear_0.npz");
    let run = |out: &str, more: &[&str]| {
        let mut args = vec!["oracle", "run", "nn.linear", "--in", &file, "--out", out];
        args.extend(more);
        lastlight(&args)
    };
    assert_eq!(run(&path("a.npz"), &[]).0, 0, "run");
    let (code, _, err) = run(&path("b.npz"), &["--precision", "f64"]);
    assert!(code == 0 && err.contains("30 products"), "the estimate is printed to stderr: {err}");
    assert_eq!(lastlight(&["oracle", "compare", &path("b.npz"), &path("a.npz")]).0, 0, "they agree");
    for input in ["a.npz", "b.npz"] {
        let before = std::fs::read(path(input)).expect("an input");
        let args = ["oracle", "compare", &path("b.npz"), &path("a.npz"), "--html", &path(input)];
        let (code, _, err) = lastlight(&args);
        assert!(code == 2 && err.contains("--html: expected a file other than the inputs"), "{err}");
        assert!(std::fs::read(path(input)).expect("an input") == before, "{input} is as it was");
    }
    let (code, out, err) = lastlight(&["oracle", "compare", &path("b.npz"), &path("a.npz"), "--tol", "0"]);
    assert!(
        code == 1 && out.contains("first diverging stage: nn.linear"),
        "f32 is not f64: {code} {out} {err}"
    );
    assert_eq!(run(&path("c.npz"), &["--set", "lr=1"]).0, 2, "an unknown setting");
    let (code, _, err) =
        lastlight(&["oracle", "run", "nn.linear", "--in", &path("g/loss.l1_0.npz"), "--out", &path("c.npz")]);
    assert!(code == 2 && err.contains("loss.l1_0.npz"), "another operator's file: {err}");
    assert_eq!(
        lastlight(&["oracle", "run", "nope", "--in", &file, "--out", &path("c.npz")]).0,
        2,
        "an unknown operator"
    );
    let (code, out, _) = lastlight(&["gradcheck", "nn.linear", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    assert!(code == 0 && json["passed"] == true, "gradcheck: {code}");
    assert_eq!(
        lastlight(&["gradcheck", "loss.mse", "--in", &path("g/loss.l1_0.npz")]).0,
        0,
        "at user-supplied inputs"
    );
    assert_eq!(lastlight(&["gradcheck"]).0, 2, "nothing to check");
}

#[test]
fn operators_are_listed_shown_and_suggested() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (code, out, _) = lastlight(&["oracle", "list", "splat"]);
    assert!(
        code == 0 && out.lines().all(|l| l.starts_with("splat.")) && out.contains("splat.render"),
        "{out}"
    );
    let (code, out, _) = lastlight(&["oracle", "show", "nn.linear"]);
    assert!(code == 0 && out.contains("weight") && out.contains("bias"), "its arguments: {out}");
    for command in [&["oracle", "show", "splat.rendr"][..], &["gradcheck", "splat.rendr"]] {
        let (code, _, err) = lastlight(command);
        assert!(code == 2 && err.contains("a similar value exists: 'splat.render'"), "{err}");
        assert!(!err.contains("nn.linear"), "the others are not listed: {err}");
    }
    let mint = |out: &str, more: &[&str]| {
        let out = path(out);
        lastlight(&[&["oracle", "mint", "nn.leaky_relu", "--out", &out][..], more].concat())
    };
    assert_eq!(
        (mint("a", &[]).0, mint("b", &["--set", "slope=0.5"]).0),
        (0, 0),
        "with and without a setting"
    );
    let y = |folder: &str| {
        let arrays =
            npz::read(Path::new(&path(folder)).join("nn.leaky_relu_0.npz").as_path()).expect("minted");
        (arrays.0.get("setting_slope").map(|a| a.to_f64()), arrays.need("y").expect("an output").to_f64())
    };
    let (with, without) = (y("b"), y("a"));
    assert!(with.0 == Some(vec![0.5]) && with.1 != without.1, "the setting is written and used: {with:?}");
    assert_eq!(mint("c", &["--set", "nonsense=1"]).0, 2, "an unknown setting");
    assert_eq!(mint("c", &["--profile", "gsplat"]).0, 2, "an operator without profiles");
    // An operator without discrete decisions has no plan.
    let file = path("a/nn.leaky_relu_0.npz");
    assert_eq!(
        lastlight(&["oracle", "run", "nn.leaky_relu", "--in", &file, "--out", &path("o.npz")]).0,
        0,
        "run"
    );
    assert!(
        Path::new(&path("o.digest.json")).is_file() && !Path::new(&path("o.plan.npz")).exists(),
        "no plan"
    );
}

/// A program in the shell, around our own binary: right, and with the gradient that ignores the cap of α.
#[cfg(unix)]
#[test]
fn a_user_supplied_program_is_checked() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let binary = env!("CARGO_BIN_EXE_lastlight");
    let script = format!("exec '{binary}' oracle run splat.blend --precision f64 --in \"$1\" --out \"$2\"\n");
    std::fs::write(path("blend.sh"), script).expect("written");
    // two Gaussians on 4x4 pixels: the nearer one capped everywhere, the other one nowhere
    let arrays = Arrays::new()
        .with("means_px", &[1, 2, 2], vec![1.9, 2.2, 2.3, 1.6])
        .with("shape", &[1, 2, 3], vec![0.2, 0.1, 0.12, -0.3, 0.2, 0.25])
        .with("axis", &[1, 2], vec![0_u8, 1])
        .with("opacities", &[2], vec![0.9, 0.15])
        .with("colors", &[1, 2, 3], vec![0.2, 0.7, 0.4, 0.9, 0.1, 0.3])
        .with("depths_z", &[1, 2], vec![1.5, 2.5])
        .with("background", &[3], vec![0.3, 0.2, 0.6])
        .with("width", &[], vec![4_i64])
        .with("height", &[], vec![4_i64])
        .with("setting_alpha_max", &[], vec![0.25])
        .with("image_bar", &[1, 4, 4, 3], vec![1.0; 48])
        .with("alpha_bar", &[1, 4, 4], vec![1.0; 16])
        .with("depth_bar", &[1, 4, 4], vec![1.0; 16]);
    let options = |command: &str| gradcheck::Options {
        exec: Some(command.to_owned()),
        input: Some(path("in.npz").into()),
        seed: 1,
        ..gradcheck::Options::default()
    };
    let check = |arrays: &Arrays, command: &str| {
        npz::write(Path::new(&path("in.npz")), arrays).expect("written");
        gradcheck::run(&options(command), &mut |_| {})
    };
    let command = format!("sh {}", path("blend.sh"));
    let right = check(&arrays, &command).expect("it runs");
    let mut calls = Vec::new();
    let counted = gradcheck::run(&options(&command), &mut |event| {
        if let gradcheck::Event::Call { done, total } = event {
            calls.push((done, total));
        }
    });
    assert!(counted.expect("it runs").passed, "the same check");
    let (done, total) = *calls.last().expect("calls are reported");
    assert!(
        done == total && calls.len() > 10,
        "the last call is the one that was announced: {done} of {total}"
    );
    assert!(right.passed, "{right}");
    let wrong = check(&arrays.clone().with("setting_inria_bwd", &[], vec![1.0]), &command).expect("it runs");
    assert!(!wrong.passed, "this gradient is not the derivative:\n{wrong}");
    let text = wrong.to_string();
    assert!(
        text.contains(": yours ") && text.contains(", finite difference "),
        "worst entries are labelled: {text}"
    );
    let e = check(&arrays, "false").expect_err("a program that fails");
    assert!(e.to_string().contains("exit code 0"), "{e}");
    assert!(check(&arrays, "/nonexistent/program").is_err(), "a program that is not there");
}
