//! `last gen` and `lirm gen` at the command line: interrupted at any moment, continued, refused.

use crate::common::{Tree, assert_same, tree};
use crate::program::{json, lastlight, refused, stdout};
use crate::samples::gltf;

#[test]
fn last_gen_makes_continues_and_refuses() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let base = [
        "last",
        "gen",
        "--scale",
        "smoke",
        "--split",
        "observational",
        "--equations",
        "LIN",
        "--observational",
        "3",
        "--appearances",
        "1",
        "--body-points",
        "64",
        "--size",
        "16",
    ];
    let with = |more: &[&'static str]| base.iter().chain(more).copied().collect::<Vec<&str>>();
    let made = json(&with(&["--out", "a", "--json"]), dir.path());
    assert_eq!(made["complete"], true, "finished");
    let text = stdout(&lastlight(&with(&["--out", "text"]), dir.path()));
    assert!(
        text.starts_with("text: 3 observational images (") && text.contains("text/dataset.json"),
        "{text}"
    );
    assert_eq!(made["files"].as_array().map(Vec::len), Some(2), "template and one shard");
    refused(&with(&["--out", "a"]), dir.path(), 2, &["new or empty folder"]);
    refused(&with(&["--out", "a", "--resume", "--seed", "1"]), dir.path(), 2, &["seed 0 instead of 1"]);
    assert_eq!(
        json(&with(&["--out", "a", "--resume", "--json"]), dir.path()),
        made,
        "continued: the same record"
    );
    assert_eq!(
        json(&with(&["--out", "a", "--force", "--json"]), dir.path()),
        made,
        "started over: the same record"
    );
    refused(&["last", "gen", "--out", "b", "--graph", "RING"], dir.path(), 2, &["RING"]);
    refused(
        &["last", "gen", "--out", "b", "--equations", "X"],
        dir.path(),
        2,
        &["--equations", "LIN, NL, NG, NL-NG"],
    );
    refused(
        &["last", "gen", "--out", "b", "--split", "video", "--size", "9999"],
        dir.path(),
        2,
        &["video size"],
    );
    refused(
        &["last", "gen", "--out", "b", "--split", "video", "--render-as", "points", "--passes", "all"],
        dir.path(),
        2,
        &["passes"],
    );
    refused(
        &["last", "gen", "--out", "b", "--character", "none.glb", "--animation", "Walk"],
        dir.path(),
        2,
        &["none.glb"],
    );
    std::fs::write(dir.path().join("arm.glb"), gltf::arm().glb()).expect("written");
    let character = ["last", "gen", "--out", "b", "--character", "arm.glb"];
    refused(&character, dir.path(), 2, &["--animation", "the file has", "bend"]);
    let mut unnamed = gltf::arm();
    unnamed.root["nodes"][2]["name"] = "hinge".into();
    std::fs::write(dir.path().join("arm.glb"), unnamed.glb()).expect("written");
    let bent = [&character[..], &["--animation", "bend"]].concat();
    refused(&bent, dir.path(), 2, &["elbow", "got the joints", "--elbow NAME"]);
    assert!(!dir.path().join("b").exists(), "what is refused makes no folder");
}

#[test]
fn lirm_gen_makes_continues_and_refuses() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let base = ["lirm", "gen", "--views", "2", "--size", "16", "--samples", "1", "--passes", "photo"];
    let with = |more: &[&'static str]| base.iter().chain(more).copied().collect::<Vec<&str>>();
    let made = json(&with(&["--out", "a", "--json"]), dir.path());
    assert_eq!((&made["objects"], &made["rendered"]), (&1.into(), &2.into()), "one object, two views");
    refused(&with(&["--out", "a"]), dir.path(), 2, &["new or empty folder"]);
    let again = json(&with(&["--out", "a", "--resume", "--json"]), dir.path());
    assert_eq!((&again["rendered"], &again["digest"]), (&0.into(), &made["digest"]), "nothing left to do");
    let more = json(&with(&["--out", "a", "--resume", "--objects", "2", "--json"]), dir.path());
    assert_eq!((&more["objects"], &more["rendered"]), (&2.into(), &2.into()), "another object");
    refused(
        &with(&["--out", "a", "--resume", "--seed", "1"]),
        dir.path(),
        2,
        &["--resume", "seed: 0, as in the set"],
    );
    assert_eq!(
        json(&with(&["--out", "a", "--force", "--json"]), dir.path())["digest"],
        made["digest"],
        "again"
    );
    refused(&with(&["--out", "b", "--mesh", "none.obj"]), dir.path(), 2, &["none.obj"]);
    refused(&with(&["--out", "b", "--env", "none.hdr"]), dir.path(), 2, &["env", "--lighting environment"]);
    refused(&with(&["--out", "b", "--lighting", "both", "--env", "none.hdr"]), dir.path(), 2, &["none.hdr"]);
    refused(&with(&["--out", "b", "--shiny"]), dir.path(), 2, &["shiny"]);
    refused(&with(&["--out", "b", "--size", "3"]), dir.path(), 2, &["size"]);
    assert!(!dir.path().join("b").exists(), "what is refused makes no folder");
    std::fs::create_dir(dir.path().join("mine")).expect("a folder");
    std::fs::write(dir.path().join("mine/letter.txt"), "dear").expect("writes");
    refused(&with(&["--out", "mine", "--resume"]), dir.path(), 2, &["mine", "other files"]);
    assert_eq!(std::fs::read_dir(dir.path().join("mine")).expect("a folder").count(), 1, "untouched");
}

