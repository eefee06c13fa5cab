//! `transforms.json` in the dialects of NeRF-synthetic, instant-ngp and nerfstudio.
//!
//! Poses in the file are camera-to-world with OpenGL axes (x right, y up, z backward); they are returned
//! world-to-camera with x right, y down, z forward. instant-ngp's scaling into its unit cube is not applied.
//! Every key may be at the top level or in a frame; the frame takes precedence. Paths may have backslashes,
//! another case, or no extension, and stay inside the folder.

use super::frame::{Capture, Dialect, Focal, Frame, Lens, Passes, Split, nearest_rotation, rigid};
use super::paths::{accept, locate};
use super::reading::Reading;
use super::{gaussian_ply, json, name_of, read_bytes};
use crate::{Error, Result};
use serde_json::{Map, Value};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Longest file read, in bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Largest image side.
const MAX_SIDE: f64 = super::image_data::MAX_SIDE as f64;

/// Contents of one file; paths are cleaned and relative, and their files are not yet checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Transforms {
    /// Dialect, recognised by the keys.
    pub dialect: Dialect,
    /// Frames in the order of the file; `image` and `mask` relative to its folder.
    pub frames: Vec<Frame>,
    /// `ply_file_path`, relative to its folder.
    pub points: Option<PathBuf>,
    /// Whether `lirm gen` wrote it: its object is in the ball of radius ½ around the origin.
    pub is_unit_ball: bool,
}

/// The first of the known files in a folder.
pub(super) fn file_in(folder: &Path) -> Option<PathBuf> {
    ["transforms.json", "transforms_train.json"].iter().map(|n| folder.join(n)).find(|p| p.is_file())
}

/// Reads one file, or the file (or the train, val and test files) of a folder, and finds the images.
///
/// # Errors
/// When a file is malformed or an image is missing.
pub fn read(path: &Path, reading: &Reading) -> Result<Capture> {
    let first = if path.is_dir() {
        file_in(path).ok_or_else(|| {
            Error::input(name_of(path)).expected("transforms.json or transforms_train.json").got("neither")
        })?
    } else {
        path.to_path_buf()
    };
    let mut files = vec![(first.clone(), Split::Unknown)];
    if path.is_dir() && first.ends_with("transforms_train.json") {
        files = [("train", Split::Train), ("val", Split::Val), ("test", Split::Test)]
            .into_iter()
            .map(|(n, s)| (path.join(format!("transforms_{n}.json")), s))
            .filter(|(f, _)| f.is_file())
            .collect();
    }
    let root = match first.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let mut capture = Capture {
        dialect: Dialect::NerfSynthetic,
        frames: Vec::new(),
        points: None,
        missing: Vec::new(),
        missing_files: Vec::new(),
        is_unit_ball: false,
    };
    for (file, split) in files {
        let name = name_of(&file);
        let parsed = parse_with(&read_bytes(&file, MAX_BYTES)?, &name, reading.outside)?;
        capture.dialect = parsed.dialect;
        capture.is_unit_ball |= parsed.is_unit_ball;
        for (i, mut frame) in parsed.frames.into_iter().enumerate() {
            let find = |p: &Path, key: &str| {
                let relative = p.to_string_lossy();
                locate(root, &relative).ok_or_else(|| {
                    let e = Error::input(name.clone()).at(format!("frames[{i}].{key}"));
                    e.expected(format!("a file in {}", root.display()))
                        .got(format!("'{relative}', which is not there"))
                })
            };
            let Some(image) = reading.image(root, &frame.image.to_string_lossy()) else {
                let image = root.join(&frame.image);
                capture.missing.push(Frame { image, mask: None, passes: Passes::default(), ..frame });
                continue;
            };
            frame.image = image;
            frame.mask = frame.mask.filter(|_| !reading.without_masks);
            frame.mask = frame.mask.map(|m| find(&m, "mask_path")).transpose()?;
            let p = &mut frame.passes;
            p.foreground = p.foreground.take().map(|x| find(&x, "foreground_path")).transpose()?;
            // Optional data that a fit does not need.
            let optional = [
                &mut p.radiance,
                &mut p.depth,
                &mut p.normal,
                &mut p.albedo,
                &mut p.material,
                &mut p.environment,
            ];
            for slot in optional {
                if let Some(named) = slot.take() {
                    *slot = locate(root, &named.to_string_lossy());
                    if slot.is_none() {
                        capture.missing_files.push(named.to_string_lossy().into_owned());
                    }
                }
            }
            if frame.split == Split::Unknown {
                frame.split = split;
            }
            capture.frames.push(frame);
        }
        if let Some(p) = parsed.points {
            let relative = p.to_string_lossy();
            match locate(root, &relative) {
                Some(found) => capture.points = Some(gaussian_ply::read_points(&found)?),
                None => capture.missing_files.push(relative.into_owned()),
            }
        }
    }
    Ok(capture)
}

