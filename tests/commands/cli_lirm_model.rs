//! `lirm train`, `reconstruct`, `update` and `eval` on the command line: a step of training, a field from it, what is refused.

use crate::program::{TINY, json, lastlight, refused, stdout};
use serde_json::Value;
use std::path::Path;

fn line(text: &str) -> Vec<&str> {
    text.split_whitespace().collect()
}

/// A model after one step, and an object of test views.
fn made(dir: &Path) -> Value {
    let set = "lirm gen --cameras test --size 64 --samples 1 --texture 32 --out set -q";
    assert!(lastlight(&line(set), dir).status.success(), "a set");
    let train = "lirm train --stage 1a --iterations 1 --batch 1 --objects-at-once 1 --out m --json -q";
    json(&line(train), dir)
}

#[test]
fn a_model_reads_images_and_more_of_them() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    let trained = made(dir);
    assert_eq!(trained["stages"], serde_json::json!(["1a"]));
    let again = json(
        &line(
            "lirm train --stage 1a --iterations 1 --batch 1 --objects-at-once 1 --out m --resume --json -q",
        ),
        dir,
    );
    assert_eq!(again["digest"], trained["digest"], "complete already");
    let model = dir.join("m/model.safetensors");
    let bytes = std::fs::read(&model).expect("a model");
    std::fs::remove_file(&model).expect("removed");
    json(&line("lirm train --out m --resume --json -q"), dir);
    assert_eq!(std::fs::read(&model).expect("written again"), bytes, "a missing file is written again");
    let next = json(
        &line(
            "lirm train --stage 2a --iterations 1 --batch 1 --objects-at-once 1 --from m --out n --json -q",
        ),
        dir,
    );
    assert_eq!(next["stages"], serde_json::json!(["1a", "2a"]));
    assert_eq!(next["settings"]["whole"], true);
    let page = std::fs::read_to_string(dir.join("n/report/index.html")).expect("a report");
    let section = page.split("<section id=\"time\">").nth(1).expect("the time of its parts");
    let passes = ["transformer", "render and losses", "adjoint of the render", "adjoint of the transformer"];
    for part in ["objects", "inputs", "optimiser"].iter().chain(&passes) {
        assert!(section.contains(&format!(">{part}</td>")), "{part}: {section:.2000}");
    }
    let parts = line(
        "lirm train --stage 1b --iterations 2 --until 1 --batch 1 --objects-at-once 1 --from m --out p --json -q",
    );
    assert_eq!(json(&parts, dir)["stages"], serde_json::json!(["1a", "1b to step 1 of 2"]));
    let rest =
        line("lirm train --stage 1b --iterations 2 --batch 1 --objects-at-once 1 --from p --out q --json -q");
    let rest = json(&rest, dir);
    assert_eq!(rest["stages"], serde_json::json!(["1a", "1b"]));
    assert_eq!((&rest["iterations"], &rest["settings"]["first_step"]), (&1.into(), &1.into()));
    let other = line("lirm train --stage 1b --iterations 3 --batch 1 --objects-at-once 1 --from p --out r");
    refused(&other, dir, 2, &["--iterations", "2, as in the part before of stage 1b"]);
    // The folder can go on too, with the moments of its checkpoint.
    let whole = json(&line("lirm train --resume --until 2 --out p --json -q"), dir);
    assert_eq!((&whole["stages"], &whole["iterations"]), (&serde_json::json!(["1a", "1b"]), &2.into()));
    refused(&line("lirm train --resume --until 1 --out p"), dir, 2, &["at most 1 iterations", "2"]);

    let capture = "set/object_00000/uniform";
    let one = json(
        &line(&format!("lirm reconstruct {capture} --model m --images-per-set 4 --out r --json -q")),
        dir,
    );
    let like = json(&line("lirm reconstruct --like r/result.json --out like --json -q"), dir);
    assert_eq!(like["digest"], one["digest"], "the recorded run again");
    assert_eq!(one["placement"]["center"], serde_json::json!([0.0, 0.0, 0.0]));
    let page = std::fs::read_to_string(dir.join("r/report/index.html")).expect("a report");
    let section = page.split("<section id=\"read\">").nth(1).expect("the images that were read");
    let section = section.split("</section>").next().expect("its end");
    assert_eq!(section.matches("<figcaption>").count(), 16, "all of them");
    let elsewhere = "lirm train --stage 1a --iterations 1 --batch 1 --objects-at-once 1 --out r --resume";
    refused(&line(elsewhere), dir, 2, &["r: ", "checkpoint.safetensors", "of another command"]);
    assert_eq!(json(&line("lirm reconstruct --like r --out liker --json -q"), dir)["digest"], one["digest"]);
    assert_eq!(one["sets"], serde_json::json!([4, 4, 4, 4]), "sixteen input images");
    assert_eq!(one["evaluation"]["views"].as_array().map(Vec::len), Some(12), "twelve outputs");
    for file in ["field.safetensors", "state.safetensors", "report/index.html", "result.json"] {
        assert!(dir.join("r").join(file).is_file(), "{file}");
    }
    let scores = json(&line(&format!("field eval r {capture} --json -q")), dir);
    assert_eq!(
        scores["evaluation"]["mean"]["psnr_db"], one["evaluation"]["mean"]["psnr_db"],
        "a field like others"
    );

    // A capture that names no map; one beside it, where `lirm gen` writes it for objects under one, is suggested.
    let relit = line("field eval r set/object_00000/uniform --relight");
    refused(&relit, dir, 2, &["environment_path", "neither"]);
    std::fs::write(dir.join("set/object_00000/environment.exr"), b"").expect("written");
    refused(&relit, dir, 2, &["--env set/object_00000/environment.exr"]);

    // The first set, then the others: the same bits.
    let text = std::fs::read_to_string(dir.join(capture).join("transforms_train.json")).expect("a capture");
    let frames: Value = serde_json::from_str(&text).expect("JSON");
    let names: Vec<&str> =
        frames["frames"].as_array().expect("frames").iter().filter_map(|f| f["file_path"].as_str()).collect();
    let [first, others] = [names[..4].join(","), names[4..].join(",")];
    let begun = json(
        &["lirm", "reconstruct", capture, "--model", "m", "--inputs", &first, "--out", "a", "--json", "-q"],
        dir,
    );
    let args = [
        "lirm",
        "update",
        "a",
        capture,
        "--model",
        "m",
        "--inputs",
        &others,
        "--images-per-set",
        "4",
        "--out",
        "b",
        "--json",
        "-q",
    ];
    let two = json(&args, dir);
    assert_eq!(two["digest"], one["digest"]);
    assert_eq!(two["evaluation"]["before"], begun["evaluation"]["mean"], "an update tells what it adds");
    assert!(begun["evaluation"]["before"].is_null(), "nothing was read before");
    let shown = args.map(|arg| if arg == "b" { "shown" } else { arg });
    let shown =
        stdout(&lastlight(&shown.iter().copied().filter(|arg| *arg != "--json").collect::<Vec<_>>(), dir));
    let of = |record: &Value| record["evaluation"]["mean"]["psnr_db"].as_f64().expect("a score");
    let gain = of(&two) - of(&begun);
    let line_of_before = format!("before      {:.2} dB on the same images ({gain:+.2} dB", of(&begun));
    assert!(shown.contains(&line_of_before), "{line_of_before}\n{shown}");
    let changes = |record: &Value| record["changes"].as_array().expect("a list").clone();
    assert_eq!(
        (changes(&one)[0].as_f64(), &changes(&one)[1..]),
        (Some(1.0), &changes(&two)[..]),
        "of every set"
    );
    assert_eq!(two["sets"], one["sets"]);
    let size = |of: &str| std::fs::metadata(dir.join(of).join("state.safetensors")).expect("a state").len();
    // One set and four: the lists of the numbers of images, of the changes (at most 22 bytes each) and of the names are longer, and the header is
    // padded to eight bytes.
    let listed = names[4..].join("\\\"\\\",").len() + "\\\"\\\",".len();
    let growth = size("b") - size("a");
    assert!(
        growth <= listed as u64 + 3 * (2 + 22) + 8,
        "arrays do not grow: {} and {} bytes",
        size("a"),
        size("b")
    );

    // A test image that is read is not scored.
    let text = std::fs::read_to_string(dir.join(capture).join("transforms_test.json")).expect("a capture");
    let frames: Value = serde_json::from_str(&text).expect("JSON");
    let name = frames["frames"][0]["file_path"].as_str().expect("a name");
    let seen = json(
        &["lirm", "update", "a", capture, "--model", "m", "--inputs", name, "--out", "s", "--json", "-q"],
        dir,
    );
    assert_eq!(seen["evaluation"]["views"].as_array().map(Vec::len), Some(11), "{name}");
    let cropped = json(
        &line(&format!(
            "lirm reconstruct {capture} --model n --crop-side 72 --images-per-set 16 --out c --json -q"
        )),
        dir,
    );
    assert_eq!(cropped["sets"], serde_json::json!([16]));

    refused(
        &line(&format!("lirm update a {capture} --model n --out d")),
        dir,
        2,
        &["--model", "setting whole: false", "setting whole: true"],
    );
    refused(&line(&format!("lirm update a {capture} --model p --out d")), dir, 2, &["--model", "digest"]);
    refused(&line(&format!("lirm update {capture} a --model m --out d")), dir, 2, &["first argument"]);
    let first = names[0];
    for (options, parts) in [
        (format!("--inputs {first},{first}"), ["every image once", first]),
        ("--box 100,100,100,101,101,101".to_owned(), ["--box", "no foreground pixel"]),
        ("--inverse-beta 1e9".to_owned(), ["--inverse-beta", "1000000"]),
        ("--inputs elsewhere/0000.png".to_owned(), ["--inputs", "elsewhere/0000.png"]),
    ] {
        let args = format!("lirm reconstruct {capture} --model m {options} --out d");
        refused(&line(&args), dir, 2, &parts);
    }
    refused(
        &line(&format!("lirm reconstruct {capture} --model m --inputs none --out d")),
        dir,
        2,
        &["--inputs", "none"],
    );
    refused(
        &line(&format!("lirm reconstruct {capture} --model m --crop-side 60 --out d")),
        dir,
        2,
        &["multiple of 8"],
    );
    refused(
        &line(&format!("lirm reconstruct {capture} --model r/field.safetensors --out d")),
        dir,
        2,
        &["LIRM model"],
    );
    let odd = format!("lirm reconstruct {capture} --model m --downscale 5 --out d");
    refused(&line(&odd), dir, 2, &["image size", "12x12", "--crop-side"]);
    assert!(!dir.join("d").exists(), "nothing is left");
    refused(&line("lirm train --stage 2a --from set --out e"), dir, 2, &["set"]);
    refused(&line("lirm train --stage 4 --out e"), dir, 2, &["1a"]);
    refused(
        &line("lirm train --stage 1b --from m --first-values published --out e"),
        dir,
        2,
        &["--first-values"],
    );
}

