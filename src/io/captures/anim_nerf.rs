//! PeopleSnapshot as 3DGS-Avatar prepares it, with the poses that Anim-NeRF refined.
//!
//! ```text
//! camera.pkl                   {camera_f (2), camera_c (2), camera_k (5), …}; the camera is the origin, its axes are the world
//! image/000000.jpg             pictures, distorted as they were taken
//! mask/000000.png              not zero: person
//! animnerf_models/000000.npz   minimal_shape (V,3), bone_transforms (K,4,4), trans (3), root_orient, pose_body, pose_hand, betas
//! body_models/misc             as in `arah`: here, or one or two folders above; else a body model is given
//! ```
//!
//! A frame is a place in the order of the pictures; its model is the one of that number. A subject is female or male by its name.

use super::people_snapshot::{Calibration, frames, in_order};
use super::{
    IDENTITY, Layout, Pixels, Plan, Selection, Source, SourceShot, UP_FROM_CAMERA, arah, called,
    first_folder, numbered, numbered_file,
};
use crate::Result;
use crate::io::capture::{Split, rigid};
use std::path::Path;

/// Side pictures are reduced to.
const SIDE: usize = 540;

/// Reads a subject.
///
/// # Errors
/// When a file is missing or malformed, or counts differ.
pub fn read(dir: &Path, selection: &Selection, gender: &str) -> Result<Source> {
    let camera = Calibration::read(&dir.join("camera.pkl"))?;
    let (intrinsics, lens) = (camera.intrinsics()?, camera.lens()?);
    let images = in_order(&first_folder(dir, &["image"], "the pictures")?)?;
    let masks = in_order(&first_folder(dir, &["mask"], "the masks")?)?;
    let folder = dir.join("animnerf_models");
    let models = numbered(&folder, "")?;
    if masks.len() != images.len() {
        return Err(crate::Error::input(crate::io::name_of(dir))
            .at("mask/")
            .expected(format!("{} masks, as many as pictures in image/", images.len()))
            .got(masks.len().to_string()));
    }
    let (train, test) = frames(dir, images.len(), selection);
    let plan = Plan::new((&[0], &train), (&[0], &test));
    let mut out = Source { target: SIDE, world: UP_FROM_CAMERA, ..Source::new(Layout::AnimNerf) };
    for &frame in &plan.frames {
        arah::moment(&numbered_file(&models, frame, &folder, "the model of frame")?, frame, &mut out)?;
    }
    for &(camera, frame, split) in &plan.shots {
        out.shots.push(SourceShot {
            time: plan.time(frame),
            camera,
            split,
            view_from_world: rigid(IDENTITY, [0.0; 3]),
            intrinsics,
            lens,
            image: Pixels::Picture(images[frame].clone()),
            mask: Pixels::Picture(masks[frame].clone()),
        });
    }
    let names = called(dir);
    let is = |sex: &str| names.iter().any(|name| name.split('-').any(|part| part == sex));
    let gender = ["female", "male"].into_iter().find(|sex| is(sex)).unwrap_or(gender);
    out.model = arah::body_model(dir, gender)?;
    if !plan.shots.iter().any(|s| s.2 == Split::Test) {
        out.notes.push("no frames are held out".to_owned());
    }
    Ok(out)
}
