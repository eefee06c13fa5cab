//! DNA-Rendering: `.smc` containers, which are HDF5 files.
//!
//! ```text
//! NAME.smc         Camera_5mp|Camera_12mp/{cam}/color/{frame}     encoded image as bytes
//! NAME_annots.smc  Camera_Parameter/{cam, two digits}/{K 3x3, D 5, RT 4x4}      RT: camera to world
//!                  Mask/{cam}/mask/{frame}                         encoded image as bytes, not zero: person
//!                  SMPLx/{betas, expression, fullpose (n, 55, 3), transl (n, 3), scale}
//! ```
//!
//! All may also be in one file. The body is scaled before it is moved. Rotations of the hands are those that
//! the SMPL-X library takes with `flat_hand_mean=False`: they come on top of the body model's mean hands.
//! Expressions and colour calibration are not used.

use super::pixels::{Container, Pixels};
use super::source::{
    Layout, Plan, Range, Selection, Source, SourceShot, distortion, intrinsics, three, triples,
};
use crate::io::capture::{Lens, nearest_rotation, rigid};
use crate::io::hdf5::Hdf5;
use crate::io::name_of;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Camera of the training images, and the held-out cameras.
const TRAIN: usize = 26;
const TEST: [usize; 4] = [24, 25, 27, 28];

/// Reads a performance: a folder with the containers, or the one with the images.
///
/// # Errors
/// When a file is missing or malformed.
pub fn read(path: &Path, selection: &Selection) -> Result<Source> {
    let (pictures, annots) = containers(path)?;
    let cameras = {
        let (groups, _) = annots.0.names("Camera_Parameter")?;
        groups.iter().filter_map(|n| n.parse().ok()).collect::<Vec<usize>>()
    };
    let train = selection.train_cameras.clone().unwrap_or_else(|| vec![TRAIN]);
    let test = selection.test_cameras.clone().unwrap_or_else(|| TEST.to_vec());
    if let Some(c) = train.iter().chain(&test).find(|c| !cameras.contains(c)) {
        return Err(Error::input(annots.0.name())
            .at("Camera_Parameter")
            .expected(format!("camera {c}"))
            .got(format!("{} cameras", cameras.len())));
    }
    let (shape, poses) = annots.0.numbers("SMPLx/fullpose")?;
    let count = shape.first().copied().unwrap_or(0);
    let per = poses.len() / crate::num::order::max(count, 1);
    let wrong = |at: &str, expected: String, got: String| {
        Error::input(annots.0.name()).at(format!("'{at}'")).expected(expected).got(got)
    };
    if per == 0 || !per.is_multiple_of(3) {
        return Err(wrong("SMPLx/fullpose", "shape (n, 55, 3)".into(), format!("{shape:?}")));
    }
    let (_, transl) = annots.0.numbers("SMPLx/transl")?;
    if transl.len() != 3 * count {
        return Err(wrong(
            "SMPLx/transl",
            format!("{count} poses, as many as fullpose"),
            format!("{} numbers", transl.len()),
        ));
    }
    let scale = if annots.0.has("SMPLx/scale") { annots.0.numbers("SMPLx/scale")?.1 } else { vec![1.0] };
    let scale_of = |f: usize| scale.get(f).or(scale.first()).copied().unwrap_or(1.0);
    if scale.iter().any(|s| !(*s > 0.0)) {
        return Err(wrong("SMPLx/scale", "positive numbers".into(), format!("{scale:?}")));
    }
    let (shape, betas) = annots.0.numbers("SMPLx/betas")?;
    // One row in total, or one per frame.
    let width = if shape.len() == 2 { shape[1] } else { betas.len() };
    if width == 0 || betas.is_empty() {
        return Err(wrong(
            "SMPLx/betas",
            "at least one shape coefficient".into(),
            format!("shape {shape:?}"),
        ));
    }
    let to_train = selection.train_frames.unwrap_or(Range { start: 0, step: 1, count: 100 }).frames(count);
    let to_test = selection.test_frames.unwrap_or(Range { start: 0, step: 5, count: 20 }).frames(count);
    let plan = Plan::new((&train, &to_train), (&test, &to_test));
    let mut out = Source { kind: "smplx", downscale: 2, on_mean_hands: true, ..Source::new(Layout::Dna) };
    let rows: Vec<&[f64]> = betas.chunks_exact(width).collect();
    for &f in &plan.frames {
        out.same_shape(rows.get(f).unwrap_or(&rows[0]), f as i64);
        out.moments.push(super::source::Moment {
            rotations: triples(&poses[f * per..(f + 1) * per]),
            global_rotation: [0.0; 3],
            global_translation: three(&transl[3 * f..3 * f + 3], "transl", annots.0.name())?,
            scale: scale_of(f),
            transforms: None,
        });
        out.numbers.push(f as i64);
    }
    if annots.0.has("SMPLx/expression") {
        out.notes.push("facial expressions are not used: the face is neutral in the template".to_owned());
    }
    let mut known = BTreeMap::new();
    for &(camera, frame, split) in &plan.shots {
        if let std::collections::btree_map::Entry::Vacant(e) = known.entry(camera) {
            e.insert(calibrated(&annots, camera)?);
        }
        let (view_from_world, intrinsics, lens) = known[&camera];
        let groups = ["Camera_5mp", "Camera_12mp"].map(|g| format!("{g}/{camera}/color/{frame}"));
        let image = groups.into_iter().find(|at| pictures.0.has(at)).ok_or_else(|| {
            Error::input(pictures.0.name())
                .at(format!("camera {camera}, frame {frame}"))
                .expected("an image")
                .got("none")
        })?;
        let masks = [format!("Mask/{camera}/mask/{frame}"), format!("Mask/{camera:02}/mask/{frame}")];
        let mask = masks.into_iter().find(|at| annots.0.has(at)).ok_or_else(|| {
            Error::input(annots.0.name())
                .at(format!("camera {camera}, frame {frame}"))
                .expected("a mask")
                .got("none")
        })?;
        out.shots.push(SourceShot {
            time: plan.time(frame),
            camera,
            split,
            view_from_world,
            intrinsics,
            lens,
            image: Pixels::Encoded(pictures.clone(), image),
            mask: Pixels::Encoded(annots.clone(), mask),
        });
    }
    Ok(out)
}

