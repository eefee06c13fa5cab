//! Fits of few images, in few iterations, up to the limit of Gaussians, and what they report.

use crate::cli::workplace;
use crate::program::{code, json, lastlight, stderr, stdout};
use crate::samples;
use lastlight::io::image_file;
use serde_json::Value;
use std::path::Path;

/// Leaves the first `count` views of the capture of [`workplace`], seen in `turns` of a full turn.
fn keep_first(dir: &Path, count: usize) {
    let path = dir.join("capture/transforms.json");
    let mut list: Value =
        serde_json::from_str(&std::fs::read_to_string(&path).expect("readable")).expect("JSON");
    list["frames"].as_array_mut().expect("frames").truncate(count);
    std::fs::write(path, list.to_string()).expect("writes");
}

/// A capture of the ball of eight images from a narrow arc.
fn eight_from_an_arc() -> tempfile::TempDir {
    let work = workplace();
    std::fs::remove_dir_all(work.path().join("capture")).expect("there");
    let args = [
        "splat",
        "render",
        "ball.ply",
        "--cameras",
        "orbit:90",
        "--center",
        "0,0,0",
        "--size",
        "48x40",
        "--out",
        "capture",
    ];
    assert_eq!(code(&lastlight(&args, work.path())), 0, "rendered");
    keep_first(work.path(), 8);
    work
}

fn fit<'a>(out: &'a str, rest: &[&'a str]) -> Vec<&'a str> {
    [&["splat", "fit", "capture", "--json", "--quiet", "--out", out], rest].concat()
}

#[test]
fn short_fits_of_few_images_work_with_defaults() {
    let work = eight_from_an_arc();
    let psnr = |r: &Value| r["evaluation"]["mean_psnr_db"].as_f64().expect("a number");
    let mut records = Vec::new();
    for iterations in ["10", "30", "300"] {
        let record = json(&fit(iterations, &["--iterations", iterations]), work.path());
        assert!(
            record["gaussians"].as_u64().expect("a count") >= 100,
            "{iterations}: {}",
            record["gaussians"]
        );
        records.push(psnr(&record));
    }
    assert!(
        records[2] > records[0] + 3.0 && records[2] > 20.0,
        "more iterations, a better scene: {records:?}"
    );
}

#[test]
fn strategies_differ() {
    let work = workplace();
    let digest = |strategy: &str| {
        let options =
            ["--iterations", "80", "--initial", "400", "--max-gaussians", "900", "--strategy", strategy];
        json(&fit(strategy, &options), work.path())["digest"].as_str().expect("a digest").to_owned()
    };
    let digests = ["inria", "gsplat", "gsplat-abs", "mcmc"].map(digest);
    for i in 0..4 {
        assert!(digests[..i].iter().all(|d| *d != digests[i]), "another result: {digests:?}");
    }
}

#[test]
fn the_limit_of_gaussians_is_reported_and_follows_the_start() {
    let work = workplace();
    let dir = work.path();
    let full = ["--iterations", "80", "--initial", "300", "--max-gaussians", "320"];
    let record = json(&fit("full", &full), dir);
    let at = record["limit_reached_at"].as_u64().expect("reached");
    assert!(at > 25 && at < 40, "in a refinement: {at}");
    let html = std::fs::read_to_string(dir.join("full/report/index.html")).expect("a report");
    assert!(html.contains("--max-gaussians N raises it"), "in the report");
    let args = ["splat", "fit", "capture", "--out", "again", "--quiet"];
    let text = stdout(&lastlight(&[&args[..], &full].concat(), dir));
    assert!(
        text.contains(&format!("320 Gaussians, reached at iteration {at}; --max-gaussians N raises it")),
        "{text}"
    );
    let free = json(&fit("free", &["--iterations", "10", "--initial", "300"]), dir);
    assert!(free["limit_reached_at"].is_null() && free["settings"]["max_gaussians"] == 10_000, "{free}");

    // A start with more than the default has room.
    let many =
        json(&fit("many", &["--iterations", "1", "--initial", "12000", "--max-gaussians", "12000"]), dir);
    assert_eq!(many["gaussians"], 12_000, "all of them");
    assert_eq!(many["limit_reached_at"], 0, "full at once");
    let from = json(&fit("from", &["--iterations", "1", "--init", "many/scene.ply"]), dir);
    assert_eq!(from["settings"]["max_gaussians"], 18_000, "half as many again");
}

#[test]
fn images_are_counted_and_a_single_one_gets_no_score() {
    let work = workplace();
    let dir = work.path();
    std::fs::remove_file(dir.join("capture/color/003.png")).expect("there");
    let record = json(&fit("gone", &["--iterations", "2", "--initial", "50"]), dir);
    assert_eq!(record["images"], serde_json::json!({"fitted": 7, "held_out": 2, "missing": 1}), "{record}");
    keep_first(dir, 1);
    let record = json(&fit("one", &["--iterations", "2", "--initial", "50"]), dir);
    assert_eq!(record["images"], serde_json::json!({"fitted": 1, "held_out": 0, "missing": 0}), "{record}");
    let e = &record["evaluation"];
    assert!(e["mean_psnr_db"].is_null() && e["views"] == serde_json::json!([]), "no score: {e}");
    let html = std::fs::read_to_string(dir.join("one/report/index.html")).expect("a report");
    assert!(html.contains("nothing is held out") && !html.contains("NaN"), "the report says so");
    let o =
        lastlight(&["splat", "fit", "capture", "--out", "two", "--iterations", "2", "--initial", "50"], dir);
    assert!(stdout(&o).contains("nothing is held out"), "{}{}", stdout(&o), stderr(&o));
}

/// Nine images of 32×24 in the folder `inside`, of a model that declares 128×96.
fn reduced(inside: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let make = |folder: &str| std::fs::create_dir_all(dir.path().join(folder)).expect("made");
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).expect("written");
    make("capture/sparse/0");
    make(&format!("capture/{inside}"));
    write("capture/sparse/0/cameras.txt", b"7 PINHOLE 128 96 160 160 64 48\n");
    write("capture/sparse/0/images.txt", &samples::images_txt(9));
    write("capture/sparse/0/points3D.txt", &samples::points_txt());
    for i in 0..9 {
        write(&format!("capture/{inside}/{i:04}.png"), &samples::png(32, 24, 3));
    }
    dir
}

