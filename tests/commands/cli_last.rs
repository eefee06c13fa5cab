//! `last pretrain`, `tune`, `intervene` at the command line: a small model from images, continued, tuned,
//! inspected, refused. `last fit` and `render`: a person seen from farther and nearer than in its photos.

use crate::program::{code, json, lastlight, refused, stderr, stdout};
use lastlight::fit::orbit::Orbit;
use lastlight::io::safetensors;
use lastlight::last::avatar::store;
use lastlight::loss::lpips::NO_WEIGHTS;
use lastlight::scene::camera::Camera;
use std::path::Path;

/// Images, groups and a video of the figure.
fn data(dir: &Path) {
    let made = json(
        &[
            "last",
            "gen",
            "--scale",
            "smoke",
            "--out",
            "data",
            "--json",
            "--observational",
            "24",
            "--groups",
            "8",
            "--appearances",
            "1",
            "--body-points",
            "128",
            "--frames",
            "3",
            "--test-cameras",
            "1",
            "--render-as",
            "points",
        ],
        dir,
    );
    assert_eq!(made["complete"], true, "finished");
}

/// The short training of these tests, with more arguments.
fn pretrain<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let base = [
        "last",
        "pretrain",
        "data",
        "--iterations",
        "4",
        "--batch-images",
        "12",
        "--batch-groups",
        "4",
        "--batch-points",
        "32",
        "--factor-dim",
        "2",
    ];
    base.iter().chain(more).copied().collect()
}

#[test]
fn a_model_is_trained_continued_tuned_and_looked_at() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    data(at);
    let made = json(&pretrain(&["--out", "model", "--json"]), at);
    assert_eq!(made["kind"], "last pretrain", "what it is");
    assert_eq!(made["iterations"], 4, "as many as were asked for, the refit included");
    assert!(made["verdict"]["probabilities"].as_array().is_some_and(|p| p.len() == 16), "every edge");
    for file in
        ["model.safetensors", "samples.png", "checkpoint.safetensors", "result.json", "report/index.html"]
    {
        assert!(at.join("model").join(file).is_file(), "{file} is there");
    }
    let page = std::fs::read_to_string(at.join("model/report/index.html")).expect("a page");
    for section in ["structure", "scores", "samples", "loss", "time", "files", "settings", "glossary"] {
        assert!(page.contains(&format!("<section id=\"{section}\">")), "{section}");
    }
    for text in ["<dt>MCC</dt>", "<dt>targets</dt>", "Different from the defaults", ">batch_images</td>"] {
        assert!(page.contains(text), "{text}");
    }
    // A run that is finished already changes nothing.
    let again = json(&pretrain(&["--out", "model", "--json", "--resume"]), at);
    assert_eq!(again["digest"], made["digest"], "continued: the same model");
    refused(&pretrain(&["--out", "model"]), at, 2, &["new or empty folder"]);
    refused(&pretrain(&["--out", "model", "--resume", "--seed", "1"]), at, 2, &["seed"]);
    let threads = json(&pretrain(&["--out", "one", "--json", "--threads", "1"]), at);
    assert_eq!(threads["digest"], made["digest"], "one thread: the same model");
    let bytes = |dir: &str| std::fs::read(at.join(dir).join("model.safetensors")).expect("written");
    assert!(bytes("model") == bytes("one"), "the file does not depend on the command line");

    let tuned = json(
        &["last", "tune", "model", "data/video", "--out", "tuned.safetensors", "--iterations", "3", "--json"],
        at,
    );
    assert_eq!(tuned["images"], 3, "every training image");
    assert_eq!(tuned["after"].as_array().map(Vec::len), Some(16), "every edge");
    let done = json(
        &["last", "intervene", "tuned.safetensors", "data/video", "--out", "do", "--json", "--factor", "0,2"],
        at,
    );
    let moved = done["moved"].as_array().expect("rows");
    assert_eq!(moved.len(), 2, "one row per factor");
    let edges: Vec<(u64, u64)> = serde_json::from_value(done["edges"].clone()).expect("pairs");
    // Without edges no factor affects another, which is noted.
    let o = lastlight(&["last", "intervene", "tuned.safetensors", "data/video", "--out", "again"], at);
    let note = "the graph of the model has no edges: no factor affects another (the model was trained for 4 iterations;";
    assert_eq!((code(&o), stderr(&o).contains(note)), (0, edges.is_empty()), "{edges:?}: {}", stderr(&o));
    let row = &moved[0]["most"];
    for j in [1_u64, 2, 3] {
        let reached = edges.iter().any(|&(_, to)| to == j);
        assert!(reached || row[j as usize] == 0.0, "factor {j} has no parent and cannot move");
    }
    assert!(at.join("do/grid.png").is_file() && at.join("do/moved.csv").is_file(), "images and numbers");
}

