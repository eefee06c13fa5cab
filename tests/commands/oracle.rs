//! `oracle` and `gradcheck` from the shell: exit codes, suggestions, and a user-supplied program.

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
    for (command, part) in [
        (&["oracle", "list", "nn.lin"][..], "did you mean nn.linear?"),
        (&["oracle", "show", "ssim"], "a similar value exists: 'loss.ssim'"),
        (&["oracle", "show", "loss"], "'loss' is a group: `lastlight oracle list loss`"),
        (&["oracle", "list", "gemm"], "operators, or groups of them: splat, geometry, nn,"),
    ] {
        let (code, _, err) = lastlight(command);
        assert!(code == 2 && err.contains(part), "{command:?}: {err}");
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

#[test]
fn a_missing_array_fails_a_comparison_and_its_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    assert_eq!(lastlight(&["oracle", "mint", "loss.ssim", "nn.linear", "--out", &path("g")]).0, 0, "mint");
    for op in ["loss.ssim", "nn.linear"] {
        let (file, out) = (path(&format!("g/{op}_0.npz")), path(&format!("{op}.npz")));
        let (code, _, err) = lastlight(&["oracle", "run", op, "--in", &file, "--out", &out]);
        let notes = err.lines().filter(|l| l.starts_with("ignored")).count();
        assert!(code == 0 && notes == 1, "what is not used is one line: {err}");
    }
    // The names fit three losses; the file of digests next to the reference tells which.
    let (code, out, _) =
        lastlight(&["oracle", "compare", &path("g/loss.ssim_0.npz"), &path("loss.ssim.npz")]);
    assert!(code == 0 && out.starts_with("loss.ssim, "), "{out}");
    let mut mine = npz::read(Path::new(&path("g/nn.linear_0.npz"))).expect("minted");
    let weight = mine.0.remove("weight_bar").expect("a gradient");
    mine.0.insert("w_bar".to_owned(), weight);
    npz::write(Path::new(&path("mine.npz")), &mine).expect("written");
    let compare = |more: &[&str]| {
        let (mine, reference) = (path("mine.npz"), path("nn.linear.npz"));
        lastlight(&[&["oracle", "compare", &mine, &reference][..], more].concat())
    };
    let (code, out, err) = compare(&["--html", &path("page.html")]);
    assert!(code == 1 && out.contains("missing in yours: weight_bar"), "{out}");
    assert!(out.contains("unknown name in yours: w_bar (did you mean weight_bar?)"), "{out}");
    assert!(err.contains("got 1 missing, 1 of unknown name (--present-only"), "{err}");
    let page = std::fs::read_to_string(path("page.html")).expect("written");
    assert!(page.contains("<h1>nn.linear: 1 missing, 1 of unknown name</h1>"), "the title of the page");
    assert!(page.contains("Missing in yours: weight_bar"), "the page");
    let (code, out, _) = compare(&["--present-only"]);
    assert!(code == 0 && out.contains("missing in yours: weight_bar"), "accepted and listed: {out}");
}

