//! `last gen`: the same settings give the same bytes, whatever the threads and however often it was
//! interrupted.

use crate::common::{assert_same, real_data, tree};
use lastlight::fit::passes::PassSet;
use lastlight::io::{capture, npz};
use lastlight::last::character::CharacterSettings;
use lastlight::last::figure::{self, Rendering};
use lastlight::last::generate::{self, Report, Settings};
use lastlight::num::{bits, par};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Digests of the files of [`small`] in the order of the paths: template and sets; the video, which the
/// renderer of surfaces made.
const DIGESTS: [u64; 2] = [0xdebf_9dbc_cd2b_f950, 0xab1c_1526_4175_5a4a];

/// A data set of every kind that takes a second.
fn small() -> Settings {
    Settings {
        count: 80,
        groups: 9,
        appearances: 3,
        points: 128,
        frames: 4,
        test_cameras: 2,
        video_size: 24,
        set_size: 16,
        samples: 2,
        mechanism: "LIN".into(),
        ..Settings::smoke()
    }
}

fn make(settings: &Settings, dir: &Path, resume: bool, threads: usize) -> Report {
    let run = || generate::run(settings, dir, resume, &AtomicBool::new(false), &mut |_, _, _| {});
    par::with_threads(threads, run).expect("a pool").expect("a data set")
}

/// A character whose file does not exist.
fn nobody() -> CharacterSettings {
    CharacterSettings {
        file: "no such folder/it's nobody.glb".into(),
        animations: vec!["Walk".into()],
        elbow: None,
        hide: Vec::new(),
        play: false,
    }
}

#[test]
fn bytes_depend_on_neither_threads_nor_interruptions() {
    let settings = small();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| {
        let dir = folder.path().join(name);
        std::fs::create_dir_all(&dir).expect("made");
        dir
    };
    let one = at("one");
    make(&settings, &one, false, 1);
    let expected = tree(&one);
    for threads in [2, 7] {
        let dir = at(&format!("threads-{threads}"));
        make(&settings, &dir, false, threads);
        assert_same(&expected, &tree(&dir), &format!("{threads} threads"));
    }
    let digest = |is_video: bool| {
        let mut digest = bits::Digest::new();
        let wanted = |name: &str| name.ends_with(".npz") && !name.starts_with("video/");
        for (name, bytes) in &expected {
            if if is_video { name.starts_with("video/") } else { wanted(name) } {
                digest.bytes(name.as_bytes());
                digest.bytes(bytes);
            }
        }
        digest.value()
    };
    let digests = [digest(false), digest(true)];
    assert!(digests == DIGESTS, "digests {digests:#x?}; a change of bits needs a reason");

    // Stopped again and again after a few pieces of work, and continued.
    let dir = at("stopped");
    let mut runs = 0;
    loop {
        let stop = AtomicBool::new(false);
        let mut pieces = 0;
        let outcome = generate::run(&settings, &dir, runs > 0, &stop, &mut |_, _, _| {
            pieces += 1;
            // The first run is stopped at once, later ones go further.
            stop.store(pieces > runs, Ordering::Relaxed);
        });
        runs += 1;
        match outcome {
            Ok(_) => break,
            Err(e) => assert_eq!(e.exit_code(), 130, "interrupted, not failed: {e}"),
        }
        assert!(runs < 50, "every run gets further");
    }
    assert!(runs > 4, "it was interrupted: {runs} runs");
    assert_same(&expected, &tree(&dir), "interrupted");

    // What a power cut can do to a finished set: lost, emptied and cut files are made again. Other settings
    // are refused.
    std::fs::remove_file(dir.join("interventions/0001.npz")).expect("removed");
    std::fs::remove_file(dir.join("video/images/c00_f0002.png")).expect("removed");
    std::fs::write(dir.join("video/foreground/c00_f0001.png"), b"").expect("emptied");
    for name in ["video/images/c00_f0003.png", "observational/0000.npz", "template.npz", "video/body.npz"] {
        let bytes = &expected[name];
        std::fs::write(dir.join(name), &bytes[..bytes.len() / 2]).expect("cut");
    }
    make(&settings, &dir, true, 2);
    assert_same(&expected, &tree(&dir), "repaired");
    let other = Settings { seed: 1, ..settings };
    let e =
        generate::run(&other, &dir, true, &AtomicBool::new(false), &mut |_, _, _| {}).expect_err("differs");
    assert!(e.to_string().contains("seed 0 instead of 1"), "{e}");
    assert_same(&expected, &tree(&dir), "refused");
}