/// Objects of a folder, built-in ones of another seed and other models: which scores are of objects that the model has seen.
#[test]
fn a_set_of_other_objects_trains_a_model_too() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    std::fs::write(dir.join("tiny.json"), TINY).expect("written");
    let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::write(dir.join("t.obj"), tetrahedron).expect("written");
    for (objects, out) in [("--mesh t.obj", "meshes"), ("--seed 3", "own")] {
        let set = format!("lirm gen {objects} --views 20 --size 128 --samples 1 --texture 32 --out {out} -q");
        assert!(lastlight(&line(&set), dir).status.success(), "{set}");
        let train = format!(
            "lirm train {out} --stage 1a --config tiny.json --iterations 1 --batch 1 --objects-at-once 1 --distances 1 --out of-{out} --json -q"
        );
        assert!(json(&line(&train), dir)["digest"].is_string(), "{train}");
    }
    let told = |model: &str, seed: u64| {
        let score = format!(
            "lirm eval {model} --seed {seed} --objects 1 --sets 1 --samples 1 --ray-samples 8 --no-baselines"
        );
        let o = lastlight(&line(&score), dir);
        assert!(o.status.success(), "{score}");
        String::from_utf8_lossy(&o.stderr).contains("was trained with objects of seed")
    };
    assert!(told("of-own", 3), "the objects of the set");
    assert!(!told("of-own", 0), "the seed of the draws is not that of the objects");
    assert!(!told("of-meshes", 0), "no built-in object");
}

