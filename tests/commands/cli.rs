//! The command line: exit codes, messages, help, JSON, and the rule for existing outputs.

use crate::program::{code, json, lastlight, refused, stderr, stdout};
use lastlight::io::safetensors;
use lastlight::loss::lpips::{CONVOLUTIONS, NO_WEIGHTS, Weights};
use lastlight::num::array::Arrays;
use lastlight::scene::convert::write_scene;
use lastlight::scene::gaussians::Gaussians;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// A ball of 200 coloured Gaussians, in `dir/ball.ply`.
fn write_ball(dir: &Path) {
    let mut g = Gaussians { sh_degree: 0, ..Gaussians::default() };
    for i in 0..200 {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / 200.0;
        let r = (1.0 - z * z).sqrt();
        // A spiral without trigonometry: quarter turns and diagonals are enough for a ball of spots.
        let [x, y] = [
            [1.0, 0.0],
            [0.6, 0.8],
            [0.0, 1.0],
            [-0.8, 0.6],
            [-1.0, 0.0],
            [-0.6, -0.8],
            [0.0, -1.0],
            [0.8, -0.6],
        ][i % 8];
        g.means.push([0.5 * r * x, 0.5 * r * y, 0.5 * z]);
        g.quats.push([1.0, 0.0, 0.0, 0.0]);
        g.scales_log.push([-2.6; 3]);
        g.opacity_logits.push(2.0);
        g.sh.extend([1.2 * x, 1.2 * y, 1.2 * z]);
    }
    write_scene(&dir.join("ball.ply"), &g, &[]).expect("writes");
}

/// The ball, and a capture of it in `dir/capture`.
pub(crate) fn workplace() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_ball(dir.path());
    let args = [
        "splat",
        "render",
        "ball.ply",
        "--cameras",
        "orbit:10",
        "--center",
        "0,0,0",
        "--size",
        "48x40",
        "--out",
        "capture",
        "--json",
    ];
    assert_eq!(json(&args, dir.path())["images"], 10, "ten images");
    dir
}

/// The formula's weights of LPIPS as a file under torchvision's names.
fn write_formula(path: &Path) {
    let formula = Weights::by_formula();
    let mut arrays = Arrays::new();
    for (layer, (at, ..)) in formula.layers.iter().zip(CONVOLUTIONS) {
        let (o, i) = (layer.outputs, layer.inputs);
        let torch = (0..o * i * 9).map(|k| layer.weight[(k / (9 * i) * 9 + k % 9) * i + k / 9 % i]).collect();
        arrays.put::<f32>(&format!("features.{at}.weight"), &[o, i, 3, 3], torch);
        arrays.put(&format!("features.{at}.bias"), &[o], layer.bias.clone());
    }
    for (j, head) in formula.heads.into_iter().enumerate() {
        arrays.put(&format!("lin{j}.model.1.weight"), &[1, head.len(), 1, 1], head);
    }
    safetensors::write(path, &arrays, &BTreeMap::new()).expect("writes");
}

