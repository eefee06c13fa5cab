//! `lirm` on captures of any kind, with a model of a configuration file: other scales, sizes and lenses, and what is refused.

use crate::program::{TINY, json, lastlight, refused, stderr};
use lastlight::fit::exposure::Common;
use lastlight::io::image_file::{self, Picture, Samples};
use lastlight::io::safetensors::Precision;
use lastlight::lirm::model::file::Model;
use lastlight::lirm::model::state::State;
use serde_json::{Value, json};
use std::path::Path;

fn line(text: &str) -> Vec<&str> {
    text.split_whitespace().collect()
}

fn runs(text: &str, dir: &Path) {
    let o = lastlight(&line(text), dir);
    assert!(o.status.success(), "{text}: {}", String::from_utf8_lossy(&o.stderr));
}

/// A file with the configuration of a small model, and the model.
fn tiny(dir: &Path) {
    std::fs::write(dir.join("tiny.json"), TINY).expect("written");
    runs("lirm init --whole --config tiny.json --out tiny.safetensors -q", dir);
}

fn frames(capture: &Path) -> Value {
    // One file, or one for each part where some images are held out.
    let read = |name: &str| std::fs::read_to_string(capture.join(name));
    let text = read("transforms.json").or_else(|_| read("transforms_train.json")).expect("a capture");
    serde_json::from_str(&text).expect("JSON")
}

/// Where the world of a capture lies in that of `lirm gen`: X = 3 x + MOVED.
const MOVED: [f64; 3] = [5.0, -2.0, 1.0];

/// The images of a set as a capture of another program: no mark of `lirm gen`, in another scale, at another place.
fn moved(from: &Path, to: &Path, keep: usize) {
    let mut all = frames(from);
    let own = all.as_object_mut().expect("an object");
    own.remove("lirm_gen");
    let list = own["frames"].as_array_mut().expect("frames");
    list.truncate(keep);
    for frame in list {
        for (row, by) in MOVED.iter().enumerate() {
            let x = frame["transform_matrix"][row][3].as_f64().expect("a number");
            frame["transform_matrix"][row][3] = json!(3.0 * x + by);
        }
        let entries = frame.as_object_mut().expect("an object");
        entries.retain(|key, _| {
            ["file_path", "w", "h", "fl_x", "fl_y", "cx", "cy", "transform_matrix", "foreground_path"]
                .contains(&key.as_str())
        });
    }
    for folder in ["images", "foreground"] {
        std::fs::create_dir_all(to.join(folder)).expect("a folder");
        for file in std::fs::read_dir(from.join(folder)).expect("a folder") {
            let file = file.expect("a file");
            std::fs::copy(file.path(), to.join(folder).join(file.file_name())).expect("copied");
        }
    }
    std::fs::write(to.join("transforms.json"), all.to_string()).expect("written");
}

