//! A capture: photos with poses and lenses, as plain records, from any layout that is read.

pub use super::frame::{Capture, Dialect, Focal, Frame, Lens, Passes, Split, nearest_rotation, rigid};
pub use super::paths::{clean, locate};
pub use super::reading::Reading;
use super::{camera_path, colmap, transforms};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// The cameras of a capture, or of a nerfstudio `camera_path.json`: frames in their order, whose images need not be there.
///
/// # Errors
/// See [`read_capture`].
pub fn read_cameras(path: &Path, reading: &Reading) -> Result<Vec<Frame>> {
    if path.is_file()
        && let Some(frames) = camera_path::read(path)?
    {
        return Ok(frames);
    }
    let capture = read_capture_with(path, reading)?;
    let mut frames: Vec<Frame> = capture.frames.into_iter().chain(capture.missing).collect();
    frames.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(frames)
}

/// Reads a capture: a `transforms.json`, a folder with one (or with `transforms_train.json`), or a folder with a COLMAP
/// model in `.`, `sparse/0`, `sparse`, `dense/0/sparse` or `dense/sparse`.
///
/// # Errors
/// When no layout is recognised, a mask is missing, a file is malformed, or a lens is not supported. Frames
/// whose photo is missing are returned separately.
pub fn read_capture(path: &Path) -> Result<Capture> {
    read_capture_with(path, &Reading::default())
}

/// [`read_capture`], with its files found according to `reading`.
///
/// # Errors
/// Those of [`read_capture`]; when the folder of images is none.
pub fn read_capture_with(path: &Path, reading: &Reading) -> Result<Capture> {
    if let Some(folder) = reading.images.as_deref().filter(|folder| !folder.is_dir()) {
        let e = Error::input("--images").at(folder.display().to_string()).expected("a folder");
        return Err(e.got(if folder.exists() { "a file" } else { "no such folder" }));
    }
    if path.is_file()
        && let Some(what) = medium(path)
    {
        let e = Error::input(path.display().to_string());
        let e = e.expected("a folder with images and their camera poses, or its transforms.json").got(what);
        return Err(e.hint("`lastlight help captures` describes captures and how they are made"));
    }
    let mut capture = if path.is_file() || transforms::file_in(path).is_some() {
        transforms::read(path, reading)?
    } else if let Some(model) = colmap::find(path) {
        colmap::read_model(&model, reading)?
    } else {
        return Err(not_a_capture(path));
    };
    capture.frames.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(pair) = capture.frames.windows(2).find(|w| w[0].name == w[1].name) {
        let e = Error::input(path.display().to_string()).at(format!("frame '{}'", pair[0].name));
        return Err(e.expected("every image once").got("two entries"));
    }
    if capture.frames.is_empty() && capture.missing.is_empty() {
        return Err(Error::input(path.display().to_string()).expected("at least one frame").got("none"));
    }
    Ok(capture)
}

/// Endings of files that hold images.
const IMAGES: [&str; 11] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp", "heic", "exr", "hdr", "dng"];

/// Endings of files that hold videos.
const VIDEOS: [&str; 6] = ["mp4", "mov", "mkv", "avi", "webm", "m4v"];

/// What a file is by its ending: an image or a video.
fn medium(path: &Path) -> Option<&'static str> {
    let ending = path.extension()?.to_str()?.to_ascii_lowercase();
    let is_in = |all: &[&str]| all.contains(&ending.as_str());
    if is_in(&IMAGES) { Some("one image") } else { is_in(&VIDEOS).then_some("a video") }
}

/// Number of images in a folder, and in the folders inside it that hold them by custom.
fn count_images(path: &Path) -> usize {
    let is_image = |p: &Path| medium(p).is_some_and(|what| what != "a video");
    let folders = ["", "images", "input", "rgb"].iter().map(|inside| path.join(inside));
    let entries = folders.flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten());
    entries.filter(|e| is_image(&e.path())).count()
}

/// The first capture in the folders of a folder, or in theirs, in the order of their names: generated sets have one per object and light.
fn captures_inside(path: &Path) -> Option<PathBuf> {
    let sorted = |path: &Path| {
        let mut all: Vec<PathBuf> =
            std::fs::read_dir(path).into_iter().flatten().flatten().map(|e| e.path()).collect();
        all.sort();
        all
    };
    let is_capture = |path: &PathBuf| {
        path.join("transforms.json").is_file() || path.join("transforms_train.json").is_file()
    };
    let inner = sorted(path);
    inner
        .iter()
        .find(|p| is_capture(p))
        .cloned()
        .or_else(|| inner.iter().flat_map(|p| sorted(p)).find(is_capture))
}

fn not_a_capture(path: &Path) -> Error {
    let name = path.display().to_string();
    if !path.exists() {
        return Error::input(name).expected("a capture").got("no such file or folder");
    }
    let e = Error::input(name.clone());
    let layouts =
        "a capture: transforms.json, transforms_train.json, or a COLMAP model (cameras.bin or cameras.txt)";
    if let Some(inside) = captures_inside(path) {
        return e.expected(layouts).got("a folder of captures").hint(format!("such as {}", inside.display()));
    }
    match count_images(path) {
        0 => e.expected(layouts).got("a folder without any of them"),
        n => e.expected(layouts).got(format!("{n} images but no camera poses")).hint(format!(
            "compute poses with COLMAP: mkdir -p scene && colmap automatic_reconstructor --workspace_path scene --image_path {name} --dense 0, then \
             lastlight splat fit scene --images {name} --out fit (`lastlight help captures` has more)"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_capture_is_named() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let text = |path: &Path| read_capture(path).expect_err("no capture").to_string();
        assert!(text(&dir.path().join("x")).contains("no such file or folder"), "nothing there");
        assert!(text(dir.path()).contains("without any of them"), "an empty folder");
        std::fs::create_dir(dir.path().join("images")).expect("made");
        for name in ["a.JPG", "images/b.png", "images/c.heic", "notes.txt"] {
            std::fs::write(dir.path().join(name), "x").expect("written");
        }
        let e = text(&dir.path().join("a.JPG"));
        assert!(e.contains("a.JPG: expected a folder with images") && e.contains("got one image"), "{e}");
        let set = dir.path().join("set");
        std::fs::create_dir_all(set.join("object_00000/uniform")).expect("made");
        std::fs::write(set.join("object_00000/uniform/transforms.json"), "{}").expect("written");
        for folder in [set.clone(), set.join("object_00000")] {
            let text = text(&folder);
            assert!(text.contains("such as") && text.contains("object_00000/uniform"), "{text}");
        }
        std::fs::remove_dir_all(set).expect("removed");
        let text = text(dir.path());
        assert!(text.contains("3 images but no camera poses"), "{text}");
        for part in
            ["mkdir -p scene && colmap automatic_reconstructor", "lastlight splat fit scene --images "]
        {
            assert!(text.contains(part), "what to type: {text}");
        }
    }
}