#[test]
fn bad_input_is_refused() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    refused(&pretrain(&["--out", "m"]), at, 2, &["data: no such folder", "lastlight last gen --out"]);
    data(at);
    for (folder, parts) in [
        ("data/video", ["a data set of last gen", "got a capture (the data set that contains it is data)"]),
        ("data/observational", ["a data set of last gen", "lastlight last gen --out"]),
        ("data/template.npz", ["a data set of last gen", "got a file"]),
    ] {
        refused(&["last", "pretrain", folder, "--out", "m"], at, 2, &parts);
    }
    // Too few draws for the search at the end: refused before the training.
    let few = ["--out", "m", "--supervision", "none", "--iterations", "40"];
    let few = [&["last", "pretrain", "data", "--batch-images", "12"][..], &few].concat();
    refused(&few, at, 2, &["more than 32", "got 24 images and 0 pairs", "--observational N --groups N"]);
    assert!(!at.join("m").exists(), "nothing was trained");
    refused(&pretrain(&["--out", "m", "--reading", "free"]), at, 2, &["reference, literal"]);
    refused(
        &pretrain(&["--out", "m", "--supervision", "all"]),
        at,
        2,
        &["none, pairs, groups, unknown, labels"],
    );
    refused(&pretrain(&["--out", "m", "--crop", "half"]), at, 2, &["person, whole"]);
    refused(&pretrain(&["--out", "m", "--weight", "kl"]), at, 2, &["KEY=VALUE"]);
    refused(&pretrain(&["--out", "m", "--weight", "kl=-1"]), at, 2, &["KEY=VALUE"]);
    // A record from which the true graph cannot be read.
    let record = std::fs::read(at.join("data/dataset.json")).expect("a record");
    for (bytes, part) in
        [(&record[..record.len() / 2], "JSON"), (br#"{"adjacency": [[0, 1], [0]]}"#, "adjacency")]
    {
        std::fs::write(at.join("data/dataset.json"), bytes).expect("writable");
        refused(&pretrain(&["--out", "m"]), at, 2, &["dataset.json", part]);
        assert!(!at.join("m").exists(), "nothing was trained");
    }
    std::fs::write(at.join("data/dataset.json"), record).expect("writable");
    std::fs::remove_dir_all(at.join("data/interventions")).expect("removed");
    refused(&pretrain(&["--out", "m"]), at, 2, &["interventions"]);
    let o = lastlight(&pretrain(&["--out", "m", "--supervision", "none", "--quiet"]), at);
    assert!(o.status.success(), "without interventions nothing of them is needed");
    refused(
        &["last", "tune", "m/checkpoint.safetensors", "data/video", "--out", "t"],
        at,
        2,
        &["kind", "image-to-point"],
    );
    refused(&["last", "intervene", "m/model.safetensors", "none", "--out", "d"], at, 2, &["none"]);
    refused(
        &["last", "intervene", "m/model.safetensors", "data/video", "--out", "d", "--factor", "4"],
        at,
        2,
        &["0 to 3"],
    );
    // What a model decides, without one; a check of images that are not there.
    let fit = |more: &[&'static str]| [&["last", "fit", "data/video", "--out", "f"], more].concat();
    for word in [&["--lambda", "0.1"][..], &["--density", "or"], &["--no-progressive"]] {
        refused(&fit(word), at, 2, &["required arguments"]);
    }
    refused(&fit(&["--model", "data"]), at, 2, &["data: expected a model file", "without model.safetensors"]);
    // A scene is no person, and a person no scene.
    std::fs::create_dir(at.join("scene")).expect("made");
    std::fs::write(at.join("scene/scene.ply"), "").expect("written");
    for scene in ["scene", "scene/scene.ply"] {
        refused(&["last", "render", scene, "--out", "r"], at, 2, &["a scene of `splat fit`", "splat render"]);
    }
    std::fs::create_dir(at.join("person")).expect("made");
    std::fs::write(at.join("person/avatar.safetensors"), "").expect("written");
    let render = ["splat", "render", "person", "--cameras", "orbit:2", "--out", "r"];
    refused(&render, at, 2, &["a person of `last fit`", "last render"]);
    // A model of another skeleton.
    let path = at.join("m/model.safetensors");
    let mut file = safetensors::read(&path).expect("a model");
    let joints = file.arrays.need("skeleton").expect("recorded").len();
    file.arrays.put("skeleton", &[joints + 1], vec![-1_i64; joints + 1]);
    safetensors::write(&at.join("other.safetensors"), &file.arrays, &file.metadata).expect("written");
    let counts = [format!("{joints} joints"), format!("{} joints", joints + 1)];
    for command in [
        &["last", "fit", "data/video", "--out", "f", "--model", "other.safetensors"][..],
        &["last", "tune", "other.safetensors", "data/video", "--out", "t"],
    ] {
        refused(command, at, 2, &["--model: skeleton", &counts[0], &counts[1]]);
    }
    // A graph with a cycle.
    let path = at.join("m/model.safetensors");
    let mut file = safetensors::read(&path).expect("a model");
    let mut graph = vec![0.0; 16];
    (graph[1], graph[6], graph[8]) = (1.0, 1.0, 1.0);
    file.arrays.put("graph", &[4, 4], graph);
    safetensors::write(&at.join("ring.safetensors"), &file.arrays, &file.metadata).expect("written");
    refused(
        &["last", "tune", "ring.safetensors", "data/video", "--out", "t"],
        at,
        2,
        &["ring.safetensors", "without cycles", "0, 1, 2"],
    );
    // A number that is changed: the digest in the file is another.
    let mut changed = safetensors::read(&path).expect("a model");
    let codes = changed.arrays.need("codes").expect("codes").clone();
    let mut numbers = codes.to_f64();
    numbers[0] += 1.0;
    changed.arrays.put("codes", codes.shape(), numbers);
    safetensors::write(&at.join("changed.safetensors"), &changed.arrays, &changed.metadata).expect("written");
    refused(
        &["last", "tune", "changed.safetensors", "data/video", "--out", "t"],
        at,
        2,
        &["changed.safetensors", "digest", "not those that were written"],
    );
    file.arrays.put("graph", &[4, 4], vec![0.5; 16]);
    safetensors::write(&at.join("half.safetensors"), &file.arrays, &file.metadata).expect("written");
    refused(&["last", "tune", "half.safetensors", "data/video", "--out", "t"], at, 2, &["0 or 1", "0.5"]);
}

/// Mean squared difference.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).fold(0.0, |s, (a, b)| s + (a - b) * (a - b)) / a.len() as f32
}

#[test]
fn a_person_is_shown_whole_and_keeps_its_surface_when_magnified() {
    const TIMES: usize = 4;
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    data(at);
    json(&["last", "fit", "data/video", "--out", "fit", "--iterations", "120", "--json"], at);
    let stored = store::read(&at.join("fit/avatar.safetensors")).expect("an avatar");
    let camera = &stored.cameras[0].1;
    let pose = &stored.poses[0];
    let small = stored.picture(pose, Some(0), camera).expect("an image").image;
    let scored = stored.avatar.picture(pose, Some(0), camera).expect("an image").image;
    assert_eq!(small, scored, "from a camera of the capture: what is scored, to the bit");
    let times = TIMES as f32;
    let near = Camera {
        focal_px: camera.focal_px.map(|f| times * f),
        center_px: camera.center_px.map(|c| times * c),
        width: TIMES * camera.width,
        height: TIMES * camera.height,
        ..camera.clone()
    };
    // Blocks of the magnified image have the colours of the pixels that the fit learned.
    let mean = |image: &[f32]| -> Vec<f32> {
        let (w, side) = (camera.width, near.width);
        (0..small.len())
            .map(|at| {
                let (pixel, c) = (at / 3, at % 3);
                let corner = (pixel / w * side + pixel % w) * TIMES;
                let block = (0..TIMES * TIMES).map(|k| corner + k / TIMES * side + k % TIMES);
                block.fold(0.0, |s, p| s + image[3 * p + c]) / (TIMES * TIMES) as f32
            })
            .collect()
    };
    let magnified = mean(&stored.picture(pose, Some(0), &near).expect("an image").image);
    let unwidened = mean(&stored.avatar.picture(pose, Some(0), &near).expect("an image").image);
    let (off, fog) = (apart(&magnified, &small), apart(&unwidened, &small));
    println!(
        "mean squared difference to what was learned: {off:.1e}, with the footprint of a smaller pixel {fog:.1e}"
    );
    assert!(off < 2e-4 && off < fog / 4.0, "blocks of the magnified image: {off:.1e}, unwidened {fog:.1e}");

    let orbit = Orbit {
        count: 5,
        arc_rad: None,
        center: None,
        radius: None,
        elevation_rad: 0.2,
        fov_x_rad: 0.7,
        size: [96, 64],
    };
    for (k, camera) in stored.around(orbit, &stored.poses).expect("cameras").iter().enumerate() {
        let out = stored.picture(pose, Some(0), camera).expect("an image");
        let (w, h) = (camera.width, camera.height);
        let border = |p: &usize| [p % w, p / w].contains(&0) || p % w == w - 1 || p / w == h - 1;
        let cut = (0..w * h).filter(border).filter(|&p| out.alpha[p] > 0.05).count();
        assert_eq!(cut, 0, "view {k}: nothing is cut by the border");
        let rows = (0..h).filter(|y| (0..w).any(|x| out.alpha[y * w + x] > 0.1)).count();
        assert!(rows > h / 2, "view {k}: the person fills the image: {rows} of {h} rows");
    }
    // Without weights the surrogate is reported in place of LPIPS, under its own name.
    let scores = lastlight(&["last", "eval", "fit", "data/video"], at);
    assert!(stderr(&scores).lines().any(|l| l == NO_WEIGHTS), "{}", stderr(&scores));
    assert!(stdout(&scores).contains("RFD-box (not LPIPS)"), "{}", stdout(&scores));
    refused(
        &["last", "eval", "fit", "data/video", "--lpips", "none.safetensors"],
        at,
        2,
        &["none.safetensors"],
    );
    // A check of held-out images needs some.
    let eval = ["last", "eval", "fit", "data/video", "--min-psnr", "1"];
    assert!(lastlight(&eval, at).status.success(), "one decibel is reached");
    std::fs::remove_file(at.join("data/video/transforms_test.json")).expect("there");
    refused(&eval, at, 2, &["--min-psnr"]);
}

#[test]
fn a_bad_held_out_image_is_reported_before_the_fit() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    data(at);
    let record =
        std::fs::read_to_string(at.join("data/video/transforms_test.json")).expect("held-out cameras");
    let record: serde_json::Value = serde_json::from_str(&record).expect("JSON");
    let image = record["frames"][0]["file_path"].as_str().expect("an image");
    let words = ["last", "fit", "data/video", "--out", "fit", "--iterations", "40"];
    for height in [1e4, 20.0] {
        let mut far = record.clone();
        far["frames"][0]["transform_matrix"][2][3] = height.into();
        std::fs::write(at.join("data/video/transforms_test.json"), far.to_string()).expect("written");
        refused(&words, at, 2, &[image, "camera and pose"]);
    }
    std::fs::write(at.join("data/video/transforms_test.json"), record.to_string()).expect("written");
    std::fs::write(at.join("data/video").join(image), b"no image").expect("written");
    refused(&words, at, 2, &[image]);
    assert!(!at.join("fit/checkpoint.safetensors").exists(), "nothing was fitted");
}