#[test]
fn a_capture_of_any_scale_is_placed_by_its_foreground_or_by_a_box() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    tiny(dir);
    runs("lirm gen --views 6 --framing whole --size 64 --samples 1 --texture 32 --out set -q", dir);
    moved(&dir.join("set/object_00000/uniform"), &dir.join("photos"), 4);
    let read = |capture: &str, more: &str, out: &str| {
        runs(&format!("lirm reconstruct {capture} --model tiny.safetensors {more} --out {out} -q"), dir);
        State::read(&dir.join(out)).expect("a state")
    };
    // One of eight images of other captures is held out unless they are named.
    let four = "--inputs 0000,0001,0002,0003";
    let found = read("photos", four, "found");
    assert_eq!(found.sets, [4]);
    for (x, wanted) in found.placement.center.iter().zip(MOVED) {
        assert!((x - wanted).abs() < 0.3, "around the object: {:?}", found.placement.center);
    }
    // The object has at most the radius 1.5 here, which becomes ½.
    let scale = found.placement.scale;
    assert!((0.3..0.7).contains(&scale), "{scale}");
    let given = read("photos", &format!("{four} --box 3.425,-3.575,-0.575,6.575,-0.425,2.575"), "given");
    assert!(
        (given.placement.scale - 1.0 / 3.0).abs() < 1e-6,
        "the box of the ball: {}",
        given.placement.scale
    );
    let same = read("set/object_00000/uniform", four, "same");
    let far = given.tokens.iter().zip(&same.tokens).map(|(a, b)| (a - b).abs()).filter(|d| *d > 1e-3).count();
    assert_eq!(far, 0, "the same object in the same box");
    // An update keeps the exposure of the first images, and tells which it has read before.
    State { exposure: Some(Common::of(0.4)), ..found }.write(&dir.join("dim.safetensors")).expect("written");
    let again = format!("lirm update dim.safetensors photos --model tiny.safetensors {four} --out dim");
    let told = stderr(&lastlight(&line(&again), dir));
    assert!(told.contains("names of images that the state has read already: 4"), "{told}");
    assert_eq!(State::read(&dir.join("dim")).expect("a state").exposure, Some(Common::of(0.4)));
    let elsewhere =
        "lirm update dim.safetensors set/object_00000/uniform --model tiny.safetensors --inputs 0000 --out d";
    refused(&line(elsewhere), dir, 2, &["capture", "in the box of the state"]);
    refused(
        &line("lirm reconstruct photos --model tiny.safetensors --box 1,2,3 --out d"),
        dir,
        2,
        &["--box"],
    );
    // A single camera does not show how far the object is.
    moved(&dir.join("set/object_00000/uniform"), &dir.join("single"), 1);
    let single = read("single", "--inputs 0000", "one");
    let eye = frames(&dir.join("set/object_00000/uniform"))["frames"][0]["transform_matrix"].clone();
    let square = (0..3).fold(0.0, |sum, k| {
        let d = single.placement.center[k] - (3.0 * eye[k][3].as_f64().expect("a number") + MOVED[k]);
        sum + d * d
    });
    assert!((square - 1.0).abs() < 1e-4, "one unit ahead: {square}");
    assert_eq!(read("single", "--inputs 0000 --box 3,-4,-1,7,0,3", "boxed").placement.center, MOVED);
}

/// The first images of a set as COLMAP's text files and images with the foreground as alpha.
fn colmap(from: &Path, to: &Path, keep: usize) {
    let all = frames(from);
    let model = to.join("sparse/0");
    std::fs::create_dir_all(&model).expect("a folder");
    std::fs::create_dir_all(to.join("images")).expect("a folder");
    let (mut cameras, mut images) = (String::new(), String::new());
    for (i, frame) in all["frames"].as_array().expect("frames").iter().take(keep).enumerate() {
        let number = |key: &str| frame[key].as_f64().or_else(|| all[key].as_f64()).expect("a number");
        let lens = ["w", "h", "fl_x", "fl_y", "cx", "cy"].map(|key| number(key).to_string()).join(" ");
        cameras += &format!("{i} PINHOLE {lens}\n");
        let m =
            |row: usize, column: usize| frame["transform_matrix"][row][column].as_f64().expect("a number");
        // Rows of the rotation from world to camera: x right, y down, z ahead.
        let r: [[f64; 3]; 3] =
            std::array::from_fn(|k| std::array::from_fn(|j| if k == 0 { m(j, k) } else { -m(j, k) }));
        let t = r.map(|row| -(0..3).fold(0.0, |sum, j| sum + row[j] * m(j, 3)));
        // The component of the quaternion that is largest in magnitude, and the others by it.
        let squares = [
            1.0 + r[0][0] + r[1][1] + r[2][2],
            1.0 + r[0][0] - r[1][1] - r[2][2],
            1.0 - r[0][0] + r[1][1] - r[2][2],
            1.0 - r[0][0] - r[1][1] + r[2][2],
        ];
        let largest = (0..4).max_by(|a, b| squares[*a].total_cmp(&squares[*b])).expect("four");
        let product = |a: usize, b: usize| match (Ord::min(a, b), Ord::max(a, b)) {
            (0, 1) => r[2][1] - r[1][2],
            (0, 2) => r[0][2] - r[2][0],
            (0, 3) => r[1][0] - r[0][1],
            (1, 2) => r[0][1] + r[1][0],
            (1, 3) => r[0][2] + r[2][0],
            (2, 3) => r[1][2] + r[2][1],
            (a, _) => squares[a],
        };
        let q: [f64; 4] = std::array::from_fn(|k| product(largest, k) / (2.0 * squares[largest].sqrt()));
        let name =
            frame["file_path"].as_str().expect("a path").rsplit('/').next().expect("a name").to_owned();
        let name = if name.ends_with(".png") { name } else { name + ".png" };
        let pose: Vec<String> = q.iter().chain(&t).map(ToString::to_string).collect();
        images += &format!("{} {} {i} {name}\n\n", i + 1, pose.join(" "));
        let [color, alpha] = ["images", "foreground"]
            .map(|folder| image_file::read(&from.join(folder).join(&name)).expect("an image"));
        let bytes = |x: &Picture, p: usize| match &x.samples {
            Samples::U8(all) => all[x.channels.len() * p..][..Ord::min(x.channels.len(), 3)].to_vec(),
            other => panic!("bytes, not {other:?}"),
        };
        let rgba: Vec<u8> = (0..color.width * color.height)
            .flat_map(|p| [bytes(&color, p), bytes(&alpha, p)[..1].to_vec()].concat())
            .collect();
        image_file::write_png(&to.join("images").join(&name), color.width, color.height, 4, &rgba)
            .expect("written");
    }
    std::fs::write(model.join("cameras.txt"), cameras).expect("written");
    std::fs::write(model.join("images.txt"), images).expect("written");
    std::fs::write(model.join("points3D.txt"), "").expect("written");
}