#[test]
fn a_colmap_model_with_reduced_images_alone_is_fitted() {
    let dir = reduced("images_4");
    let record = json(&fit("out", &["--iterations", "20"]), dir.path());
    assert_eq!(record["images"], serde_json::json!({"fitted": 7, "held_out": 2, "missing": 0}), "{record}");
    assert_eq!(record["evaluation"]["views"][0]["width"], 32, "of that size");
}

#[test]
fn the_check_before_the_first_iteration_says_what_the_capture_is() {
    let work = workplace();
    let dir = work.path();
    let o =
        lastlight(&["splat", "fit", "capture", "--out", "f", "--iterations", "1", "--initial", "50"], dir);
    let text = stderr(&o);
    for part in ["cameras: 8 of 8 point at the centre", "random Gaussians in a cube", "sheet of the images"] {
        assert!(text.contains(part), "'{part}' in {text}");
    }
    assert!(!text.contains("warning") && !text.contains("masks:"), "{text}");
    let sheet = image_file::read(&dir.join("f/images.png")).expect("a PNG");
    assert_eq!((sheet.width, sheet.height), (10 * 122 - 2, 100), "ten thumbnails in a row");
    let record: Value =
        serde_json::from_slice(&std::fs::read(dir.join("f/result.json")).expect("a record")).expect("JSON");
    assert_eq!(record["check"]["images"], 8, "training images");
    assert_eq!(record["check"]["cameras_pointing_inward"], 8, "all of them");

    // Every camera turned around its own vertical axis; a mask on two images.
    let path = dir.join("capture/transforms.json");
    let mut list: Value =
        serde_json::from_str(&std::fs::read_to_string(&path).expect("readable")).expect("JSON");
    for (i, frame) in list["frames"].as_array_mut().expect("frames").iter_mut().enumerate() {
        for row in 0..3 {
            for column in [0, 2] {
                let x = frame["transform_matrix"][row][column].as_f64().expect("a number");
                frame["transform_matrix"][row][column] = (-x).into();
            }
        }
        if i == 3 || i == 4 {
            frame["mask_path"] = "mask.png".into();
        }
    }
    std::fs::write(&path, list.to_string()).expect("writes");
    let half: Vec<u8> = (0..48 * 40).map(|i| if i % 48 < 24 { 0 } else { 255 }).collect();
    image_file::write_png(&dir.join("capture/mask.png"), 48, 40, 1, &half).expect("writes");
    let run = |out: &str, rest: &[&str]| {
        let args = ["splat", "fit", "capture", "--iterations", "1", "--initial", "50", "--out", out];
        stderr(&lastlight(&[&args[..], rest].concat(), dir))
    };
    let text = run("g", &[]);
    for part in
        ["cameras: 0 of 8 point", "warning: most cameras look away", "masks: 2 of 10 images", "count neither"]
    {
        assert!(text.contains(part), "'{part}' in {text}");
    }
    let text = run("h", &["--masks", "background"]);
    assert!(text.contains("trained toward the background colour"), "{text}");
    assert!(!run("i", &["--masks", "off"]).contains("masks:"), "masks are not read");
}
