//! `field import` on the command line: miniatures of both layouts become captures that `field fit` and `field eval` read.

use crate::ball_layouts::{dtc, orb};
use crate::lpips_weights::torchvision;
use crate::program::{code, json, lastlight, refused, stderr, stdout};
use lastlight::io::safetensors;
use lastlight::loss::lpips::Weights;
use std::collections::BTreeMap;

#[rustfmt::skip]
const TINY: [&str; 14] = [
    "--iterations", "8", "--side", "8", "--channels", "2", "--ray-samples", "16", "--crop-side", "16", "--crops", "1", "--json", "-q",
];

#[test]
fn a_published_capture_is_imported_fitted_scored_and_relit() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    let from = orb(dir);
    let from = from.strip_prefix(dir).expect("inside").to_str().expect("a name");
    let import = ["field", "import", from, "--out", "ball", "--json", "-q"];
    let made = json(&import, dir);
    let counts = ["train", "test", "unsplit", "novel_light"].map(|n| made[n].as_u64());
    assert_eq!(
        (made["layout"].as_str(), counts),
        (Some("Stanford-ORB"), [Some(3), Some(1), Some(0), Some(1)])
    );
    assert_eq!(made["scan"], true, "{made}");
    refused(&import, dir, 2, &["ball", "--force"]);
    assert_eq!(json(&[&import[..], &["--force"]].concat(), dir)["size"], made["size"], "replaced");

    let fit = json(&[&["field", "fit", "ball", "--out", "f"], &TINY[..]].concat(), dir);
    assert_eq!(fit["images"], serde_json::json!({"fitted": 3, "held_out": 1}), "the split of the set");
    let eval = ["field", "eval", "f", "ball", "--mesh", "ball/scan.glb", "--json", "-q"];
    let scores = json(&eval, dir);
    let of = |v: &serde_json::Value| v["benchmark"]["perceptual"].as_str().map(str::to_owned);
    assert!(scores["benchmark"]["views"]["psnr_h_db"].is_number(), "{scores}");
    assert!(scores["benchmark"]["shape"]["distance_radii"].is_number(), "{scores}");
    assert_eq!(of(&scores).as_deref(), Some("RFD (not LPIPS)"), "no weights were given");

    // Weights of LPIPS change the name and the number of the perceptual score alone.
    let file = dir.join("vgg.safetensors");
    safetensors::write(&file, &torchvision(&Weights::by_formula()), &BTreeMap::new()).expect("written");
    let weighed = json(&[&eval[..], &["--lpips", "vgg.safetensors"]].concat(), dir);
    assert_eq!(of(&weighed).as_deref(), Some("LPIPS-vgg"), "{weighed}");
    let [before, after] = [&scores, &weighed].map(|v| v["benchmark"]["views"].clone());
    assert_eq!(before["psnr_h_db"], after["psnr_h_db"], "the others stay");
    assert_ne!(before["perceptual"], after["perceptual"]);

    // Another light: the capture names its map.
    let novel =
        ["field", "eval", "f", "ball/transforms_novel.json", "--relight", "--split", "all", "--samples", "4"];
    let relit = json(&[&novel[..], &["--out", "relit", "--json", "-q"]].concat(), dir);
    assert!(relit["benchmark"]["relit"]["mean"]["psnr_mask_db"].is_number(), "{relit}");
    assert!(relit["benchmark"]["views"].is_null(), "the field's colours hold another light: {relit}");
    assert_eq!(std::fs::read_dir(dir.join("relit/relit")).expect("a folder").count(), 1, "a render");
}

#[test]
fn renders_without_a_split_are_imported_and_what_is_missing_is_named() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    dtc(dir);
    let o = lastlight(&["field", "import", "ball", "--out", "all"], dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    let text = stdout(&o);
    assert!(text.contains("all: 4 images, 0 held out") && text.contains("DTC"), "{text}");
    assert!(text.contains("depth") && text.contains("normal"), "its passes: {text}");
    let small = json(&["field", "import", "ball", "--out", "half", "--downscale", "2", "--json", "-q"], dir);
    assert_eq!(small["size"], serde_json::json!([12, 12]), "averaged");
    std::fs::remove_file(dir.join("ball/images/rgb/mask0000002.png")).expect("there");
    refused(&["field", "import", "ball", "--out", "b"], dir, 2, &["mask0000002.png"]);
    assert!(!dir.join("b/transforms.json").exists(), "no capture is left");
    refused(&["field", "import", "all", "--out", "c"], dir, 2, &["Stanford-ORB", "DTC"]);
}
