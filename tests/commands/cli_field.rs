//! `field fit | eval | mesh` on the command line: a small object from end to end, and what is refused.

use crate::program::{code, json, lastlight, refused, stderr, stdout};
use lastlight::io::{image_file, safetensors};
use lastlight::scene::field::Field;
use serde_json::Value;
use std::path::Path;

/// Options of a fit of a second.
const TINY: [&str; 16] = [
    "--iterations",
    "8",
    "--side",
    "8",
    "--channels",
    "2",
    "--ray-samples",
    "16",
    "--crop-side",
    "16",
    "--crops",
    "1",
    "--checkpoint-every",
    "2",
    "--seed",
    "3",
];

/// A folder with `capture`: eight images of 24×24 with all passes.
fn workplace() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let args = "lirm gen --views 8 --size 24 --samples 2 --texture 32 --framing whole --out set -q";
    let o = lastlight(&args.split(' ').collect::<Vec<_>>(), dir.path());
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    std::fs::rename(dir.path().join("set/object_00000/uniform"), dir.path().join("capture")).expect("made");
    dir
}

/// A command with these options, and those of [`TINY`] that are not among them.
fn fit<'a>(capture: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let others = TINY.chunks(2).filter(|option| !more.contains(&option[0]));
    let mut words = vec!["field", "fit", capture, "--out", out];
    words.extend(others.flatten());
    words.extend(more);
    words
}

/// Names of the files of a folder that begin with `start`.
fn files(dir: &Path, start: &str) -> Vec<String> {
    let all = std::fs::read_dir(dir).expect("a folder");
    let names = all.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with(start)).collect()
}

/// Changes `capture/transforms.json`.
fn edit(dir: &Path, change: impl Fn(&mut Value)) {
    let path = dir.join("capture/transforms.json");
    let mut all: Value = serde_json::from_slice(&std::fs::read(&path).expect("readable")).expect("JSON");
    change(&mut all);
    std::fs::write(path, all.to_string()).expect("written");
}

/// Leaves images and cameras alone in the frames.
fn without_passes(all: &mut Value) {
    for frame in all["frames"].as_array_mut().expect("frames") {
        let frame = frame.as_object_mut().expect("an object");
        frame.retain(|name, _| !name.ends_with("_path") || name == "file_path");
        frame.remove("exposure");
        frame.remove("digests");
    }
}

