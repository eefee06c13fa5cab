//! Miniatures of PeopleSnapshot as published and as InstantAvatar and 3DGS-Avatar prepare it.

use super::{check, convert, error};
use crate::mini_person::{pairs, write_picture};
use crate::mutate::every_case;
use crate::person_layouts::{self as layouts, model, snapshot};
use lastlight::io::captures::{self, Layout, Range, Selection};
use lastlight::scene::person::import;
use std::sync::atomic::AtomicBool;

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
    let truth = layouts::instant_avatar(dir);
    let c = check(Layout::InstantAvatar, dir, &Selection::default(), Some(&model()), &truth);
    assert_eq!((c.train.len(), c.test.len()), (3, 1), "three quarters and the rest");
}

#[test]
fn anim_nerf() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dir = &folder.path().join("somebody");
    let truth = layouts::anim_nerf(dir);
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