#[test]
fn a_model_can_keep_a_share_of_the_one_before() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    std::fs::write(dir.join("tiny.json"), TINY).expect("written");
    let first = "lirm init --config tiny.json --out first.safetensors -q";
    assert!(lastlight(&line(first), dir).status.success(), "first values");
    let train =
        |more: &str| format!("lirm train --stage 1b --iterations 1 --batch 1 --objects-at-once 1 {more}");
    let made = |more: &str| json(&line(&train(&format!("--from first.safetensors --json -q {more}"))), dir);
    let (trained, mixed) = (made("--out a"), made("--start-share 0.5 --out b"));
    assert_ne!(trained["digest"], mixed["digest"]);
    assert_eq!(
        (&trained["settings"]["start_share"], &mixed["settings"]["start_share"]),
        (&Value::Null, &0.5.into())
    );
    let again = json(&line("lirm train --resume --start-share 0.5 --out a --json -q"), dir);
    assert_eq!(again["digest"], mixed["digest"], "the same steps");
    let kept = json(&line("lirm train --resume --out a --json -q"), dir);
    assert_eq!(kept["digest"], mixed["digest"], "the share of the last command");
    let [a, b] = ["a", "b"].map(|of| std::fs::read(dir.join(of).join("model.safetensors")).expect("a model"));
    assert!(a == b, "the same file");
    refused(&line(&train("--start-share 0.5 --out c")), dir, 2, &["--from"]);
    refused(
        &line(&train("--from first.safetensors --start-share 1 --out c")),
        dir,
        2,
        &["--start-share", "below 1"],
    );
}

