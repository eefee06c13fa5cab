//! Captures of one object in the layouts of published data sets, as plain records; `scene::object` turns them into the layout that
//! all fits read.
//!
//! ```text
//! orb     Stanford-ORB: blender_LDR/NAME and blender_HDR/NAME with transforms_{train,test,novel}.json, *_mask; ground_truth/NAME
//! dtc     renders of the Digital Twin Catalog and of LIRM: images/CameraRig.json, images/rgb/{rgb,mask,depth,normal,…}NNNNNNN
//! ```
//!
//! # Conventions
//! * Cameras of both are camera-to-world with OpenGL axes (x right, y up, z backward); they become world-to-camera with z forward.
//! * The field of view is the horizontal one: radians in Stanford-ORB, degrees in `CameraRig.json`. The principal point is the centre.
//! * Depth is z along the optical axis, in units of the world. Normals of the renders are in the axes of the world, those of
//!   Stanford-ORB in the OpenGL axes of the camera.
//! * `autoexposure_scale` is the factor from the linear radiance of the scene to the photo.
//!
//! Novel-light images of Stanford-ORB (`transforms_novel.json`) show the object in another scene: the image, its mask and its
//! environment map are those of the scene that the entry names, the camera is that of the entry.

mod dtc;
mod orb;
mod record;

use super::name_of;
use crate::{Error, Result};
use std::path::Path;

pub use record::{Axes, Layout, ObjectSet, ObjectShot, Part};

/// Recognises the layout of a folder by its files.
pub fn detect(dir: &Path) -> Option<Layout> {
    if dtc::images_of(dir).is_some() {
        return Some(Layout::Dtc);
    }
    orb::is_one(dir).then_some(Layout::Orb)
}

/// Reads the records of a set.
///
/// # Errors
/// When the folder has neither layout, a list is malformed, a listed file is missing, or numbers of entries disagree.
pub fn read(dir: &Path) -> Result<ObjectSet> {
    let set = match detect(dir) {
        Some(Layout::Orb) => orb::read(dir)?,
        Some(Layout::Dtc) => dtc::read(dir)?,
        None => {
            let got = if dir.is_dir() { "a folder without them" } else { "no such folder" };
            return Err(Error::input(name_of(dir))
                .expected(
                    "a folder of Stanford-ORB (blender_LDR/NAME or blender_HDR/NAME with transforms_train.json and train_mask) or of DTC renders \
                     (images/CameraRig.json)",
                )
                .got(got));
        }
    };
    let mut names: Vec<&str> = set.shots.iter().map(|s| s.name.as_str()).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        return Err(Error::input(name_of(dir))
            .at(format!("image '{}'", twice[0]))
            .expected("every image once")
            .got("two entries"));
    }
    if set.shots.is_empty() {
        return Err(Error::input(name_of(dir)).expected("at least one image").got("none"));
    }
    Ok(set)
}
