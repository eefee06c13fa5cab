//! Miniatures of PeopleSnapshot as published and as InstantAvatar and 3DGS-Avatar prepare it.

use super::layouts::{D, flat, model, posed_model};
use super::{BODY, Truth, check, convert, error, up};
use crate::common::copy_hdf5;
use crate::mini_person::{Cam, Mini, V3, betas, matrix, pairs, thetas, write_picture};
use crate::mutate::every_case;
use crate::python::{Py, dump};
use lastlight::io::captures::{self, Layout, Range, Selection};
use lastlight::io::npz;
use lastlight::num::array::Arrays;
use lastlight::scene::person::import;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Points of PeopleSnapshot: a camera's axes are the world axes, and the person is upside down in them.
fn turning(frame: usize, mini: &Mini, rest: &[V3]) -> (Vec<V3>, Vec<V3>, V3) {
    let turns = thetas(frame, [std::f64::consts::PI, 0.2 * frame as f64, 0.0]);
    let trans = [0.02 * frame as f64, 0.1, 3.0];
    let body = mini.shaped(&betas());
    (mini.posed_about(&body, rest, &turns, &|x| std::array::from_fn(|c| x[c] + trans[c])), turns, trans)
}

/// The camera of PeopleSnapshot and InstantAvatar: at the origin.
fn still(side: usize, d: &[f64]) -> Cam {
    Cam { t: [0.0; 3], r: matrix([0.0; 3]), ..Cam::around(side, 0.0, false, d) }
}

/// `camera.pkl`.
fn camera_pkl(cam: &Cam, side: usize) -> Vec<u8> {
    dump(&Py::Dict(vec![
        ("camera_t", Py::Array(vec![3], cam.t.to_vec())),
        ("camera_rt", Py::Array(vec![3], vec![0.0; 3])),
        ("camera_f", Py::Array(vec![2], vec![cam.k[0][0], cam.k[1][1]])),
        ("camera_c", Py::Array(vec![2], vec![cam.k[0][2], cam.k[1][2]])),
        ("camera_k", Py::Array(vec![5], cam.d.clone())),
        ("width", Py::Int(side as i64)),
        ("height", Py::Int(side as i64)),
    ]))
}

/// PeopleSnapshot of 4, 11 or 101 frames without images; returns the points and the images to be written.
fn snapshot(dir: &Path, frames: usize) -> (Truth, Vec<Vec<u8>>) {
    std::fs::create_dir_all(dir).expect("made");
    let side = 16;
    let (mini, cam) = (Mini::new(), still(side, &D));
    // The person at rest is not the model's shape: clothes.
    let rest: Vec<V3> = mini.shaped(&betas()).iter().map(|x| [1.02 * x[0], x[1], 1.05 * x[2]]).collect();
    std::fs::write(dir.join("camera.pkl"), camera_pkl(&cam, side)).expect("written");
    let (mut points, mut photographs) = (BTreeMap::new(), Vec::new());
    for f in 0..frames {
        let (x, ..) = turning(f, &mini, &rest);
        photographs.push(cam.photograph(side, &x).0);
        points.insert(f as i64, x);
    }
    // Masks and poses.
    copy_hdf5(&format!("snapshot_{frames}"), dir);
    let lines: Vec<String> = rest.iter().map(|x| format!("v {:?} {:?} {:?}", x[0], x[1], x[2])).collect();
    std::fs::write(
        dir.join("consensus.obj"),
        format!("# person\n{}\nvt 0 0\nf 1/1 2/1 3/1\n", lines.join("\n")),
    )
    .expect("written");
    (
        Truth { points, cameras: BTreeMap::from([(0, cam)]), world: up, scale: 1, side, body: BODY },
        photographs,
    )
}

#[test]
fn people_snapshot() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("somebody");
    let (truth, photographs) = snapshot(dir, 4);
    let e =
        error(convert(Layout::PeopleSnapshot, dir, &Selection::default(), Some(&model()), &dir.join("out")));
    assert!(e.contains("images") && e.contains("the video beside it"), "{e}");
    for (f, rgb) in photographs.iter().enumerate() {
        write_picture(&dir.join(format!("images/image_{f:04}.png")), 16, 3, rgb);
    }
    let c = check(Layout::PeopleSnapshot, dir, &Selection::default(), Some(&model()), &truth);
    assert_eq!(pairs(&c, &c.train), [(0, 0), (0, 1), (0, 2)], "three quarters");
    assert_eq!(pairs(&c, &c.test), [(0, 3)], "the rest");
    std::fs::remove_file(dir.join("images/image_0003.png")).expect("removed");
    let e =
        error(convert(Layout::PeopleSnapshot, dir, &Selection::default(), Some(&model()), &dir.join("out")));
    assert!(e.contains("images in images/") && e.contains("expected 4") && e.contains("got 3"), "{e}");
    write_picture(&dir.join("images/image_0003.png"), 16, 3, &photographs[3]);
    // Damaged containers: an error or a value, never a panic.
    let poses = std::fs::read(dir.join("reconstructed_poses.hdf5")).expect("there");
    every_case(4, 500, &[&poses], |_, bytes| {
        std::fs::write(dir.join("reconstructed_poses.hdf5"), bytes).expect("written");
        let _ = lastlight::io::captures::read(Layout::PeopleSnapshot, dir, &Selection::default(), None);
    });
    std::fs::write(dir.join("reconstructed_poses.hdf5"), &poses[..poses.len() / 2]).expect("written");
    let e =
        error(convert(Layout::PeopleSnapshot, dir, &Selection::default(), Some(&model()), &dir.join("out")));
    assert!(e.contains("reconstructed_poses.hdf5"), "{e}");
    std::fs::write(dir.join("reconstructed_poses.hdf5"), &poses).expect("written");
    std::fs::write(dir.join("masks.hdf5"), b"\x89HDF\r\n\x1a\nnothing").expect("written");
    let e =
        error(convert(Layout::PeopleSnapshot, dir, &Selection::default(), Some(&model()), &dir.join("out")));
    assert!(e.contains("masks.hdf5") && e.contains("HDF5"), "{e}");
}