#[test]
fn arrays_are_those_of_the_layout() {
    let settings = Settings { set: "all".into(), factors: 6, graph: "ER-7".into(), ..small() };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let report = make(&settings, folder.path(), false, 2);
    let read = |name: &str| npz::read(&folder.path().join(name)).expect("readable");
    let shape = |arrays: &lastlight::num::array::Arrays, name: &str| {
        arrays.need(name).expect("there").shape().to_vec()
    };
    let t = read("template.npz");
    assert_eq!(shape(&t, "weights"), [128, 12], "weights");
    assert_eq!(shape(&t, "rest"), [12, 4, 4], "rest");
    let (spacing, sigma) =
        (t.need("spacing").expect("there").to_f64(), t.need("sigma").expect("there").to_f64());
    assert!(spacing.len() == 128 && spacing.iter().all(|s| *s > 0.0), "points lie apart");
    let off = spacing.iter().zip(&sigma).fold(0.0f64, |m, (d, s)| m + (s - 0.6 * d).abs());
    assert!(off < 1e-6, "σ = 0.6 × mean distance of the three nearest: {off}");
    let o = read("observational/0001.npz");
    assert_eq!(shape(&o, "images"), [16, 16, 16, 3], "64 + 16 frames");
    assert_eq!((shape(&o, "u"), shape(&o, "points")), (vec![16, 6], vec![16, 128, 3]), "factors, points");
    assert_eq!(o.need("index").expect("there").to_f64()[0], 64.0, "counted through");
    let i = read("interventions/0001.npz");
    assert_eq!(shape(&i, "after_images"), [1, 8, 16, 16, 3], "8 + 1 groups of 8");
    let target = i.scalar("target").expect("one") as usize;
    assert_eq!(target, 8 % 6, "targets take turns");
    let (u, v) = (i.need("after_u").expect("there").to_f64(), i.scalar("value").expect("one"));
    assert!((0..8).all(|m| u[6 * m + target] == v), "one value for the group");
    let body = read("video/body.npz");
    assert_eq!(shape(&body, "transforms"), [4, 12, 4, 4], "poses");
    assert_eq!(shape(&body, "factors"), [4, 6], "factors");
    let capture = capture::read_capture(&folder.path().join("video")).expect("a capture");
    let count = |split| capture.frames.iter().filter(|f| f.split == split).count();
    assert_eq!((count(capture::Split::Train), count(capture::Split::Test)), (4, 2), "splits");
    assert!(report.sortabilities.len() == 3 && report.record["complete"] == true, "the record is complete");
}

