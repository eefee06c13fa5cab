//! `lirm gen`: the same bytes for any number of threads and however often interrupted, read back by the
//! loaders.

use crate::common::{assert_same, tree};
use lastlight::fit::passes::PassSet;
use lastlight::geometry::bvh::Bvh;
use lastlight::io::capture::{Dialect, Split, read_capture};
use lastlight::lirm::r#gen::{Lighting, Set, Settings, Summary, run};
use lastlight::lirm::subject::Subject;
use lastlight::num::par;
use lastlight::scene::passes::PassImages;
use serde_json::Value;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

fn small() -> Settings {
    Settings {
        objects: 2,
        first: 9,
        lighting: Lighting::Both,
        shiny: true,
        views: 3,
        size: 24,
        samples: 4,
        texture: 64,
        map_width: 32,
        seed: 11,
        ..Settings::default()
    }
}

fn make(dir: &Path, settings: &Settings) -> Summary {
    run(dir, settings, false, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a set")
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("readable")).expect("JSON")
}

#[test]
fn the_bytes_do_not_depend_on_threads_or_on_how_many_objects_there_are() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut trees = Vec::new();
    for threads in [1, 2, 7] {
        let out = dir.path().join(threads.to_string());
        let summary = par::with_threads(threads, || make(&out, &small())).expect("a pool");
        assert_eq!((summary.objects, summary.rendered), (2, 2 * 3 * 3), "{threads} threads: images");
        assert_eq!(
            format!("{:016x}", summary.digest),
            "96d9864c840d4e84",
            "{threads} threads: digest of the set"
        );
        trees.push(tree(&out));
    }
    assert!(trees[0].len() > 2 * 3 * 3 * 7, "{} files", trees[0].len());
    assert_same(&trees[0], &trees[1], "one thread and two");
    assert_same(&trees[0], &trees[2], "one thread and seven");
    // The second object alone.
    let alone = dir.path().join("alone");
    make(&alone, &Settings { objects: 1, first: 10, ..small() });
    let both = [alone.join("object_00010"), dir.path().join("1/object_00010")].map(|d| tree(&d));
    assert_same(&both[0], &both[1], "an object does not depend on the others");
}

#[test]
fn an_interrupted_set_continues_to_the_same_bytes() {
    let dir = tempfile::tempdir().expect("a folder");
    let (whole, parts) = (dir.path().join("whole"), dir.path().join("parts"));
    let want = make(&whole, &small());
    let mut runs = 0;
    let got = loop {
        runs += 1;
        assert!(runs < 20, "every run makes some progress");
        let stop = AtomicBool::new(false);
        let mut seen = 0;
        let outcome = run(&parts, &small(), runs > 1, &stop, &mut |_, _, _| {
            seen += 1;
            // Each run is stopped a few images later than the one before it.
            stop.store(seen >= 5 * runs, Ordering::Relaxed);
        });
        match outcome {
            Ok(summary) => break summary,
            Err(e) => assert_eq!(e.exit_code(), 130, "interrupted, not failed: {e}"),
        }
    };
    assert!(runs > 2, "it was interrupted {} times", runs - 1);
    assert_eq!(got.digest, want.digest, "digest of the set");
    assert_same(&tree(&whole), &tree(&parts), "continued");
    let again =
        run(&parts, &small(), true, &AtomicBool::new(false), &mut |_, _, _| {}).expect("nothing to do");
    assert_eq!((again.rendered, again.digest), (0, want.digest), "a finished set is left alone");
    let other = Settings { samples: 5, ..small() };
    let refused = run(&parts, &other, true, &AtomicBool::new(false), &mut |_, _, _| {});
    assert!(refused.is_err_and(|e| e.exit_code() == 2), "other settings are refused");
}

#[test]
fn a_finished_set_is_looked_through_and_repaired() {
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("set");
    let made = make(&out, &small());
    let want = tree(&out);
    let again = || run(&out, &small(), true, &AtomicBool::new(false), &mut |_, _, _| {});
    // Three images: a file cut, one emptied, one lost; both objects are finished.
    let cut = "object_00009/shiny/depth/0001.exr";
    std::fs::write(out.join(cut), &want[cut][..want[cut].len() / 2]).expect("cut");
    std::fs::write(out.join("object_00010/uniform/images/0002.png"), b"").expect("emptied");
    std::fs::remove_file(out.join("object_00010/environment/material/0000.png")).expect("removed");
    let repaired = again().expect("repaired");
    assert_eq!((repaired.rendered, repaired.digest), (3, made.digest), "three images are rendered");
    assert_same(&want, &tree(&out), "repaired");
    // A lost description is made again with its images.
    std::fs::remove_file(out.join("object_00009/uniform/transforms.json")).expect("removed");
    assert_eq!(again().expect("repaired").rendered, 3, "one capture");
    assert_same(&want, &tree(&out), "described again");
    // A changed one is not taken for what was written, and not overwritten.
    let file = out.join("object_00010/shiny/transforms.json");
    let text =
        std::fs::read_to_string(&file).expect("readable").replacen("\"fov_deg\": ", "\"fov_deg\": 1", 1);
    std::fs::write(&file, &text).expect("changed");
    let refused = again().expect_err("changed").to_string();
    assert!(refused.contains("object_00010/shiny") && refused.contains("remove that folder"), "{refused}");
    assert_eq!(std::fs::read_to_string(&file).expect("readable"), text, "it is left as it is");
    std::fs::remove_dir_all(out.join("object_00010/shiny")).expect("removed");
    assert_eq!(again().expect("repaired").rendered, 3, "the capture that was removed");
    assert_same(&want, &tree(&out), "made again");
}

