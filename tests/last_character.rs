//! `last gen --character`: the record is of the motion that is seen, and `body.npz` has all that the figure's has.

#[path = "samples/gltf.rs"]
mod samples;

use data_gen::figure::sortability::{r2_sortability, varsortability};
use data_gen::figure::video;
use lastlight::io::npz;
use lastlight::last::character::{Actor, Casting};
use lastlight::last::figure::SIGMA;
use lastlight::last::generate::{self, Settings};
use lastlight::last::subject::Subject;
use lastlight::num::array::Arrays;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// The arm of the samples held upright, as a file.
fn cast(folder: &Path) -> Casting {
    let mut b = samples::arm();
    // Its first triangle gets an area: the second vertex goes to y = −0.1.
    b.bin[16..20].copy_from_slice(&(-0.1f32).to_le_bytes());
    let h = 0.5f32.sqrt();
    b.push("nodes", serde_json::json!({ "name": "stand", "rotation": [0.0, 0.0, h, h], "children": [0, 1] }));
    b.root["scenes"] = serde_json::json!([{ "nodes": [4] }]);
    let file = folder.join("arm.glb");
    std::fs::write(&file, b.glb()).expect("written");
    Casting { file, animations: vec!["bend".into()], elbow: None, hide: Vec::new(), play: false }
}

fn settings(casting: &Casting, subject: u64) -> Settings {
    Settings {
        set: "video".into(),
        character: Some(casting.clone()),
        subject,
        frames: 20,
        test_cameras: 1,
        video_size: 24,
        samples: 1,
        points: 96,
        ..Settings::smoke()
    }
}

fn make(settings: &Settings, dir: &Path) -> (generate::Report, Arrays) {
    let report = generate::run(settings, dir, false, &AtomicBool::new(false), &mut |_, _, _| {});
    (report.expect("a video"), npz::read(&dir.join("video/body.npz")).expect("readable"))
}

#[test]
fn the_record_is_of_the_motion_that_is_seen() {
    let folder = tempfile::tempdir().expect("a folder");
    let casting = cast(folder.path());
    let mut seen = Vec::new();
    for subject in [0, 3] {
        let settings = settings(&casting, subject);
        let (report, body) = make(&settings, &folder.path().join(subject.to_string()));
        let scm = settings.scm().expect("a model");
        let (t, n) = (settings.frames, scm.graph.n());
        let factors = body.need("factors").expect("there").to_f64();
        assert_eq!(factors.len(), t * n, "subject {subject}: factors of every frame");
        let frames: Vec<Vec<f64>> = factors.chunks(n).map(<[f64]>::to_vec).collect();
        for (i, u) in frames.iter().enumerate() {
            let want = video::frame(&scm, settings.seed, subject, i, t).u;
            assert_eq!(*u, want, "subject {subject}: factors of frame {i}");
        }
        let s = &report.sortabilities[0];
        assert_eq!(
            (s.varsortability, s.r2_sortability),
            (varsortability(&scm.graph, &frames), r2_sortability(&scm.graph, &frames)),
            "subject {subject}: what is scored is what is seen"
        );
        let actor = Actor::new(&casting, &scm, &settings).expect("plays");
        let moved = body.need("transforms").expect("there").to_f64();
        let poses: Vec<f64> =
            (0..t).flat_map(|i| actor.transforms(i)).flatten().flatten().map(f64::from).collect();
        assert_eq!(moved, poses, "subject {subject}: the poses are those of the factors");
        let picture = folder.path().join(format!("{subject}/video/images/c00_f0007.png"));
        seen.push((frames, moved, std::fs::read(picture).expect("a picture")));
    }
    let (first, second) = (&seen[0], &seen[1]);
    assert!(
        first.0 != second.0 && first.1 != second.1 && first.2 != second.2,
        "two subjects move differently"
    );
}

#[test]
fn the_body_has_bones_spacing_and_the_size_of_its_gaussians() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = settings(&cast(folder.path()), 0);
    let (_, body) = make(&settings, &folder.path().join("out"));
    let figure = Settings { character: None, ..settings };
    let (_, of_figure) = make(&figure, &folder.path().join("figure"));
    for name in of_figure.0.keys() {
        body.need(name).unwrap_or_else(|e| panic!("the figure has '{name}': {e}"));
    }
    let (p, k) = (96, 2);
    let shape = |name: &str| body.need(name).expect("there").shape().to_vec();
    assert_eq!((shape("bone"), shape("spacing"), shape("sigma")), (vec![p], vec![p], vec![p]), "shapes");
    let get = |name: &str| body.need(name).expect("there").to_f64();
    let (points, weights, bone) = (get("points"), get("weights"), get("bone"));
    let (spacing, sigma) = (get("spacing"), get("sigma"));
    for i in 0..p {
        let mut squares: Vec<f64> = (0..p)
            .filter(|&j| j != i)
            .map(|j| {
                let d: [f64; 3] = std::array::from_fn(|c| points[3 * i + c] - points[3 * j + c]);
                (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
            })
            .collect();
        squares.sort_by(f64::total_cmp);
        let want = squares[..3].iter().fold(0.0, |s, x| s + x.sqrt()) / 3.0;
        assert!((spacing[i] - want).abs() < 1e-6 * want, "point {i}: spacing {}, want {want}", spacing[i]);
        assert!((sigma[i] - SIGMA * want).abs() < 1e-6 * want, "point {i}: sigma {}", sigma[i]);
        let row = &weights[k * i..k * (i + 1)];
        let heaviest = usize::from(row[1] > row[0]);
        assert_eq!(bone[i] as usize, heaviest, "point {i}: weights {row:?}");
    }
    assert!(bone.contains(&0.0) && bone.contains(&1.0), "both joints have points");
}