#[test]
fn an_object_is_fitted_scored_meshed_and_relit() {
    let work = workplace();
    let dir = work.path();
    let o = lastlight(&fit("capture", "f", &["--json", "-q"]), dir);
    assert_eq!((code(&o), stderr(&o).as_str()), (0, ""), "-q prints results alone");
    let record: Value = serde_json::from_slice(&o.stdout).expect("one document");
    assert_eq!((&record["kind"], &record["iterations"]), (&"field fit".into(), &8.into()), "{record}");
    assert_eq!(record["images"], serde_json::json!({"fitted": 7, "held_out": 1}), "every eighth is held out");
    assert_eq!(record["settings"]["materials"], "passes", "auto: all passes are there");
    let mean = &record["evaluation"]["mean"];
    let psnr = mean["psnr_db"].as_f64().expect("a number");
    assert!(psnr > 5.0 && mean["numerical_normals_deg"].is_number() && mean["depth"].is_number(), "{mean}");
    for file in
        ["field.safetensors", "checkpoint.safetensors", "result.json", "command.json", "report/index.html"]
    {
        assert!(dir.join("f").join(file).is_file(), "{file}");
    }
    assert_eq!(std::fs::read_dir(dir.join("f/heldout")).expect("a folder").count(), 1, "held-out renders");
    let field = Field::read(&dir.join("f/field.safetensors")).expect("valid");
    assert_eq!(record["digest"], field.digest().expect("finite"), "of the field that was written");

    // Scores again, from the field alone.
    let scores = json(&["field", "eval", "f", "capture", "--json", "-q"], dir);
    assert_eq!(scores["evaluation"]["mean"], *mean, "the same scores");
    let low = ["field", "eval", "f/field.safetensors", "capture", "--min-psnr", "99", "-q"];
    refused(&low, dir, 1, &["field eval", "mean PSNR", "at least 99 dB"]);
    let all = ["field", "eval", "f", "capture", "--split", "all", "--out", "scores", "-q"];
    let text = stdout(&lastlight(&all, dir));
    assert!(text.contains("PSNR") && text.contains("numerical normals"), "{text}");
    assert!(dir.join("scores/report/index.html").is_file(), "a report");
    assert_eq!(std::fs::read_dir(dir.join("scores/normals")).expect("a folder").count(), 8, "all images");

    // A mesh, which other commands read.
    let mesh = ["field", "mesh", "f", "--out", "o.glb", "--side", "24", "--texture", "128", "--json", "-q"];
    let made = json(&mesh, dir);
    assert!(made["triangles"].as_u64().expect("a count") > 20, "{made}");
    refused(&mesh[..9], dir, 2, &["o.glb", "does not exist yet", "--force"]);
    let view = ["mesh", "view", "o.glb", "--size", "8", "--samples", "1", "--out", "v", "--json", "-q"];
    let view = json(&view, dir);
    assert_eq!(view["facts"]["closed"], true, "every edge of a fit is in two triangles: {view}");
    let obj =
        ["field", "mesh", "f", "--out", "o.obj", "--side", "24", "--texture", "128", "--smoothing", "0"];
    assert_eq!(code(&lastlight(&obj, dir)), 0, "as OBJ");
    let library = std::fs::read_to_string(dir.join("o.mtl")).expect("beside it");
    let maps = files(dir, "o_").into_iter().filter(|name| name.ends_with(".png")).collect::<Vec<_>>();
    assert!(!maps.is_empty() && maps.iter().all(|name| library.contains(name)), "{maps:?} in {library}");
    let relit =
        ["mesh", "render", "o.glb", "--env", "studio", "--size", "16", "--samples", "2", "--out", "r", "-q"];
    let o = lastlight(&relit, dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    let same = json(&["mesh", "compare", "o.glb", "o.glb", "--json", "-q"], dir);
    assert!(same.is_object(), "{same}");
    refused(&["field", "mesh", "f", "--out", "o.ply"], dir, 2, &["--out", ".glb or .obj", "o.ply"]);
    refused(&["field", "mesh", "f", "--out", "p.glb", "--side", "4"], dir, 2, &["--side", "8 to 1024", "4"]);
    let large = ["field", "mesh", "f", "--out", "p.glb", "--side", "512", "--max-memory", "1G"];
    refused(&large, dir, 2, &["field mesh", "memory", "--side and --texture lower"]);
}

#[test]
fn a_finished_fit_is_left_as_it_is_and_a_record_is_run_again() {
    let work = workplace();
    let dir = work.path();
    let first = json(&fit("capture", "f", &["--json", "-q"]), dir);
    let state = || {
        let names = ["field.safetensors", "checkpoint.safetensors", "result.json", "report/index.html"];
        names.map(|n| std::fs::metadata(dir.join("f").join(n)).expect("there").modified().expect("a time"))
    };
    let before = state();
    let resume = ["field", "fit", "--out", "f", "--resume"];
    let o = lastlight(&resume, dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    let text = stdout(&o);
    assert!(text.contains("all 8 iterations are done; no file was changed"), "{text}");
    assert_eq!(json(&[&resume[..], &["--json", "-q"]].concat(), dir), first, "the record that is there");
    assert!(state() == before, "no file is written again");
    // What is missing is made again; where gradients are in memory is no part of the result.
    std::fs::remove_file(dir.join("f/report/index.html")).expect("there");
    let again = json(&[&resume[..], &["--chunk", "64", "--json", "-q"]].concat(), dir);
    assert_eq!(again["digest"], first["digest"], "the same");
    assert!(dir.join("f/report/index.html").is_file(), "a report");
    let other = [&resume[..], &["--nde", "--side", "16", "-q"]].concat();
    refused(&other, dir, 2, &["--side 16 (there: 8)", "--nde (not given there)", "field fit --like"]);

    let like = ["field", "fit", "--like", "f/result.json", "--out", "g", "--json", "-q"];
    assert_eq!(json(&like, dir)["digest"], first["digest"], "all arguments of the record");
    let more = ["field", "fit", "--like", "f", "--out", "h", "--iterations", "2", "--json", "-q"];
    let other = json(&more, dir);
    assert_eq!(
        (&other["iterations"], &other["settings"]["seed"]),
        (&2.into(), &3.into()),
        "but what is typed"
    );
}

#[cfg(unix)]
#[test]
fn an_interrupted_fit_goes_on_with_the_same_bits() {
    let work = workplace();
    let dir = work.path();
    let long = |out: &'static str, more: &[&'static str]| {
        fit("capture", out, &[&["--iterations", "400"][..], more].concat())
    };
    let whole = json(&long("whole", &["--json", "-q"]), dir);
    let is_time = || dir.join("parts/checkpoint.safetensors").is_file();
    let o = crate::program::signalled(&long("parts", &[]), dir, "-INT", &is_time);
    assert_eq!(code(&o), 130, "{}", stderr(&o));
    assert!(stderr(&o).contains("--resume"), "{}", stderr(&o));
    refused(
        &["field", "mesh", "parts", "--out", "o.glb"],
        dir,
        2,
        &["parts", "field.safetensors", "--resume"],
    );
    let parts = json(&["field", "fit", "--out", "parts", "--resume", "--threads", "3", "--json", "-q"], dir);
    assert_eq!(parts["digest"], whole["digest"], "one result");
}

#[test]
fn captures_that_no_field_can_be_fitted_to_are_refused() {
    let work = workplace();
    let dir = work.path();
    let few = |more: &[&'static str], parts: &[&str]| {
        refused(&fit("capture", "x", &[more, &["-q"]].concat()), dir, 2, parts);
        assert!(!dir.join("x").exists(), "a command that cannot start leaves no folder");
    };
    few(&["--crop-side", "32"], &["--crop-side", "at most 24, the smaller side of the image", "got 32"]);
    few(&["--box", "8,8,8,9,9,9"], &["--box", "no foreground pixel of any training image sees"]);
    few(&["--box", "1,0,0,0,1,1"], &["--box", "x0,y0,z0,x1,y1,z1"]);
    few(&["--heads", "trunk"], &["--rule", "midpoint", "analytic"]);
    few(&["--heads", "trunk", "--rule", "midpoint", "--nde"], &["--nde", "--heads trunk"]);
    few(&["--env", "studio"], &["--env", "--materials shaded", "got --materials passes"]);
    few(&["--env-scale", "2"], &["--env-scale", "no --env"]);
    few(&["--materials", "shaded", "--env", "nowhere.exr"], &["--env", "nowhere.exr"]);
    few(&["--max-memory", "1M", "--side", "128"], &["field fit", "memory", "--side and --channels lower"]);
    few(&["--first-inverse-beta", "300"], &["--first-inverse-beta", "at most 200"]);
    std::fs::write(dir.join("broken.hdr"), b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n12")
        .expect("written");
    few(&["--materials", "shaded", "--env", "broken.hdr"], &["broken.hdr"]);

    edit(dir, |all| all["frames"].as_array_mut().expect("frames").truncate(2));
    few(&[], &["at least two training images", "got 1"]);
    edit(dir, without_passes);
    few(&[], &["foreground", "an alpha channel, a mask, or a pass", "a mask of it"]);
    few(&["--materials", "passes"], &["foreground"]);
}

#[test]
fn images_with_alpha_or_masks_alone_are_fitted_at_any_size() {
    let work = workplace();
    let dir = work.path();
    // An alpha channel in place of passes: materials are shaded under a light that is learned, or a map of any size.
    for k in 0..8 {
        let [image, mask] = ["images", "foreground"].map(|f| dir.join(format!("capture/{f}/{k:04}.png")));
        let read = |path: &Path| image_file::read(path).expect("an image");
        let (rgb, m) = (read(&image), read(&mask));
        let (c, n) = (rgb.channels.len(), rgb.width * rgb.height);
        let values = (0..n).flat_map(|i| {
            let at = |x: usize| rgb.value(i * c + x);
            [at(0), at(1), at(2), m.value(i * m.channels.len())]
        });
        let bytes = image_file::to_u8(&values.collect::<Vec<f32>>()).expect("in range");
        image_file::write_png(&image, rgb.width, rgb.height, 4, &bytes).expect("written");
    }
    edit(dir, without_passes);
    let learned = json(&fit("capture", "learned", &["--json", "-q"]), dir);
    assert_eq!(
        (&learned["settings"]["materials"], &learned["settings"]["light"]),
        (&"shaded".into(), &"learned".into())
    );
    let page = std::fs::read_to_string(dir.join("learned/report/index.html")).expect("a report");
    assert!(
        page.contains("direct light, no shadows, no light from other surfaces"),
        "what shading leaves out"
    );
    let light = image_file::read(&dir.join("learned/light.exr")).expect("a map");
    assert_eq!((light.width, light.height), (32, 16), "the learned light");
    let light = (0..3 * 512).map(|i| light.value(i));
    assert!(light.into_iter().all(|x| x > 0.0 && x.is_finite()), "radiance");
    image_file::write_exr(&dir.join("small.exr"), 3, 2, &["R", "G", "B"], &[0.5; 18]).expect("written");
    let mut digests = Vec::new();
    for (out, env) in [("a", "small.exr"), ("b", "studio"), ("c", "uniform")] {
        let options = ["--materials", "shaded", "--env", env, "--json", "-q"];
        let record = json(&fit("capture", out, &options), dir);
        let light = record["settings"]["light"].as_str().expect("a text").to_owned();
        assert!(light.starts_with("known "), "{light}");
        digests.push(light);
    }
    digests.dedup();
    assert_eq!(digests.len(), 3, "three lights");
    // Half as large: foreground too.
    let small = ["--downscale", "2", "--crop-side", "16", "-q"];
    refused(&fit("capture", "half", &small), dir, 2, &["--crop-side", "at most 12"]);
    let more: Vec<&str> = vec!["field", "eval", "learned", "capture", "--downscale", "2", "--json", "-q"];
    let half = json(&more, dir);
    assert_eq!(half["evaluation"]["mean"]["views"], 1, "{half}");

    // Masks alone.
    edit(dir, |all| {
        for (k, frame) in all["frames"].as_array_mut().expect("frames").iter_mut().enumerate() {
            frame["mask_path"] = format!("foreground/{k:04}.png").into();
        }
    });
    for k in 0..8 {
        let path = dir.join(format!("capture/images/{k:04}.png"));
        let rgba = image_file::read(&path).expect("an image");
        let n = rgba.width * rgba.height;
        let rgb: Vec<f32> = (0..n).flat_map(|i| [0, 1, 2].map(|c| rgba.value(4 * i + c))).collect();
        let bytes = image_file::to_u8(&rgb).expect("in range");
        image_file::write_png(&path, rgba.width, rgba.height, 3, &bytes).expect("written");
    }
    let masks = json(&fit("capture", "masks", &["--materials", "off", "--json", "-q"]), dir);
    assert_eq!(masks["settings"]["materials"], "off", "{masks}");
}

#[test]
fn damaged_and_empty_fields_are_refused_or_rendered() {
    let work = workplace();
    let dir = work.path();
    json(&fit("capture", "f", &["--json", "-q"]), dir);
    let good = dir.join("f/field.safetensors");
    let file = safetensors::read(&good).expect("a field");
    let bad = |change: &dyn Fn(&mut lastlight::num::array::Arrays), parts: &[&str]| {
        let mut arrays = file.arrays.clone();
        change(&mut arrays);
        safetensors::write(&dir.join("bad.safetensors"), &arrays, &file.metadata).expect("written");
        let parts = [parts, &["bad.safetensors"]].concat();
        refused(&["field", "mesh", "bad.safetensors", "--out", "o.glb", "-q"], dir, 2, &parts);
        refused(&["field", "eval", "bad.safetensors", "capture", "-q"], dir, 2, &parts);
    };
    let planes = file.arrays.need("planes").expect("planes");
    let (shape, values) = (planes.shape().to_vec(), planes.to_f32());
    let mut nan = values.clone();
    nan[5] = f32::NAN;
    bad(&|all| all.put("planes", &shape, nan.clone()), &["planes", "NaN"]);
    let mut other = values.clone();
    other[5] += 1.0;
    bad(&|all| all.put("planes", &shape, other.clone()), &["digest"]);
    bad(&|all| all.put("planes", &[2, 8, 8, 6], values.clone()), &["planes"]);
    bad(&|all| all.put("extra", &[1], vec![1.0_f32]), &["extra"]);
    bad(
        &|all| {
            all.0.remove("heads/color/1");
        },
        &["head 'color'", "3 outputs, got 32"],
    );
    bad(
        &|all| {
            all.0.remove("planes");
        },
        &["planes"],
    );
    std::fs::write(dir.join("cut.safetensors"), &std::fs::read(&good).expect("readable")[..99])
        .expect("written");
    refused(&["field", "mesh", "cut.safetensors", "--out", "o.glb", "-q"], dir, 2, &["cut.safetensors"]);
    let state = ["field", "mesh", "f/checkpoint.safetensors", "--out", "o.glb", "-q"];
    refused(&state, dir, 2, &["checkpoint.safetensors"]);

    // A field without a surface is rendered as background; there is nothing to mesh.
    let mut field = Field::read(&good).expect("valid");
    field.planes.values.fill(1.0);
    field.heads.sdf.weights.iter_mut().for_each(|w| w.fill(1.0));
    field.write(&dir.join("empty.safetensors")).expect("written");
    let scores = json(&["field", "eval", "empty.safetensors", "capture", "--json", "-q"], dir);
    assert!(scores["evaluation"]["mean"]["psnr_db"].is_number(), "white images have a score: {scores}");
    assert_eq!(scores["evaluation"]["mean"]["samples"], 0, "no sample is taken");
    refused(
        &["field", "mesh", "empty.safetensors", "--out", "o.glb", "-q"],
        dir,
        1,
        &["field mesh", "surface", "the field is empty"],
    );
    assert!(!dir.join("o.glb").exists(), "no file");
}