/// Silhouettes of the three renderings: splats, discs and a mesh over the same skeleton. The bounds follow
/// from the geometry:
///
/// * a splat of σ = 0.6 and a disc of 0.9 spacings extend beyond the body by the same distance, but the soft
///   edge of the splat covers another half pixel (blur of 0.3 px², opacities that add up): discs lie within
///   splats, splats within the pixels next to discs;
/// * discs extend 0.9 spacings beyond the capsules, the mesh lies within the capsules (limbs are thinner than
///   their capsules, trousers do not fill the band of the points of the skirt): the mesh lies within the
///   discs except for shoes, which have no points. The remaining difference shrinks with the spacing, so the
///   overlap grows with the number of points.
#[test]
fn both_point_renderers_and_surfaces_show_the_same_person() {
    const SIDE: usize = 64;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shown = |look: Rendering, points: usize| {
        let settings = Settings {
            set: "observational".into(),
            set_look: look,
            set_size: SIDE,
            count: 2,
            appearances: 1,
            points,
            samples: 8,
            ..small()
        };
        let dir = folder.path().join(format!("{}-{points}", look.name()));
        std::fs::create_dir_all(&dir).expect("made");
        make(&settings, &dir, false, 2);
        let shard = npz::read(&dir.join("observational/0000.npz")).expect("readable");
        let mask: Vec<bool> =
            shard.need("mask").expect("there").to_f64().iter().map(|&x| x > 127.5).collect();
        let light = shard.need("images").expect("there").to_f64();
        (mask, light.iter().fold(0.0, |s, x| s + x) / light.len() as f64 / 255.0)
    };
    let count = |m: &mut dyn Iterator<Item = bool>| m.filter(|x| *x).count() as f64;
    let overlap = |a: &[bool], b: &[bool]| {
        let pairs = || a.iter().zip(b);
        count(&mut pairs().map(|(a, b)| *a && *b)) / count(&mut pairs().map(|(a, b)| *a || *b))
    };
    let outside = |a: &[bool], b: &[bool]| count(&mut a.iter().zip(b).map(|(a, b)| *a && !*b));
    // Each image and the pixels beside it, corners included.
    let wider = |m: &[bool]| -> Vec<bool> {
        let picture = |i: usize| i / (SIDE * SIDE) * (SIDE * SIDE);
        let at = |i: usize| {
            let (row, column) = (i / SIDE % SIDE, i % SIDE);
            let rows = row.saturating_sub(1)..Ord::min(row + 2, SIDE);
            let columns = column.saturating_sub(1)..Ord::min(column + 2, SIDE);
            rows.into_iter().any(|r| columns.clone().any(|c| m[picture(i) + r * SIDE + c]))
        };
        (0..m.len()).map(at).collect()
    };
    let (discs, light) = shown(Rendering::Discs, 1024);
    let (splats, splat_light) = shown(Rendering::Splats, 1024);
    let (mesh, mesh_light) = shown(Rendering::Mesh, 1024);
    let (fine, _) = shown(Rendering::Discs, 8192);
    let of = |m: &[bool]| count(&mut m.iter().copied());
    let measured = [overlap(&discs, &splats), overlap(&discs, &mesh), overlap(&fine, &mesh)];
    let strays =
        [outside(&discs, &splats), outside(&splats, &wider(&discs)), outside(&mesh, &discs) / of(&mesh)];
    println!(
        "intersection over union {measured:.3?}, strays {strays:.4?}, light {light:.3} {splat_light:.3} {mesh_light:.3}"
    );
    assert!(strays[0] == 0.0, "discs lie within splats but for {} pixels", strays[0]);
    assert!(strays[1] == 0.0, "splats lie within a pixel of discs but for {} pixels", strays[1]);
    assert!(strays[2] < 0.03, "surfaces lie within discs but for {} of them", strays[2]);
    assert!(measured[0] > 0.88, "splats: intersection over union with discs {}", measured[0]);
    assert!(measured[1] > 0.64, "mesh: intersection over union with discs {}", measured[1]);
    assert!(measured[2] > measured[1] + 0.1, "mesh: {} with eight times the points", measured[2]);
    for (look, other) in [("splats", splat_light), ("mesh", mesh_light)] {
        assert!((other - light).abs() < 0.5 * light, "{look}: {other} and {light}");
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let refused = |change: fn(&mut Settings)| {
        let mut settings = small();
        change(&mut settings);
        settings.validate().and_then(|()| settings.scm().map(|_| ())).expect_err("refused").to_string()
    };
    assert!(refused(|s| s.factors = 9).contains("2 to 8"), "factors");
    assert!(refused(|s| s.graph = "ER-99".into()).contains("at most 6 edges"), "edges");
    assert!(refused(|s| s.graph = "fork".into()).contains("FORK"), "names");
    assert!(refused(|s| s.mechanism = "lin".into()).contains("LIN, NL, NG or NL-NG"), "mechanism");
    assert!(refused(|s| s.points = 3).contains("64 to"), "points");
    assert!(refused(|s| s.set = "some".into()).contains("observational"), "set");
    assert!(refused(|s| s.test_cameras = 23).contains("1 to 22"), "cameras");
    assert!(refused(|s| s.set_size = 1024).contains("set size"), "side of the sets");
    assert!(refused(|s| s.video_size = 5000).contains("video size"), "side of the video");
    let points = |s: &mut Settings| (s.passes, s.video_look) = (PassSet::ALL, Rendering::Splats);
    assert!(refused(points).contains("points have no depth"), "passes of points");
    let five = |s: &mut Settings| {
        (s.set, s.factors, s.character) = ("video".into(), 5, Some(nobody()));
    };
    assert!(refused(five).contains("have no effect"), "more factors than a character has");
    // What is not made is not checked.
    let mut video = Settings { set: "video".into(), set_size: 1024, count: 0, ..small() };
    video.validate().expect("no set is made");
    (video.set, video.set_size, video.count, video.video_size) = ("observational".into(), 64, 1, 9999);
    video.validate().expect("no video is made");
    assert_eq!(Settings::smoke().points, 1024, "the smallest template");
}

#[test]
fn a_folder_never_mixes_two_runs() {
    let a = small();
    let b = Settings { seed: 1, count: 70, groups: 3, frames: 3, test_cameras: 1, ..small() };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (fresh, used) = (folder.path().join("fresh"), folder.path().join("used"));
    make(&b, &fresh, false, 2);
    let expected = tree(&fresh);
    make(&a, &used, false, 2);
    std::fs::write(used.join("notes.txt"), "mine").expect("written");
    // Started over with other settings, stopped after one shard, continued.
    let stop = AtomicBool::new(false);
    generate::run(&b, &used, false, &stop, &mut |_, _, _| stop.store(true, Ordering::Relaxed))
        .expect_err("stopped");
    let there = tree(&used);
    assert!(there.contains_key("observational/0000.npz"), "one shard was made");
    assert!(!there.contains_key("observational/0001.npz"), "shards of the run before are gone");
    assert!(!there.keys().any(|name| name.starts_with("video/")), "and so is its video");
    make(&b, &used, true, 2);
    assert_eq!(std::fs::read(used.join("notes.txt")).expect("kept"), b"mine", "other files stay");
    std::fs::remove_file(used.join("notes.txt")).expect("removed");
    assert_same(&expected, &tree(&used), "started over");

    // A shard that was changed is made again, whether the set is finished or not.
    std::fs::write(used.join("observational/0001.npz"), "broken").expect("written");
    make(&b, &used, true, 2);
    assert_same(&expected, &tree(&used), "repaired");

    // A record with other causes is refused, and so are files of unknown origin.
    let record = used.join("dataset.json");
    let text = std::fs::read_to_string(&record).expect("readable");
    let resume = || generate::run(&b, &used, true, &AtomicBool::new(false), &mut |_, _, _| {});
    let other = text.replace("\"version\": 1", "\"version\": 7");
    std::fs::write(&record, &other).expect("written");
    let e = resume().expect_err("another version").to_string();
    assert!(e.contains("version 7 instead of 1"), "{e}");
    assert_eq!(std::fs::read_to_string(&record).expect("readable"), other, "the record is kept");
    std::fs::remove_file(&record).expect("removed");
    let e = resume().expect_err("unknown files").to_string();
    assert!(e.contains("files but no dataset.json"), "{e}");
}

#[test]
fn a_character_that_cannot_play_leaves_no_folder() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = folder.path().join("out");
    let settings = Settings { set: "video".into(), character: Some(nobody()), ..small() };
    assert!(
        settings.command().contains("--character 'it'\\''s nobody.glb' --animation Walk"),
        "{}",
        settings.command()
    );
    generate::run(&settings, &dir, false, &AtomicBool::new(false), &mut |_, _, _| {}).expect_err("no file");
    assert!(!dir.exists(), "nothing was made");
}

