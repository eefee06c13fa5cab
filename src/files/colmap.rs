//! COLMAP sparse models, binary and text.
//!
//! Three files: cameras (lenses), images (poses, world to camera, x right, y down, z forward) and points3D.
//! Observations are checked and skipped; the `rigs` and `frames` files of newer versions are not needed,
//! because the images file contains the poses.

use super::bytes::Cursor;
pub use super::colmap_model::{Camera, Image};
use super::colmap_model::{MODELS, camera, check_pose};
use super::frame::{Capture, Dialect, Focal, Frame, Passes, Split, rigid};
use super::gaussian_ply::Points;
use super::paths::{accept, locate};
use super::reading::Reading;
use super::{MAX_FILE_BYTES, colmap_text, name_of, read_bytes};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Longest image name.
const MAX_NAME: usize = 4096;

/// Where the parts of a capture are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Model {
    folder: PathBuf,
    root: PathBuf,
    binary: bool,
}

/// Folders of images, in the order in which they are tried: full size, reduced by common scripts, and before undistortion.
const FOLDERS: [&str; 5] = ["images", "images_2", "images_4", "images_8", "input"];
/// Endings of reduced images, which may differ from those of the model.
const ENDINGS: [&str; 6] = ["png", "jpg", "JPG", "jpeg", "PNG", "webp"];

/// The image in a folder, possibly with another ending.
fn image(folder: &Path, name: &str) -> Option<PathBuf> {
    let other = |ending: &&str| folder.join(Path::new(name).with_extension(ending));
    locate(folder, name).or_else(|| ENDINGS.iter().map(other).find(|p| p.is_file()))
}

/// The model of a capture folder, if there is one.
pub(super) fn find(path: &Path) -> Option<Model> {
    // Folder of the model, and of the capture around it.
    let inside = [("sparse/0", ""), ("sparse", ""), ("dense/0/sparse", "dense/0"), ("dense/sparse", "dense")];
    let mut places: Vec<(PathBuf, PathBuf)> =
        inside.iter().map(|(m, r)| (path.join(m), path.join(r))).collect();
    // The path may be the model itself: the images are beside it, or one or two levels up.
    let around = ["", "..", "../.."]
        .map(|r| path.join(r))
        .into_iter()
        .find(|r| FOLDERS.iter().any(|f| r.join(f).is_dir()));
    places.push((path.to_path_buf(), around.unwrap_or_else(|| path.to_path_buf())));
    places.into_iter().find_map(|(folder, root)| {
        let binary = folder.join("cameras.bin").is_file();
        let there = binary || folder.join("cameras.txt").is_file();
        there.then_some(Model { folder, root, binary })
    })
}

/// Reads the files of a model and finds the images.
///
/// # Errors
/// When a file is malformed, or a camera or image is missing.
pub(super) fn read_model(model: &Model, reading: &Reading) -> Result<Capture> {
    let extension = if model.binary { "bin" } else { "txt" };
    let file = |stem: &str| model.folder.join(format!("{stem}.{extension}"));
    let load = |stem: &str| Ok::<_, Error>((read_bytes(&file(stem), MAX_FILE_BYTES)?, name_of(&file(stem))));
    let (camera_bytes, camera_name) = load("cameras")?;
    let (image_bytes, image_name) = load("images")?;
    let points_file = file("points3D");
    let points_bytes = if points_file.is_file() { Some(load("points3D")?) } else { None };
    let (cameras, images, points) = if model.binary {
        let points = points_bytes.map(|(b, n)| parse_points(&b, &n)).transpose()?;
        (parse_cameras(&camera_bytes, &camera_name)?, parse_images(&image_bytes, &image_name)?, points)
    } else {
        let points = points_bytes.map(|(b, n)| colmap_text::parse_points(&b, &n)).transpose()?;
        let cameras = colmap_text::parse_cameras(&camera_bytes, &camera_name)?;
        (cameras, colmap_text::parse_images(&image_bytes, &image_name)?, points)
    };
    let dialect = if model.binary { Dialect::ColmapBinary } else { Dialect::ColmapText };
    let mut frames = frames(&cameras, &images, &image_name, reading.outside)?;
    let holds = |folder: &PathBuf| frames.iter().any(|frame| image(folder, &frame.name).is_some());
    let own = || FOLDERS.iter().map(|f| model.root.join(f)).find(holds);
    let folder = reading.images.clone().or_else(own).unwrap_or_else(|| model.root.join(FOLDERS[0]));
    let masks = model.root.join("masks");
    for frame in &mut frames {
        let found = reading.images.as_ref().and_then(|_| reading.image(&model.root, &frame.name));
        let Some(image) = found.or_else(|| image(&folder, &frame.name)) else {
            frame.image = folder.join(&frame.name);
            continue;
        };
        frame.image = image;
        if reading.without_masks {
            continue;
        }
        let stem = Path::new(&frame.name).with_extension("");
        frame.mask = [format!("{}.png", frame.name), format!("{}.png", stem.display()), frame.name.clone()]
            .into_iter()
            .map(|n| masks.join(n))
            .find(|p| p.is_file());
    }
    let (frames, missing) = frames.into_iter().partition(|frame| frame.image.is_file());
    Ok(Capture { dialect, frames, points, missing, missing_files: Vec::new(), is_unit_ball: false })
}