#[test]
fn a_folder_never_mixes_two_runs() {
    let dir = tempfile::tempdir().expect("a folder");
    let (fresh, used) = (dir.path().join("fresh"), dir.path().join("used"));
    // Training images of two objects, then fewer test images of one, begun in the same folder.
    let first = small();
    let second = Settings {
        objects: 1,
        set: Set::Test,
        lighting: Lighting::Environment,
        shiny: false,
        size: 8,
        samples: 1,
        seed: 12,
        ..small()
    };
    make(&fresh, &second);
    make(&used, &first);
    std::fs::write(used.join("notes.txt"), "mine").expect("written");
    let stop = AtomicBool::new(false);
    let mut seen = 0;
    let stopped = run(&used, &second, false, &stop, &mut |_, _, _| {
        seen += 1;
        stop.store(seen > 3, Ordering::Relaxed);
    });
    assert_eq!(stopped.expect_err("stopped").exit_code(), 130, "interrupted");
    assert!(read_capture(&used.join("object_00009/environment")).is_err(), "no cameras of the run before");
    let again = |settings| run(&used, settings, true, &AtomicBool::new(false), &mut |_, _, _| {});
    assert_eq!(again(&first).expect_err("other settings").exit_code(), 2, "the run before is gone");
    again(&second).expect("continued");
    assert_eq!(std::fs::read(used.join("notes.txt")).expect("kept"), b"mine", "other files stay");
    std::fs::remove_file(used.join("notes.txt")).expect("removed");
    assert_same(&tree(&fresh), &tree(&used), "started over");
    let capture = read_capture(&used.join("object_00009/environment")).expect("a capture");
    assert_eq!(capture.frames.len(), 48, "the test set");
}

#[test]
fn what_was_made_is_read_back_and_agrees_with_the_object() {
    let dir = tempfile::tempdir().expect("a folder");
    let settings = Settings { objects: 1, ..small() };
    make(dir.path(), &settings);
    let object = dir.path().join("object_00009");
    let record = json(&object.join("object.json"));
    let subject = Subject::new(&settings, 9).expect("the object");
    assert_eq!(record["triangles"], subject.object.mesh.triangles.len(), "triangles");
    assert!(record["environment"]["kind"].is_string(), "the light is described");
    let factor = record["versions"][2]["roughness_factor"].as_f64().expect("a factor");
    assert!((0.3..0.6).contains(&factor), "shiny by {factor}");
    let bvh = Bvh::build(&subject.object.mesh.positions, &subject.object.mesh.triangles);
    let (mut rough, mut compared, mut cameras) = (Vec::new(), 0, Vec::new());
    for version in ["uniform", "environment", "shiny"] {
        let capture = read_capture(&object.join(version)).expect("a capture");
        assert_eq!((capture.frames.len(), capture.dialect), (3, Dialect::Nerfstudio), "{version}");
        for frame in &capture.frames {
            let p = PassImages::read(frame).expect("passes");
            let depth = p.depth.expect("depth");
            let foreground = p.foreground.expect("foreground");
            let hit = depth.iter().filter(|z| **z > 0.0).count();
            assert!(hit > 20, "{version}, {}: the object is in the image ({hit} pixels)", frame.name);
            // Depth belongs to the ray through the middle of a pixel, the foreground to its samples: they
            // differ at borders only.
            let agree = depth.iter().zip(&foreground).filter(|(z, a)| (**z > 0.0) == (**a >= 0.5)).count();
            assert!(agree > 500, "{version}, {}: depth and foreground agree on {agree} of 576", frame.name);
            let exposure = p.exposure.expect("an exposure");
            if version == "uniform" {
                assert_eq!(exposure, 1.0, "white stays white");
                let corner = p.radiance.as_ref().expect("radiance")[0];
                assert!(foreground[0] > 0.0 || corner == [1.0; 3], "a white dome behind: {corner:?}");
            } else {
                assert!((0.25..=4.0).contains(&exposure), "{version}: exposure {exposure}");
            }
            cameras.push((version, frame.name.clone(), frame.view_from_world, frame.intrinsics(24, 24).ok()));
            // The rays through the middles of the pixels find the same depth.
            let m = frame.view_from_world;
            let [fx, fy, cx, cy] = frame.intrinsics(24, 24).expect("intrinsics");
            let world = |v: [f64; 3]| -> [f32; 3] {
                std::array::from_fn(|k| (m[0][k] * v[0] + m[1][k] * v[1] + m[2][k] * v[2]) as f32)
            };
            let origin = world([-m[0][3], -m[1][3], -m[2][3]]);
            let (mut close, mut seen) = (0, 0);
            for (i, &z) in depth.iter().enumerate() {
                let d = [((i % 24) as f64 + 0.5 - cx) / fx, ((i / 24) as f64 + 0.5 - cy) / fy, 1.0];
                let direction = world(d);
                let t =
                    bvh.closest(&lastlight::geometry::bvh::Ray { origin, direction, t_max: f32::INFINITY }).t;
                seen += usize::from(z > 0.0);
                close += usize::from(if z > 0.0 { (t - z).abs() < 1e-4 } else { t == f32::INFINITY });
            }
            // A ray at a silhouette may pass on the other side: the pose went through text.
            assert!(
                close >= 574,
                "{version}, {}: {close} of 576 pixels have the depth of their ray",
                frame.name
            );
            compared += seen;
            if version != "uniform" {
                let r = p.roughness.expect("roughness");
                let covered = r.iter().zip(&foreground).filter(|(_, a)| **a == 1.0);
                let (sum, n) = covered.fold((0.0, 0.0), |(s, n), (r, _)| (s + f64::from(*r), n + 1.0));
                rough.push(sum / n);
            }
        }
    }
    assert!(compared > 9 * 40, "{compared} depths were compared");
    for (i, (version, name, pose, intrinsics)) in cameras.iter().enumerate().skip(3) {
        let (_, first_name, first_pose, first_intrinsics) = &cameras[i % 3];
        assert_eq!(name, first_name, "{version}: the same images in every light");
        assert_eq!((pose, intrinsics), (first_pose, first_intrinsics), "{version}, {name}: the same camera");
    }
    let (plain, shiny) = (rough[..3].iter(), rough[3..].iter());
    for (a, b) in plain.zip(shiny) {
        assert!((b / a - factor).abs() < 0.03, "roughness {a} becomes {b}, not {factor} times as much");
    }
}

