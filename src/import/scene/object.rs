//! Conversion of a published capture of one object to the layout that all fits read: images, foreground and passes of one size.
//!
//! ```text
//! ObjectSet (io::objects) ─► blocks of pixels averaged ─► images/ foreground/ radiance/ depth/ normal/ albedo/ material/
//!                        └─► environment map ─► our orientation, axes of the world ─► environment/
//!                        └─► scan ─► scan.glb                          cameras ─► transforms_{train,test,novel}.json
//! ```
//!
//! * Reduced by s, a value is the mean of s×s pixels: photos and albedo of encoded values, radiance of linear ones, the foreground of
//!   the mask. Depth and normals are means over the pixels of the block that the surface covers, and 0 where these are less than half.
//! * Depth that is not positive or not finite is background; so is a normal shorter than ½. Outside the foreground both are 0.
//! * Normals are turned to the axes of the world. If most of those in the foreground do not face the camera, the set is refused.
//! * Without a photo, it is made of the radiance: limited to 0..1 and sRGB-encoded.

use super::environment_file::{self, Orientation};
use super::model;
use crate::error::Kind;
use crate::io::capture::Split;
use crate::io::image_file::{self, Encoding};
use crate::io::objects::{Axes, ObjectSet, ObjectShot, Part};
use crate::io::{MAX_FILE_BYTES, atomic, memory, name_of, npy, read_bytes};
use crate::num::array::Array;
use crate::num::elem::f64 as elem;
use crate::num::{order, par};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Side to which larger images are reduced by default, the one of Stanford-ORB's scores.
const SIDE: usize = 512;
/// Images processed between two checks of the stop flag.
const BATCH: usize = 8;
/// Part of the normals in the foreground that must face the camera.
const FACING: f64 = 0.8;
/// Folders of a converted capture.
const FOLDERS: [&str; 8] =
    ["images", "foreground", "radiance", "depth", "normal", "albedo", "material", "environment"];
/// Lists of a converted capture.
const LISTS: [&str; 4] =
    ["transforms.json", "transforms_train.json", "transforms_test.json", "transforms_novel.json"];

/// How a set is converted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Factor by which images are reduced; by default the integer that makes their larger side 512 or less where it divides it.
    pub downscale: Option<usize>,
    /// Axes of the normals, in place of those of the layout.
    pub normals: Option<Axes>,
    /// Orientation of the environment maps, in place of that of the layout.
    pub probe: Option<Orientation>,
    /// Environment maps are mirror images.
    pub probe_mirror: bool,
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Images of training, held out, without a split, under another light.
    pub images: [usize; 4],
    /// Size of the first image.
    pub size: [usize; 2],
    /// Names of the passes that every image of some list has, besides the photo and the foreground.
    pub passes: Vec<&'static str>,
    /// Whether the scan was written.
    pub scan: bool,
}

/// Values of an image file or a NumPy array, (H, W, C).
struct Values {
    name: String,
    size: [usize; 2],
    channels: usize,
    data: Vec<f32>,
}

impl Values {
    /// Reads the channels of an image, or an array of shape (H, W) or (H, W, C).
    fn read(path: &Path, channels: usize, encoding: Option<Encoding>) -> Result<Self> {
        let name = name_of(path);
        let is_array = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy"));
        if is_array {
            let array = npy::parse(&read_bytes(path, MAX_FILE_BYTES)?, &name)?;
            let shape = match &array {
                Array::F32(a) => a.shape().to_vec(),
                Array::F64(a) => a.shape().to_vec(),
                _ => {
                    return Err(Error::input(name).at("element type").expected("floats").got("integers"));
                }
            };
            let data: Vec<f32> = match &array {
                Array::F32(a) => a.iter().copied().collect(),
                Array::F64(a) => a.iter().map(|x| *x as f32).collect(),
                _ => Vec::new(),
            };
            let fits = matches!(shape[..], [h, w] if channels == 1 && h * w > 0)
                || matches!(shape[..], [h, w, c] if c == channels && h * w > 0);
            if !fits {
                let e = Error::input(name).at("shape");
                return Err(e.expected(format!("(H, W, {channels})")).got(format!("{shape:?}")));
            }
            return Ok(Self { name, size: [shape[1], shape[0]], channels, data });
        }
        let image = image_file::read(path)?;
        if let Some(encoding) = encoding
            && image.encoding != encoding
        {
            let expected = match encoding {
                Encoding::Linear => "an OpenEXR or Radiance file of linear values",
                Encoding::Srgb => "an image of encoded values, such as PNG",
            };
            return Err(Error::input(name).expected(expected).got("the other kind"));
        }
        let place = |n: &str| image.channels.iter().position(|c| c == n);
        let named = |names: [&str; 3]| names.map(place).into_iter().collect::<Option<Vec<usize>>>();
        let stride = image.channels.len();
        let take: Vec<usize> = match channels {
            3 => named(["R", "G", "B"]).or_else(|| named(["X", "Y", "Z"])).unwrap_or_default(),
            n if stride >= n => match place("R").zip(place("G")).filter(|_| n == 2) {
                Some((r, g)) => vec![r, g],
                None => (0..n).map(|i| if n == 1 { place("R").unwrap_or(i) } else { i }).collect(),
            },
            _ => Vec::new(),
        };
        let grey = channels == 3 && stride <= 2;
        let take = if grey { vec![0; 3] } else { take };
        if take.len() != channels {
            let e = Error::input(name).at("channels");
            return Err(e.expected(format!("{channels}")).got(image.channels.join(", ")));
        }
        let pixels = image.width * image.height;
        let mut data: Vec<f32> = memory::room(&name, pixels * channels)?;
        data.extend(
            (0..pixels).flat_map(|p| take.iter().map(move |c| p * stride + c)).map(|i| image.value(i)),
        );
        Ok(Self { name, size: [image.width, image.height], channels, data })
    }

