//! `last inspect` and `last import`: missing parts of a capture are named, and published layouts are
//! converted.

use crate::common;
use crate::mini_person::{Cam, Mini, betas, figure_video, thetas, write_picture};
use crate::program::{code, json, lastlight, refused, stderr, stdout};
use crate::python::{Py, dump};
use lastlight::scene::person::PersonCapture;
use serde_json::Value;
use std::path::Path;

#[test]
fn inspect_says_what_is_missing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = folder.path();
    figure_video(&dir.join("data"));
    let record = json(&["last", "inspect", "data", "--out", "look", "--json"], dir);
    assert_eq!(
        (record["usable"].as_bool(), record["kind"].as_str()),
        (Some(true), Some("figure")),
        "{record}"
    );
    assert_eq!(record["images"].as_array().map(Vec::len), Some(6), "four moments, two cameras");
    for name in record["images"].as_array().expect("a list") {
        let picture = lastlight::io::image_file::read(&dir.join("look").join(name.as_str().expect("a name")));
        assert_eq!(picture.expect("an image").width, 384, "enlarged by an integer factor");
    }
    refused(&["last", "inspect", "data", "--out", "look"], dir, 2, &["--out", "new or empty"]);
    let o = lastlight(&["last", "inspect", "data"], dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    let text = stdout(&o);
    assert!(text.contains("256 points") && text.contains("points on mask"), "{text}");
    std::fs::remove_file(dir.join("data/video/images/c00_f0001.png")).expect("removed");
    std::fs::remove_file(dir.join("data/video/foreground/c00_f0002.png")).expect("removed");
    let o = lastlight(&["last", "inspect", "data"], dir);
    assert_eq!(code(&o), 1, "something needed is missing");
    let text = stdout(&o);
    assert_eq!(text.lines().filter(|l| l.starts_with("problem ")).count(), 2, "every one is named: {text}");
    assert!(text.contains("c00_f0001.png") && text.contains("c00_f0002.png"), "{text}");
    let o = lastlight(&["last", "inspect", "data", "--json"], dir);
    let record: Value = serde_json::from_slice(&o.stdout).expect("JSON all the same");
    assert_eq!((code(&o), record["usable"].as_bool()), (1, Some(false)), "not usable");
    refused(&["last", "inspect", "nothing"], dir, 2, &["transforms_train.json", "no such file or folder"]);
}

/// A miniature of PeopleSnapshot of four frames, for the command line.
fn snapshot(dir: &Path) -> Vec<Vec<u8>> {
    std::fs::create_dir_all(dir).expect("made");
    let (mini, side) = (Mini::new(), 16);
    let cam = Cam { t: [0.0; 3], ..Cam::around(side, 0.0, false, &[0.0; 5]) };
    let rest = mini.shaped(&betas());
    let turns = thetas(0, [std::f64::consts::PI, 0.0, 0.0]);
    let points = mini.posed(&rest, &turns, &|x| [x[0], x[1], x[2] + 3.0]);
    let (rgb, _) = cam.photograph(side, &points);
    let camera = dump(&Py::Dict(vec![
        ("camera_t", Py::Array(vec![3], vec![0.0; 3])),
        ("camera_rt", Py::Array(vec![3], vec![0.0; 3])),
        ("camera_f", Py::Array(vec![2], vec![cam.k[0][0], cam.k[1][1]])),
        ("camera_c", Py::Array(vec![2], vec![cam.k[0][2], cam.k[1][2]])),
        ("camera_k", Py::Array(vec![5], vec![0.0; 5])),
    ]));
    std::fs::write(dir.join("camera.pkl"), camera).expect("written");
    common::copy_hdf5("standing_4", dir);
    std::fs::write(dir.join("body.pkl"), mini.pickle()).expect("written");
    vec![rgb; 4]
}