#[test]
fn lpips_needs_weights_and_says_so() {
    let (place, eval) = (workplace(), ["splat", "eval", "ball.ply", "capture", "--split", "all"]);
    let dir = place.path();
    let without = lastlight(&eval, dir);
    assert!(stderr(&without).lines().any(|l| l == NO_WEIGHTS), "{}", stderr(&without));
    assert!(
        !stdout(&without).replace("not LPIPS", "").contains("LPIPS"),
        "no number under that name: {}",
        stdout(&without)
    );
    let with = |more: &[&'static str]| [&eval[..], more].concat();
    assert!(stdout(&without).contains("RFD (not LPIPS)"), "the surrogate: {}", stdout(&without));
    let surrogate = json(&with(&["--json", "--quiet"]), dir)["perception"].clone();
    assert_eq!(surrogate["name"], "RFD (not LPIPS)", "{surrogate}");
    refused(&with(&["--lpips", "none.safetensors"]), dir, 2, &["none.safetensors"]);
    write_formula(&dir.join("vgg.safetensors"));
    let record = json(&with(&["--lpips", "vgg.safetensors", "--json", "--quiet"]), dir)["perception"].clone();
    assert_eq!(record["name"], "LPIPS-vgg", "{record}");
    let views = record["views"].as_array().expect("one number per view");
    assert!(views.len() == 10 && views.iter().all(|v| v.as_f64().is_some_and(|v| v >= 0.0)), "{record}");
    assert!(record["mean"].as_f64().is_some_and(|m| m < 0.01), "quantised renders of itself: {record}");
    let raw = with(&["--lpips", "vgg.safetensors", "--lpips-raw", "--json", "--quiet"]);
    assert_eq!(json(&raw, dir)["perception"]["name"], "LPIPS-vgg-raw", "named by its variant");
    refused(&with(&["--lpips-raw"]), dir, 2, &["required arguments"]);
}

#[test]
fn help_shows_examples_and_exit_codes() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for args in [
        &["--help"][..],
        &["demo", "--help"],
        &["splat", "fit", "--help"],
        &["splat", "render", "--help"],
        &["splat", "eval", "--help"],
        &["convert", "--help"],
        &["last", "gen", "--help"],
        &["lirm", "gen", "--help"],
        &["mesh", "render", "--help"],
    ] {
        let o = lastlight(args, dir.path());
        assert_eq!(code(&o), 0, "{args:?}");
        assert!(stdout(&o).contains("Examples:") && stdout(&o).contains("lastlight "), "{args:?}: examples");
        assert!(o.stderr.is_empty(), "{args:?}: help is printed to stdout");
    }
    let top = stdout(&lastlight(&["--help"], dir.path()));
    for word in ["demo", "splat", "oracle", "gradcheck", "convert", "doctor", "Exit codes", "--threads"] {
        assert!(top.contains(word), "'{word}' in the help");
    }
    let version = stdout(&lastlight(&["--version"], dir.path()));
    assert!(version.contains(env!("CARGO_PKG_VERSION")), "{version}");
}