    /// Refuses another size.
    fn of_size(self, size: [usize; 2]) -> Result<Self> {
        if self.size == size {
            return Ok(self);
        }
        Err(Error::input(self.name)
            .at("image size")
            .expected(format!("{}x{}, as the mask", size[0], size[1]))
            .got(format!("{}x{}", self.size[0], self.size[1])))
    }

    /// Refuses values that are not in a range.
    fn within(self, range: std::ops::RangeInclusive<f32>) -> Result<Self> {
        let Some(i) = self.data.iter().position(|x| !range.contains(x)) else { return Ok(self) };
        let pixel = i / self.channels;
        Err(Error::input(self.name)
            .at(format!("row {}, column {}", pixel / self.size[0], pixel % self.size[0]))
            .expected(format!("a number from {} to {}", range.start(), range.end()))
            .got(self.data[i].to_string()))
    }

    /// Means of blocks of s×s pixels: a left fold over rows, then columns, in f64.
    fn reduced(&self, s: usize) -> Vec<f32> {
        let c = self.channels;
        self.blocks(s, |pixels| {
            let mut sum = vec![0.0f64; c];
            pixels.iter().for_each(|p| {
                sum.iter_mut().zip(&self.data[p * c..]).for_each(|(s, x)| *s += f64::from(*x));
            });
            sum.iter().map(|x| (x / pixels.len() as f64) as f32).collect()
        })
    }

    /// Means over the pixels of a block that count; 0 where they are less than half.
    fn reduced_where(&self, s: usize, counts: &dyn Fn(usize) -> bool) -> Vec<f32> {
        let c = self.channels;
        self.blocks(s, |pixels| {
            let kept: Vec<usize> = pixels.iter().copied().filter(|p| counts(*p)).collect();
            let mut sum = vec![0.0f64; c];
            kept.iter().for_each(|p| {
                sum.iter_mut().zip(&self.data[p * c..]).for_each(|(s, x)| *s += f64::from(*x));
            });
            let is_seen = 2 * kept.len() >= pixels.len();
            sum.iter().map(|x| if is_seen { (x / kept.len() as f64) as f32 } else { 0.0 }).collect()
        })
    }

    fn blocks(&self, s: usize, value: impl Fn(&[usize]) -> Vec<f32>) -> Vec<f32> {
        let [w, h] = self.size.map(|x| x / s);
        let mut out = Vec::with_capacity(w * h * self.channels);
        let mut pixels = Vec::with_capacity(s * s);
        for i in 0..w * h {
            let (r, c) = (i / w, i % w);
            pixels.clear();
            pixels.extend(
                (r * s..r * s + s).flat_map(|y| (c * s..c * s + s).map(move |x| y * self.size[0] + x)),
            );
            out.extend(value(&pixels));
        }
        out
    }
}

/// An image as it is written.
struct Made {
    size: [usize; 2],
    frame: Value,
}

/// Where the files go.
struct Writer<'a> {
    dir: &'a Path,
    written: Mutex<Vec<PathBuf>>,
}