#[test]
fn pictures_have_seeds_of_their_own() {
    let mut seeds = std::collections::BTreeSet::new();
    for seed in [0, 1, 1 << 32, 1 << 63] {
        for purpose in [data_gen::figure::purpose::PICTURE_VIDEO, data_gen::figure::purpose::PICTURE_BASE] {
            seeds.extend((0..64).map(|item| figure::picture_seed(seed, purpose, item)));
        }
    }
    assert_eq!(seeds.len(), 4 * 2 * 64, "no two are the same");
}

#[test]
fn cameras_of_sets_and_video_have_the_documented_positions() {
    use data_gen::figure::video;
    use lastlight::scene::camera::Model;
    use lastlight::scene::from_data_gen;
    for index in 0..video::CAMERAS {
        let c = from_data_gen::camera(&video::camera(index, 64), Model::Pinhole);
        let eye: Vec<f64> = (0..3)
            .map(|k| -(0..3).fold(0.0, |s, i| s + f64::from(c.rotation[i][k]) * f64::from(c.translation[i])))
            .collect();
        let radius = (eye[0] * eye[0] + eye[1] * eye[1]).sqrt();
        assert!((radius - 6.0).abs() < 1e-5, "camera {index}: three body heights, {radius}");
        let angle = std::f64::consts::TAU * index as f64 / 23.0;
        let off = (eye[0] - radius * libm::sin(angle)).abs() + (eye[1] + radius * libm::cos(angle)).abs();
        assert!(off < 1e-5, "camera {index} is at 1/23 turns: {eye:?}");
    }
    let full = Settings::full();
    let tested = (0..full.frames).filter(|t| t.is_multiple_of(video::TEST_STEP)).count();
    assert_eq!((full.frames, tested * full.test_cameras), (100, 88), "frames 0, 30, 60, 90 from 22 cameras");
    let smoke = Settings::smoke();
    assert_eq!(
        (smoke.frames, smoke.test_cameras, smoke.video_size, smoke.set_size),
        (20, 4, 64, 64),
        "smoke"
    );
}

