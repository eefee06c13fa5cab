//! ZJU-MoCap, as released (`zju`) and with the refined cameras of Instant-NVR (`zju-refine`).
//!
//! ```text
//! CoreView_377/annots.npy                  {cams: {K, D, R, T}, ims: [{ims: [path per camera]} per frame]}
//! CoreView_377/Camera_B1/000000.jpg        images at the paths of ims (subjects 313, 315: "Camera (1)/…_0001_….jpg")
//! CoreView_377/mask_cihp/Camera_B1/000000.png, mask/…        not zero: person; the first folder that is there
//! CoreView_377/new_params/0.npy (params, smpl_params)        {poses (1,72), Rh (1,3), Th (1,3), shapes (1,10)}
//! ```
//!
//! Cameras are numbered from 0 in the order of `cams`, frames in the order of `ims`; parameters are found by
//! the number in the image's name.

use super::annots;
use super::source::{Layout, Plan, Range, Selection, Source, first_folder, numbered, numbered_file};
use crate::io::person::find_below;
use crate::io::pickle::Value;
use crate::{Error, Result};
use std::path::Path;

/// Reads one of the two.
///
/// # Errors
/// When a file is missing or malformed.
pub fn read(layout: Layout, dir: &Path, selection: &Selection) -> Result<Source> {
    let (annots, name) = annots::read(dir)?;
    let cameras = annots::cameras(&annots, &name)?;
    let wrong = |at: String, expected: &str, v: &Value| {
        Error::input(name.clone()).at(at).expected(expected).got(v.describe())
    };
    let ims = annots.need("ims", &name)?;
    let frames = ims.items().ok_or_else(|| wrong("ims".into(), "a list of frames", ims))?;
    // Some copies were written on Windows.
    let path_of = |frame: usize, camera: usize| -> Result<String> {
        let entry = frames.get(frame).ok_or_else(|| {
            Error::input(name.clone())
                .at("ims")
                .expected(format!("frame {frame}"))
                .got(format!("{} frames", frames.len()))
        })?;
        let paths = entry.need("ims", &name).map_err(|e| e.at(format!("ims[{frame}]")))?;
        match paths.items().and_then(|p| p.get(camera)) {
            Some(Value::Text(t)) => Ok(t.replace('\\', "/")),
            _ => Err(wrong(format!("ims[{frame}].ims"), &format!("the path of camera {camera}"), paths)),
        }
    };
    let refined = layout == Layout::ZjuRefine;
    let own = if refined { 4 } else { 0 };
    let train = selection.train_cameras.clone().unwrap_or_else(|| vec![own]);
    let others = || (0..cameras.len()).filter(|c| !train.contains(c)).collect();
    let test = selection.test_cameras.clone().unwrap_or_else(others);
    if let Some(&c) = train.iter().chain(&test).find(|&&c| c >= cameras.len()) {
        return Err(Error::input(name)
            .at("cams")
            .expected(format!("camera {c}"))
            .got(format!("{} cameras", cameras.len())));
    }
    let (to_train, to_test) = if refined {
        (Range { start: 0, step: 5, count: 100 }, Range { start: 0, step: 30, count: 17 })
    } else {
        (Range { start: 0, step: 1, count: usize::MAX }, Range { start: 0, step: 30, count: usize::MAX })
    };
    let to_train = selection.train_frames.unwrap_or(to_train).frames(frames.len());
    let to_test = selection.test_frames.unwrap_or(to_test).frames(frames.len());
    let plan = Plan::new((&train, &to_train), (&test, &to_test));
    let masks =
        first_folder(dir, if refined { &["mask", "mask_cihp"] } else { &["mask_cihp", "mask"] }, "masks")?;
    let bodies = first_folder(
        dir,
        if refined {
            &["smpl_params", "new_params", "params"]
        } else {
            &["new_params", "params", "smpl_params"]
        },
        "body parameters",
    )?;
    let of_body = numbered(&bodies, "")?;
    let mut out = Source { downscale: 2, ..Source::new(layout) };
    for &frame in &plan.frames {
        let path = path_of(frame, 0)?;
        let number = frame_number(&path).unwrap_or(frame);
        let (moment, shape) =
            annots::params(&numbered_file(&of_body, number, &bodies, "body parameters of frame")?)?;
        out.same_shape(&shape, number as i64);
        out.moments.push(moment);
        out.numbers.push(number as i64);
    }
    for &(camera, frame, split) in &plan.shots {
        let path = path_of(frame, camera)?;
        let image = find_below(dir, &path, "image")?;
        let relative = ["images/", "./"].iter().find_map(|p| path.strip_prefix(p)).unwrap_or(&path);
        // The same name below the folder of masks, whatever its extension.
        let bare = Path::new(relative).with_extension("");
        let mask = find_below(&masks, &bare.to_string_lossy(), "mask")?;
        out.shots.push(cameras[camera].shot(plan.time(frame), camera, split, image, mask));
    }
    out.reference = annots::reference(dir, &out.numbers);
    Ok(out)
}

/// The number in an image's name: all of the stem, or the first part between underscores that has at least
/// four digits.
fn frame_number(path: &str) -> Option<usize> {
    let stem = Path::new(path).file_stem()?.to_str()?;
    let is_number = |p: &&str| p.len() >= 4 && p.bytes().all(|b| b.is_ascii_digit());
    stem.split('_').find(is_number).or(Some(stem))?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::frame_number;

    #[test]
    fn frames_are_numbered_by_their_pictures() {
        assert_eq!(frame_number("Camera_B1/000123.jpg"), Some(123), "all digits");
        assert_eq!(
            frame_number("Camera (1)/Camera (1)_0042_2019-08-23_16-08-50.592.jpg"),
            Some(42),
            "between underscores"
        );
        assert_eq!(frame_number("a/b.jpg"), None, "no number");
    }
}