#[test]
fn scores_stand_beside_baselines() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    made(dir);
    let scores = json(&line("lirm eval m --objects 1 --samples 1 --ray-samples 16 --json -q"), dir);
    assert_eq!(scores["seed"], 2, "objects that no training draws and no choice is made by");
    let rounds = scores["rounds"].as_array().expect("rounds");
    assert_eq!(rounds.len(), 4);
    let of = |r: usize, key: &str| rounds[r][key].as_f64().expect("a number");
    assert!(of(0, "hull_db") > of(0, "psnr_db"), "a model after one step is worse than the hull: {rounds:?}");
    assert!((0..4).all(|r| of(r, "small_hull_db") != of(r, "hull_db")), "of smaller images: {rounds:?}");
    assert!(of(3, "small_hull_db") > of(0, "small_hull_db"), "{rounds:?}");
    assert!((0..4).all(|r| of(r, "blurred_hull_db") > of(r, "hull_db")), "noise and edges: {rounds:?}");
    assert!(of(3, "hull_db") > of(0, "hull_db") && of(3, "nearest_db") > of(0, "nearest_db"), "{rounds:?}");
    // As Stanford-ORB defines them: a constant foreground of one half over black is the least.
    assert!(of(0, "psnr_h_db") > 5.0 && of(0, "psnr_l_db") > 5.0 && of(0, "orb_ssim") > 0.0, "{rounds:?}");
    assert!((0.0..=2.0).contains(&of(0, "orb_normals")) && of(0, "orb_depth") >= 0.0, "{rounds:?}");
}

