//! MonoCap in the layout of Instant-NVR: `lan`, `marc`, `olek`, `vlad`.
//!
//! ```text
//! annots.npy                  {cams: {K, D, R, T}}, T in millimetres
//! images/00/0000.jpg          view, frame (olek, vlad: six digits, from frame 1)
//! mask/00/0000.png            not zero: person
//! params/0.npy (smpl_params, new_params)
//! ```
//!
//! The subject is known by the name of the folder or of the one above; other names get the protocol of lan.

use super::annots;
use super::source::{Layout, Plan, Range, Selection, Source, first_folder, numbered, numbered_file};
use crate::{Error, Result};
use std::path::Path;

/// Margin of the box, metres.
const MARGIN_M: f64 = 0.1;

/// Which of the four a folder is.
pub(super) fn subject(dir: &Path) -> Option<&'static str> {
    let names = super::source::called(dir);
    ["lan", "marc", "olek", "vlad"]
        .into_iter()
        .find(|s| names.iter().any(|n| n.split(['_', '-', '.']).any(|part| part == *s)))
}

/// Reads a subject.
///
/// # Errors
/// When a file is missing or malformed.
pub fn read(dir: &Path, selection: &Selection) -> Result<Source> {
    let (annots, name) = annots::read(dir)?;
    let cameras = annots::cameras(&annots, &name)?;
    let (own, others, start): (usize, Vec<usize>, usize) = match subject(dir) {
        Some("olek") => (44, vec![45], 1),
        Some("vlad") => (66, (0..=10).map(|i| 10 * i).collect(), 1),
        _ => (0, (1..=10).collect(), 0),
    };
    let train = selection.train_cameras.clone().unwrap_or_else(|| vec![own]);
    let test = selection.test_cameras.clone().unwrap_or(others);
    if let Some(&c) = train.iter().chain(&test).find(|&&c| c >= cameras.len()) {
        return Err(Error::input(name)
            .at("cams")
            .expected(format!("camera {c}"))
            .got(format!("{} cameras", cameras.len())));
    }
    let bodies = first_folder(dir, &["params", "smpl_params", "new_params"], "body parameters")?;
    let of_body = numbered(&bodies, "")?;
    let end = of_body.keys().last().map_or(0, |n| n + 1);
    let to_train = selection.train_frames.unwrap_or(Range { start, step: 5, count: 100 }).frames(end);
    let to_test = selection.test_frames.unwrap_or(Range { start, step: 30, count: 17 }).frames(end);
    let plan = Plan::new((&train, &to_train), (&test, &to_test));
    let mut out = Source { margin_m: MARGIN_M, ..Source::new(Layout::MonoCap) };
    for &frame in &plan.frames {
        let (moment, shape) =
            annots::params(&numbered_file(&of_body, frame, &bodies, "body parameters of frame")?)?;
        out.same_shape(&shape, frame as i64);
        out.moments.push(moment);
        out.numbers.push(frame as i64);
    }
    let (images, masks) = (dir.join("images"), dir.join("mask"));
    let (of_image, of_mask) = (numbered(&images, "")?, numbered(&masks, "")?);
    let mut views = std::collections::BTreeMap::new();
    for &(camera, frame, split) in &plan.shots {
        if let std::collections::btree_map::Entry::Vacant(e) = views.entry(camera) {
            let image = numbered_file(&of_image, camera, &images, "images of view")?;
            let mask = numbered_file(&of_mask, camera, &masks, "masks of view")?;
            e.insert((numbered(&image, "")?, numbered(&mask, "")?, image, mask));
        }
        let (pictures, silhouettes, image, mask) = &views[&camera];
        let image = numbered_file(pictures, frame, image, "image of frame")?;
        let mask = numbered_file(silhouettes, frame, mask, "mask of frame")?;
        out.shots.push(cameras[camera].shot(plan.time(frame), camera, split, image, mask));
    }
    out.reference = annots::reference(dir, &out.numbers);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::subject;
    use std::path::Path;

    #[test]
    fn subjects_are_known_by_their_folder() {
        for (path, expected) in [
            ("a/olek_images0812", Some("olek")),
            ("monocap/vlad", Some("vlad")),
            ("lan_images620_1300/x", Some("lan")),
            ("plan", None),
        ] {
            assert_eq!(subject(Path::new(path)), expected, "{path}");
        }
    }
}