impl Writer<'_> {
    /// Writes a file and gives its name in lists.
    fn put(&self, folder: &str, file: &str, bytes: &[u8]) -> Result<String> {
        let name = format!("{folder}/{file}");
        let path = self.dir.join(&name);
        std::fs::create_dir_all(self.dir.join(folder)).map_err(|e| Error::os(&path, &e))?;
        atomic::write_unflushed(&path, bytes)?;
        self.written.lock().unwrap_or_else(PoisonError::into_inner).push(path);
        Ok(name)
    }

    /// Removes what was written, and the folders that are empty then.
    fn discard(self) -> Result<()> {
        let written = self.written.into_inner().unwrap_or_else(PoisonError::into_inner);
        written.iter().try_for_each(|path| atomic::remove(path))?;
        for folder in FOLDERS {
            // It holds something else, or is not there.
            let _kept = std::fs::remove_dir(self.dir.join(folder));
        }
        Ok(())
    }
}

/// Converts a set into the folder `dir`.
///
/// # Errors
/// When a file is bad, sizes disagree, normals do not face the cameras, a file cannot be written, or `stop` is set. Files written
/// before are removed, except after an interruption.
pub fn write(
    set: &ObjectSet,
    options: &Options,
    dir: &Path,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Report> {
    for file in LISTS {
        atomic::remove(&dir.join(file))?;
    }
    let writer = Writer { dir, written: Mutex::new(Vec::new()) };
    let made = match images(set, options, &writer, stop, progress) {
        Ok(made) => made,
        Err(e) if e.kind() == Kind::Interrupted => return Err(e),
        Err(e) => {
            writer.discard()?;
            return Err(e);
        }
    };
    let scan = match &set.scan {
        Some(path) => scan(path, &dir.join("scan.glb")).map(|()| true)?,
        None => false,
    };
    let of = |part: Part| -> Vec<&Value> {
        let both = set.shots.iter().zip(&made).filter(|(s, _)| s.part == part);
        both.map(|(_, m)| &m.frame).collect()
    };
    let parts = [Part::Novel, Part::Own(Split::Test), Part::Own(Split::Unknown), Part::Own(Split::Train)];
    let files = [LISTS[3], LISTS[2], LISTS[0], LISTS[1]];
    // The training images last: their list marks the capture as complete.
    for (part, file) in parts.into_iter().zip(files) {
        let frames = of(part);
        if !frames.is_empty() {
            let top = json!({ "object": { "layout": set.layout.name() }, "camera_model": "PINHOLE", "frames": frames });
            atomic::write_bytes(&dir.join(file), format!("{top:#}\n").as_bytes())?;
        }
    }
    let count = |part| of(part).len();
    let has = |key: &str| made.iter().any(|m| m.frame.get(format!("{key}_path")).is_some());
    Ok(Report {
        images: [count(parts[3]), count(parts[1]), count(parts[2]), count(parts[0])],
        size: made.first().map_or([0; 2], |m| m.size),
        passes: FOLDERS[2..].iter().copied().filter(|f| has(f)).collect(),
        scan,
    })
}

fn images(
    set: &ObjectSet,
    options: &Options,
    writer: &Writer<'_>,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<Made>> {
    let total = set.shots.len();
    let mut made = Vec::with_capacity(total);
    for start in (0..total).step_by(BATCH) {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::interrupted("field import").hint("start over with --force"));
        }
        progress(start, total);
        let end = Ord::min(start + BATCH, total);
        let some = par::map(end - start, |i| image(&set.shots[start + i], options, writer));
        made.extend(some.into_iter().collect::<Result<Vec<Made>>>()?);
    }
    progress(total, total);
    Ok(made)
}

/// The factor by which an image is reduced.
fn factor(size: [usize; 2], options: &Options, name: &str) -> Result<usize> {
    let larger = Ord::max(size[0], size[1]);
    let s = options.downscale.unwrap_or_else(|| if larger.is_multiple_of(SIDE) { larger / SIDE } else { 1 });
    if s == 0 || size.iter().any(|x| !x.is_multiple_of(s)) {
        return Err(Error::input(name)
            .at("image size")
            .expected(format!("sides that are multiples of --downscale {s}"))
            .got(format!("{}x{}", size[0], size[1])));
    }
    Ok(s)
}

fn encoded(x: f32) -> f32 {
    let x = order::clamp(f64::from(x), 0.0, 1.0);
    (if x > 0.003_130_8 { elem::pow(x, 1.0 / 2.4) * 1.055 - 0.055 } else { 12.92 * x }) as f32
}