/// What an interrupted run left: every file under its final name equals that of the complete set, `record`
/// states that the set is incomplete, and descriptions of what has not been finished are not there.
#[cfg(unix)]
fn assert_nothing_half_written(left: &Tree, whole: &Tree, record: &str, what: &str) {
    for (name, bytes) in left {
        let (folder, file) = name.rsplit_once('/').unwrap_or(("", name));
        if name == ".lastlight.lock" {
            assert!(bytes.iter().all(u8::is_ascii_digit), "{what}: the number of the process that held it");
        } else if file.starts_with(".lastlight-") {
            assert!(file.ends_with(".part"), "{what}: {name} has a name that no reader opens");
        } else if folder.ends_with(".shots") {
            let parsed: Result<serde_json::Value, _> = serde_json::from_slice(bytes);
            assert!(parsed.is_ok(), "{what}: {name} is no JSON document");
        } else if folder.ends_with(".shards") {
            assert_eq!(bytes.len(), 16, "{what}: {name} is no digest");
        } else if name == record {
            let there: serde_json::Value = serde_json::from_slice(bytes).expect("JSON");
            assert_eq!(there["complete"], false, "{what}: {name} states that it is not complete");
        } else {
            assert!(whole.get(name) == Some(bytes), "{what}: {name} is not that of the complete set");
        }
    }
    assert!(left.len() < whole.len(), "{what}: it was interrupted");
}

/// A moment to interrupt: the signal, what it is called, the file that is waited for.
#[cfg(unix)]
type Moment = (&'static str, &'static str, &'static str);

/// Interrupts a command when a file appears, checks the folder, continues, and compares with the complete
/// set.
#[cfg(unix)]
fn interrupt(args: &[&str], dir: &std::path::Path, whole: &Tree, record: &str, moments: &[Moment]) {
    use crate::program::{code, signalled, stderr};
    use std::os::unix::process::ExitStatusExt;
    for &(signal, out, file) in moments {
        let what = format!("{signal} at {file}");
        let args = [args, &["--out", out]].concat();
        let awaited = dir.join(out).join(file);
        let o = signalled(&args, dir, signal, &|| awaited.exists());
        if signal == "-INT" {
            assert_eq!(code(&o), 130, "{what}: {}", stderr(&o));
            assert!(stderr(&o).contains("--resume"), "{what}: it prints how to continue: {}", stderr(&o));
        } else {
            assert_eq!(o.status.signal(), Some(9), "{what}: killed");
        }
        assert_nothing_half_written(&tree(&dir.join(out)), whole, record, &what);
        let folder = awaited.parent().and_then(std::path::Path::parent).expect("a folder");
        let refused = lastlight::io::capture::read_capture(folder);
        assert!(refused.is_err(), "{what}: an unfinished folder is no capture");
        // A kill in the middle of a write leaves a temporary file; here it surely did.
        std::fs::write(awaited.with_file_name(".lastlight-aBc123.part"), "half").expect("written");
        std::fs::write(dir.join(out).join(".lastlight-dEf456.part"), "half").expect("written");
        json(&[&args[..], &["--resume", "--json"]].concat(), dir);
        assert_same(whole, &tree(&dir.join(out)), &what);
    }
}

#[cfg(unix)]
#[test]
fn last_gen_is_interrupted_at_any_moment_and_continues_to_the_same_bytes() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let args = [
        "last",
        "gen",
        "--split",
        "all",
        "--equations",
        "LIN",
        "--observational",
        "384",
        "--groups",
        "16",
        "--appearances",
        "2",
        "--body-points",
        "256",
        "--set-size",
        "32",
        "--frames",
        "12",
        "--test-cameras",
        "6",
        "--video-size",
        "48",
        "--samples",
        "8",
        "--passes",
        "all",
    ];
    json(&[&args[..], &["--out", "whole", "--json"]].concat(), dir.path());
    let whole = tree(&dir.path().join("whole"));
    let video = lastlight::io::capture::read_capture(&dir.path().join("whole/video")).expect("a capture");
    assert_eq!(video.frames.len(), 12 + 6, "images of the video");
    let moments = [
        ("-INT", "int-set", "observational/0002.npz"),
        ("-KILL", "kill-set", "interventions/0000.npz"),
        ("-INT", "int-video", "video/.shots/c00_f0002.json"),
        ("-KILL", "kill-video", "video/images/c00_f0005.png"),
    ];
    interrupt(&args, dir.path(), &whole, "dataset.json", &moments);
}

#[cfg(unix)]
#[test]
fn lirm_gen_is_interrupted_at_any_moment_and_continues_to_the_same_bytes() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let args = [
        "lirm",
        "gen",
        "--objects",
        "2",
        "--views",
        "8",
        "--size",
        "64",
        "--samples",
        "16",
        "--lighting",
        "both",
    ];
    let made = json(&[&args[..], &["--out", "whole", "--json"]].concat(), dir.path());
    assert_eq!(made["rendered"], 32, "two objects, two lights, eight views");
    let whole = tree(&dir.path().join("whole"));
    let moments = [
        ("-INT", "int", "object_00000/environment/.shots/0002.json"),
        ("-KILL", "kill", "object_00001/uniform/depth/0003.exr"),
        ("-KILL", "kill-at-once", "object_00000/uniform/images/0000.png"),
    ];
    interrupt(&args, dir.path(), &whole, "dataset.json", &moments);
}
