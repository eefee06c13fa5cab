//! `last gen --character`: the record is of the motion that is seen, `body.npz` has all that the figure's
//! has, and the image-to-point model learns from its sets.

use crate::samples::gltf;
use data_gen::figure::samples::{BASES, group};
use data_gen::figure::sortability::{r2_sortability, varsortability};
use data_gen::figure::video;
use lastlight::io::npz;
use lastlight::last::avatar::guide::{Framing, Square};
use lastlight::last::character::{CharacterSettings, CharacterSubject};
use lastlight::last::figure::{Rendering, SIGMA};
use lastlight::last::generate::{self, Settings};
use lastlight::last::model::data::{Data, Item};
use lastlight::last::model::pictures::Pictures;
use lastlight::last::model::settings::Settings as Learning;
use lastlight::last::model::train::Training;
use lastlight::last::sets::ImageSource;
use lastlight::last::subject::Subject;
use lastlight::num::array::Arrays;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// The arm of the samples held upright, as a file.
fn cast(folder: &Path) -> CharacterSettings {
    let mut b = gltf::arm();
    // Its first triangle gets an area: the second vertex is moved to y = −0.1.
    b.bin[16..20].copy_from_slice(&(-0.1f32).to_le_bytes());
    let h = 0.5f32.sqrt();
    b.push("nodes", serde_json::json!({ "name": "stand", "rotation": [0.0, 0.0, h, h], "children": [0, 1] }));
    b.root["scenes"] = serde_json::json!([{ "nodes": [4] }]);
    let file = folder.join("arm.glb");
    std::fs::write(&file, b.glb()).expect("written");
    CharacterSettings { file, animations: vec!["bend".into()], elbow: None, hide: Vec::new(), play: false }
}

fn settings(casting: &CharacterSettings, subject: u64) -> Settings {
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
        let actor = CharacterSubject::new(&casting, &scm, &settings).expect("plays");
        let moved = body.need("transforms").expect("there").to_f64();
        let poses: Vec<f64> =
            (0..t).flat_map(|i| actor.transforms(i)).flatten().flatten().map(f64::from).collect();
        assert_eq!(moved, poses, "subject {subject}: the poses are those of the factors");
        let picture = folder.path().join(format!("{subject}/video/images/c00_f0007.png"));
        seen.push((frames, moved, std::fs::read(picture).expect("an image")));
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

/// Sets of the arm: ten frames, two groups.
fn sets(casting: &CharacterSettings) -> Settings {
    Settings {
        set: "all".into(),
        count: 10,
        groups: 2,
        appearances: 1,
        frames: 2,
        set_size: 64,
        ..settings(casting, 0)
    }
}

#[test]
fn the_sets_of_a_character_are_what_the_model_learns_from() {
    let folder = tempfile::tempdir().expect("a folder");
    let (casting, dir) = (cast(folder.path()), folder.path().join("out"));
    let settings = sets(&casting);
    make(&settings, &dir);
    let data = Pictures::read(&dir, true, Framing::Whole).expect("what pretraining reads");
    assert_eq!(
        (data.observed(), data.groups().len(), data.members(), data.side()),
        (10, 2, BASES, 64),
        "sizes"
    );
    let scm = settings.scm().expect("a model");
    let actor = CharacterSubject::new(&casting, &scm, &settings).expect("plays");
    assert_eq!(data.camera(), ImageSource::camera(&actor, 64), "the camera that took the images");
    assert_eq!(Subject::camera(&actor, 0, 64), ImageSource::camera(&actor, 64), "which is that of the video");
    // What is written of a group is what its factors make of the character, with one value shared after the
    // intervention.
    let truth = group(&scm, settings.seed, 1, 1);
    for (m, frame) in truth.after.iter().enumerate() {
        let item = Item::After(1, m);
        assert_eq!(data.truth(item), frame.u, "member {m}: factors");
        assert_eq!(data.truth(item)[truth.target], truth.value, "member {m}: the shared value");
        let points = actor.points(frame).expect("a pose");
        let shown: Vec<f32> =
            points.points.iter().zip(&points.rgb).flat_map(|(x, c)| [*x, *c].concat()).collect();
        assert_eq!(data.shown(item), shown, "member {m}: points and colours");
        let lit = data.seen(item).iter().filter(|x| **x > 0.0).count();
        assert!(lit > 200, "member {m}: a person is visible: {lit} numbers");
    }
    assert_ne!(data.seen(Item::Base(1, 0)), data.seen(Item::After(1, 0)), "the intervention is seen");
    // The square around the person, of the same images.
    let near = Pictures::read(&dir, true, Framing::Person).expect("the same folder");
    for item in [Item::Observed(3), Item::Base(1, 0), Item::After(0, 2)] {
        let posed: Vec<[f32; 3]> = data.shown(item).chunks_exact(6).map(|p| [p[0], p[1], p[2]]).collect();
        let square = Square::around(&data.camera(), &posed).expect("before the camera");
        assert_eq!(near.seen(item), square.window(64, [64; 2]).take(&data.seen(item)), "{item:?}");
        let covered = |x: &[f32]| x.chunks_exact(3).filter(|p| p.iter().any(|c| *c > 0.02)).count();
        assert!(
            covered(&near.seen(item)) > covered(&data.seen(item)),
            "{item:?}: the person fills more of it"
        );
    }
    let learning = Learning {
        steps: 2,
        refit: 1,
        freeze: 1,
        observed: 4,
        groups: 1,
        points: 32,
        width: 2,
        ..Learning::default()
    };
    let mut training = Training::new(learning, &data).expect("images of 64 pixels");
    for _ in 0..3 {
        training.advance().expect("finite");
    }
    training.finish().expect("all steps are done");

    // Surfaces instead of points, through the same camera.
    let surfaces = folder.path().join("surfaces");
    make(
        &Settings { set_look: Rendering::Mesh, count: 2, groups: 1, set_size: 16, ..settings.clone() },
        &surfaces,
    );
    let shard = npz::read(&surfaces.join("observational/0000.npz")).expect("readable");
    let covered = shard.need("mask").expect("there").to_f64().iter().filter(|a| **a > 0.0).count();
    assert!(covered > 10, "surfaces are seen: {covered} pixels");

    for (wrong, what) in [
        (Settings { appearances: 2, ..settings.clone() }, "one appearance"),
        (
            Settings {
                character: Some(CharacterSettings { play: true, ..casting.clone() }),
                ..settings.clone()
            },
            "no animation in the sets",
        ),
        (Settings { video_look: Rendering::Discs, ..settings.clone() }, "mesh for a character"),
    ] {
        let refused = wrong.validate().expect_err("refused").to_string();
        assert!(refused.contains(what), "'{what}' in '{refused}'");
    }
}

#[test]
fn the_sets_of_a_character_are_continued_byte_by_byte() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = Settings { count: 70, set_size: 16, points: 64, ..sets(&cast(folder.path())) };
    let whole = make(&settings, &folder.path().join("whole")).0;
    let dir = folder.path().join("parts");
    let stop = AtomicBool::new(false);
    let half = generate::run(&settings, &dir, false, &stop, &mut |done, _, what| {
        if what == "observational" && done > 0 {
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
        }
    });
    assert!(half.is_err(), "interrupted after the first shard");
    let resumed = generate::run(&settings, &dir, true, &AtomicBool::new(false), &mut |_, _, _| {});
    assert_eq!(resumed.expect("continued").files, whole.files, "the same files with the same digests");
}
