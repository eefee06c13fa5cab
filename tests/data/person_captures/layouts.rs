//! Miniatures of the layouts but those of PeopleSnapshot, and what is true of them.

use super::{BODY, Truth, check, convert, error, same};
use crate::common::copy_hdf5;
use crate::mini_person::{
    Cam, KX, Mini, V, V3, apart, betas, mean_hands, pairs, rotated, thetas, thetas_of, write_picture,
};
use crate::python::{Py, object_npy};
use lastlight::io::captures::{self, Layout, Range, Selection};
use lastlight::io::npz;
use lastlight::io::smpl::{self, BodyModel};
use lastlight::num::array::Arrays;
use lastlight::scene::person::{PersonCapture, import};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Distortion that moves pixels of a small image by up to one.
pub(crate) const D: [f64; 5] = [-0.08, 0.01, 0.002, -0.001, 0.003];

pub(crate) fn model() -> BodyModel {
    smpl::from_arrays(&Mini::new().arrays()).expect("a body model")
}

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

pub(crate) fn flat(rows: &[V3]) -> Vec<f64> {
    rows.iter().flatten().copied().collect()
}

/// `params/N.npy`.
pub(crate) fn params(poses: &[f64], rh: V3, th: V3) -> Vec<u8> {
    object_npy(&Py::Dict(vec![
        ("poses", Py::Array(vec![1, poses.len()], poses.to_vec())),
        ("Rh", Py::Array(vec![1, 3], rh.to_vec())),
        ("Th", Py::Array(vec![1, 3], th.to_vec())),
        ("shapes", Py::Array(vec![1, 10], betas())),
    ]))
}

/// A person standing in a world with z up: Rh turns y up to z up and a little about, Th lifts it.
fn standing(frame: usize) -> (V3, V3) {
    let half = std::f64::consts::FRAC_PI_2;
    // The turn about the vertical after the one about x, as one axis-angle, through matrices.
    let spin = [0.0, 0.0, 0.4 * frame as f64];
    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        .map(|e| rotated(spin, rotated([half, 0.0, 0.0], e)));
    let r: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
    (lastlight::scene::person::rotation_vector(&r), [0.05 * frame as f64, -0.1, 0.35])
}

/// Points of a frame of ZJU-MoCap and MonoCap.
fn easymocap(frame: usize) -> (Vec<V3>, Vec<f64>, V3, V3) {
    let (mini, turns, (rh, th)) = (Mini::new(), thetas(frame, [0.0; 3]), standing(frame));
    let place = move |x: V3| -> V3 {
        let y = rotated(rh, x);
        std::array::from_fn(|c| y[c] + th[c])
    };
    (mini.posed(&mini.shaped(&betas()), &turns, &place), flat(&turns), rh, th)
}

fn annots(cameras: &BTreeMap<usize, Cam>, ims: Option<Vec<Vec<String>>>) -> Vec<u8> {
    let each = |f: &dyn Fn(&Cam) -> Py| Py::List(cameras.values().map(f).collect());
    let mut entries = vec![(
        "cams",
        Py::Dict(vec![
            ("K", each(&|c| Py::Array(vec![3, 3], flat(&c.k)))),
            ("D", each(&|c| Py::Array(vec![5, 1], c.d.clone()))),
            ("R", each(&|c| Py::Array(vec![3, 3], flat(&c.r)))),
            ("T", each(&|c| Py::Array(vec![3, 1], c.t.iter().map(|x| 1000.0 * x).collect()))),
        ]),
    )];
    if let Some(ims) = ims {
        let frame = |paths: &Vec<String>| {
            Py::Dict(vec![("ims", Py::List(paths.iter().map(|p| Py::Str(p.clone())).collect()))])
        };
        entries.push(("ims", Py::List(ims.iter().map(frame).collect())));
    }
    object_npy(&Py::Dict(entries))
}