#[test]
fn the_paper_as_printed_goes_all_the_way() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    data(at);
    let made = json(&pretrain(&["--out", "model", "--reading", "literal", "--json"]), at);
    assert_eq!(made["settings"]["reading"], "literal", "as requested");
    assert_eq!(made["settings"]["mechanism"], "printed", "eq. 3: linear, then networks");
    let run = |words: &[&str]| json(&[words, &["--json"]].concat(), at);
    // The model's file stores the setting; later commands need no option.
    let model = "model/model.safetensors";
    let tuned =
        run(&["last", "tune", model, "data/video", "--out", "tuned.safetensors", "--iterations", "3"]);
    assert_eq!(tuned["images"], 3, "every training image");
    run(&["last", "intervene", "tuned.safetensors", "data/video", "--out", "do"]);
    let fit = ["last", "fit", "data/video", "--out", "fit", "--model", "tuned.safetensors"];
    run(&[&fit[..], &["--iterations", "60"]].concat());
    let stored = store::read(&at.join("fit/avatar.safetensors")).expect("an avatar");
    assert!(!stored.avatar.gaussians.is_empty(), "a person of Gaussians");
}

#[test]
fn poses_and_cameras_of_a_film_go_together() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let at = dir.path();
    data(at);
    json(&["last", "fit", "data/video", "--out", "fit", "--iterations", "40", "--json"], at);
    let film = |out: &str, more: &[&str]| -> Vec<Vec<u8>> {
        let out = format!("films/{out}");
        let words = [&["last", "render", "fit", "--out", &out, "--json"], more].concat();
        json(&words, at);
        let folder = std::fs::read_dir(at.join(&out)).expect("a folder");
        let mut files: Vec<_> = folder.map(|file| file.expect("a file").path()).collect();
        files.retain(|file| file.extension().is_some_and(|x| x == "png"));
        files.sort();
        files.iter().map(|file| std::fs::read(file).expect("an image")).collect()
    };
    let all = film("all", &[]);
    assert_eq!(all.len(), 3, "an image for each moment");
    assert!(film("one", &["--pose", "1"])[..] == all[1..2], "one moment of them");
    let around = film("around", &["--cameras", "orbit:3", "--pose", "1", "--size", "48x40"]);
    assert_eq!(around.len(), 3, "one moment from all sides");
    assert!(around[0] != around[1] && around[1] != around[2], "the sides differ");
    let both = film("both", &["--cameras", "orbit:3", "--size", "48x40"]);
    assert_eq!(both.len(), 3, "moments and cameras go on together");
    let side = film("side", &["--cameras", "12", "--pose", "1"]);
    assert!(side.len() == 1 && side[0] != all[1], "another camera of the capture");
    // The same body in another animation.
    let made = "last gen --scale smoke --split video --out dancer --seed 5 --frames 2 --test-cameras 1 --body-points 128 --json";
    json(&made.split(' ').collect::<Vec<_>>(), at);
    let dance = film("dance", &["--pose-from", "dancer/video"]);
    assert_eq!(dance.len(), 2, "the moments of the other animation");
    assert!(dance.iter().all(|picture| !all.contains(picture)), "poses that the fit has not seen");
    refused(&["last", "render", "fit", "--out", "r", "--pose", "3"], at, 2, &["--pose"]);
}