#[test]
fn a_folder_of_colmap_is_read_like_another_capture() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    tiny(dir);
    runs("lirm gen --views 6 --framing whole --size 64 --samples 1 --texture 32 --out set -q", dir);
    colmap(&dir.join("set/object_00000/uniform"), &dir.join("colmap"), 4);
    let read = |capture: &str, out: &str| {
        let text = format!(
            "lirm reconstruct {capture} --model tiny.safetensors --inputs 0000,0001,0002,0003 --box -0.525,-0.525,-0.525,0.525,0.525,0.525 --out {out} -q"
        );
        runs(&text, dir);
        State::read(&dir.join(out)).expect("a state")
    };
    let [own, other] = [read("set/object_00000/uniform", "own"), read("colmap", "other")];
    assert_eq!(own.sets, other.sets);
    let far = |a: f32, b: f32| (a - b).abs() > 2e-3;
    let differ = own.tokens.iter().zip(&other.tokens).filter(|(a, b)| far(**a, **b)).count();
    assert_eq!(differ, 0, "the same images and cameras, of {} numbers", own.tokens.len());
}

/// Two sets in one command and in two, whatever is known of the exposures: of a white dome (all 1), under a map (each
/// its own), of photos (unknown).
#[test]
fn a_second_command_has_the_bits_of_one_for_both_sets() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    tiny(dir);
    runs("lirm gen --views 6 --lighting both --size 64 --samples 1 --texture 32 --out set -q", dir);
    moved(&dir.join("set/object_00000/uniform"), &dir.join("photos"), 4);
    let own: Vec<Option<f64>> = frames(&dir.join("set/object_00000/environment"))["frames"]
        .as_array()
        .expect("frames")
        .iter()
        .map(|frame| frame["exposure"].as_f64())
        .collect();
    assert!(own[0].is_some() && own[1..].iter().any(|e| *e != own[0]), "exposed one by one: {own:?}");
    for (capture, placed) in [
        ("set/object_00000/uniform", ""),
        ("set/object_00000/environment", ""),
        ("photos", "--box 3.425,-3.575,-0.575,6.575,-0.425,2.575"),
    ] {
        let made = |command: &str, out: &str| {
            json(&line(&format!("{command} --model tiny.safetensors --out {out} --force --json -q")), dir)
        };
        let both = made(
            &format!("lirm reconstruct {capture} --inputs 0000,0001,0002,0003 --images-per-set 2 {placed}"),
            "both",
        );
        let first = made(&format!("lirm reconstruct {capture} --inputs 0000,0001 {placed}"), "first");
        let second = made(&format!("lirm update first {capture} --inputs 0002,0003"), "second");
        assert_eq!(both["sets"], json!([2, 2]));
        assert_eq!(second["digest"], both["digest"], "{capture}");
        assert_ne!(first["digest"], both["digest"], "{capture}: the second set counts");
        assert_eq!(
            (&second["exposure"], both["exposure"].is_null()),
            (&both["exposure"], capture == "photos"),
            "{capture}"
        );
    }
}

