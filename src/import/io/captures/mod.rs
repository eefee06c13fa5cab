//! Captures of persons in the layouts of published data sets, as plain records; `scene::person::import` turns
//! them into the layout of [`super::person`].
//!
//! ```text
//! zju              ZJU-MoCap, original and refined: annots.npy, images, masks, params
//! monocap          MonoCap (the layout of Instant-NVR)
//! arah             ARAH / 3DGS-Avatar preprocessing: cam_params.json, models/*.npz
//! people_snapshot  PeopleSnapshot: camera.pkl, masks.hdf5, reconstructed_poses.hdf5, consensus.obj
//! instant_avatar   InstantAvatar's preprocessing of it: cameras.npz, poses.npz
//! anim_nerf        3DGS-Avatar's preprocessing of it: camera.pkl, animnerf_models/*.npz
//! dna              DNA-Rendering: .smc containers (HDF5)
//! annots           cameras and body parameters that ZJU-MoCap and MonoCap share
//! ```
//!
//! # Conventions that are converted
//! * Principal points are those of OpenCV, whose pixel centres are integers; here they are at halves, so ½ is
//!   added.
//! * `annots.npy` has translations of cameras in millimetres; they are divided by 1000.
//! * Body models have y up. Points and joints at rest leave [`crate::io`] as they are and are turned by the
//!   importer.
//! * Worlds that are a camera's axes (y down) name a rotation to z up, [`Source::world`].
//!
//! # Splits
//! [`Selection`] overrides them; the defaults are those of the programs that the sets are known from:
//!
//! | layout | train | test | scale |
//! |---|---|---|---|
//! | `zju-refine` | camera 4, frames 0, 5, …, 495 | the other cameras, frames 0, 30, …, 480 | ½ |
//! | `zju` | camera 0 ("1"), all frames | the other cameras, every 30th frame | ½ |
//! | `monocap` | camera 0 (olek 44, vlad 66), 100 frames step 5 (olek, vlad from frame 1) | lan, marc: 1 … 10; olek: 45; vlad: 0, 10, …, 100; 17 frames step 30 | 1 |
//! | `arah` | camera 1, all frames | the other cameras, every 30th frame | to 512 |
//! | `people-snapshot`, `instant-avatar`, `anim-nerf` | one camera, the frames of InstantAvatar for the four subjects it names; else the first three quarters | the rest | 1, `anim-nerf` to 540 |
//! | `dna` | camera 26, 100 frames step 1 | cameras 24, 25, 27, 28, 20 frames step 5 | ½ |

pub mod anim_nerf;
mod annots;
pub mod arah;
pub mod dna;
pub mod instant_avatar;
pub mod monocap;
pub mod people_snapshot;
mod pixels;
mod source;
pub mod zju;

use super::capture::Split;
use super::name_of;
use crate::{Error, Result};
use std::path::Path;

pub use pixels::{Container, Pixels};
pub use source::{LAYOUTS, Layout, Moment, Range, Selection, Source, SourceShot};

impl Layout {
    /// What a folder looks like, if it looks like one of them. ZJU-MoCap's two releases differ in numbers,
    /// not in names: it is taken for the refined one where there is no `mask_cihp`.
    pub fn detect(dir: &Path) -> Option<Self> {
        let has = |n: &str| dir.join(n).exists();
        let smc = || {
            std::fs::read_dir(dir)
                .ok()?
                .filter_map(|e| e.ok()?.file_name().into_string().ok())
                .any(|n| n.ends_with(".smc"))
                .then_some(())
        };
        if dir.extension().is_some_and(|e| e == "smc") || smc().is_some() {
            Some(Self::Dna)
        } else if has("cam_params.json") {
            Some(Self::Arah)
        } else if has("cameras.npz") {
            Some(Self::InstantAvatar)
        } else if has("animnerf_models") {
            Some(Self::AnimNerf)
        } else if has("camera.pkl") {
            Some(Self::PeopleSnapshot)
        } else if has("annots.npy") {
            let monocap = monocap::subject(dir).is_some();
            Some(if monocap {
                Self::MonoCap
            } else if has("mask_cihp") {
                Self::Zju
            } else {
                Self::ZjuRefine
            })
        } else {
            None
        }
    }
}

/// Reads a capture of a layout. `gender` is the person's, which chooses among bodies; without one, that of
/// the layout.
///
/// # Errors
/// When a file is missing or malformed, or nothing is selected.
pub fn read(layout: Layout, dir: &Path, selection: &Selection, gender: Option<&str>) -> Result<Source> {
    if !dir.exists() {
        return Err(Error::input(name_of(dir))
            .expected(format!("a capture in the layout {}", layout.name()))
            .got("no such folder"));
    }
    let mut source = match layout {
        Layout::Zju | Layout::ZjuRefine => zju::read(layout, dir, selection),
        Layout::MonoCap => monocap::read(dir, selection),
        Layout::Arah => arah::read(dir, selection, gender),
        Layout::PeopleSnapshot => people_snapshot::read(dir, selection),
        Layout::InstantAvatar => instant_avatar::read(dir, selection),
        Layout::AnimNerf => anim_nerf::read(dir, selection, gender),
        Layout::Dna => dna::read(dir, selection),
    }?;
    if let Some(given) = gender {
        given.clone_into(&mut source.gender);
    }
    if !source.shots.iter().any(|s| s.split == Split::Train) {
        return Err(Error::input(name_of(dir))
            .expected("at least one training image")
            .got("none in the cameras and frames that were selected"));
    }
    Ok(source)
}