#[test]
fn test_and_egocentric_sets_have_their_splits() {
    let dir = tempfile::tempdir().expect("a folder");
    let tiny = Settings { objects: 1, size: 8, samples: 1, passes: PassSet::NONE, shiny: false, ..small() };
    let out = dir.path().join("test");
    make(&out, &Settings { set: Set::Test, lighting: Lighting::Uniform, ..tiny.clone() });
    let object = out.join("object_00009");
    let capture = read_capture(&object.join("uniform")).expect("a capture");
    let count = |split| capture.frames.iter().filter(|f| f.split == split).count();
    assert_eq!([count(Split::Train), count(Split::Test), count(Split::Val)], [16, 12, 20], "16 in, 12 out");
    let protocol = &json(&object.join("object.json"))["protocol"];
    for order in ["input_sets_random", "input_sets_sequential"] {
        let sets = protocol[order].as_array().expect("sets");
        assert!(
            sets.len() == 4 && sets.iter().all(|s| s.as_array().is_some_and(|s| s.len() == 4)),
            "{order}"
        );
    }
    let out = dir.path().join("ego");
    let ego = Settings { set: Set::Egocentric, lighting: Lighting::Environment, views: 9, ..tiny };
    make(&out, &ego);
    let capture = read_capture(&out.join("object_00009/environment")).expect("a capture");
    assert_eq!(capture.frames.len(), 9, "moving images");
    assert_eq!(
        capture.frames.iter().filter(|f| f.split == Split::Test).count(),
        1,
        "every eighth is held out"
    );
    let fisheye =
        |f: &lastlight::io::capture::Frame| matches!(f.lens, lastlight::io::capture::Lens::Fisheye { .. });
    assert!(capture.frames.iter().all(fisheye), "a fisheye");
}

#[test]
fn models_from_files_fill_the_ball() {
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("brick.obj");
    let corner = |k: usize| format!("v {} {} {}\n", 10 + k % 2, 4 * (k / 2 % 2), 7 * (k / 4));
    let faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    std::fs::write(&file, (0..8).map(corner).collect::<String>() + faces).expect("written");
    let settings = Settings { meshes: vec![file], objects: 1, first: 0, passes: PassSet::NONE, ..small() };
    let subject = Subject::new(&settings, 0).expect("a brick");
    let reach = subject.object.mesh.positions.iter().fold(0.0_f32, |m, p| {
        let d = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
        if d > m { d } else { m }
    });
    assert!((0.499..=0.5).contains(&reach), "the farthest corner lies {reach} from the origin");
    let scale = subject.record["scale"].as_f64().expect("a scale");
    assert!((scale * (1.0_f64 + 16.0 + 49.0).sqrt() - 1.0).abs() < 0.03, "the diagonal becomes 1: {scale}");
    let out = dir.path().join("out");
    make(&out, &settings);
    assert_eq!(read_capture(&out.join("object_00000/shiny")).expect("a capture").frames.len(), 3, "pictures");
    let missing = Settings { meshes: vec![dir.path().join("none.obj")], ..settings };
    let failed = run(&dir.path().join("none"), &missing, false, &AtomicBool::new(false), &mut |_, _, _| {});
    assert!(failed.is_err(), "a missing model is an error");
}