fn image(shot: &ObjectShot, options: &Options, writer: &Writer<'_>) -> Result<Made> {
    let mask = Values::read(&shot.mask, 1, Some(Encoding::Srgb))?;
    let full = mask.size;
    if let Some(size) = shot.size.filter(|s| *s != full) {
        return Err(Error::input(mask.name)
            .at("image size")
            .expected(format!("{}x{}, as the list declares", size[0], size[1]))
            .got(format!("{}x{}", full[0], full[1])));
    }
    let s = factor(full, options, &mask.name)?;
    let [w, h] = full.map(|x| x / s);
    let foreground = mask.reduced(s);
    let is_inside = |p: usize| mask.data[p] > 0.5;
    let name = &shot.name;
    let png = |folder: &str, channels: usize, values: &[f32]| {
        let bytes = image_file::png_bytes(w, h, channels, &image_file::to_u8(values)?)?;
        writer.put(folder, &format!("{name}.png"), &bytes)
    };
    let exr = |folder: &str, channels: &[&str], values: &[f32]| {
        writer.put(folder, &format!("{name}.exr"), &image_file::exr_bytes(w, h, channels, values)?)
    };
    let mut frame = camera(shot, [w, h]);
    let mut set = |key: &str, value: String| frame[format!("{key}_path")] = json!(value);
    let radiance = match &shot.radiance {
        Some(path) => {
            let values = Values::read(path, 3, Some(Encoding::Linear))?.of_size(full)?;
            // Sensors and resampling give small negative values.
            let values = values.within(-f32::MAX..=f32::MAX)?.reduced(s);
            let values: Vec<f32> = values.iter().map(|x| order::max(*x, 0.0)).collect();
            set("radiance", exr("radiance", &["R", "G", "B"], &values)?);
            Some(values)
        }
        None => None,
    };
    let photo = match (&shot.photo, &radiance) {
        (Some(path), _) => Values::read(path, 3, Some(Encoding::Srgb))?.of_size(full)?.reduced(s),
        (None, Some(values)) => values.iter().map(|x| encoded(*x)).collect(),
        (None, None) => {
            return Err(Error::input(name.clone()).expected("a photo or its radiance").got("neither"));
        }
    };
    set("file", png("images", 3, &photo)?);
    set("foreground", png("foreground", 1, &foreground)?);
    if let Some(path) = &shot.depth {
        let z = Values::read(path, 1, None)?.of_size(full)?;
        let values = z.reduced_where(s, &|p| is_inside(p) && z.data[p] > 0.0 && z.data[p].is_finite());
        set("depth", exr("depth", &["Z"], &values)?);
    }
    if let Some(path) = &shot.normal {
        let n = Values::read(path, 3, None)?.of_size(full)?.within(-2.0..=2.0)?;
        let axes = options.normals.unwrap_or(shot.normal_axes);
        let values = normals(&n, s, &is_inside, axes, shot)?;
        facing(&values, shot, [w, h], &n.name)?;
        set("normal", exr("normal", &["X", "Y", "Z"], &values)?);
    }
    if let Some(path) = &shot.albedo {
        let values = Values::read(path, 3, None)?.of_size(full)?.within(0.0..=1.0)?;
        set("albedo", png("albedo", 3, &values.reduced(s))?);
    }
    if let Some(path) = &shot.material {
        let values = Values::read(path, 2, Some(Encoding::Srgb))?.of_size(full)?.reduced(s);
        let three: Vec<f32> = values.as_chunks::<2>().0.iter().flat_map(|v| [v[0], v[1], 0.0]).collect();
        set("material", png("material", 3, &three)?);
    }
    if let Some(path) = &shot.environment {
        let map = environment_file::read(path, &probe(options, shot))?;
        let bytes =
            image_file::exr_bytes(map.width, map.height, &["R", "G", "B"], map.radiance.as_flattened())?;
        set("environment", writer.put("environment", &format!("{name}.exr"), &bytes)?);
    }
    Ok(Made { size: [w, h], frame })
}