#[test]
fn a_character_gives_the_same_bytes_wherever_its_file_lies() {
    let Some(knight) = real_data("characters/Knight.glb") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let moved = folder.path().join("a folder/Knight.glb");
    std::fs::create_dir_all(moved.parent().expect("a folder")).expect("made");
    std::fs::copy(&knight, &moved).expect("copied");
    let cast = |file: &Path| Settings {
        set: "video".into(),
        character: Some(CharacterSettings {
            file: file.to_path_buf(),
            animations: vec!["Walking_A".into()],
            elbow: None,
            hide: Vec::new(),
            play: false,
        }),
        ..small()
    };
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    make(&cast(&knight), &one, false, 2);
    let stop = AtomicBool::new(false);
    generate::run(&cast(&moved), &two, false, &stop, &mut |done, _, _| {
        stop.store(done > 0, Ordering::Relaxed)
    })
    .expect_err("stopped");
    make(&cast(&moved), &two, true, 1);
    assert_same(&tree(&one), &tree(&two), "moved, interrupted, other threads");
    let unknown = |change: fn(&mut CharacterSettings)| {
        let mut settings = cast(&knight);
        change(settings.character.as_mut().expect("a character"));
        let dir = folder.path().join("refused");
        let run = generate::run(&settings, &dir, false, &AtomicBool::new(false), &mut |_, _, _| {});
        assert!(!dir.exists(), "nothing was made");
        run.expect_err("refused").to_string()
    };
    assert!(unknown(|c| c.animations = vec!["Swim".into()]).contains("Walking_A"), "animations are listed");
    assert!(unknown(|c| c.elbow = Some("tail".into())).contains("lowerarm.r"), "joints are listed");
    assert!(unknown(|c| c.hide = vec!["Nothing".into()]).contains("one of"), "parts are listed");
}
