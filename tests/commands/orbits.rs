//! Orbits of `splat render`: the object is upright, whole, and large, whichever way is up in the world of its capture.

use crate::program::{code, json, lastlight, refused, stderr};
use lastlight::io::image_file;
use lastlight::scene::convert::write_scene;
use lastlight::scene::gaussians::Gaussians;
use serde_json::{Value, json};
use std::path::Path;

/// A rotation of the world, row-major.
type Turn = [[f64; 3]; 3];

/// z up; y down, as COLMAP leaves it; tilted by about 50 degrees around a skew axis.
const WORLDS: [(&str, Turn); 3] = [
    ("z_up", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ("y_down", [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    ("tilted", [[0.76, -0.48, 0.4384], [0.64, 0.6, -0.48], [-0.0326, 0.6454, 0.7632]]),
];

/// The nearest rotation to a matrix that is one to two digits (Gram and Schmidt).
fn orthonormal(m: Turn) -> Turn {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let unit = |a: [f64; 3]| a.map(|x| x / dot(a, a).sqrt());
    let x = unit(m[0]);
    let y = unit(std::array::from_fn(|k| m[1][k] - dot(m[1], x) * x[k]));
    [x, y, [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]]
}

fn turned(r: &Turn, p: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| r[i][0] * p[0] + r[i][1] * p[1] + r[i][2] * p[2])
}

/// Eight directions.
const AROUND: [[f64; 2]; 8] =
    [[1.0, 0.0], [0.7, 0.7], [0.0, 1.0], [-0.7, 0.7], [-1.0, 0.0], [-0.7, -0.7], [0.0, -1.0], [0.7, -0.7]];

/// A figure of 1.8 off the origin, red above and green below, thinner above; without its world's rotation.
fn figure(r: &Turn) -> Gaussians {
    let mut g = Gaussians { sh_degree: 0, ..Gaussians::default() };
    for i in 0..1200 {
        let height = (i / 8) as f64 / 149.0;
        let [x, y] = AROUND[i % 8];
        let width = 0.3 - 0.15 * height;
        let p = [2.0 + width * x, -1.0 + width * y, 0.5 + 1.8 * height];
        g.means.push(turned(r, p).map(|x| x as f32));
        g.quats.push([1.0, 0.0, 0.0, 0.0]);
        g.scales_log.push([-3.2; 3]);
        g.opacity_logits.push(4.0);
        let color = if height > 0.5 { [1.5, -1.7, -1.7] } else { [-1.7, 1.5, -1.7] };
        g.sh.extend(color);
    }
    g
}

/// Rotates the poses of a capture.
fn turn_cameras(path: &Path, r: &Turn) {
    let mut list: Value =
        serde_json::from_str(&std::fs::read_to_string(path).expect("readable")).expect("JSON");
    for frame in list["frames"].as_array_mut().expect("frames") {
        let m = frame["transform_matrix"].clone();
        let at = |i: usize, j: usize| m[i][j].as_f64().expect("a number");
        let row = |i: usize| {
            let columns = (0..4).map(|j| turned(r, [at(0, j), at(1, j), at(2, j)])[i]);
            columns.collect::<Vec<f64>>()
        };
        frame["transform_matrix"] = json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]);
    }
    std::fs::write(path, list.to_string()).expect("writes");
}