#[test]
fn import_from_the_command_line() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = folder.path();
    let photographs = snapshot(&dir.join("person"));
    for (f, rgb) in photographs.iter().enumerate() {
        write_picture(&dir.join(format!("person/images/{f:04}.png")), 16, 3, rgb);
    }
    let record = json(
        &["last", "import", "person", "--out", "made", "--body", "person/body.pkl", "--json", "--quiet"],
        dir,
    );
    assert_eq!(
        (record["layout"].as_str(), record["train"].as_u64()),
        (Some("people-snapshot"), Some(3)),
        "{record}"
    );
    let record = json(&["last", "inspect", "made", "--json"], dir);
    assert_eq!((record["usable"].as_bool(), record["kind"].as_str()), (Some(true), Some("smpl")), "{record}");
    refused(
        &["last", "import", "person", "--out", "made", "--body", "person/body.pkl"],
        dir,
        2,
        &["--out", "--force"],
    );
    refused(&["last", "import", "person", "--out", "b"], dir, 2, &["body model", "--body"]);
    refused(&["last", "import", "made", "--out", "b"], dir, 2, &["zju", "dna"]);
    refused(
        &["last", "import", "person", "--layout", "zip", "--out", "b"],
        dir,
        2,
        &["--layout", "zju-refine", "zip"],
    );
    refused(
        &["last", "import", "person", "--train-frames", "3", "--out", "b"],
        dir,
        2,
        &["--train-frames", "START:STEP:COUNT"],
    );
    refused(
        &["last", "inspect", "person"],
        dir,
        2,
        &["people-snapshot", "lastlight last import person --out"],
    );
    // What one import wrote, another writes again.
    let again = [
        "last",
        "import",
        "person",
        "--out",
        "again",
        "--body",
        "person/body.pkl",
        "--quiet",
        "--threads",
        "1",
    ];
    assert_eq!(code(&lastlight(&again, dir)), 0, "imported");
    common::assert_same(
        &common::tree(&dir.join("made")),
        &common::tree(&dir.join("again")),
        "whatever the threads",
    );
    std::fs::write(dir.join("evil.pkl"), b"cposix\nsystem\n(S'touch evil'\ntR.").expect("written");
    refused(&["last", "import", "person", "--out", "b", "--body", "evil.pkl"], dir, 2, &["posix.system"]);
    assert!(!dir.join("evil").exists() && !dir.join("b").exists(), "nothing was run or made");
}

#[cfg(unix)]
#[test]
fn a_video_is_taken_apart_or_the_command_is_given() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = folder.path();
    let photographs = snapshot(&dir.join("somebody"));
    std::fs::write(dir.join("somebody/somebody.mp4"), b"a video").expect("written");
    let run = |path: &str| {
        std::process::Command::new(env!("CARGO_BIN_EXE_lastlight"))
            .args(["last", "import", "somebody", "--out", "made", "--body", "somebody/body.pkl", "--quiet"])
            .env("PATH", path)
            .current_dir(dir)
            .output()
            .expect("the binary starts")
    };
    let o = run("/nonexistent");
    let text = stderr(&o);
    assert_eq!(code(&o), 2, "{text}");
    let command = "mkdir -p somebody/images && ffmpeg -nostdin -loglevel error -i somebody/somebody.mp4 -start_number 0 somebody/images/image_%04d.png";
    assert!(text.contains(command), "the exact command: {text}");
    assert!(
        !dir.join("somebody/images").exists() && !dir.join("somebody/images.part").exists(),
        "nothing half"
    );
    // A program of that name that does what ffmpeg would.
    write_picture(&dir.join("frame.png"), 16, 3, &photographs[0]);
    let bin = dir.join("bin");
    std::fs::create_dir(&bin).expect("made");
    let script = format!(
        "#!/bin/sh\nfor last; do :; done\nfor i in 0000 0001 0002 0003; do /bin/cp {} \"${{last%%%04d.png}}$i.png\"; done\n",
        dir.join("frame.png").display()
    );
    std::fs::write(bin.join("ffmpeg"), script).expect("written");
    std::fs::set_permissions(bin.join("ffmpeg"), std::fs::Permissions::from_mode(0o755))
        .expect("made executable");
    let o = run(bin.to_str().expect("text"));
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    assert_eq!(
        std::fs::read_dir(dir.join("somebody/images")).expect("made").count(),
        4,
        "frames beside the data"
    );
    let c = PersonCapture::open(&dir.join("made")).expect("a capture");
    assert_eq!((c.train.len(), c.test.len()), (3, 1), "imported");
    std::fs::write(bin.join("ffmpeg"), "#!/bin/sh\necho no such codec >&2\nexit 3\n").expect("written");
    std::fs::remove_dir_all(dir.join("somebody/images")).expect("removed");
    std::fs::remove_dir_all(dir.join("made")).expect("removed");
    let text = stderr(&run(bin.to_str().expect("text")));
    assert!(text.contains("no such codec") && text.contains(command), "{text}");
}