/// Frames from cameras and images; names may lead out of the folder if `outside` is set; `name` is the file of the images.
///
/// # Errors
/// When an image names a camera that does not exist, or a path outside the folder.
pub fn frames(
    cameras: &BTreeMap<u32, Camera>,
    images: &[Image],
    name: &str,
    outside: bool,
) -> Result<Vec<Frame>> {
    let mut out = Vec::with_capacity(images.len());
    for image in images {
        let place = || Error::input(name).at(format!("image {}", image.id));
        let Some(camera) = cameras.get(&image.camera) else {
            return Err(place()
                .expected("the id of a camera in the cameras file")
                .got(image.camera.to_string()));
        };
        let path = accept(&image.name, outside).map_err(|why| {
            place().expected("a path inside the folder of images").got(format!("'{}', {why}", image.name))
        })?;
        out.push(Frame {
            name: path.clone(),
            image: PathBuf::from(path),
            mask: None,
            view_from_world: rigid(rotation(image.rotation), image.translation),
            focal: Focal::Pixels(camera.focal),
            center: Some(camera.center),
            size: Some(camera.size),
            lens: camera.lens,
            split: Split::Unknown,
            passes: Passes::default(),
        });
    }
    Ok(out)
}

/// Rotation matrix of a quaternion w x y z of any length but zero.
fn rotation(q: [f64; 4]) -> [[f64; 3]; 3] {
    let n = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    let [w, x, y, z] = q.map(|v| v / n);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Parses `cameras.bin`.
///
/// # Errors
/// When it is malformed or a model is not supported.
pub fn parse_cameras(bytes: &[u8], name: &str) -> Result<BTreeMap<u32, Camera>> {
    let mut c = Cursor::new(bytes, name);
    let n = c.count(48, format_args!("number of cameras"))?;
    let mut out = BTreeMap::new();
    for i in 0..n {
        let id = c.u32(format_args!("camera {i} of {n}, id"))?;
        let model = c.i32(format_args!("camera {i} of {n}, model"))?;
        let Some(model) = usize::try_from(model).ok().filter(|&m| m < MODELS.len()) else {
            let e = Error::input(name).at(format!("camera {i} of {n} (id {id}), model"));
            return Err(e.expected(format!("an id from 0 to {}", MODELS.len() - 1)).got(model.to_string()));
        };
        let size = [
            c.u64(format_args!("camera {i} of {n}, width"))?,
            c.u64(format_args!("camera {i} of {n}, height"))?,
        ];
        let mut p = Vec::with_capacity(MODELS[model].1);
        for j in 0..MODELS[model].1 {
            p.push(c.f64(format_args!("camera {i} of {n}, parameter {j}"))?);
        }
        let at = || Error::input(name).at(format!("camera {i} of {n} (id {id})"));
        if out.insert(id, camera(model, size, &p, &at)?).is_some() {
            return Err(at().expected("every id once").got("two cameras"));
        }
    }
    c.end()?;
    Ok(out)
}

/// Parses `images.bin`.
///
/// # Errors
/// When it is malformed.
pub fn parse_images(bytes: &[u8], name: &str) -> Result<Vec<Image>> {
    let mut c = Cursor::new(bytes, name);
    let n = c.count(73, format_args!("number of images"))?;
    let mut out = Vec::with_capacity(n);
    for i in 0..n {
        let id = c.u32(format_args!("image {i} of {n}, id"))?;
        let mut pose = [0.0; 7];
        for (j, x) in pose.iter_mut().enumerate() {
            *x = c.f64(format_args!("image {i} of {n}, pose value {j}"))?;
        }
        let [w, x, y, z, tx, ty, tz] = pose;
        let at = || Error::input(name).at(format!("image {i} of {n} (id {id})"));
        check_pose(&pose[..4], &pose[4..], &at)?;
        let camera = c.u32(format_args!("image {i} of {n}, camera id"))?;
        let mut text = Vec::new();
        loop {
            match c.array::<1>(format_args!("image {i} of {n}, name"))? {
                [0] => break,
                [b] if text.len() < MAX_NAME => text.push(b),
                _ => {
                    return Err(at()
                        .expected(format!("a name of at most {MAX_NAME} bytes"))
                        .got("a longer one"));
                }
            }
        }
        let text =
            String::from_utf8(text).map_err(|_| at().expected("a name in UTF-8").got("other bytes"))?;
        let points = c.count(24, format_args!("image {i} of {n}, number of observations"))?;
        c.take(points * 24, format_args!("image {i} of {n}, observations"))?;
        out.push(Image { id, rotation: [w, x, y, z], translation: [tx, ty, tz], camera, name: text });
    }
    c.end()?;
    Ok(out)
}

/// Parses `points3D.bin`.
///
/// # Errors
/// When it is malformed.
pub fn parse_points(bytes: &[u8], name: &str) -> Result<Points> {
    let mut c = Cursor::new(bytes, name);
    let n = c.count(51, format_args!("number of points"))?;
    let mut out = Points { xyz: Vec::with_capacity(n), rgb: Vec::with_capacity(n) };
    for i in 0..n {
        c.u64(format_args!("point {i} of {n}, id"))?;
        let mut xyz = [0.0; 3];
        for (j, x) in xyz.iter_mut().enumerate() {
            *x = c.f64(format_args!("point {i} of {n}, coordinate {j}"))?;
        }
        out.xyz.push(xyz);
        out.rgb.push(c.array(format_args!("point {i} of {n}, colour"))?);
        c.take(8, format_args!("point {i} of {n}, error"))?;
        let track = c.count(8, format_args!("point {i} of {n}, track length"))?;
        c.take(track * 8, format_args!("point {i} of {n}, track"))?;
    }
    c.end()?;
    Ok(out)
}