/// Content box of every image of a folder: it touches no border, is at least a third of the height, red above green.
fn check_views(folder: &Path, count: usize, what: &str) {
    let files: Vec<_> = std::fs::read_dir(folder.join("color"))
        .expect("images")
        .map(|e| e.expect("an entry").path())
        .collect();
    assert_eq!(files.len(), count, "{what}: all views");
    for file in files {
        let p = image_file::read(&file).expect("a PNG");
        let (w, h) = (p.width, p.height);
        let channel = |x: usize, y: usize, c: usize| p.value((y * w + x) * 3 + c);
        let lit = |x: usize, y: usize| (0..3).any(|c| channel(x, y, c) > 0.2);
        let inside: Vec<(usize, usize)> =
            (0..w * h).map(|i| (i % w, i / w)).filter(|&(x, y)| lit(x, y)).collect();
        let name = format!("{what}: {}", file.display());
        let span = |f: fn(&(usize, usize)) -> usize| {
            let all = inside.iter().map(f);
            (all.clone().min().expect("content"), all.max().expect("content"))
        };
        let ((left, right), (top, bottom)) = (span(|p| p.0), span(|p| p.1));
        assert!(left > 0 && right < w - 1 && top > 0 && bottom < h - 1, "{name}: whole");
        assert!(3 * (bottom + 1 - top) >= h, "{name}: {} of {h} rows", bottom + 1 - top);
        let mean = |color: usize| {
            let rows: Vec<usize> =
                inside.iter().filter(|&&(x, y)| channel(x, y, color) > 0.4).map(|p| p.1).collect();
            rows.iter().fold(0.0, |s, &y| s + y as f64) / rows.len() as f64
        };
        assert!(mean(0) + 0.2 * h as f64 * 0.5 < mean(1), "{name}: red at {}, green at {}", mean(0), mean(1));
    }
}

#[test]
fn orbits_of_fits_show_the_object_upright_whole_and_large() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let dir = dir.path();
    for (world, turn) in WORLDS {
        let turn = orthonormal(turn);
        let path = |name: &str| format!("{world}_{name}");
        let run = |args: &[&str]| {
            let o = lastlight(args, dir);
            assert_eq!(code(&o), 0, "{args:?}: {}", stderr(&o));
            stderr(&o)
        };
        let ply = path("figure.ply");
        write_scene(&dir.join(&ply), &figure(&turn), &[]).expect("writes");
        // Filmed from 12 sides 25 degrees above, in a world with z up, then in the other worlds.
        write_scene(&dir.join("still.ply"), &figure(&WORLDS[0].1), &[]).expect("writes");
        let (capture, out) = (path("capture"), path("fit"));
        let film =
            ["splat", "render", "still.ply", "--cameras", "orbit:12", "--elevation", "25", "--size", "72x96"];
        run(&[&film[..], &["--out", &capture]].concat());
        turn_cameras(&dir.join(&capture).join("transforms.json"), &turn);
        let start = ["--init", &ply, "--iterations", "3", "--sh-degree", "0"];
        run(&[&["splat", "fit", &capture, "--out", &out][..], &start].concat());

        let views = path("views");
        let text =
            run(&["splat", "render", &out, "--cameras", "orbit:36", "--size", "160x120", "--out", &views]);
        assert!(!text.contains("z is up"), "the cameras say what is up: {text}");
        check_views(&dir.join(&views), 36, world);
        let again = path("again");
        run(&["splat", "render", &out, "--cameras", &out, "--out", &again]);
        check_views(&dir.join(&again), 12, world);
    }
    // Without cameras, z is up or what is given.
    for (world, up) in [("z_up", "auto"), ("y_down", "-y")] {
        let (scene, out) = (format!("{world}_figure.ply"), format!("{world}_alone"));
        let args = [
            "splat",
            "render",
            &scene,
            "--cameras",
            "orbit:8",
            "--size",
            "160x120",
            "--up",
            up,
            "--out",
            &out,
        ];
        let o = lastlight(&args, dir);
        assert_eq!((code(&o), stderr(&o).contains("z is up")), (0, up == "auto"), "{}", stderr(&o));
        check_views(&dir.join(out), 8, world);
    }
}

#[test]
fn folders_without_a_scene_and_unknown_axes_are_refused() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let dir = dir.path();
    write_scene(&dir.join("figure.ply"), &figure(&WORLDS[0].1), &[]).expect("writes");
    let orbit = |scene: &'static str, up: &'static str| {
        ["splat", "render", scene, "--cameras", "orbit:2", "--out", "o", "--up", up]
    };
    refused(&orbit(".", "z"), dir, 2, &["scene.ply"]);
    refused(&orbit("nothing.ply", "z"), dir, 2, &["nothing.ply: no such file"]);
    refused(&orbit("figure.ply", "w"), dir, 2, &["--up", "-y"]);
    let small = [&orbit("figure.ply", "-x")[..], &["--size", "32x24", "--json"]].concat();
    assert_eq!(json(&small, dir)["images"], 2, "an axis");
    // Options of an orbit beside other cameras.
    let o =
        lastlight(&["splat", "render", "figure.ply", "--cameras", "o", "--out", "p", "--size", "64"], dir);
    assert!(code(&o) == 0 && stderr(&o).contains("--size has no effect"), "{}", stderr(&o));
}