#[test]
fn sizes_and_lenses_may_differ() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    tiny(dir);
    for (size, out) in [(64, "large"), (48, "small")] {
        runs(&format!("lirm gen --views 6 --size {size} --samples 1 --texture 32 --out {out} -q"), dir);
        moved(&dir.join(format!("{out}/object_00000/uniform")), &dir.join(format!("{out}-photos")), 4);
    }
    // The first two images of one size, the others of another.
    let text = |of: &str| std::fs::read_to_string(dir.join(of).join("transforms.json")).expect("a capture");
    let parse = |of: &str| -> Value { serde_json::from_str(&text(of)).expect("JSON") };
    let (mut both, small) = (parse("large-photos"), parse("small-photos"));
    for i in 2..4 {
        both["frames"][i] = small["frames"][i].clone();
        for folder in ["images", "foreground"] {
            let name = format!("{folder}/{i:04}.png");
            std::fs::copy(dir.join("small-photos").join(&name), dir.join("large-photos").join(&name))
                .expect("copied");
        }
    }
    std::fs::write(dir.join("large-photos/transforms.json"), both.to_string()).expect("written");
    let read = |capture: &str, more: &str, out: &str| {
        json(
            &line(&format!(
                "lirm reconstruct {capture} --model tiny.safetensors {more} --out {out} --json -q"
            )),
            dir,
        )
    };
    let four = "--inputs 0000,0001,0002,0003";
    let cut = read("large-photos", four, "cut");
    let own = read("large-photos", &format!("{four} --downscale 1"), "own");
    assert_eq!((&cut["sets"], &own["sets"]), (&json!([4]), &json!([4])), "cut to one size; as they are");
    let large = read("large-photos", "--inputs 0000,0001 --downscale 1", "same");
    assert_ne!(cut["digest"], own["digest"], "other pixels");
    assert_ne!(own["digest"], large["digest"], "the images of another size count");
    // 64 tokens for each image of 64², 36 for one of 48².
    let text =
        format!("lirm reconstruct large-photos --model tiny.safetensors {four} --downscale 1 --out told");
    let (told, of_state) = (stderr(&lastlight(&line(&text), dir)), 6 * 4 + 4);
    assert!(told.contains(&format!("{} tokens in the largest set", of_state + 2 * 64 + 2 * 36)), "{told}");
    // Each image is shrunk or cut by its own size.
    let mixed = read("large-photos", &format!("{four} --images-per-set 2"), "mixed");
    let shrunk = read("large-photos", "--inputs 0000,0001", "shrunk");
    assert_eq!(mixed["changes"][0], shrunk["changes"][0], "an image of another size changes nothing");
    // Two images in folders have the same name.
    let mut twice = parse("large-photos");
    std::fs::create_dir_all(dir.join("large-photos/left")).expect("a folder");
    std::fs::copy(dir.join("large-photos/images/0000.png"), dir.join("large-photos/left/0001.png"))
        .expect("copied");
    twice["frames"][0]["file_path"] = json!("left/0001.png");
    std::fs::write(dir.join("large-photos/transforms.json"), twice.to_string()).expect("written");
    refused(
        &line("lirm reconstruct large-photos --model tiny.safetensors --inputs 0001 --out d"),
        dir,
        2,
        &["--inputs", "left/0001.png", "images/0001.png"],
    );
    // An image without the object.
    let empty = vec![0; 64 * 64];
    image_file::write_png(&dir.join("large-photos/foreground/0001.png"), 64, 64, 1, &empty).expect("written");
    refused(
        &line("lirm reconstruct large-photos --model tiny.safetensors --inputs images/0001.png,0002 --out d"),
        dir,
        2,
        &["0001.png", "foreground", "the object in at least one pixel"],
    );
    refused(
        &line("lirm reconstruct large-photos --model tiny.safetensors --inputs 0002 --downscale 4 --out d"),
        dir,
        2,
        &["image size", "12x12"],
    );
    runs("lirm gen --cameras egocentric --views 6 --size 64 --samples 1 --texture 32 --out head -q", dir);
    let capture = "head/object_00000/uniform";
    assert_eq!(frames(&dir.join(capture))["camera_model"], "OPENCV_FISHEYE");
    let made = read(capture, "--images-per-set 3", "fisheye");
    assert_eq!(made["sets"].as_array().map(Vec::len), Some(2), "{made}");
    assert!(
        made["evaluation"]["mean"]["psnr_db"].is_number(),
        "an image through a fisheye is rendered too: {made}"
    );
}

