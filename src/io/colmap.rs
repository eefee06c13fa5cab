//! COLMAP sparse models, binary and text.
//!
//! Three files: cameras (lenses), images (poses, world to camera, x right, y down, z forward) and points3D. Observations
//! are checked and skipped; `rigs` and `frames` files of newer versions are not needed, since images carry their poses.

use super::bytes::Cursor;
use super::capture::{Capture, Dialect, Focal, Frame, Lens, Passes, Split, clean, locate, rigid};
use super::gaussian_ply::Points;
use super::{MAX_FILE_BYTES, colmap_text, image_file, name_of, read_bytes};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name, number of parameters and support of every model, by id.
pub(super) const MODELS: [(&str, usize, bool); 12] = [
    ("SIMPLE_PINHOLE", 3, true),
    ("PINHOLE", 4, true),
    ("SIMPLE_RADIAL", 4, true),
    ("RADIAL", 5, true),
    ("OPENCV", 8, true),
    ("OPENCV_FISHEYE", 8, true),
    ("FULL_OPENCV", 12, true),
    ("FOV", 5, false),
    ("SIMPLE_RADIAL_FISHEYE", 4, true),
    ("RADIAL_FISHEYE", 5, true),
    ("THIN_PRISM_FISHEYE", 12, false),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16, false),
];

/// Longest picture name.
const MAX_NAME: usize = 4096;

/// A lens and a picture size.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// f_x, f_y in pixels.
    pub focal: [f64; 2],
    /// Principal point; the first pixel's centre is at 0.5.
    pub center: [f64; 2],
    /// Distortion.
    pub lens: Lens,
}

/// A posed picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Id in the file.
    pub id: u32,
    /// World to camera, w x y z.
    pub rotation: [f64; 4],
    /// World to camera.
    pub translation: [f64; 3],
    /// Its camera.
    pub camera: u32,
    /// Path below the folder of pictures.
    pub name: String,
}

/// Where the parts of a capture are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Model {
    folder: PathBuf,
    images: PathBuf,
    masks: PathBuf,
    binary: bool,
}

/// The model of a capture folder, if there is one.
pub(super) fn find(path: &Path) -> Option<Model> {
    // Folder of the model, and of the capture around it.
    let inside = [("sparse/0", ""), ("sparse", ""), ("dense/0/sparse", "dense/0"), ("dense/sparse", "dense")];
    let mut places: Vec<(PathBuf, PathBuf)> =
        inside.iter().map(|(m, r)| (path.join(m), path.join(r))).collect();
    // The path may be the model itself: the pictures are beside it, or one or two levels up.
    let around = ["", "..", "../.."].map(|r| path.join(r)).into_iter().find(|r| r.join("images").is_dir());
    places.push((path.to_path_buf(), around.unwrap_or_else(|| path.to_path_buf())));
    places.into_iter().find_map(|(folder, root)| {
        let binary = folder.join("cameras.bin").is_file();
        let there = binary || folder.join("cameras.txt").is_file();
        there.then(|| Model { folder, images: root.join("images"), masks: root.join("masks"), binary })
    })
}

/// Reads the files of a model and finds the pictures.
///
/// # Errors
/// When a file is malformed, or a camera or picture is missing.
pub(super) fn read_model(model: &Model) -> Result<Capture> {
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
    let mut frames = frames(&cameras, &images, &image_name)?;
    for (frame, image) in frames.iter_mut().zip(&images) {
        frame.image = locate(&model.images, &frame.name).ok_or_else(|| {
            let e = Error::input(image_name.clone()).at(format!("image {}", image.id));
            e.expected(format!("a file in {}", model.images.display()))
                .got(format!("'{}', which is not there", frame.name))
        })?;
        let stem = Path::new(&frame.name).with_extension("");
        frame.mask = [format!("{}.png", frame.name), format!("{}.png", stem.display()), frame.name.clone()]
            .into_iter()
            .map(|n| model.masks.join(n))
            .find(|p| p.is_file());
    }
    Ok(Capture { dialect, frames, points })
}