#[test]
fn orbits_stay_where_the_photos_were_taken_and_keep_their_format() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let dir = dir.path();
    write_scene(&dir.join("figure.ply"), &figure(&WORLDS[0].1), &[]).expect("writes");
    let film = [
        "splat",
        "render",
        "figure.ply",
        "--cameras",
        "orbit:36",
        "--size",
        "36x48",
        "--out",
        "capture",
        "--json",
    ];
    json(&film, dir);
    // Twelve of thirty-six: a third of a turn, in portrait format.
    let path = dir.join("capture/transforms.json");
    let mut list: Value =
        serde_json::from_str(&std::fs::read_to_string(&path).expect("readable")).expect("JSON");
    list["frames"].as_array_mut().expect("frames").truncate(12);
    std::fs::write(&path, list.to_string()).expect("writes");
    let fit = [
        "splat",
        "fit",
        "capture",
        "--out",
        "fit",
        "--init",
        "figure.ply",
        "--iterations",
        "1",
        "--json",
        "-q",
    ];
    json(&fit, dir);

    let run = |out: &'static str, more: &[&'static str]| {
        let args = ["splat", "render", "fit", "--cameras", "orbit:3", "--json", "--out", out];
        let o = lastlight(&[&args[..], more].concat(), dir);
        assert_eq!(code(&o), 0, "{}", stderr(&o));
        let text = std::fs::read_to_string(dir.join(out).join("transforms.json")).expect("written");
        let record: Value = serde_json::from_slice(&o.stdout).expect("JSON");
        (record["arc_degrees"].as_f64(), stderr(&o), serde_json::from_str::<Value>(&text).expect("JSON"))
    };
    let (arc, text, views) = run("arc", &[]);
    assert!(arc.is_some_and(|a| (a - 120.0).abs() < 1.0), "{arc:?}");
    assert!(
        text.contains("degrees around the scene, and the orbit stays within them")
            && text.contains("--arc 360"),
        "{text}"
    );
    let frame = |views: &Value, i: usize| views["frames"][i].clone();
    assert_eq!((&frame(&views, 0)["w"], &frame(&views, 0)["h"]), (&600.into(), &800.into()), "portrait");
    let eye = |views: &Value, i: usize| -> [f64; 3] {
        let m = &frame(views, i)["transform_matrix"];
        std::array::from_fn(|k| m[k][3].as_f64().expect("a number"))
    };
    let apart = |views: &Value, i: usize, j: usize| {
        let (a, b) = (eye(views, i), eye(views, j));
        (0..3).fold(0.0, |s, k| s + (a[k] - b[k]) * (a[k] - b[k])).sqrt()
    };
    // Chords of 120 and of 60 degrees.
    let ratio = apart(&views, 0, 2) / apart(&views, 0, 1);
    assert!((ratio - 3.0_f64.sqrt()).abs() < 0.02, "from end to end: {ratio}");
    let (arc, text, views) = run("full", &["--arc", "360", "--size", "40x30"]);
    assert!(arc.is_none() && !text.contains("taken from"), "{text}");
    assert!((apart(&views, 0, 2) / apart(&views, 0, 1) - 1.0).abs() < 0.01, "a triangle");
    assert_eq!(frame(&views, 0)["w"], 40, "a given size");
    refused(
        &["splat", "render", "fit", "--cameras", "orbit:3", "--out", "x", "--arc", "-4"],
        dir,
        2,
        &["arc", "360"],
    );
    let o = lastlight(&["splat", "render", "fit", "--cameras", "fit", "--out", "y", "--arc", "90"], dir);
    assert!(code(&o) == 0 && stderr(&o).contains("--arc has no effect"), "{}", stderr(&o));
}