/// The container with the images and the one with the rest, which may be the same.
fn containers(path: &Path) -> Result<(Arc<Container>, Arc<Container>)> {
    let files: Vec<PathBuf> = if path.is_dir() {
        let entries = std::fs::read_dir(path).map_err(|e| Error::os(path, &e))?;
        entries
            .filter_map(|e| Some(e.ok()?.path()))
            .filter(|p| p.extension().is_some_and(|e| e == "smc"))
            .collect()
    } else {
        let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
        let annots = path.with_file_name(format!("{stem}_annots.smc"));
        std::iter::once(path.to_path_buf()).chain(annots.is_file().then_some(annots)).collect()
    };
    let is_annots =
        |p: &PathBuf| p.file_stem().and_then(|s| s.to_str()).is_some_and(|s| s.ends_with("_annots"));
    let (annots, mains): (Vec<PathBuf>, Vec<PathBuf>) = files.into_iter().partition(is_annots);
    match (&mains[..], &annots[..]) {
        ([main], []) => {
            let one = Arc::new(Container(Hdf5::open(main)?));
            Ok((one.clone(), one))
        }
        ([main], [annots]) => {
            Ok((Arc::new(Container(Hdf5::open(main)?)), Arc::new(Container(Hdf5::open(annots)?))))
        }
        _ => Err(Error::input(name_of(path))
            .expected("one NAME.smc, and NAME_annots.smc beside it")
            .got(format!("{} and {} files", mains.len(), annots.len()))),
    }
}

/// View from world, intrinsics, lens.
fn calibrated(annots: &Container, camera: usize) -> Result<([[f64; 4]; 4], [f64; 4], Lens)> {
    let at = |key: &str| {
        let padded = format!("Camera_Parameter/{camera:02}/{key}");
        if annots.0.has(&padded) { padded } else { format!("Camera_Parameter/{camera}/{key}") }
    };
    let name = format!("{}: 'Camera_Parameter/{camera:02}'", annots.0.name());
    let (_, k) = annots.0.numbers(&at("K"))?;
    let (_, d) = annots.0.numbers(&at("D"))?;
    let (_, rt) = annots.0.numbers(&at("RT"))?;
    if rt.len() != 16 {
        return Err(Error::input(name).at("RT").expected("4x4 numbers").got(rt.len().to_string()));
    }
    let r =
        nearest_rotation(std::array::from_fn(|i| std::array::from_fn(|j| rt[4 * i + j]))).map_err(|got| {
            Error::input(name.clone()).at("RT").expected("a rotation in the upper left block").got(got)
        })?;
    // Camera to world: the inverse is the view.
    let back: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]));
    let c = [rt[3], rt[7], rt[11]];
    let t = std::array::from_fn(|i| -((back[i][0] * c[0] + back[i][1] * c[1]) + back[i][2] * c[2]));
    Ok((rigid(back, t), intrinsics(&k, &name)?, distortion(&d, &name)?))
}