#[test]
fn the_demo_reconstructs_an_object_with_a_given_model() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    let made = json(&line("lirm init --whole --out first.safetensors --json"), dir);
    assert_eq!(made["configuration"]["first_values"], "scaled", "{made}");
    let record = json(&line("demo --only lirm --model first.safetensors --json -q"), dir);
    let object = &record["object"];
    assert_eq!(
        object["rounds"].as_array().map(Vec::len),
        Some(2),
        "after four images and after eight: {record}"
    );
    let first = &object["rounds"][0];
    assert!(first["albedo_orb_db"].is_number(), "under a map, with materials: {object}");
    assert!(
        first["albedo_db"].is_null() && first["depth"].is_null(),
        "first values are opaque nowhere: {object}"
    );
    assert!(record["person"].is_null() && record["scene"].is_null(), "one part alone");
    let page = std::fs::read_to_string(dir.join("demo/report/index.html")).expect("a report");
    for id in ["object", "rounds", "relit", "time", "files"] {
        assert_eq!(page.matches(&format!("<section id=\"{id}\">")).count(), 1, "section '{id}', once");
    }
    assert!(page.contains("<h1>An object from a few images</h1>"), "a title");
    for file in ["first/state.safetensors", "second/field.safetensors", "mesh.glb", "relit.png"] {
        assert!(dir.join("demo/object").join(file).is_file(), "{file}");
    }
}

#[test]
fn a_study_runs_and_its_report_can_be_made_again() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    made(dir);
    let study = json(&line("lirm study --model m --out s --scale smoke --json -q"), dir);
    let all = study["experiments"].as_array().expect("experiments");
    assert_eq!(all.len(), 12, "{study}");
    let of = |id: &str| all.iter().find(|x| x["id"] == id).expect("an experiment");
    assert_eq!(of("rounds")["rows"].as_array().map(Vec::len), Some(4), "two orders, and both in the paper");
    assert_eq!(of("controls")["rows"].as_array().map(Vec::len), Some(5), "five kinds of inputs");
    assert!(of("materials")["verdict"].as_str().is_some_and(|v| v.contains("no materials")), "a plain model");
    assert!(of("relit")["verdict"].as_str().is_some_and(|v| v.contains("no materials")), "a plain model");
    let whole = line("lirm init --whole --out whole.safetensors -q");
    assert!(lastlight(&whole, dir).status.success(), "a model with materials");
    let relit =
        json(&line("lirm study relit --model whole.safetensors --out w --scale smoke --json -q"), dir);
    let verdict = relit["experiments"][0]["verdict"].as_str().expect("a verdict");
    assert!(verdict.contains("1 of 1 objects have a surface"), "a field of first values has one: {relit}");
    let rows = relit["experiments"][0]["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 5, "{relit}");
    assert!(rows.iter().all(|row| row[1] != "–"), "all five are rendered: {relit}");
    assert_eq!(of("variants")["rows"].as_array().map(Vec::len), Some(9), "five models and four differences");
    let again = json(&line("lirm study --model m --out s --scale smoke --report-only --json -q"), dir);
    assert_eq!(again["experiments"], study["experiments"], "from the files");
    let one = json(&line("lirm study head --model m --out s --scale smoke --resume --json -q"), dir);
    assert_eq!(one["experiments"], study["experiments"], "those of the command before stay in the report");
    let other = line("lirm study --model m --out s --report-only");
    refused(&other, dir, 2, &["--scale", "smoke, as in s/study.json", "full"]);
    refused(
        &line("lirm study head --model m --out m --resume"),
        dir,
        2,
        &["m: ", "study.json", "of another command"],
    );
    let listed = json(&line("lirm study list --json"), dir);
    assert_eq!(listed["experiments"].as_array().map(Vec::len), Some(all.len()));
}

