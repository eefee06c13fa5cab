//! PeopleSnapshot as 3DGS-Avatar prepares it, with the poses that Anim-NeRF refined.
//!
//! ```text
//! camera.pkl                   {camera_f (2), camera_c (2), camera_k (5), …}; the camera is the origin, its axes are the world
//! image/000000.jpg             images, distorted as they were taken
//! mask/000000.png              not zero: person
//! animnerf_models/000000.npz   minimal_shape (V,3), bone_transforms (K,4,4), trans (3), root_orient, pose_body, pose_hand, betas
//! body_models/misc             as in `arah`: here, or one or two folders above; else a body model is given
//! ```
//!
//! A frame is an index into the sorted images; its model has the same index. A subject is female or male by
//! the name of its folder by default.

use super::arah;
use super::people_snapshot::{Calibration, frames, in_order};
use super::pixels::Pixels;
use super::source::{
    IDENTITY, Layout, Plan, Selection, Source, SourceShot, UP_FROM_CAMERA, called, first_folder, numbered,
    numbered_file,
};
use crate::io::capture::{Split, rigid};
use crate::io::name_of;
use crate::{Error, Result};
use std::path::Path;

/// Side in pixels to which images are reduced.
const SIDE: usize = 540;

/// Reads a subject.
///
/// # Errors
/// When a file is missing or malformed, or counts differ.
pub fn read(dir: &Path, selection: &Selection, gender: Option<&str>) -> Result<Source> {
    let camera = Calibration::read(&dir.join("camera.pkl"))?;
    let (intrinsics, lens) = (camera.intrinsics()?, camera.lens()?);
    let images = in_order(&first_folder(dir, &["image"], "the images")?)?;
    let masks = in_order(&first_folder(dir, &["mask"], "the masks")?)?;
    let folder = dir.join("animnerf_models");
    let models = numbered(&folder, "")?;
    let wrong = |expected: String, got: String| {
        Err(Error::input(name_of(dir)).at("mask/").expected(expected).got(got))
    };
    if masks.len() != images.len() {
        let expected = format!("{} masks, as many as images in image/", images.len());
        return wrong(expected, masks.len().to_string());
    }
    if let Some(((image, _), (mask, _))) = images.iter().zip(&masks).find(|(image, mask)| image.0 != mask.0) {
        return wrong(format!("a mask {image}, as there is an image"), format!("mask {mask}"));
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
            image: Pixels::Picture(images[frame].1.clone()),
            mask: Pixels::Picture(masks[frame].1.clone()),
        });
    }
    let names = called(dir);
    if let Some(sex) = ["female", "male"].into_iter().find(|sex| names[0].contains(sex)) {
        sex.clone_into(&mut out.gender);
    }
    out.model = arah::body_model(dir, gender.unwrap_or(&out.gender))?;
    if !plan.shots.iter().any(|s| s.2 == Split::Test) {
        out.notes.push("no frames are held out".to_owned());
    }
    Ok(out)
}