/// ZJU-MoCap.
pub(crate) fn zju(dir: &Path, refined: bool, count: usize, frames: usize) -> Truth {
    let side = 32;
    let cameras: BTreeMap<usize, Cam> =
        (0..count).map(|c| (c, Cam::around(side, 0.9 * c as f64, true, &D))).collect();
    let path =
        |c: usize, f: usize| format!("{}Camera_B{}/{f:06}.jpg", if refined { "images/" } else { "" }, c + 1);
    let mut points = BTreeMap::new();
    let (bodies, masks) = if refined { ("smpl_params", "mask") } else { ("new_params", "mask_cihp") };
    for f in 0..frames {
        let (x, poses, rh, th) = easymocap(f);
        std::fs::create_dir_all(dir.join(bodies)).expect("made");
        std::fs::write(dir.join(format!("{bodies}/{f}.npy")), params(&poses, rh, th)).expect("written");
        for (c, cam) in &cameras {
            let (rgb, mask) = cam.photograph(side, &x);
            write_picture(&dir.join(path(*c, f)), side, 3, &rgb);
            // Not zero is the person, whatever the label.
            let labels: Vec<u8> = mask.iter().enumerate().map(|(i, m)| m * (1 + (i % 20) as u8)).collect();
            write_picture(&dir.join(format!("{masks}/Camera_B{}/{f:06}.png", c + 1)), side, 1, &labels);
        }
        points.insert(f as i64, x);
    }
    // Copies of the refined set were written on Windows.
    let stored = |p: String| if refined { p.replace('/', "\\") } else { p };
    let ims = (0..frames).map(|f| (0..count).map(|c| stored(path(c, f))).collect()).collect();
    std::fs::write(dir.join("annots.npy"), annots(&cameras, Some(ims))).expect("written");
    if !refined {
        // Points of the release, with which the body is compared.
        let mut a = Arrays::new();
        a.put("0", &[V, 3], flat(&points[&0]));
        let zip = npz::to_bytes(&a, npz::Packing::Stored).expect("made");
        // The member of the archive is the file.
        let start = zip.windows(6).position(|w| w == b"\x93NUMPY").expect("an array");
        let end = start + 128 + 8 * 3 * V;
        std::fs::create_dir_all(dir.join("new_vertices")).expect("made");
        std::fs::write(dir.join("new_vertices/0.npy"), &zip[start..end]).expect("written");
    }
    Truth { points, cameras, world: same, scale: 2, side, body: BODY }
}

#[test]
fn zju_mocap() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let truth = zju(dir.path(), false, 2, 3);
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
    let side = 16;
    let cameras: BTreeMap<usize, Cam> =
        (0..2).map(|c| (c, Cam::around(side, 1.2 * c as f64, true, &[0.0; 5]))).collect();
    let mut points = BTreeMap::new();
    for f in 0..3 {
        let (x, poses, rh, th) = easymocap(f);
        std::fs::create_dir_all(dir.join("params")).expect("made");
        std::fs::write(dir.join(format!("params/{f}.npy")), params(&poses, rh, th)).expect("written");
        for (c, cam) in &cameras {
            let (rgb, mask) = cam.photograph(side, &x);
            write_picture(&dir.join(format!("images/{c:02}/{f:04}.jpg")), side, 3, &rgb);
            let mask: Vec<u8> = mask.iter().map(|m| 255 * m).collect();
            write_picture(&dir.join(format!("mask/{c:02}/{f:04}.png")), side, 1, &mask);
        }
        points.insert(f as i64, x);
    }
    std::fs::write(dir.join("annots.npy"), annots(&cameras, None)).expect("written");
    let truth = Truth { points, cameras, world: same, scale: 1, side, body: BODY };
    let c = check(Layout::MonoCap, dir, &both(), Some(&model()), &truth);
    assert_eq!(pairs(&c, &c.test), [(1, 0), (1, 1), (1, 2)], "as selected");
    assert_eq!(c.box_margin, 0.1, "MonoCap's margin");
    // Of its own accord it would look for ten cameras to hold out.
    let out = tempfile::tempdir().expect("a temporary folder");
    let e = error(convert(Layout::MonoCap, dir, &Selection::default(), Some(&model()), out.path()));
    assert!(e.contains("camera 2") && e.contains("2 cameras"), "{e}");
}