/// A script that writes what it reads, with another name for some arrays: `cp` for an `.npz`.
#[cfg(unix)]
#[test]
fn a_program_with_missing_or_unknown_arrays_fails() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let case = Arrays::new().with("x", &[2, 3], vec![0.5; 6]).with("w", &[3], vec![0.25; 3]).with(
        "y_bar",
        &[2, 3],
        vec![1.0; 6],
    );
    npz::write(Path::new(&path("in.npz")), &case).expect("written");
    // The program writes what `write` holds, whatever its inputs.
    let check = |write: &Arrays, wrt: &[&str]| {
        npz::write(Path::new(&path("fixed.npz")), write).expect("written");
        std::fs::write(path("fixed.sh"), format!("cp '{}' \"$2\"\n", path("fixed.npz"))).expect("written");
        let options = gradcheck::Options {
            exec: Some(format!("sh {}", path("fixed.sh"))),
            input: Some(path("in.npz").into()),
            seed: 1,
            wrt: wrt.iter().map(|n| (*n).to_owned()).collect(),
            ..gradcheck::Options::default()
        };
        gradcheck::run(&options, &mut |_| {})
    };
    let y = || Arrays::new().with("y", &[2, 3], vec![0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
    let x = || y().with("x_bar", &[2, 3], vec![1.0; 6]);
    let failed = |write: &Arrays, parts: &[&str]| {
        let report = check(write, &[]).expect("it runs");
        let text = report.to_string();
        assert!(!report.passed && parts.iter().all(|p| text.contains(p)), "{parts:?}: {text}");
    };
    failed(&x(), &["no gradient of w: OUT.npz contains no w_bar", "--wrt x checks this gradient only"]);
    failed(&x().with("dW", &[3], vec![1.0; 3]), &["unknown name dW in OUT.npz: did you mean w_bar?"]);
    let both = || x().with("w_bar", &[3], vec![1.0; 3]);
    failed(&both().with("q_bar", &[1], vec![1.0]), &["unknown name q_bar in OUT.npz: IN.npz contains no q"]);
    failed(&x().with("w_bar", &[1, 3], vec![1.0; 3]), &["w_bar has shape [1, 3], but w has [3]"]);
    let mut nan = both();
    nan.put("x_bar", &[2, 3], vec![1.0, 1.0, 1.0, 1.0, f64::NAN, 1.0]);
    failed(&nan, &["x_bar[1, 1] is NaN"]);
    let mut upper = both();
    upper.0.remove("y");
    failed(
        &upper.with("Y", &[2, 3], vec![0.1; 6]),
        &["no output y", "unknown name Y in OUT.npz: did you mean y?"],
    );
    // Constant outputs have no gradient: the entries are named by their index along each axis.
    failed(&both(), &["x[0, ", "x[1, ", ": yours 1e0, finite difference 0e0"]);
    let one = check(&x(), &["x"]).expect("it runs");
    assert!(
        one.checks[0].rung("R3").is_some_and(|r| r.worst.iter().all(|e| e.array == "x")),
        "--wrt x: {one}"
    );
    let e = check(&x(), &["v"]).expect_err("no such input");
    assert!(e.to_string().contains("float arrays of") && e.to_string().contains(": w, x, got 'v'"), "{e}");
    // No cotangent, no output file, no command, no entries.
    let mut bare = case.clone();
    bare.0.remove("y_bar");
    npz::write(Path::new(&path("bare.npz")), &bare).expect("written");
    let run = |args: &[&str]| lastlight(&[&["gradcheck"][..], args].concat());
    for (exec, file, part) in [
        ("true", "bare.npz", "expected the cotangent y_bar of at least one output"),
        (
            "true",
            "in.npz",
            "program 'true': expected a file OUT.npz, got none (it is called as CMD IN.npz OUT.npz",
        ),
        ("", "in.npz", "gradcheck --exec: expected a command"),
        ("no-such-program", "in.npz", "no such file or folder (the command is split at spaces"),
    ] {
        let (code, _, err) = run(&["--exec", exec, "--in", &path(file)]);
        assert!(code == 2 && err.contains(part) && !err.contains("out.npz"), "{exec}: {err}");
    }
    let (code, _, err) = run(&["nn.linear", "--entries", "0"]);
    assert!(code == 2 && err.contains("invalid value '0' for '--entries <N>'"), "{err}");
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
    // The values of R3 are entries of the gradient that the program writes for the file.
    let [input, output] = [path("in.npz"), path("out.npz")];
    npz::write(Path::new(&input), &arrays.clone().with("setting_inria_bwd", &[], vec![1.0]))
        .expect("written");
    let run = ["oracle", "run", "splat.blend", "--precision", "f64", "--in", &input, "--out", &output];
    assert_eq!(lastlight(&run).0, 0, "one run");
    let out = npz::read(Path::new(&output)).expect("arrays");
    let worst = &wrong.checks[0].rung("R3").expect("R3").worst;
    assert!(!worst.is_empty(), "wrong entries: {wrong}");
    for e in worst {
        let array = out.need(&format!("{}_bar", e.array)).expect("a gradient");
        let (shape, values) = (array.shape(), array.to_f64());
        let i = e.index.iter().zip(shape).fold(0, |i, (k, size)| i * size + k);
        assert_eq!(e.value, values[i], "{}{:?}", e.array, e.index);
    }
    let e = check(&arrays, "false").expect_err("a program that fails");
    assert!(e.to_string().contains("exit code 0"), "{e}");
    assert!(check(&arrays, "/nonexistent/program").is_err(), "a program that is not there");
}

/// A case of the list has inputs without a gradient and intermediates; neither stops a check.
#[cfg(unix)]
#[test]
fn a_minted_case_is_checked_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    assert_eq!(lastlight(&["oracle", "mint", "causal.mask", "--out", &path("g")]).0, 0, "mint");
    let binary = env!("CARGO_BIN_EXE_lastlight");
    let script = format!("exec '{binary}' oracle run causal.mask --precision f64 --in \"$1\" --out \"$2\"\n");
    std::fs::write(path("mask.sh"), script).expect("written");
    let command = format!("sh {}", path("mask.sh"));
    let file = path("g/causal.mask_0.npz");
    let (code, out, err) = lastlight(&["gradcheck", "--exec", &command, "--in", &file]);
    assert_eq!(code, 0, "{out}{err}");
    assert!(err.contains("not checked, inputs of causal.mask without a gradient: "), "{err}");
    assert!(out.contains("with y_bar of IN.npz") && out.contains("with random y_bar"), "{out}");
}