#[test]
fn bad_usage_and_input_exit_with_2_and_one_line() {
    let work = workplace();
    let dir = work.path();
    for args in [
        &["nonsense"][..],
        &["splat", "fit"],
        &["splat", "fit", "capture", "--out", "x", "--iterations", "many"],
        &["--threads", "0", "doctor"],
    ] {
        assert_eq!(code(&lastlight(args, dir)), 2, "{args:?}");
    }
    let fit =
        |rest: &[&'static str]| [&["splat", "fit", "capture", "--out", "new", "--quiet"][..], rest].concat();
    refused(&["splat", "fit", "nowhere", "--out", "new"], dir, 2, &["nowhere"]);
    refused(&fit(&["--profile", "exactly"]), dir, 2, &["--profile", "exact, gsplat"]);
    refused(&fit(&["--strategy", "x"]), dir, 2, &["--strategy", "mcmc"]);
    refused(&fit(&["--background", "grey"]), dir, 2, &["--background"]);
    refused(&fit(&["--box", "0,0,0,1,1"]), dir, 2, &["--box"]);
    refused(&fit(&["--tile", "12"]), dir, 2, &["--tile"]);
    refused(&fit(&["--iterations", "0"]), dir, 2, &["--iterations"]);
    refused(&fit(&["--initial", "300", "--max-gaussians", "10"]), dir, 2, &["--max-gaussians"]);
    refused(
        &fit(&["--max-memory", "4M"]),
        dir,
        2,
        &["splat fit: memory", "at most 4.0 MiB", "--downscale", "--max-memory"],
    );
    refused(&fit(&["--max-memory", "1"]), dir, 2, &["memory: expected at most 1 B", "--max-memory"]);
    refused(&fit(&["--init", "missing.ply"]), dir, 2, &["missing.ply"]);
    refused(&["splat", "render", "ball.ply", "--cameras", "orbit:none", "--out", "o1"], dir, 2, &["orbit:N"]);
    refused(
        &["splat", "render", "ball.ply", "--cameras", "orbit:2", "--out", "o2", "--passes", "colour"],
        dir,
        2,
        &["--passes"],
    );
    refused(
        &["splat", "render", "ball.ply", "--cameras", "orbit:2", "--out", "o3", "--size", "0x9"],
        dir,
        2,
        &["--size"],
    );
    refused(&["splat", "eval", "ball.ply", "capture", "--split", "some"], dir, 2, &["--split"]);
    for out in ["o1", "o2", "o3"] {
        assert!(!dir.join(out).exists(), "a refused command makes no folder: {out}");
    }
}

#[test]
fn broken_files_are_named() {
    let work = workplace();
    let dir = work.path();
    let ply = std::fs::read(dir.join("ball.ply")).expect("written");
    std::fs::write(dir.join("cut.ply"), &ply[..ply.len() - 5]).expect("writes");
    refused(&["convert", "cut.ply", "out.splat"], dir, 2, &["cut.ply"]);
    assert!(!dir.join("out.splat").exists(), "nothing is written");
    std::fs::write(dir.join("empty.splat"), []).expect("writes");
    refused(
        &["splat", "render", "empty.splat", "--cameras", "orbit:2", "--out", "e"],
        dir,
        2,
        &["empty.splat"],
    );
    std::fs::write(dir.join("flat.obj"), "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n").expect("writes");
    refused(&["mesh", "compare", "flat.obj", "flat.obj"], dir, 2, &["flat.obj"]);
    std::fs::write(dir.join("odd.splat"), [0; 33]).expect("writes");
    refused(&["convert", "odd.splat", "out.ply"], dir, 2, &["odd.splat"]);
    std::fs::write(dir.join("capture/transforms.json"), "{\"frames\": [").expect("writes");
    refused(&["splat", "fit", "capture", "--out", "f"], dir, 2, &["transforms.json"]);
    refused(
        &["splat", "render", "ball.ply", "--cameras", "capture", "--out", "g"],
        dir,
        2,
        &["transforms.json"],
    );
    assert!(!dir.join("f").exists() && !dir.join("g").exists(), "no folder for nothing");
}

#[test]
fn a_scene_is_rendered_fitted_scored_and_converted() {
    let work = workplace();
    let dir = work.path();
    let fit = [
        "splat",
        "fit",
        "capture",
        "--out",
        "fit",
        "--iterations",
        "40",
        "--initial",
        "300",
        "--sh-degree",
        "1",
        "--max-gaussians",
        "600",
        "--seed",
        "3",
        "--json",
        "--quiet",
    ];
    let record = json(&fit, dir);
    assert_eq!(record["iterations"], 40, "as requested");
    assert_eq!(record["evaluation"]["views"].as_array().map(Vec::len), Some(2), "views 0 and 8 are held out");
    assert_eq!(record["settings"]["seed"], 3, "settings are recorded");
    let digest = record["digest"].as_str().expect("a digest").to_owned();
    for file in ["scene.ply", "scene.splat", "checkpoint.safetensors", "result.json", "report/index.html"] {
        assert!(dir.join("fit").join(file).is_file(), "{file}");
    }
    let html = std::fs::read_to_string(dir.join("fit/report/index.html")).expect("a report");
    assert!(html.contains(&digest) && html.contains("data:image/png;base64,"), "digest and images");
    assert!(!html.contains("http://") && !html.contains("https://"), "no network");

    // The same bits for another number of threads, and where a file of the same name is in the way only with
    // --force.
    let again = |threads: &str, out: &str, extra: &[&str]| {
        let mut args = vec!["--threads", threads];
        args.extend(fit.iter().map(|a| if *a == "fit" { *a } else { a }));
        let at = args.iter().position(|a| *a == "--out").expect("given");
        args[at + 1] = out;
        args.extend(extra);
        args.into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    for (threads, out) in [("1", "fit1"), ("3", "fit3")] {
        let args = again(threads, out, &[]);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        assert_eq!(json(&args, dir)["digest"], *digest, "{threads} threads");
        assert_eq!(
            std::fs::read(dir.join("fit/scene.ply")).expect("one"),
            std::fs::read(dir.join(out).join("scene.ply")).expect("other"),
            "{threads} threads: the same file"
        );
    }
    refused(&fit, dir, 2, &["--out", "fit", "--resume", "--force"]);
    let args = again("2", "fit", &["--force"]);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    assert_eq!(json(&args, dir)["digest"], *digest, "forced");
    let args = again("2", "fit", &["--resume", "--downscale", "2"]);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let sheet = || std::fs::read(dir.join("fit/images.png")).expect("the sheet of the images");
    let before = sheet();
    refused(&args, dir, 2, &["--downscale 2 (there: 1)", "--like"]);
    // The checkpoint has the images too, where the options of the run are lost.
    for record in ["command.json", "result.json"] {
        std::fs::remove_file(dir.join("fit").join(record)).expect("there");
    }
    refused(&args, dir, 2, &["images of", "pixels"]);
    assert!(sheet() == before, "a refused fit leaves the sheet as it was");
    let args = again("2", "fit", &["--resume"]);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    assert_eq!(json(&args, dir)["digest"], *digest, "a finished fit resumes at its end");

    let scores = json(&["splat", "eval", "fit", "capture", "--json", "--quiet", "--out", "scores"], dir);
    assert_eq!(scores["evaluation"], record["evaluation"], "the scene file scores as the fit did");
    assert!(dir.join("scores/report/index.html").is_file(), "a report");
    refused(
        &["splat", "eval", "fit/scene.ply", "capture", "--min-psnr", "99", "--quiet"],
        dir,
        1,
        &["at least 99 dB"],
    );
    let text = stdout(&lastlight(&["splat", "eval", "ball.ply", "capture", "--split", "all"], dir));
    assert!(
        text.contains("PSNR") && text.lines().count() == 13,
        "a table of ten views, a head, a mean, the surrogate: {text}"
    );

    let made = json(&["convert", "fit/scene.ply", "scene.npz", "--json"], dir);
    assert_eq!(made["gaussians"], record["gaussians"], "all of them");
    refused(&["convert", "fit/scene.ply", "scene.npz"], dir, 2, &["scene.npz", "--force"]);
    json(&["convert", "scene.npz", "back.ply", "--json"], dir);
    let back = json(&["splat", "eval", "back.ply", "capture", "--json", "--quiet"], dir);
    let psnr = |v: &Value| v["evaluation"]["mean_psnr_db"].as_f64().expect("finite");
    assert!(
        (psnr(&back) - psnr(&scores)).abs() < 1e-3,
        "through npz and back: {} and {}",
        psnr(&back),
        psnr(&scores)
    );
}

#[test]
fn all_passes_are_written_and_described() {
    let work = workplace();
    let dir = work.path();
    let args = [
        "splat",
        "render",
        "ball.ply",
        "--cameras",
        "capture",
        "--out",
        "p",
        "--passes",
        "color,linear,depth,alpha",
        "--json",
    ];
    let record = json(&args, dir);
    assert_eq!(record["files"].as_array().map(Vec::len), Some(41), "four files a view and the description");
    let text = std::fs::read_to_string(dir.join("p/transforms.json")).expect("written");
    let t: Value = serde_json::from_str(&text).expect("JSON");
    let frame = &t["frames"][0];
    assert!(dir.join("p").join(frame["file_path"].as_str().expect("a path")).is_file(), "the image is there");
    assert!(
        dir.join("p").join(frame["depth_file_path"].as_str().expect("a path")).is_file(),
        "the depth is there"
    );
    // Cameras survive the way through the file: the second rendering is the first one.
    let names: Vec<_> = std::fs::read_dir(dir.join("p/color"))
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name())
        .collect();
    for name in names {
        let name = name.into_string().expect("text");
        let first = dir.join("capture/color").join(name.trim_start_matches("color_"));
        assert_eq!(std::fs::read(first).ok(), std::fs::read(dir.join("p/color").join(&name)).ok(), "{name}");
    }
}

#[test]
fn doctor_and_demo_say_that_all_is_well() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let record = json(&["doctor", "--json"], dir.path());
    assert_eq!(record["ok"], true, "{record}");
    // All three parts: `the_report_of_the_demo_says_what_it_shows`.
    let record = json(&["demo", "--only", "last", "--iterations", "8", "--json", "--quiet"], dir.path());
    assert_eq!(record["person"]["iterations"], 8, "as requested");
    assert_eq!(record["person"]["structure"]["after"].as_array().map(Vec::len), Some(16), "every edge");
    assert!(record["scene"].is_null() && record["object"].is_null(), "one part alone");
    let again = json(
        &["demo", "--only", "last", "--iterations", "8", "--json", "--quiet", "--threads", "1"],
        dir.path(),
    );
    assert_eq!(again["person"]["digest"], record["person"]["digest"], "one thread, the same person");
    refused(&["demo", "--size", "8"], dir.path(), 2, &["--size", "32 to 1024"]);
    // The model sees squares of 64 pixels of any picture.
    let odd =
        ["demo", "--only", "last", "--iterations", "8", "--size", "50", "--out", "odd", "--json", "--quiet"];
    assert!(json(&odd, dir.path())["person"]["digest"].is_string(), "images of 50 pixels");
    std::fs::create_dir(dir.path().join("mine")).expect("a folder");
    std::fs::write(dir.path().join("mine/letter.txt"), "dear").expect("writes");
    refused(&["demo", "--out", "mine", "--iterations", "8"], dir.path(), 2, &["mine", "--force"]);
    assert_eq!(std::fs::read_dir(dir.path().join("mine")).expect("a folder").count(), 1, "untouched");
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_a_checkpoint_and_kill_leaves_the_last_one() {
    use crate::program::signalled;
    use std::os::unix::process::ExitStatusExt;
    let work = workplace();
    let dir = work.path();
    let args = |out: &'static str, rest: &[&'static str]| {
        let fit = [
            "splat",
            "fit",
            "capture",
            "--out",
            out,
            "--iterations",
            "1500",
            "--initial",
            "300",
            "--sh-degree",
            "0",
            "--max-gaussians",
            "400",
            "--checkpoint-every",
            "25",
            "--quiet",
            "--json",
        ];
        [&fit[..], rest].concat()
    };
    let whole = json(&args("whole", &[]), dir);
    let second = |out: &'static str| {
        // While one program writes to the folder, another is refused, with any option.
        for flag in ["--force", "--resume"] {
            refused(&args(out, &[flag]), dir, 2, &["--out", "in use by process"]);
        }
    };
    let mut is_tried = false;
    for (signal, out, exit) in [
        ("-INT", "int", Some(130)),
        ("-TERM", "term", Some(130)),
        ("-HUP", "hup", Some(130)),
        ("-KILL", "kill", None),
    ] {
        let checkpoint = dir.join(out).join("checkpoint.safetensors");
        let tried = std::cell::Cell::new(is_tried);
        let o = signalled(&args(out, &[]), dir, signal, &|| {
            if checkpoint.exists() && !tried.replace(true) {
                second(out);
            }
            checkpoint.exists()
        });
        is_tried = true;
        match exit {
            Some(n) => {
                assert_eq!(code(&o), n, "{}", stderr(&o));
                assert!(stderr(&o).contains("--resume"), "it prints how to continue: {}", stderr(&o));
            }
            None => assert_eq!(o.status.signal(), Some(9), "killed"),
        }
        assert!(!dir.join(out).join("scene.ply").exists(), "it was interrupted before its end");
        assert_eq!(
            dir.join(out).join(".lastlight.lock").exists(),
            exit.is_none(),
            "{signal}: who is killed leaves its lock"
        );
        let resumed = json(&args(out, &["--resume"]), dir);
        assert_eq!(resumed["digest"], whole["digest"], "{signal}: the bits of an uninterrupted fit");
        assert_eq!(
            std::fs::read(dir.join("whole/checkpoint.safetensors")).expect("one"),
            std::fs::read(checkpoint).expect("other"),
            "{signal}: the same checkpoint"
        );
    }
}