#[test]
fn a_picture_missing_among_a_hundred_is_a_note() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("somebody");
    let (truth, photographs) = snapshot(dir, 101);
    for (f, rgb) in photographs[..100].iter().enumerate() {
        write_picture(&dir.join(format!("images/image_{f:04}.png")), 16, 3, rgb);
    }
    // Later the person has walked out of the image.
    let early = |start, count| Some(Range { start, step: 1, count });
    let some = Selection { train_frames: early(0, 4), test_frames: early(5, 2), ..Selection::default() };
    let source = lastlight::io::captures::read(Layout::PeopleSnapshot, dir, &some, None).expect("enough");
    assert!(source.notes.iter().any(|n| n.contains("first 100 frames")), "{:?}", source.notes);
    let c = check(Layout::PeopleSnapshot, dir, &some, Some(&model()), &truth);
    assert_eq!((c.train.len(), c.test.len()), (4, 2), "as selected");
    std::fs::remove_file(dir.join("images/image_0099.png")).expect("removed");
    let e = error(convert(Layout::PeopleSnapshot, dir, &some, Some(&model()), &dir.join("out")));
    assert!(e.contains("images in images/") && e.contains("got 99"), "two of 101 are too many: {e}");
}

#[test]
fn a_body_without_shape_has_no_joints() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("somebody");
    let (_, photographs) = snapshot(dir, 4);
    for (f, rgb) in photographs.iter().enumerate() {
        write_picture(&dir.join(format!("images/image_{f:04}.png")), 16, 3, rgb);
    }
    let mut flat = model();
    flat.template.fill([0.0; 3]);
    let e = error(convert(Layout::PeopleSnapshot, dir, &Selection::default(), Some(&flat), &dir.join("out")));
    assert!(e.contains("a template") && e.contains("under the clothes"), "consensus.obj has no joints: {e}");
}

#[test]
fn the_protocol_of_a_known_subject() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("female-4-casual");
    let (truth, photographs) = snapshot(dir, 11);
    for (f, rgb) in photographs.iter().enumerate() {
        write_picture(&dir.join(format!("images/{f:06}.png")), 16, 3, rgb);
    }
    let only = Selection { test_frames: Some(Range { start: 1, step: 4, count: 2 }), ..Selection::default() };
    let c = check(Layout::PeopleSnapshot, dir, &only, Some(&model()), &truth);
    assert_eq!(pairs(&c, &c.train), [(0, 0), (0, 4), (0, 8)], "every fourth frame of 336");
    assert_eq!(pairs(&c, &c.test), [(0, 1), (0, 5)], "as selected");
}