#[test]
fn the_included_model_is_the_default() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    let scores = json(&line("lirm eval --objects 1 --sets 1 --samples 1 --ray-samples 16 --json -q"), dir);
    assert_eq!(scores["model"], "objects64.safetensors");
    let study = json(&line("lirm study limits --out s --scale smoke --json -q"), dir);
    let name = study["models"][0]["name"].as_str().expect("a model with a name");
    let included = lastlight::lirm::model::shipped::objects();
    let stage = &included.training.last().expect("a part").stage;
    assert!(name.starts_with(&format!("stage {stage}")), "{name}, of a model that ends with {stage}");
    let set = "lirm gen --cameras test --size 64 --samples 1 --texture 32 --out set -q";
    assert!(lastlight(&line(set), dir).status.success(), "a set");
    let capture = "set/object_00000/uniform";
    let made = json(&line(&format!("lirm reconstruct {capture} --images-per-set 8 --out r --json -q")), dir);
    assert_eq!(made["settings"]["model"], "objects64.safetensors");
    assert_eq!(made["sets"], serde_json::json!([8, 8]));
    let o = lastlight(&line(&format!("lirm update r {capture} --out u")), dir);
    assert!(o.status.success(), "a state of the included model");
    let note = String::from_utf8_lossy(&o.stderr).into_owned();
    assert!(note.contains("objects64.safetensors, trained in stages 1a"), "how far it has come: {note}");
}

#[test]
fn first_values_are_a_model_and_any_number_of_images_of_any_size_is_read() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    let made = json(&line("lirm init --whole --out first.safetensors --json"), dir);
    assert!(made["parameters"].as_u64().is_some_and(|n| (5_700_000..5_900_000).contains(&n)), "{made}");
    let again = json(&line("lirm init --whole --out again.safetensors --json"), dir);
    assert_eq!(again["digest"], made["digest"]);
    refused(&line("lirm init --out first.safetensors"), dir, 2, &["first.safetensors", "--force"]);
    let size = std::fs::metadata(dir.join("first.safetensors")).expect("a file").len();
    assert!(size <= 12 << 20, "{size} bytes");

    // Forty of forty-six images are not held out.
    let set = "lirm gen --views 46 --size 64 --samples 1 --texture 32 --out many -q";
    assert!(lastlight(&line(set), dir).status.success(), "a set");
    let reconstruct = |capture: &str, more: &str, out: &str| {
        let text =
            format!("lirm reconstruct {capture} --model first.safetensors {more} --out {out} --json -q");
        json(&line(&text), dir)
    };
    let capture = "many/object_00000/uniform";
    let of = |record: &Value| record["sets"].clone();
    assert_eq!(of(&reconstruct(capture, "", "all")), serde_json::json!([40]), "in one set");
    assert_eq!(of(&reconstruct(capture, "--inputs 0007", "one")), serde_json::json!([1]), "one image");
    let mut scores = Vec::new();
    for pose in ["world", "upright", "first-camera"] {
        let made = reconstruct(capture, &format!("--inputs 0001,0002 --field-axes {pose}"), pose);
        let views = made["evaluation"]["views"].as_array().expect("held-out images");
        assert_eq!(views.len(), 6, "{made}");
        scores.push(made["evaluation"]["mean"]["psnr_db"].as_f64().expect("a score"));
    }
    // First values are about a ball at the centre, which looks the same in all axes.
    assert!(scores.iter().all(|db| (db - scores[0]).abs() < 0.5), "{scores:?}");
    let folder = dir.join("photos");
    std::fs::create_dir(&folder).expect("a folder");
    std::fs::copy(dir.join(capture).join("images/0000.png"), folder.join("0000.png")).expect("an image");
    refused(
        &line("lirm reconstruct photos --model first.safetensors --out d"),
        dir,
        2,
        &["photos", "camera poses"],
    );
}