#[test]
fn a_configuration_file_makes_other_models() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    tiny(dir);
    std::fs::write(
        dir.join("tri.json"),
        r#"{"planes": 3, "plane_tokens": 3, "embed_tokens": 0, "blocks": 1, "width": 16, "heads": 2, "channels": 4, "fuse": "published", "material_layers": 2}"#,
    )
    .expect("written");
    let short = "--iterations 1 --batch 1 --objects-at-once 1 --json -q";
    let options = "--state-gradient --normal-weight 2";
    let tri =
        json(&line(&format!("lirm train --stage 1a --config tri.json {options} --out tri {short}")), dir);
    let of = |key: &str| tri["settings"][key].clone();
    assert_eq!((of("planes"), of("plane_tokens"), of("fuse")), (3.into(), 3.into(), "published".into()));
    assert_eq!(of("first_values"), "scaled", "what the file does not say is as in small");
    assert_eq!(
        (of("state_gradient"), of("last_set_only"), of("normal_weight")),
        (true.into(), Value::Null, 2.0.into())
    );
    let next = json(
        &line(&format!("lirm train --stage 2a --from tri --last-set-only --added 1 --out next {short}")),
        dir,
    );
    assert_eq!(
        (&next["settings"]["last_set_only"], &next["settings"]["state_gradient"]),
        (&true.into(), &Value::Null)
    );
    assert_eq!((&next["settings"]["added"], &tri["settings"]["added"]), (&1.0.into(), &Value::Null));
    assert_eq!(next["settings"]["whole"], true);
    assert_eq!(next["settings"]["material_layers"], 2);
    // The layers of `paper` in their full width, with fewer blocks and tokens: a file, which reads images.
    let wide = json!({
        "blocks": 1, "width": 1024, "heads": 16, "plane_tokens": 2, "embed_tokens": 2, "channels": 32, "fuse": "published", "pose": "first-camera",
        "first_values": "published", "whole": true,
    });
    std::fs::write(dir.join("wide.json"), wide.to_string()).expect("written");
    let wide = json(&line("lirm init --config wide.json --out wide.safetensors --json"), dir);
    assert!(wide["parameters"].as_u64().is_some_and(|n| n > 15_000_000), "{wide}");
    runs("lirm gen --views 6 --size 64 --samples 1 --texture 32 --out set -q", dir);
    let read = "lirm reconstruct set/object_00000/uniform --model wide.safetensors --out wide --json -q";
    assert!(json(&line(read), dir)["evaluation"]["mean"]["psnr_db"].is_number(), "a field of a wide model");
    // As many layers as a head of a field may have.
    let deep = json!({ "blocks": 1, "width": 16, "heads": 2, "plane_tokens": 2, "channels": 4, "material_layers": 15 });
    std::fs::write(dir.join("deep.json"), deep.to_string()).expect("written");
    runs("lirm init --whole --config deep.json --out deep.safetensors -q", dir);
    runs("lirm reconstruct set/object_00000/uniform --model deep.safetensors --out deep -q", dir);
    let told =
        lastlight(&line("lirm reconstruct set/object_00000/uniform --model wide.safetensors --out w"), dir);
    let told = stderr(&told);
    let count = format!("{} parameters", wide["parameters"]);
    assert!(
        [&*count, "tokens in the largest set", "MiB", "GFLOP"].iter().all(|part| told.contains(part)),
        "{told}"
    );
    std::fs::write(dir.join("huge.json"), r#"{"blocks": 48, "width": 4096, "heads": 64}"#).expect("written");
    let huge = "lirm init --config huge.json --max-memory 1G --out d";
    refused(&line(huge), dir, 2, &["lirm init", "--max-memory"]);
    assert!(!dir.join("d").exists(), "nothing is written");
    std::fs::write(dir.join("bad.json"), r#"{"depth": 3}"#).expect("written");
    refused(&line("lirm init --config bad.json --out d"), dir, 2, &["bad.json", "depth", "blocks"]);
    std::fs::write(dir.join("bad.json"), "{").expect("written");
    refused(&line("lirm init --config bad.json --out d"), dir, 2, &["bad.json", "a complete JSON document"]);
    refused(&line("lirm init --config none.json --out d"), dir, 2, &["none.json"]);
    refused(&line("lirm init --config large --out d"), dir, 2, &["large", "small, paper or a .json file"]);
    refused(
        &line("lirm train --stage 2a --config tiny.json --normal-weight 0 --out d"),
        dir,
        2,
        &["--normal-weight", "above 0"],
    );
    refused(
        &line("lirm train --stage 1a --config tiny.json --max-memory 20M --objects-at-once 1 --out d"),
        dir,
        2,
        &["lirm train", "--objects-at-once"],
    );
}

#[test]
fn a_reconstruction_is_shown_under_another_light_and_an_overflow_is_refused() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    tiny(dir);
    runs("lirm gen --views 6 --size 64 --samples 1 --texture 32 --out set -q", dir);
    runs("lirm reconstruct set/object_00000/uniform --model tiny.safetensors --out r -q", dir);
    // The largest weights that a file may have: their products overflow in the second set.
    let mut large = Model::read(&dir.join("tiny.safetensors")).expect("a model");
    for name in ["places/planes", "places/panoramas", "fuse/w1", "fuse/w2", "norm/bias"] {
        large.params.get_mut(name).expect("an array").fill(1e12);
    }
    large.write(&dir.join("large.safetensors"), Precision::Single).expect("written");
    refused(
        &line(
            "lirm reconstruct set/object_00000/uniform --images-per-set 3 --model large.safetensors --out d",
        ),
        dir,
        1,
        &["LIRM state", "overflow", "--model"],
    );
    assert!(!dir.join("d").exists(), "nothing is left");
    let relit = json(
        &line("lirm relight r --env sunset --cameras orbit:2 --size 16x16 --samples 1 --out relit --json -q"),
        dir,
    );
    assert_eq!(relit["images"], 2, "two directions: {relit}");
    let images = ["000.png", "001.png"]
        .map(|name| std::fs::read(dir.join("relit/images").join(name)).expect("an image"));
    assert_ne!(images[0], images[1], "from two sides");
    let other = "lirm relight r --env studio --cameras orbit:2 --size 16x16 --samples 1 --out other -q";
    runs(other, dir);
    let other = std::fs::read(dir.join("other/images/000.png")).expect("an image");
    assert_ne!(images[0], other, "under another light");
    // The mesh is in the axes of the capture whatever those of the field are.
    runs(
        "lirm reconstruct set/object_00000/uniform --model tiny.safetensors --field-axes first-camera --out t -q",
        dir,
    );
    let middle = |of: &str| -> Vec<f64> {
        let made =
            json(&line(&format!("field mesh {of} --out {of}.glb --side 48 --texture 128 --json -q")), dir);
        assert!(made["vertices"].as_u64().is_some_and(|n| n > 100), "{made}");
        let bytes = std::fs::read(dir.join(of).with_extension("glb")).expect("a mesh");
        let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
        let header: Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
        let positions = header["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64();
        let accessor = &header["accessors"][positions.expect("an index") as usize];
        let of = |end: &str, k: usize| accessor[end][k].as_f64().expect("a number");
        (0..3).map(|k| 0.5 * (of("min", k) + of("max", k))).collect()
    };
    let (own, turned) = (middle("r"), middle("t"));
    assert!(own.iter().zip(&turned).all(|(a, b)| (a - b).abs() < 0.1), "{own:?} {turned:?}");
}
