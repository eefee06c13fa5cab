//! Miniatures of the layouts but those of PeopleSnapshot, and what is true of them.

use super::{check, convert, error};
use crate::mini_person::{KX, Mini, V, apart, pairs};
use crate::person_layouts::{self as layouts, model};
use lastlight::io::captures::{self, Layout, Range, Selection};
use lastlight::io::smpl;
use lastlight::scene::person::{PersonCapture, import};
use std::sync::atomic::AtomicBool;

/// Cameras 0 to learn from, 1 held out, all three frames.
pub(crate) fn both() -> Selection {
    let all = Some(Range { start: 0, step: 1, count: 3 });
    Selection {
        train_cameras: Some(vec![0]),
        test_cameras: Some(vec![1]),
        train_frames: all,
        test_frames: all,
    }
}

#[test]
fn zju_mocap() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let truth = layouts::zju(dir.path(), false, 2, 3);
    let c = check(Layout::Zju, dir.path(), &Selection::default(), Some(&model()), &truth);
    assert_eq!(pairs(&c, &c.train), [(0, 0), (0, 1), (0, 2)], "one camera, all frames");
    assert_eq!(pairs(&c, &c.test), [(1, 0)], "the other, every thirtieth");
    let t = &c.template;
    assert_eq!((t.kind.name(), t.unit_m, t.faces.len()), ("smpl", 1.0, V - 2), "the body");
    // The canonical pose has its hips turned by 45 degrees, in axes with z up: about −y.
    let angles = t.axis_angles(&t.canonical);
    let quarter = std::f32::consts::FRAC_PI_4;
    let expected = [0.0, -quarter, 0.0];
    assert!((0..3).all(|i| (angles[1][i] - expected[i]).abs() < 1e-6), "{:?}", angles[1]);
    let (canonical, feet) = (t.canonical_points(), [7, 8]);
    let apart = canonical[feet[0]][0] - canonical[feet[1]][0];
    assert!(apart > 0.9, "legs are apart: {apart}");
    // Poses in our axes give the transforms again.
    for pose in &c.poses {
        let derived = t.axis_angles(&pose.transforms);
        for k in 1..derived.len() {
            let off = (0..3)
                .map(|i| (derived[k][i] - pose.axis_angles[k][i]).abs())
                .fold(0.0f32, |m, d| if d > m { d } else { m });
            assert!(off < 5e-6, "joint {k}: {:?} and {:?}", derived[k], pose.axis_angles[k]);
        }
        assert!(pose.global.is_some(), "Rh and Th are kept");
    }
    let report = {
        let out = tempfile::tempdir().expect("a temporary folder");
        convert(Layout::Zju, dir.path(), &both(), Some(&model()), out.path()).expect("imported")
    };
    assert!(
        report.notes.iter().any(|n| n.contains("0.0 mm from the points of")),
        "compared: {:?}",
        report.notes
    );
    // Another body is noticed.
    let mut other = model();
    other.template.iter_mut().for_each(|x| x[1] += 0.1);
    let out = tempfile::tempdir().expect("a temporary folder");
    let report = convert(Layout::Zju, dir.path(), &both(), Some(&other), out.path()).expect("imported");
    assert!(report.notes.iter().any(|n| n.contains("is this the body model")), "{:?}", report.notes);
}

#[test]
fn monocap() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("lan_images620_1300");
    let truth = layouts::monocap(dir);
    let c = check(Layout::MonoCap, dir, &both(), Some(&model()), &truth);
    assert_eq!(pairs(&c, &c.test), [(1, 0), (1, 1), (1, 2)], "as selected");
    assert_eq!(c.box_margin, 0.1, "MonoCap's margin");
    // Of its own accord it would look for ten cameras to hold out.
    let out = tempfile::tempdir().expect("a temporary folder");
    let e = error(convert(Layout::MonoCap, dir, &Selection::default(), Some(&model()), out.path()));
    assert!(e.contains("camera 2") && e.contains("2 cameras"), "{e}");
}

#[test]
fn arah() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("CoreView_377");
    let truth = layouts::arah(dir);
    let c = check(Layout::Arah, dir, &Selection::default(), None, &truth);
    assert_eq!(pairs(&c, &c.train), [(1, 0), (1, 1), (1, 2)], "camera 1, all frames");
    assert_eq!(pairs(&c, &c.test), [(2, 0)], "the others, every thirtieth");
    assert!(c.template.pose_shapes.is_some(), "pose shapes of body_models/misc");
}

#[test]
fn dna_rendering() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = folder.path();
    let model = smpl::from_arrays(&Mini::of(KX).arrays()).expect("a body model");
    let truth = layouts::dna(dir);
    let c = check(Layout::Dna, dir, &Selection::default(), Some(&model), &truth);
    assert_eq!(pairs(&c, &c.train), [(26, 0), (26, 1), (26, 2)], "camera 26");
    assert_eq!(pairs(&c, &c.test), [(24, 0), (25, 0), (27, 0), (28, 0)], "its neighbours, every fifth frame");
    assert_eq!(c.template.kind.name(), "smplx", "the body");
    assert!(c.poses[0].global.is_none(), "a scale is part of the transforms");
    let one = check(Layout::Dna, &dir.join("0012_09.smc"), &Selection::default(), Some(&model), &truth);
    assert_eq!(one.train.len(), 3, "by the name of the container");
    let e = error(convert(
        Layout::Dna,
        dir,
        &Selection { train_cameras: Some(vec![3]), ..Selection::default() },
        Some(&model),
        &dir.join("out"),
    ));
    assert!(e.contains("_annots.smc") && e.contains("camera 3"), "{e}");
    let mut flat_handed = model.clone();
    flat_handed.mean_hands = None;
    let source = captures::read(Layout::Dna, dir, &Selection::default(), None).expect("read");
    let to = tempfile::tempdir().expect("a temporary folder");
    let report =
        import::write(&source, Some(&flat_handed), None, to.path(), &AtomicBool::new(false), &mut |_, _| {})
            .expect("written");
    assert!(report.notes.iter().any(|n| n.contains("hands_meanl")), "{:?}", report.notes);
    let missed = apart(&PersonCapture::open(to.path()).expect("opens").posed_points(0), &truth.points[&0]);
    assert!(missed > 1e-3, "without their mean hands are elsewhere: {missed:e}");
}
