//! `last gen`: the same settings give the same bytes, whatever the threads and however often it was interrupted.

use lastlight::io::{capture, npz};
use lastlight::last::figure::Look;
use lastlight::last::generate::{self, Report, Settings};
use lastlight::num::{bits, par};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Digests of the files of [`small`] in the order of the paths: template and sets; the video, which the renderer of surfaces made.
const DIGESTS: [u64; 2] = [0x3d6a_6aa9_ebcd_1ac6, 0xb530_e9ce_e1bb_0d3f];

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

/// Contents of a folder by path.
fn contents(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![dir.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("readable") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(dir).expect("inside").to_string_lossy().replace('\\', "/");
                files.insert(name, std::fs::read(&path).expect("readable"));
            }
        }
    }
    files
}

fn assert_same(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>, what: &str) {
    let names = |x: &BTreeMap<String, Vec<u8>>| x.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(a), names(b), "{what}: the same files");
    for (name, bytes) in a {
        assert!(*bytes == b[name], "{what}: {name} differs");
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
    let expected = contents(&one);
    for threads in [2, 7] {
        let dir = at(&format!("threads-{threads}"));
        make(&settings, &dir, false, threads);
        assert_same(&expected, &contents(&dir), &format!("{threads} threads"));
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
    assert_same(&expected, &contents(&dir), "interrupted");

    // A lost file is made again, a finished set stays as it is, other settings are refused.
    std::fs::remove_file(dir.join("interventions/0001.npz")).expect("removed");
    std::fs::remove_file(dir.join("video/images/c00_f0002.png")).expect("removed");
    make(&settings, &dir, true, 2);
    assert_same(&expected, &contents(&dir), "repaired");
    let other = Settings { seed: 1, ..settings };
    let e =
        generate::run(&other, &dir, true, &AtomicBool::new(false), &mut |_, _, _| {}).expect_err("differs");
    assert!(e.to_string().contains("seed 0 instead of 1"), "{e}");
    assert_same(&expected, &contents(&dir), "refused");
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

#[test]
fn both_point_renderers_and_surfaces_show_the_same_person() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mask = |look: Look| {
        let settings = Settings {
            set: "observational".into(),
            set_look: look,
            set_size: 64,
            count: 2,
            appearances: 1,
            points: 1024,
            samples: 8,
            ..small()
        };
        let dir = folder.path().join(look.name());
        std::fs::create_dir_all(&dir).expect("made");
        make(&settings, &dir, false, 2);
        let shard = npz::read(&dir.join("observational/0000.npz")).expect("readable");
        let mean = |name: &str| {
            let x = shard.need(name).expect("there").to_f64();
            x.iter().fold(0.0, |s, x| s + x) / x.len() as f64 / 255.0
        };
        (shard.need("mask").expect("there").to_f64(), mean("images"))
    };
    let (discs, light) = mask(Look::Discs);
    let inside = |m: &[f64]| m.iter().map(|&x| x > 127.5).collect::<Vec<_>>();
    let overlap = |a: &[bool], b: &[bool]| {
        let both = a.iter().zip(b).filter(|(a, b)| **a && **b).count() as f64;
        both / a.iter().zip(b).filter(|(a, b)| **a || **b).count() as f64
    };
    for (look, least) in [(Look::Splats, 0.75), (Look::Mesh, 0.6)] {
        let (other, other_light) = mask(look);
        let iou = overlap(&inside(&discs), &inside(&other));
        println!(
            "{}: intersection over union with discs {iou:.3}, light {other_light:.3} and {light:.3}",
            look.name()
        );
        assert!(iou > least, "{}: intersection over union with discs {iou}", look.name());
        assert!((other_light - light).abs() < 0.5 * light, "{}: {other_light} and {light}", look.name());
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
    assert!(refused(|s| s.mechanism = "lin".into()).contains("LIN, NL or NG"), "mechanism");
    assert!(refused(|s| s.points = 3).contains("64 to"), "points");
    assert!(refused(|s| s.set = "some".into()).contains("observational"), "set");
    assert!(refused(|s| s.test_cameras = 23).contains("1 to 22"), "cameras");
}