/// Entry of a list: the camera, and the exposure where there is one.
fn camera(shot: &ObjectShot, [w, h]: [usize; 2]) -> Value {
    let v = &shot.view_from_world;
    // OpenGL axes: the inverse, with the columns of y and z negated.
    let row = |i: usize| {
        let c = -((v[0][i] * v[0][3] + v[1][i] * v[1][3]) + v[2][i] * v[2][3]);
        json!([v[0][i], -v[1][i], -v[2][i], c])
    };
    let f = 0.5 * w as f64 / libm::tan(0.5 * shot.fov_x_rad);
    let mut frame = json!({
        "w": w, "h": h, "fl_x": f, "fl_y": f, "cx": 0.5 * w as f64, "cy": 0.5 * h as f64,
        "transform_matrix": [row(0), row(1), row(2), json!([0.0, 0.0, 0.0, 1.0])],
    });
    if let Some(exposure) = shot.exposure {
        frame["exposure"] = json!(exposure);
    }
    frame
}

/// Unit normals in the axes of the world, 0 where there is none.
fn normals(
    n: &Values,
    s: usize,
    is_inside: &dyn Fn(usize) -> bool,
    axes: Axes,
    shot: &ObjectShot,
) -> Result<Vec<f32>> {
    let length =
        |v: [f32; 3]| (f64::from(v[0] * v[0]) + f64::from(v[1] * v[1]) + f64::from(v[2] * v[2])).sqrt();
    let all: &[[f32; 3]] = n.data.as_chunks().0;
    let means = n.reduced_where(s, &|p| is_inside(p) && length(all[p]) > 0.5);
    let v = &shot.view_from_world;
    let turned = |x: [f32; 3]| -> [f32; 3] {
        let l = length(x);
        if l < 1e-6 {
            return [0.0; 3];
        }
        let u = x.map(|x| f64::from(x) / l);
        match axes {
            Axes::World => u.map(|x| x as f32),
            // Columns of camera-to-world in OpenGL axes: rows of world-to-camera, y and z negated.
            Axes::Camera => {
                std::array::from_fn(|k| ((v[0][k] * u[0] - v[1][k] * u[1]) - v[2][k] * u[2]) as f32)
            }
        }
    };
    Ok(means.as_chunks::<3>().0.iter().flat_map(|x| turned(*x)).collect())
}

/// Refuses normals that do not face the camera: they are in other axes.
fn facing(normals: &[f32], shot: &ObjectShot, [w, h]: [usize; 2], name: &str) -> Result<()> {
    let f = 0.5 * w as f64 / libm::tan(0.5 * shot.fov_x_rad);
    let v = &shot.view_from_world;
    let (mut seen, mut front) = (0usize, 0usize);
    for (i, n) in normals.as_chunks::<3>().0.iter().enumerate().filter(|(_, n)| **n != [0.0; 3]) {
        let d =
            [((i % w) as f64 + 0.5 - 0.5 * w as f64) / f, ((i / w) as f64 + 0.5 - 0.5 * h as f64) / f, 1.0];
        let along = |k: usize| (v[0][k] * d[0] + v[1][k] * d[1]) + v[2][k] * d[2];
        let dot = (0..3).fold(0.0, |s, k| s + along(k) * f64::from(n[k]));
        seen += 1;
        front += usize::from(dot < 0.0);
    }
    if front as f64 >= FACING * seen as f64 {
        return Ok(());
    }
    Err(Error::input(name.to_owned())
        .at("normals")
        .expected(format!("at least {} % that face the camera", 100.0 * FACING))
        .got(format!("{front} of {seen}"))
        .hint("--normals names their axes: camera or world"))
}

/// How the environment map of an image is read.
fn probe(options: &Options, shot: &ObjectShot) -> environment_file::Options {
    let orientation = options.probe.unwrap_or(Orientation::Orb);
    // Of a map in the axes of a camera, our form of its axes is (x, y, z) = (X, −Z, Y) with X right, Y up, Z backward, as for every
    // map with y up: columns of camera-to-world are the camera's x, its forward axis, and its up axis.
    let v = &shot.view_from_world;
    let of_camera = || std::array::from_fn(|k| [v[0][k], v[2][k], -v[1][k]]);
    environment_file::Options {
        orientation,
        mirror: options.probe_mirror,
        world_from_map: (orientation == Orientation::Orb).then(of_camera),
        ..environment_file::Options::default()
    }
}

/// Writes the scan, whose coordinates are those of the world, which is z up.
fn scan(from: &Path, to: &Path) -> Result<()> {
    let mut object = model::read(from)?;
    let back = |p: &mut [f32; 3]| *p = [p[0], p[2], -p[1]];
    object.mesh.positions.iter_mut().for_each(back);
    object.mesh.normals.iter_mut().for_each(back);
    model::write(to, &object)
}
