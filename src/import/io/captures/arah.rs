//! ZJU-MoCap as ARAH and 3DGS-Avatar prepare it.
//!
//! ```text
//! cam_params.json        {all_cam_names: ["1", …], "1": {K, D, R, T}}, T in metres
//! 1/000000.jpg           images of camera "1"; 1/000000.png its masks
//! models/000000.npz      minimal_shape (V,3), bone_transforms (K,4,4), trans (3), root_orient, pose_body, pose_hand, betas
//! gender.txt             optional
//! body_models/misc       skinning weights, joints, pose shapes (here, or one or two folders above; else a body model is given)
//! ```
//!
//! `minimal_shape` is the person at rest; `bone_transforms` pose it, `trans` moves it. Frames are models in
//! the order of their numbers.

use super::pixels::Pixels;
use super::source::{
    Layout, Plan, Range, Selection, Source, SourceShot, distortion, intrinsics, pose, triples,
};
use crate::io::capture::Split;
use crate::io::smpl::BodyModel;
use crate::io::{MAX_SMALL_FILE_BYTES, json, name_of, npz, read_bytes, smpl};
use crate::num::array::Arrays;
use crate::{Error, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Frames that 3DGS-Avatar uses of a subject; of others, all.
const LENGTHS: [(&str, usize); 4] = [("377", 570), ("386", 540), ("387", 540), ("394", 475)];

/// Side in pixels to which images are reduced.
const SIDE: usize = 512;

const KEYS: [&str; 7] =
    ["minimal_shape", "bone_transforms", "trans", "root_orient", "pose_body", "pose_hand", "betas"];

/// Reads a subject.
///
/// # Errors
/// When a file is missing or malformed.
pub fn read(dir: &Path, selection: &Selection, gender: Option<&str>) -> Result<Source> {
    let path = dir.join("cam_params.json");
    let name = name_of(&path);
    let json = json::parse(&read_bytes(&path, MAX_SMALL_FILE_BYTES)?, &name)?;
    let models = super::source::numbered(&dir.join("models"), "")?;
    let numbers: Vec<usize> = models.keys().copied().collect();
    let names = super::source::called(dir);
    let known = LENGTHS.iter().find(|(n, _)| names.iter().any(|name| name.contains(n)));
    let length = known.map_or(usize::MAX, |(_, length)| *length);
    // A camera is called by its number, which may be written "1" or "01".
    let named = |n: &Value| -> Option<(usize, String)> {
        let name = n.as_str().map_or_else(|| n.as_u64().map(|n| n.to_string()), |s| Some(s.to_owned()))?;
        Some((name.parse().ok()?, name))
    };
    let cameras: BTreeMap<usize, String> =
        json["all_cam_names"].as_array().into_iter().flatten().filter_map(named).collect();
    let train = selection.train_cameras.clone().unwrap_or_else(|| vec![1]);
    let others = || cameras.keys().copied().filter(|c| !train.contains(c)).collect();
    let test = selection.test_cameras.clone().unwrap_or_else(others);
    let all = |step: usize| Range { start: 0, step, count: length.div_ceil(step) };
    let to_train = selection.train_frames.unwrap_or(all(1)).frames(numbers.len());
    let to_test = selection.test_frames.unwrap_or(all(30)).frames(numbers.len());
    let plan = Plan::new((&train, &to_train), (&test, &to_test));
    let mut out = Source { target: SIDE, ..Source::new(Layout::Arah) };
    for &frame in &plan.frames {
        moment(&models[&numbers[frame]], numbers[frame], &mut out)?;
    }
    let mut calibrated = BTreeMap::new();
    for &camera in train.iter().chain(&test) {
        // The listed name, unless the entry is under the plain number.
        let listed = cameras.get(&camera).filter(|name| json.get(name.as_str()).is_some());
        let called = listed.cloned().unwrap_or_else(|| camera.to_string());
        calibrated.insert(camera, Folder::read(&json[&called], &called, dir, &name)?);
    }
    for &(camera, frame, split) in &plan.shots {
        let shot = calibrated[&camera].shot(numbers[frame], camera, plan.time(frame), split)?;
        out.shots.push(shot);
    }
    if let Ok(gender) = std::fs::read_to_string(dir.join("gender.txt")) {
        gender.trim().clone_into(&mut out.gender);
    }
    out.model = body_model(dir, gender.unwrap_or(&out.gender))?;
    Ok(out)
}

/// The body in `body_models/misc`, here or up to two folders above, if there is one.
pub(super) fn body_model(dir: &Path, gender: &str) -> Result<Option<BodyModel>> {
    let mut above = dir.to_path_buf();
    for _ in 0..3 {
        let misc = above.join("body_models/misc");
        if misc.is_dir() {
            return smpl::read(&misc, gender).map(Some);
        }
        above.push("..");
    }
    Ok(None)
}

/// One model file.
pub(super) fn moment(path: &Path, number: usize, out: &mut Source) -> Result<()> {
    let name = name_of(path);
    let arrays = npz::read_some(path, &KEYS)?;
    arrays.finite(KEYS).map_err(|e| e.within(name.clone()))?;
    let flat = |a: &Arrays, key: &str, len: usize| -> Result<Vec<f64>> {
        let v = a.need(key).map_err(|e| e.within(name.clone()))?.to_f64();
        if v.len() == len {
            Ok(v)
        } else {
            Err(Error::input(name.clone())
                .at(format!("array '{key}'"))
                .expected(format!("{len} numbers"))
                .got(v.len().to_string()))
        }
    };
    let transforms = arrays.need("bone_transforms").map_err(|e| e.within(name.clone()))?;
    let &[joints, 4, 4] = transforms.shape() else {
        let e = Error::input(name).at("array 'bone_transforms'").expected("shape (K, 4, 4)");
        return Err(e.got(format!("{:?}", transforms.shape())));
    };
    let mut rotations = flat(&arrays, "root_orient", 3)?;
    rotations.extend(flat(&arrays, "pose_body", 63)?);
    rotations.extend(flat(&arrays, "pose_hand", 6)?);
    if rotations.len() != 3 * joints {
        let e = Error::input(name)
            .at("array 'bone_transforms'")
            .expected(format!("{} joints", rotations.len() / 3));
        return Err(e.got(joints.to_string()));
    }
    if out.rest.is_none() {
        let rest = arrays.need("minimal_shape").map_err(|e| e.within(name.clone()))?;
        if rest.shape().len() != 2 || rest.shape()[1] != 3 {
            let e = Error::input(name).at("array 'minimal_shape'").expected("shape (V, 3)");
            return Err(e.got(format!("{:?}", rest.shape())));
        }
        out.rest = Some(triples(&rest.to_f64()));
    }
    if let Some(b) = arrays.get("betas") {
        out.same_shape(&b.to_f64(), number as i64);
    }
    let rows = |m: &[f64; 16]| [0, 4, 8].map(|r| [m[r], m[r + 1], m[r + 2], m[r + 3]]);
    out.moments.push(super::source::Moment {
        rotations: triples(&rotations),
        global_rotation: [0.0; 3],
        global_translation: super::source::three(&flat(&arrays, "trans", 3)?, "trans", &name)?,
        scale: 1.0,
        transforms: Some(transforms.to_f64().as_chunks::<16>().0.iter().map(rows).collect()),
    });
    out.numbers.push(number as i64);
    Ok(())
}

/// A camera with its folder.
struct Folder {
    dir: PathBuf,
    images: BTreeMap<usize, PathBuf>,
    masks: BTreeMap<usize, PathBuf>,
    view_from_world: [[f64; 4]; 4],
    intrinsics: [f64; 4],
    lens: crate::io::capture::Lens,
}

impl Folder {
    fn read(entry: &Value, camera: &str, dir: &Path, name: &str) -> Result<Self> {
        let numbers = |key: &str| -> Result<Vec<f64>> {
            let mut out = Vec::new();
            flatten(&entry[key], &mut out).filter(|()| !out.is_empty()).ok_or_else(|| {
                let e = Error::input(name).at(format!("\"{camera}\".{key}")).expected("numbers");
                e.got(entry[key].to_string().chars().take(60).collect::<String>())
            })?;
            Ok(out)
        };
        let dir = dir.join(camera);
        let files = super::source::numbered(&dir, "")?;
        let is = |p: &Path, ends: &[&str]| {
            p.extension().and_then(|e| e.to_str()).is_some_and(|e| ends.contains(&e.to_lowercase().as_str()))
        };
        // A number may have an image and a mask: search for the other extension too.
        let with = |ends: &[&str]| {
            let of = |(n, p): (&usize, &PathBuf)| {
                let candidates = std::iter::once(p.clone()).chain(ends.iter().map(|e| p.with_extension(e)));
                candidates.into_iter().find(|p| is(p, ends) && p.is_file()).map(|p| (*n, p))
            };
            files.iter().filter_map(of).collect()
        };
        let at = |e: Error| e.at(format!("camera \"{camera}\""));
        Ok(Self {
            images: with(&["jpg", "jpeg"]),
            masks: with(&["png"]),
            view_from_world: pose(&numbers("R")?, &numbers("T")?, name).map_err(at)?,
            intrinsics: intrinsics(&numbers("K")?, name).map_err(at)?,
            lens: distortion(&numbers("D")?, name).map_err(at)?,
            dir,
        })
    }

    fn shot(&self, number: usize, camera: usize, time: usize, split: Split) -> Result<SourceShot> {
        let find = |files, what| super::source::numbered_file(files, number, &self.dir, what);
        Ok(SourceShot {
            time,
            camera,
            split,
            view_from_world: self.view_from_world,
            intrinsics: self.intrinsics,
            lens: self.lens,
            image: Pixels::Picture(find(&self.images, "image (.jpg) of frame")?),
            mask: Pixels::Picture(find(&self.masks, "mask (.png) of frame")?),
        })
    }
}

/// Numbers of nested lists, in order.
fn flatten(v: &Value, out: &mut Vec<f64>) -> Option<()> {
    match v {
        Value::Array(list) => {
            list.iter().try_for_each(|x| if out.len() < 64 { flatten(x, out) } else { None })
        }
        other => other.as_f64().filter(|x| x.is_finite()).map(|x| out.push(x)),
    }
}