#[test]
fn instant_avatar() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("somebody");
    let (side, frames) = (16, 4);
    let (mini, cam) = (Mini::new(), still(side, &[]));
    let rest = mini.shaped(&betas());
    let (mut points, mut angles, mut transl) = (BTreeMap::new(), Vec::new(), Vec::new());
    for f in 0..frames {
        let (x, turns, t) = turning(f, &mini, &rest);
        let (rgb, mask) = cam.photograph(side, &x);
        write_picture(&dir.join(format!("images/image_{f:04}.png")), side, 3, &rgb);
        let mut a = Arrays::new();
        a.put("m", &[side, side], mask);
        let zip = npz::to_bytes(&a, npz::Packing::Stored).expect("made");
        let start = zip.windows(6).position(|w| w == b"\x93NUMPY").expect("an array");
        std::fs::create_dir_all(dir.join("masks")).expect("made");
        std::fs::write(dir.join(format!("masks/mask_{f:04}.npy")), &zip[start..start + 128 + side * side])
            .expect("written");
        angles.push(flat(&turns));
        transl.push(t);
        points.insert(f as i64, x);
    }
    let eye: Vec<f64> = (0..16).map(|i| f64::from(u8::from(i % 5 == 0))).collect();
    let camera = Arrays::new()
        .with("intrinsic", &[3, 3], flat(&cam.k))
        .with("extrinsic", &[4, 4], eye)
        .with("height", &[], vec![side as i64])
        .with("width", &[], vec![side as i64]);
    npz::write(&dir.join("cameras.npz"), &camera).expect("written");
    // Poses of all frames are coarse; those of the training frames are refined.
    let coarse = Arrays::new()
        .with("betas", &[10], betas())
        .with(
            "thetas",
            &[frames, 72],
            angles
                .iter()
                .enumerate()
                .flat_map(|(f, a)| a.iter().map(move |x| if f < 3 { x + 0.3 } else { *x }))
                .collect::<Vec<f64>>(),
        )
        .with("transl", &[frames, 3], flat(&transl));
    npz::write(&dir.join("poses.npz"), &coarse).expect("written");
    let fine = Arrays::new()
        .with("betas", &[1, 10], betas())
        .with(
            "global_orient",
            &[3, 3],
            angles[..3].iter().flat_map(|a| a[..3].to_vec()).collect::<Vec<f64>>(),
        )
        .with("body_pose", &[3, 69], angles[..3].iter().flat_map(|a| a[3..].to_vec()).collect::<Vec<f64>>())
        .with("transl", &[3, 3], flat(&transl[..3]));
    std::fs::create_dir_all(dir.join("poses")).expect("made");
    npz::write(&dir.join("poses/anim_nerf_train.npz"), &fine).expect("written");
    let truth = Truth { points, cameras: BTreeMap::from([(0, cam)]), world: up, scale: 1, side, body: BODY };
    let c = check(Layout::InstantAvatar, dir, &Selection::default(), Some(&model()), &truth);
    assert_eq!((c.train.len(), c.test.len()), (3, 1), "three quarters and the rest");
}

#[test]
fn anim_nerf() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("somebody");
    let (side, frames) = (32, 4);
    let (mini, cam) = (Mini::new(), still(side, &D));
    mini.misc(&folder.path().join("body_models/misc"));
    std::fs::create_dir_all(dir.join("animnerf_models")).expect("made");
    std::fs::write(dir.join("camera.pkl"), camera_pkl(&cam, side)).expect("written");
    let rest = mini.shaped(&betas());
    let mut points = BTreeMap::new();
    for f in 0..frames {
        let (x, turns, trans) = turning(f, &mini, &rest);
        posed_model(&dir.join(format!("animnerf_models/{f:06}.npz")), &rest, &turns, trans);
        let (rgb, mask) = cam.photograph(side, &x);
        // Images are counted, models are named: their numbers need not agree.
        write_picture(&dir.join(format!("image/{:06}.jpg", f + 1)), side, 3, &rgb);
        write_picture(&dir.join(format!("mask/{:06}.png", f + 1)), side, 1, &mask);
        points.insert(f as i64, x);
    }
    let truth = Truth { points, cameras: BTreeMap::from([(0, cam)]), world: up, scale: 1, side, body: BODY };
    let c = check(Layout::AnimNerf, dir, &Selection::default(), None, &truth);
    assert_eq!((c.train.len(), c.test.len()), (3, 1), "three quarters and the rest");
    // The folder name gives the gender; the folder has no body of that gender.
    let male = &folder.path().join("male-3-casual");
    std::fs::rename(dir, male).expect("renamed");
    let e = error(convert(Layout::AnimNerf, male, &Selection::default(), None, &folder.path().join("out")));
    assert!(e.contains("'male'"), "{e}");
    let to = folder.path().join("told");
    let told = captures::read(Layout::AnimNerf, male, &Selection::default(), Some("neutral"))
        .expect("another gender given");
    assert_eq!(told.gender, "neutral", "the given gender takes precedence");
    import::write(&told, None, None, &to, &AtomicBool::new(false), &mut |_, _| {}).expect("written");
    std::fs::rename(male, dir).expect("renamed");
    std::fs::rename(dir.join("mask/000004.png"), dir.join("mask/000005.png")).expect("renamed");
    let e = error(convert(Layout::AnimNerf, dir, &Selection::default(), None, &folder.path().join("out")));
    assert!(e.contains("a mask 4") && e.contains("mask 5"), "{e}");
    std::fs::rename(dir.join("mask/000005.png"), dir.join("mask/000004.png")).expect("renamed");
    std::fs::remove_file(dir.join("animnerf_models/000002.npz")).expect("removed");
    let e = error(convert(Layout::AnimNerf, dir, &Selection::default(), None, &folder.path().join("out")));
    assert!(e.contains("the model of frame 2"), "{e}");
    std::fs::remove_file(dir.join("mask/000004.png")).expect("removed");
    let e = error(convert(Layout::AnimNerf, dir, &Selection::default(), None, &folder.path().join("out")));
    assert!(e.contains("mask/") && e.contains("expected 4") && e.contains("got 3"), "{e}");
}