/// Parses one file; `name` is the file name in errors. Does not access the disk.
///
/// # Errors
/// When it is malformed, a number is out of range, a path leads outside, or a camera model is not supported.
pub fn parse(bytes: &[u8], name: &str) -> Result<Transforms> {
    parse_with(bytes, name, false)
}

/// [`parse`]; with `outside`, paths may be absolute and lead out of the folder.
///
/// # Errors
/// Those of [`parse`].
pub(super) fn parse_with(bytes: &[u8], name: &str, outside: bool) -> Result<Transforms> {
    if bytes.len() as u64 > MAX_BYTES {
        let e = Error::input(name).at("file size");
        return Err(e.expected(format!("at most {MAX_BYTES} bytes")).got(bytes.len().to_string()));
    }
    let value = json::parse(bytes, name)?;
    let top =
        value.as_object().ok_or_else(|| Error::input(name).expected("a JSON object").got(kind(&value)))?;
    let frames = match top.get("frames") {
        Some(Value::Array(frames)) => frames,
        other => {
            return Err(Error::input(name)
                .at("frames")
                .expected("a list")
                .got(other.map_or("nothing".into(), kind)));
        }
    };
    let mut out = Transforms {
        dialect: dialect(top, frames),
        frames: Vec::new(),
        points: None,
        is_unit_ball: top.contains_key("lirm_gen"),
    };
    for (i, frame) in frames.iter().enumerate() {
        let Some(frame) = frame.as_object() else {
            return Err(Error::input(name).at(format!("frames[{i}]")).expected("an object").got(kind(frame)));
        };
        let keys = Keys { top, frame, index: i, name, outside };
        out.frames.push(keys.frame()?);
    }
    for (list, split) in
        [("train_filenames", Split::Train), ("val_filenames", Split::Val), ("test_filenames", Split::Test)]
    {
        let Some(names) = top.get(list).and_then(Value::as_array) else { continue };
        let names: BTreeSet<String> =
            names.iter().filter_map(|n| accept(n.as_str()?, outside).ok()).collect();
        for frame in out.frames.iter_mut().filter(|f| names.contains(&f.name)) {
            frame.split = split;
        }
    }
    if let Some(path) = top.get("ply_file_path") {
        let text = path
            .as_str()
            .ok_or_else(|| Error::input(name).at("ply_file_path").expected("text").got(kind(path)))?;
        let path = accept(text, outside).map_err(|why| {
            Error::input(name)
                .at("ply_file_path")
                .expected("a path inside the folder")
                .got(format!("'{text}', {why}"))
                .hint(OUTSIDE)
        })?;
        out.points = Some(PathBuf::from(path));
    }
    Ok(out)
}

fn dialect(top: &Map<String, Value>, frames: &[Value]) -> Dialect {
    if ["camera_model", "applied_transform", "ply_file_path"].iter().any(|k| top.contains_key(*k)) {
        return Dialect::Nerfstudio;
    }
    let bare = |f: &Value| {
        let path = f.get("file_path").and_then(Value::as_str).unwrap_or_default();
        Path::new(path).extension().is_none()
    };
    if !frames.is_empty() && frames.iter().all(bare) { Dialect::NerfSynthetic } else { Dialect::InstantNgp }
}

fn kind(v: &Value) -> String {
    match v {
        Value::Null => "null".into(),
        Value::Bool(b) => b.to_string(),
        Value::Number(n) => n.to_string(),
        Value::String(s) => format!("the text '{}'", s.chars().take(60).collect::<String>()),
        Value::Array(a) => format!("a list of {}", a.len()),
        Value::Object(_) => "an object".into(),
    }
}

/// The keys of one frame, falling back to the top of the file.
struct Keys<'a> {
    top: &'a Map<String, Value>,
    frame: &'a Map<String, Value>,
    index: usize,
    name: &'a str,
    outside: bool,
}

/// What lets paths lead elsewhere.
const OUTSIDE: &str = "--allow-outside accepts such paths, where you trust the file";