/// A moment as ARAH and 3DGS-Avatar have it.
pub(crate) fn posed_model(path: &Path, rest: &[V3], turns: &[V3], trans: V3) {
    let body = model();
    let joints = lastlight::scene::person::smpl::joints(&body, rest);
    let bones = lastlight::scene::person::smpl::chain(&body.parents, &joints, turns);
    let square = |a: &[[f64; 4]; 3]| -> Vec<f32> {
        a.iter().flatten().copied().chain([0.0, 0.0, 0.0, 1.0]).map(|x| x as f32).collect()
    };
    let squares: Vec<f32> = bones.iter().flat_map(square).collect();
    let angles = flat(turns);
    let model = Arrays::new()
        .with("minimal_shape", &[V, 3], flat(rest))
        .with("betas", &[1, 10], betas())
        .with("bone_transforms", &[24, 4, 4], squares)
        .with("trans", &[3], trans.to_vec())
        .with("root_orient", &[3], angles[..3].to_vec())
        .with("pose_body", &[63], angles[3..66].to_vec())
        .with("pose_hand", &[6], angles[66..].to_vec())
        .with("Jtr_posed", &[24, 3], vec![0.0f64; 72]);
    npz::write(path, &model).expect("written");
}

#[test]
fn arah() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("CoreView_377");
    let side = 32;
    let mini = Mini::new();
    mini.misc(&folder.path().join("body_models/misc"));
    let cameras: BTreeMap<usize, Cam> =
        (1..3).map(|c| (c, Cam::around(side, 0.7 * c as f64, false, &D))).collect();
    // Some sets write names with zeros in front.
    let called = |c: usize| if c == 2 { "02".to_owned() } else { c.to_string() };
    let mut params = json!({"all_cam_names": ["1", "02"]});
    for (c, cam) in &cameras {
        let column = |v: &[f64]| v.iter().map(|x| vec![*x]).collect::<Vec<_>>();
        params[called(*c)] = json!({"K": cam.k, "D": column(&cam.d), "R": cam.r, "T": column(&cam.t)});
    }
    std::fs::create_dir_all(dir.join("models")).expect("made");
    std::fs::write(dir.join("cam_params.json"), params.to_string()).expect("written");
    let mut points = BTreeMap::new();
    for f in 0..3 {
        // The world has y down: half a turn about x puts the person upright.
        let turns = thetas(f, [std::f64::consts::PI, 0.1, 0.0]);
        let trans = [0.05, -0.1 * f as f64, 0.1];
        let rest = mini.shaped(&betas());
        let x = mini.posed(&rest, &turns, &|x| std::array::from_fn(|c| x[c] + trans[c]));
        posed_model(&dir.join(format!("models/{f:06}.npz")), &rest, &turns, trans);
        for (c, cam) in &cameras {
            let (rgb, mask) = cam.photograph(side, &x);
            write_picture(&dir.join(format!("{}/{f:06}.jpg", called(*c))), side, 3, &rgb);
            write_picture(&dir.join(format!("{}/{f:06}.png", called(*c))), side, 1, &mask);
        }
        points.insert(f as i64, x);
    }
    let truth = Truth { points, cameras, world: same, scale: 1, side, body: BODY };
    let c = check(Layout::Arah, dir, &Selection::default(), None, &truth);
    assert_eq!(pairs(&c, &c.train), [(1, 0), (1, 1), (1, 2)], "camera 1, all frames");
    assert_eq!(pairs(&c, &c.test), [(2, 0)], "the others, every thirtieth");
    assert!(c.template.pose_shapes.is_some(), "pose shapes of body_models/misc");
}

#[test]
fn dna_rendering() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (dir, side, frames) = (folder.path(), 32, 3);
    let mini = Mini::of(KX);
    let model = smpl::from_arrays(&mini.arrays()).expect("a body model");
    let hands = mean_hands().concat();
    let rest = mini.shaped(&betas());
    let cameras: BTreeMap<usize, Cam> =
        [24, 25, 26, 27, 28].map(|c| (c, Cam::around(side, 0.8 * c as f64, false, &D))).into();
    let mut points = BTreeMap::new();
    for f in 0..frames {
        // Stored hand poses are offsets from the mean hands.
        let mut turns = thetas_of(KX, f, [std::f64::consts::PI, 0.3, 0.0]);
        for (v, mean) in turns[KX - 30..].iter_mut().zip(hands.as_chunks::<3>().0) {
            *v = std::array::from_fn(|c| v[c] + mean[c]);
        }
        let t = [0.0, 0.05 * f as f64, 0.1];
        points.insert(f as i64, mini.posed(&rest, &turns, &|x| std::array::from_fn(|c| 1.1 * x[c] + t[c])));
    }
    copy_hdf5("dna", dir);
    let truth = Truth { points, cameras, world: same, scale: 2, side, body: mini.size() };
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