/// Frames from cameras and images; `name` is the file of the images.
///
/// # Errors
/// When an image names a camera that is not there, or a path that leads outside.
pub fn frames(cameras: &BTreeMap<u32, Camera>, images: &[Image], name: &str) -> Result<Vec<Frame>> {
    let mut out = Vec::with_capacity(images.len());
    for image in images {
        let place = || Error::input(name).at(format!("image {}", image.id));
        let Some(camera) = cameras.get(&image.camera) else {
            return Err(place()
                .expected("the id of a camera in the cameras file")
                .got(image.camera.to_string()));
        };
        let path = clean(&image.name).map_err(|why| {
            place().expected("a path inside the folder of pictures").got(format!("'{}', {why}", image.name))
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

/// A camera from its model and parameters; errors are placed by the caller.
pub(super) fn camera(model: usize, size: [u64; 2], p: &[f64], at: &dyn Fn() -> Error) -> Result<Camera> {
    let (name, count, supported) = MODELS[model];
    if !supported {
        let have: Vec<_> = MODELS.iter().filter(|m| m.2).map(|m| m.0).collect();
        return Err(at().expected(format!("a camera model out of {}", have.join(", "))).got(name));
    }
    if p.len() != count {
        return Err(at().expected(format!("{count} parameters of {name}")).got(p.len().to_string()));
    }
    let side = image_file::MAX_SIDE as u64;
    if size.iter().any(|&s| s == 0 || s > side) {
        return Err(at()
            .expected(format!("1 to {side} pixels a side"))
            .got(format!("{}x{}", size[0], size[1])));
    }
    if let Some(x) = p.iter().find(|x| !(-1e9..=1e9).contains(*x)) {
        return Err(at().expected("finite parameters").got(x.to_string()));
    }
    let perspective = |k: &[f64], d: [f64; 3], t: [f64; 2]| {
        let mut numerator = [0.0; 4];
        numerator[..k.len()].copy_from_slice(k);
        Lens::Perspective { numerator, denominator: d, tangential: t }
    };
    let fisheye = |k: &[f64]| {
        let mut all = [0.0; 4];
        all[..k.len()].copy_from_slice(k);
        Lens::Fisheye { k: all }
    };
    let one = matches!(
        name,
        "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE"
    );
    let (focal, rest) = if one { ([p[0], p[0]], &p[1..]) } else { ([p[0], p[1]], &p[2..]) };
    if !(focal[0] > 0.0 && focal[1] > 0.0) {
        return Err(at().expected("positive focal lengths").got(format!("{focal:?}")));
    }
    let (center, k) = ([rest[0], rest[1]], &rest[2..]);
    let lens = match name {
        "SIMPLE_RADIAL" | "RADIAL" => perspective(k, [0.0; 3], [0.0; 2]),
        "OPENCV" => perspective(&k[..2], [0.0; 3], [k[2], k[3]]),
        // k1 k2 p1 p2 k3 k4 k5 k6, the last three in the denominator
        "FULL_OPENCV" => perspective(&[k[0], k[1], k[4]], [k[5], k[6], k[7]], [k[2], k[3]]),
        "OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => fisheye(k),
        _ => Lens::PINHOLE,
    };
    Ok(Camera { size: [size[0] as usize, size[1] as usize], focal, center, lens })
}

/// Checks a pose; errors are placed by the caller.
pub(super) fn check_pose(q: &[f64], t: &[f64], at: &dyn Fn() -> Error) -> Result<()> {
    if let Some(x) = q.iter().chain(t).find(|x| !(-1e15..=1e15).contains(*x)) {
        return Err(at().expected("a finite pose").got(x.to_string()));
    }
    let n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    if !(1e-12..).contains(&n) {
        return Err(at().expected("a quaternion other than zero").got(format!("{q:?}")));
    }
    Ok(())
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