#[test]
fn an_operator_is_shown_with_its_equation() {
    let (code, out, _) = lastlight(&["oracle", "show", "loss.mse"]);
    assert!(
        code == 0 && out.contains("\n    loss.mse: ") && out.contains("\n    Kinks and domain\n"),
        "{out}"
    );
    let (_, out, _) = lastlight(&["oracle", "show", "loss.mse", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    let text = json["operators"][0]["text"].as_str().expect("a text");
    assert!(text.starts_with("loss.mse: "), "{text}");
}

#[test]
fn a_comparison_names_factors_and_the_rounding_of_f32() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let reference: Vec<f64> = (1..=64).map(|i| f64::from(i).sqrt()).collect();
    let compare = |yours: &dyn Fn(usize, f64) -> f64| {
        let y = reference.iter().enumerate().map(|(i, x)| yours(i, *x) as f32).collect();
        let shape = [reference.len()];
        npz::write(Path::new(&path("a.npz")), &Arrays::new().with::<f32>("y", &shape, y)).expect("written");
        npz::write(Path::new(&path("b.npz")), &Arrays::new().with("y", &shape, reference.clone()))
            .expect("written");
        let (code, out, _) = lastlight(&["oracle", "compare", &path("a.npz"), &path("b.npz")]);
        assert_eq!(code, 1, "they differ: {out}");
        out
    };
    // Errors of 1.4e-5 with both signs: no factor, and a hint.
    let out = compare(&|i, x| x * (1.0 + if i % 2 == 0 { 1.4e-5 } else { -1.4e-5 }));
    assert!(!out.contains("× reference"), "{out}");
    let last = out.trim_end().lines().last().expect("a line");
    assert_eq!(last, "y: within rounding of f32? --tol 2e-5 is what our own adjoints are held to");
    let out = compare(&|_, x| 0.5 * x);
    assert!(out.contains("(yours = 0.5 × reference)") && !out.contains("rounding of f32"), "{out}");
    assert!(compare(&|_, _| 0.0).contains("(yours is all zero)"));
}