impl Keys<'_> {
    fn error(&self, key: &str, expected: &str, got: impl Into<String>) -> Error {
        let place = if self.frame.contains_key(key) || !self.top.contains_key(key) {
            format!("frames[{}].{key}", self.index)
        } else {
            key.to_owned()
        };
        Error::input(self.name).at(place).expected(expected).got(got)
    }

    fn get(&self, key: &str) -> Option<&Value> {
        self.frame.get(key).or_else(|| self.top.get(key))
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        let Some(v) = self.get(key) else { return Ok(None) };
        match v.as_f64().filter(|x| x.is_finite()) {
            Some(x) => Ok(Some(x)),
            None => Err(self.error(key, "a number", kind(v))),
        }
    }

    fn positive(&self, key: &str) -> Result<Option<f64>> {
        match self.number(key)? {
            Some(x) if !(x > 0.0 && x < 1e9) => Err(self.error(key, "a positive number", x.to_string())),
            other => Ok(other),
        }
    }

    fn angle(&self, key: &str) -> Result<Option<f64>> {
        match self.number(key)? {
            Some(x) if !(x > 0.0 && x < std::f64::consts::PI) => {
                Err(self.error(key, "an angle between 0 and pi radians", x.to_string()))
            }
            other => Ok(other),
        }
    }

    fn side(&self, key: &str) -> Result<Option<usize>> {
        match self.number(key)? {
            Some(x) if !((1.0..=MAX_SIDE).contains(&x) && x.trunc() == x) => Err(self.error(
                key,
                &format!("an integer number of pixels from 1 to {MAX_SIDE}"),
                x.to_string(),
            )),
            other => Ok(other.map(|x| x as usize)),
        }
    }

    fn path(&self, key: &str) -> Result<Option<String>> {
        // A path is never inherited from the top.
        let Some(v) = self.frame.get(key) else { return Ok(None) };
        let Some(text) = v.as_str() else { return Err(self.error(key, "text", kind(v))) };
        accept(text, self.outside).map(Some).map_err(|why| {
            self.error(key, "a path inside the folder of the file", format!("'{text}', {why}")).hint(OUTSIDE)
        })
    }

    fn flag(&self, key: &str) -> bool {
        match self.get(key) {
            Some(Value::Bool(b)) => *b,
            Some(Value::Number(n)) => n.as_f64() != Some(0.0),
            _ => false,
        }
    }

    fn refuse_unsupported(&self) -> Result<()> {
        for key in ["equirectangular", "latlong", "orthographic"] {
            if self.flag(key) {
                return Err(self.error(
                    key,
                    "a pinhole or OpenCV fisheye camera",
                    "true, which is not supported",
                ));
            }
        }
        for i in 0..5 {
            let key = format!("ftheta_p{i}");
            if self.flag(&key) {
                return Err(self.error(
                    &key,
                    "a pinhole or OpenCV fisheye camera",
                    "an f-theta lens, which is not supported",
                ));
            }
        }
        if let Some(Value::Array(v)) = self.get("rolling_shutter")
            && v.iter().any(|x| x.as_f64() != Some(0.0))
        {
            return Err(self.error("rolling_shutter", "zeros", "a rolling shutter, which is not supported"));
        }
        let (start, end) = (self.frame.get("transform_matrix_start"), self.frame.get("transform_matrix_end"));
        if start.is_some() && start != end {
            return Err(self.error(
                "transform_matrix_start",
                "one pose per frame",
                "a moving camera, which is not supported",
            ));
        }
        Ok(())
    }

    fn lens(&self) -> Result<Lens> {
        let mut fisheye = self.flag("is_fisheye");
        let mut ideal = false;
        if let Some(v) = self.get("camera_model") {
            match v.as_str().map(str::to_ascii_uppercase).as_deref() {
                Some("SIMPLE_PINHOLE" | "PINHOLE") => ideal = true,
                Some("SIMPLE_RADIAL" | "RADIAL" | "OPENCV" | "PERSPECTIVE") => {}
                Some("OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" | "FISHEYE") => {
                    fisheye = true
                }
                _ => {
                    let expected = "PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE or another fisheye of that family";
                    return Err(self.error("camera_model", expected, kind(v)));
                }
            }
        }
        let k = |key: &str| Ok::<f64, Error>(self.number(key)?.unwrap_or(0.0));
        let radial = [k("k1")?, k("k2")?, k("k3")?, k("k4")?];
        let tangential = [k("p1")?, k("p2")?];
        if let Some(x) = radial.iter().chain(&tangential).find(|x| x.abs() > 1e6) {
            return Err(self.error("k1", "distortion coefficients below 1e6", x.to_string()));
        }
        let lens = if fisheye {
            Lens::Fisheye { k: radial }
        } else {
            Lens::Perspective { numerator: radial, denominator: [0.0; 3], tangential }
        };
        if ideal && !lens.is_ideal() {
            return Err(self.error(
                "camera_model",
                "OPENCV, since there are distortion coefficients",
                "a pinhole",
            ));
        }
        Ok(lens)
    }

    fn pose(&self) -> Result<[[f64; 4]; 4]> {
        let key =
            ["transform_matrix", "transform_matrix_start"].into_iter().find(|k| self.frame.contains_key(*k));
        let key = key.unwrap_or("transform_matrix");
        let expected = "a 4x4 matrix of finite numbers";
        let rows = match self.frame.get(key) {
            Some(Value::Array(rows)) if rows.len() == 4 || rows.len() == 3 => rows,
            other => return Err(self.error(key, expected, other.map_or("nothing".into(), kind))),
        };
        let mut m = [[0.0; 4], [0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        for (i, row) in rows.iter().enumerate() {
            let cells = row.as_array().filter(|r| r.len() == 4);
            let cells = cells.ok_or_else(|| self.error(&format!("{key}[{i}]"), "4 numbers", kind(row)))?;
            for (j, cell) in cells.iter().enumerate() {
                let x = cell.as_f64().filter(|x| x.abs() < 1e15);
                m[i][j] =
                    x.ok_or_else(|| self.error(&format!("{key}[{i}][{j}]"), "a finite number", kind(cell)))?;
            }
        }
        if (0..4).any(|j| (m[3][j] - [0.0, 0.0, 0.0, 1.0][j]).abs() > 1e-6) {
            return Err(self.error(&format!("{key}[3]"), "0 0 0 1", format!("{:?}", m[3])));
        }
        // OpenGL to OpenCV axes: negate the camera's y and z, columns 1 and 2 of camera-to-world.
        let c2w = std::array::from_fn(|i: usize| [m[i][0], -m[i][1], -m[i][2]]);
        let c2w = nearest_rotation(c2w)
            .map_err(|got| self.error(key, "a rotation in the upper left 3x3 block", got))?;
        let c = [m[0][3], m[1][3], m[2][3]];
        let r: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| c2w[j][i]));
        let t = std::array::from_fn(|i| -(r[i][0] * c[0] + r[i][1] * c[1] + r[i][2] * c[2]));
        Ok(rigid(r, t))
    }

    fn frame(&self) -> Result<Frame> {
        self.refuse_unsupported()?;
        let image = self.path("file_path")?.ok_or_else(|| self.error("file_path", "a path", "nothing"))?;
        let size = match (self.side("w")?, self.side("h")?) {
            (Some(w), Some(h)) => Some([w, h]),
            _ => None,
        };
        let focal = match (self.positive("fl_x")?, self.angle("camera_angle_x")?) {
            (Some(fx), _) => Focal::Pixels([fx, self.positive("fl_y")?.unwrap_or(fx)]),
            (None, Some(ax)) => Focal::Angles(ax, self.angle("camera_angle_y")?),
            (None, None) => {
                return Err(self.error("fl_x", "fl_x or camera_angle_x, here or at the top", "neither"));
            }
        };
        let center = match (self.number("cx")?, self.number("cy")?) {
            (Some(cx), Some(cy)) => Some([cx, cy]),
            (None, None) => None,
            _ => return Err(self.error("cx", "both cx and cy, or neither", "one")),
        };
        Ok(Frame {
            name: image.clone(),
            image: PathBuf::from(image),
            mask: self.path("mask_path")?.map(PathBuf::from),
            view_from_world: self.pose()?,
            focal,
            center,
            size,
            lens: self.lens()?,
            split: Split::Unknown,
            passes: self.passes()?,
        })
    }

    /// Paths of passes. `depth_file_path` is nerfstudio's name of instant-ngp's `depth_path`.
    fn passes(&self) -> Result<Passes> {
        let path = |key: &str| Ok::<_, Error>(self.path(key)?.map(PathBuf::from));
        let depth = match path("depth_path")? {
            None => path("depth_file_path")?,
            some => some,
        };
        Ok(Passes {
            foreground: path("foreground_path")?,
            radiance: path("radiance_path")?,
            depth,
            normal: path("normal_path")?,
            albedo: path("albedo_path")?,
            material: path("material_path")?,
            environment: path("environment_path")?,
            exposure: self.positive("exposure")?,
        })
    }
}
