//! PeopleSnapshot as InstantAvatar prepares it: undistorted, one file per frame.
//!
//! ```text
//! cameras.npz                 intrinsic (3,3), extrinsic (4,4) world to camera, height, width
//! images/image_0000.png       masks/mask_0000.npy (H, W), or .png; not zero: person
//! poses.npz                   betas, thetas (n, 72), transl (n, 3)
//! poses/anim_nerf_train.npz   refined poses of the training frames: betas, global_orient (m, 3), body_pose (m, 69), transl (m, 3)
//! poses/anim_nerf_test.npz    likewise
//! ```
//!
//! Refined poses are used for the frames of InstantAvatar's protocol, where there are as many of them as
//! frames in the split, else those of `poses.npz`.

use super::people_snapshot::frames;
use super::pixels::Pixels;
use super::source::{
    Layout, Plan, Selection, Source, SourceShot, UP_FROM_CAMERA, intrinsics, numbered, numbered_file, pose,
    three, triples,
};
use crate::io::capture::{Lens, Split};
use crate::io::{name_of, npz};
use crate::num::array::Arrays;
use crate::{Error, Result};
use std::path::Path;

/// Poses of some frames: (n, K·3) and (n, 3).
struct Poses {
    name: String,
    thetas: Vec<Vec<f64>>,
    transl: Vec<f64>,
    betas: Vec<f64>,
}

impl Poses {
    fn read(path: &Path, parts: &[&str]) -> Result<Self> {
        let name = name_of(path);
        let keys = ["betas", "thetas", "transl", "global_orient", "body_pose"];
        let arrays = npz::read_some(path, &keys)?;
        arrays.finite(keys).map_err(|e| e.within(name.clone()))?;
        let need = |a: &Arrays, key: &str| {
            a.need(key).map(|x| (x.shape().to_vec(), x.to_f64())).map_err(|e| e.within(name.clone()))
        };
        let (_, transl) = need(&arrays, "transl")?;
        let n = transl.len() / 3;
        let mut thetas: Vec<Vec<f64>> = vec![Vec::new(); n];
        for key in parts {
            let (_, flat) = need(&arrays, key)?;
            if n == 0 || flat.is_empty() || !flat.len().is_multiple_of(n) || !transl.len().is_multiple_of(3) {
                return Err(Error::input(name)
                    .at(format!("array '{key}'"))
                    .expected(format!("{n} poses, as many as transl"))
                    .got(format!("{} numbers", flat.len())));
            }
            for (row, part) in thetas.iter_mut().zip(flat.chunks_exact(flat.len() / n)) {
                row.extend_from_slice(part);
            }
        }
        if thetas.iter().any(|t| !t.len().is_multiple_of(3)) {
            return Err(Error::input(name)
                .at("poses")
                .expected("three numbers per joint")
                .got(thetas[0].len().to_string()));
        }
        let (_, betas) = need(&arrays, "betas")?;
        Ok(Self { name, thetas, transl, betas })
    }
}

/// Reads a subject.
///
/// # Errors
/// When a file is missing or malformed, or counts differ.
pub fn read(dir: &Path, selection: &Selection) -> Result<Source> {
    let path = dir.join("cameras.npz");
    let name = name_of(&path);
    let keys = ["intrinsic", "extrinsic", "height", "width"];
    let camera = npz::read_some(&path, &keys)?;
    camera.finite(keys).map_err(|e| e.within(name.clone()))?;
    let flat = |key: &str| camera.need(key).map(|a| a.to_f64()).map_err(|e| e.within(name.clone()));
    let k = intrinsics(&flat("intrinsic")?, &name)?;
    let e = flat("extrinsic")?;
    if e.len() != 16 {
        return Err(Error::input(name)
            .at("array 'extrinsic'")
            .expected("4x4 numbers")
            .got(e.len().to_string()));
    }
    let rotation: Vec<f64> = (0..9).map(|i| e[4 * (i / 3) + i % 3]).collect();
    let view = pose(&rotation, &[e[3], e[7], e[11]], &name)?;
    let all = Poses::read(&dir.join("poses.npz"), &["thetas"])?;
    let count = all.thetas.len();
    let (train, test) = frames(dir, count, selection);
    let plan = Plan::new((&[0], &train), (&[0], &test));
    let mut out =
        Source { betas: all.betas.clone(), world: UP_FROM_CAMERA, ..Source::new(Layout::InstantAvatar) };
    let mut refined = Vec::new();
    let asked = [("train", &train, selection.train_frames), ("test", &test, selection.test_frames)];
    for (split, frames, chosen) in asked {
        let file = dir.join(format!("poses/anim_nerf_{split}.npz"));
        if !file.is_file() {
            continue;
        }
        if chosen.is_some() {
            out.notes.push(format!("{} is of the protocol's frames and is not used", name_of(&file)));
            continue;
        }
        let poses = Poses::read(&file, &["global_orient", "body_pose"])?;
        if poses.thetas.len() == frames.len() {
            refined.push((frames.clone(), poses));
        } else {
            out.notes.push(format!(
                "{} has {} poses for {} frames and is not used",
                poses.name,
                poses.thetas.len(),
                frames.len()
            ));
        }
    }
    if let Some((_, first)) = refined.first() {
        out.betas.clone_from(&first.betas);
    }
    for &f in &plan.frames {
        let found = refined.iter().find_map(|(frames, p)| Some((p, frames.iter().position(|&x| x == f)?)));
        let (p, i) = found.unwrap_or((&all, f));
        out.moments.push(super::source::Moment {
            rotations: triples(&p.thetas[i]),
            global_rotation: [0.0; 3],
            global_translation: three(&p.transl[3 * i..3 * i + 3], "transl", &p.name)?,
            scale: 1.0,
            transforms: None,
        });
        out.numbers.push(f as i64);
    }
    let (images, masks) = (dir.join("images"), dir.join("masks"));
    let (of_image, of_mask) = (numbered(&images, "image_")?, numbered(&masks, "mask_")?);
    for &(_, frame, split) in &plan.shots {
        let mask = numbered_file(&of_mask, frame, &masks, "mask of frame")?;
        out.shots.push(SourceShot {
            time: plan.time(frame),
            camera: 0,
            split,
            view_from_world: view,
            intrinsics: k,
            lens: Lens::PINHOLE,
            image: Pixels::Picture(numbered_file(&of_image, frame, &images, "image of frame")?),
            mask: if mask.extension().is_some_and(|e| e == "npy") {
                Pixels::Array(mask)
            } else {
                Pixels::Picture(mask)
            },
        });
    }
    if !plan.shots.iter().any(|s| s.2 == Split::Test) {
        out.notes.push("no frames are held out".to_owned());
    }
    Ok(out)
}
