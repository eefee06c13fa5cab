//! Ray-traced images with their passes, written to disk as a capture. Writing can be interrupted and
//! continued.
//!
//! ```text
//! DIR/images/NAME.png       image: radiance × exposure, sRGB-encoded; with Style::transparent RGBA, straight alpha
//!     foreground/NAME.png   coverage of the object, 8 bits, linear
//!     radiance/NAME.exr     R G B linear, before exposure
//!     depth/NAME.exr        Z     camera depth of the pixel's centre, scene units, 0 where nothing is hit; seen from `transform_matrix`
//!     normal/NAME.exr       X Y Z world, unit, 0 where nothing is hit
//!     albedo/NAME.png       sRGB-encoded base colour
//!     material/NAME.png     R metallic, G roughness, B 0, linear
//!     transforms.json       cameras, paths and digests; one file per split if there are splits
//! ```
//!
//! `transforms.json` is that of nerfstudio with further keys: `foreground_path`, `radiance_path`,
//! `depth_path`, `normal_path`, `albedo_path`, `material_path`, `exposure`, for a moving camera
//! `transform_matrix_open` and `_close` (`transform_matrix` is the pose half-way, used for depth, normal,
//! albedo and material; image, foreground and radiance are means over the exposure), and `digests` (FNV-1a 64
//! of each file). [`crate::io::capture`] reads all keys except the last three.
//!
//! While the set is being written, each finished image has a record in `DIR/.shots/`. The record is written
//! after the files, so an image with a record is complete, except after a power failure: the system may delay
//! writing images and records to disk ([`atomic::write_unflushed`]). A continued run therefore compares every
//! file with its digest, also in a finished set, and renders images again whose files differ.
//! [`Recorder::finish`] collects the records in `transforms*.json` and removes them. The bytes depend neither
//! on the number of threads nor on interruptions.

mod pass_set;

pub use pass_set::PassSet;

use super::frames;
use crate::io::capture::Split;
use crate::io::{self, atomic, image_file};
use crate::num::bits::Digest;
use crate::scene::camera::Camera;
use crate::scene::passes::PassImages;
use crate::shade::render::Passes;
use crate::shade::tonemap;
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Folder of the records of finished images.
pub(super) const JOURNAL: &str = ".shots";
/// File name of the header in this folder.
pub(super) const HEADER: &str = "header.json";

/// Folders of images and passes.
pub const FOLDERS: [&str; 7] = ["images", "foreground", "radiance", "depth", "normal", "albedo", "material"];

/// One image to render.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Without extension and folders: ASCII letters, digits, `_`, `-`, `.`.
    pub name: String,
    /// Camera when the shutter opens.
    pub camera: Camera,
    /// Camera when the shutter closes; absent: the camera does not move.
    pub shutter_close: Option<Camera>,
    /// Split that the image belongs to.
    pub split: Split,
    /// Further keys of its frame.
    pub extra: Map<String, Value>,
}

impl Shot {
    /// The camera in the middle of the exposure: that of the image.
    pub fn middle(&self) -> Camera {
        self.shutter_close
            .as_ref()
            .map_or_else(|| self.camera.clone(), |close| self.camera.between(close, 0.5))
    }
}

/// Conversion of radiance to an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Factor before the sRGB transfer function.
    pub exposure: f32,
    /// Whether the image has an alpha channel; its colour is then that of the object only.
    pub transparent: bool,
    /// What is written in addition to photo and foreground.
    pub passes: PassSet,
}

/// An image in memory as a reader of its files gets it: the 8-bit photo, made from `signal` if there is one ([`Recorder::put_with`]), and
/// all passes.
///
/// # Errors
/// When a value is not a number.
pub fn as_read(p: &Passes, exposure: f32, signal: Option<&[[f32; 3]]>) -> Result<(Vec<u8>, PassImages)> {
    let unit = |x: u8| f32::from(x) / 255.0;
    let bytes = |x: &[f32]| Ok::<_, Error>(image_file::to_u8(x)?.into_iter().map(unit).collect());
    let albedo: Vec<f32> = tonemap::srgb_u8(&p.albedo, 1.0).into_iter().map(unit).collect();
    let passes = PassImages {
        width: p.width,
        height: p.height,
        foreground: Some(bytes(&p.alpha)?),
        radiance: Some(p.color.clone()),
        depth: Some(p.depth_z.clone()),
        normal: Some(p.normal.clone()),
        albedo: Some(albedo.as_chunks::<3>().0.to_vec()),
        metallic: Some(bytes(&p.metallic)?),
        roughness: Some(bytes(&p.roughness)?),
        exposure: Some(f64::from(exposure)),
    };
    let (light, exposure) = exposed(p, exposure, signal);
    Ok((tonemap::srgb_u8(light, exposure), passes))
}

/// What a photo is made from, and the factor that is left.
fn exposed<'a>(p: &'a Passes, exposure: f32, signal: Option<&'a [[f32; 3]]>) -> (&'a [[f32; 3]], f32) {
    signal.map_or((&*p.color, exposure), |s| (s, 1.0))
}

/// A capture being written.
#[derive(Debug)]
pub struct Recorder {
    dir: PathBuf,
    header: Map<String, Value>,
    done: Vec<(String, Value)>,
}

impl Recorder {
    /// Opens the folder and creates it if necessary. With `resume`, continues a previous run with the same
    /// header. `header` becomes the top level of every `transforms*.json`. Without `resume`, an existing set
    /// is removed first ([`clear`]), so that cameras and images of different runs are never mixed. Temporary
    /// files of a killed run are removed.
    ///
    /// # Errors
    /// When the folder cannot be created, holds the records of a run with another header, or a folder where a
    /// file of cameras will be written.
    pub fn open(dir: &Path, header: Map<String, Value>, resume: bool) -> Result<Self> {
        for path in SPLITS.iter().map(|(file, _)| dir.join(file)) {
            if path.is_dir() {
                return Err(Error::input(path.display().to_string()).expected("a file").got("a folder"));
            }
        }
        let journal = dir.join(JOURNAL);
        let mark = journal.join(HEADER);
        let mut recorder = Self { dir: dir.to_path_buf(), header, done: Vec::new() };
        let text = format!("{:#}\n", Value::Object(recorder.header.clone()));
        atomic::sweep(dir)?;
        for folder in FOLDERS.into_iter().chain([JOURNAL]) {
            atomic::sweep(&dir.join(folder))?;
        }
        if resume && mark.is_file() {
            let old = std::fs::read_to_string(&mark).map_err(|e| Error::os(&mark, &e))?;
            if old != text {
                return Err(Error::input("--resume")
                    .at(dir.display().to_string())
                    .expected("an unfinished set with the same settings")
                    .got("a set with other settings")
                    .hint("choose another folder, or use the settings of the first run"));
            }
            return Ok(recorder);
        }
        if resume && let Some(frames) = recorder.finished()? {
            recorder.done = frames;
            return Ok(recorder);
        }
        if resume {
            remove_journal(dir)?;
        } else {
            clear(dir)?;
        }
        std::fs::create_dir_all(&journal).map_err(|e| Error::os(&journal, &e))?;
        atomic::write_bytes(&mark, text.as_bytes())?;
        Ok(recorder)
    }

    /// The frames of a finished set with this header, by name; `None` if there is none.
    fn finished(&self) -> Result<Option<Vec<(String, Value)>>> {
        let mut out = Vec::new();
        for (file, _) in SPLITS {
            let path = self.dir.join(file);
            if !path.is_file() {
                continue;
            }
            let mut value = read_json(&path)?;
            let frames = value.as_object_mut().and_then(|top| top.remove("frames"));
            if let Some(top) = value.as_object_mut() {
                top.remove("camera_model");
            }
            if value.as_object() != Some(&self.header) {
                return Err(Error::input("--resume")
                    .at(path.display().to_string())
                    .expected("a set made with the same settings")
                    .got("a set with other settings"));
            }
            let frames = frames.and_then(|f| f.as_array().cloned()).unwrap_or_default();
            for mut frame in frames.into_iter().filter(Value::is_object) {
                // The file that lists a frame determines its split.
                frame["split"] = json!(file);
                if let Some(name) = frame.get("file_path").and_then(Value::as_str) {
                    let name = Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
                    out.push((name, frame));
                }
            }
        }
        Ok((!out.is_empty()).then_some(out))
    }

    /// Verifies the finished set of these images in a folder; `None` if there is none. Every file is read,
    /// nothing is written.
    ///
    /// # Errors
    /// When the set has another header, or its description cannot be read.
    pub fn verify(dir: &Path, header: Map<String, Value>, order: &[Shot]) -> Result<Option<Verified>> {
        let mut set = Self { dir: dir.to_path_buf(), header, done: Vec::new() };
        let Some(frames) = set.finished()? else { return Ok(None) };
        set.done = frames;
        let known = |shot: &Shot| set.done.iter().any(|(name, _)| *name == shot.name);
        if !order.iter().all(known) {
            return Ok(None);
        }
        let mut is_whole = true;
        for shot in order {
            is_whole &= set.has(shot)?;
        }
        Ok(Some(Verified { digest: set.gather(order)?.0, is_whole }))
    }

    /// Whether this image is complete on disk: it has a record and every file has the recorded digest.
    ///
    /// # Errors
    /// When a record exists but cannot be read.
    pub fn has(&self, shot: &Shot) -> Result<bool> {
        let Some(frame) = self.frame(&shot.name)? else { return Ok(false) };
        let Some(digests) = frame.get("digests").and_then(Value::as_object) else { return Ok(false) };
        let whole = |(file, digest): (&String, &Value)| {
            std::fs::read(self.dir.join(file))
                .is_ok_and(|bytes| digest.as_str() == Some(&*io::digest(&bytes)))
        };
        Ok(!digests.is_empty() && digests.iter().all(whole))
    }

    /// The frame of an image: that of the finished set, or its record. A record that is not a JSON object
    /// (after a power failure) is treated as missing.
    fn frame(&self, name: &str) -> Result<Option<Value>> {
        if let Some((_, frame)) = self.done.iter().find(|(n, _)| *n == name) {
            return Ok(Some(frame.clone()));
        }
        let path = self.record(name);
        if !path.is_file() {
            return Ok(None);
        }
        let bytes = crate::io::read_bytes(&path, crate::io::MAX_SMALL_FILE_BYTES)?;
        Ok(serde_json::from_slice(&bytes).ok().filter(Value::is_object))
    }

    fn record(&self, name: &str) -> PathBuf {
        self.dir.join(JOURNAL).join(format!("{name}.json"))
    }

    /// Writes the files of an image, then its record.
    ///
    /// # Errors
    /// When the name is not a plain file name, the sizes do not agree, or a file cannot be written.
    pub fn put(&mut self, shot: &Shot, passes: &Passes, style: &Style) -> Result<()> {
        self.put_with(shot, passes, style, None)
    }

    /// Like [`Self::put`], but the image is made from `signal` (H, W), linear and exposed, instead of
    /// radiance × exposure, for example after a sensor model. `radiance/` is still that of the passes.
    ///
    /// # Errors
    /// See [`Self::put`].
    pub fn put_with(
        &mut self,
        shot: &Shot,
        passes: &Passes,
        style: &Style,
        signal: Option<&[[f32; 3]]>,
    ) -> Result<()> {
        if !is_plain(&shot.name) {
            return Err(Error::input("image name")
                .expected("ASCII letters, digits, '_', '-' or '.', not beginning with '.'")
                .got(format!("'{}'", shot.name)));
        }
        let middle = shot.middle();
        let image = format!("images/{}.png", shot.name);
        let mut frame = frames::frame(&image, &middle);
        let mut digests = Map::new();
        for (key, file, bytes) in self.files(shot, passes, style, signal)? {
            let path = self.dir.join(&file);
            let folder = path.parent().unwrap_or(&self.dir);
            std::fs::create_dir_all(folder).map_err(|e| Error::os(folder, &e))?;
            atomic::write_unflushed(&path, &bytes)?;
            digests.insert(file.clone(), json!(io::digest(&bytes)));
            frame[key] = json!(file);
        }
        frame["exposure"] = json!(f64::from(style.exposure));
        if let Some(close) = &shot.shutter_close {
            frame["transform_matrix_open"] = frames::world_from_camera(&shot.camera);
            frame["transform_matrix_close"] = frames::world_from_camera(close);
        }
        for (key, value) in &shot.extra {
            frame[key] = value.clone();
        }
        frame["digests"] = Value::Object(digests);
        frame["split"] = json!(file_of(shot.split));
        frame["camera_model"] = json!(frames::model_name(middle.model));
        // A finished set that lost a file no longer has records.
        let journal = self.dir.join(JOURNAL);
        std::fs::create_dir_all(&journal).map_err(|e| Error::os(&journal, &e))?;
        atomic::write_unflushed(&self.record(&shot.name), format!("{frame:#}\n").as_bytes())
    }

    /// Key, path and bytes of every file of an image.
    fn files(
        &self,
        shot: &Shot,
        p: &Passes,
        style: &Style,
        signal: Option<&[[f32; 3]]>,
    ) -> Result<Vec<(&'static str, String, Vec<u8>)>> {
        let (w, h) = (p.width, p.height);
        let (light, exposure) = exposed(p, style.exposure, signal);
        if p.color.len() != w * h || light.len() != w * h || (w, h) != (shot.camera.width, shot.camera.height)
        {
            return Err(Error::input(format!("image '{}'", shot.name))
                .expected(format!("{}x{} pixels", shot.camera.width, shot.camera.height))
                .got(format!("{w}x{h}")));
        }
        let path = |folder: &str, extension: &str| format!("{folder}/{}.{extension}", shot.name);
        let coverage = image_file::to_u8(&p.alpha)?;
        let image = if style.transparent {
            let rgb = tonemap::srgb_u8(&straight(light, &p.alpha), exposure);
            let rgba: Vec<u8> =
                rgb.chunks_exact(3).zip(&coverage).flat_map(|(c, &a)| [c[0], c[1], c[2], a]).collect();
            image_file::png_bytes(w, h, 4, &rgba)?
        } else {
            image_file::png_bytes(w, h, 3, &tonemap::srgb_u8(light, exposure))?
        };
        let mut out = vec![
            ("file_path", path("images", "png"), image),
            ("foreground_path", path("foreground", "png"), image_file::png_bytes(w, h, 1, &coverage)?),
        ];
        let exr = |channels: &[&str], data: &[f32]| image_file::exr_bytes(w, h, channels, data);
        if style.passes.has("radiance") {
            let bytes = exr(&["R", "G", "B"], p.color.as_flattened())?;
            out.push(("radiance_path", path("radiance", "exr"), bytes));
        }
        if style.passes.has("depth") {
            out.push(("depth_path", path("depth", "exr"), exr(&["Z"], &p.depth_z)?));
        }
        if style.passes.has("normal") {
            out.push(("normal_path", path("normal", "exr"), exr(&["X", "Y", "Z"], p.normal.as_flattened())?));
        }
        if style.passes.has("albedo") {
            let albedo = tonemap::srgb_u8(&p.albedo, 1.0);
            out.push(("albedo_path", path("albedo", "png"), image_file::png_bytes(w, h, 3, &albedo)?));
        }
        if style.passes.has("material") {
            let packed: Vec<f32> =
                p.metallic.iter().zip(&p.roughness).flat_map(|(&m, &r)| [m, r, 0.0]).collect();
            let packed = image_file::to_u8(&packed)?;
            out.push(("material_path", path("material", "png"), image_file::png_bytes(w, h, 3, &packed)?));
        }
        Ok(out)
    }

    /// Writes `transforms*.json` from the records and removes them. `order` lists every image of the set.
    /// Returns the digest of the set, computed from the digests of its files and the text of its cameras, in
    /// order.
    ///
    /// # Errors
    /// When an image is missing or a file cannot be written.
    pub fn finish(self, order: &[Shot]) -> Result<u64> {
        let (digest, files) = self.gather(order)?;
        for (file, list, model) in files {
            let mut top = self.header.clone();
            top.insert("camera_model".into(), model);
            top.insert("frames".into(), Value::Array(list));
            atomic::write_bytes(&self.dir.join(file), format!("{:#}\n", Value::Object(top)).as_bytes())?;
        }
        remove_journal(&self.dir)?;
        Ok(digest)
    }

    /// Digest of the set, and for each `transforms*.json` its frames and their camera model.
    fn gather(&self, order: &[Shot]) -> Result<(u64, Vec<Described>)> {
        let mut digest = Digest::new();
        let mut files: Vec<Described> = Vec::new();
        for shot in order {
            let missing = || {
                Error::input(self.record(&shot.name).display().to_string())
                    .expected("the record of a finished image")
                    .got("none")
            };
            let mut frame = self.frame(&shot.name)?.ok_or_else(missing)?;
            let top = frame.as_object_mut().ok_or_else(missing)?;
            top.remove("split");
            let model =
                top.remove("camera_model").unwrap_or_else(|| json!(frames::model_name(shot.camera.model)));
            let file = file_of(shot.split);
            digest.bytes(format!("{file} {frame:#}").as_bytes());
            match files.iter_mut().find(|g| g.0 == file) {
                Some(group) => {
                    if group.2 != model {
                        return Err(Error::input("capture")
                            .at(format!("image '{}'", shot.name))
                            .expected("one camera model per file")
                            .got(format!("{} and {model}", group.2)));
                    }
                    group.1.push(frame);
                }
                None => files.push((file, vec![frame], model)),
            }
        }
        Ok((digest.value(), files))
    }
}

/// Result of verifying a finished set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verified {
    /// Digest as returned by [`Recorder::finish`], provided that the description is unchanged.
    pub digest: u64,
    /// Whether every file has the digest that the description records.
    pub is_whole: bool,
}

/// Removes the finished or unfinished set in a folder: descriptions and records first, then the images that
/// they list. Other files are kept.
///
/// # Errors
/// When the folder cannot be read or a file not removed.
pub fn clear(dir: &Path) -> Result<()> {
    let mut described: Vec<PathBuf> = SPLITS.iter().map(|(file, _)| dir.join(file)).collect();
    let journal = dir.join(JOURNAL);
    if journal.is_dir() {
        for entry in std::fs::read_dir(&journal).map_err(|e| Error::os(&journal, &e))? {
            described.push(entry.map_err(|e| Error::os(&journal, &e))?.path());
        }
    }
    let mut images: Vec<String> = Vec::new();
    for path in described.iter().filter(|p| p.is_file()) {
        // An unreadable file lists no images.
        let Ok(value) = read_json(path) else { continue };
        let frames = value["frames"].as_array().map_or(std::slice::from_ref(&value), Vec::as_slice);
        let named = frames.iter().filter_map(|f| f["digests"].as_object()).flat_map(Map::keys);
        let is_ours = |n: &&String| {
            n.split_once('/').is_some_and(|(folder, file)| FOLDERS.contains(&folder) && is_plain(file))
        };
        images.extend(named.filter(is_ours).cloned());
    }
    for path in described.iter().take(SPLITS.len()) {
        atomic::remove(path)?;
    }
    remove_journal(dir)?;
    images.iter().try_for_each(|name| atomic::remove(&dir.join(name)))
}

fn remove_journal(dir: &Path) -> Result<()> {
    let journal = dir.join(JOURNAL);
    if journal.is_dir() {
        std::fs::remove_dir_all(&journal).map_err(|e| Error::os(&journal, &e))?;
    }
    Ok(())
}

/// Whether a name is that of a file in a folder, on any system.
fn is_plain(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    !name.is_empty() && !name.starts_with('.') && name.chars().all(plain)
}

/// Content of a `transforms*.json`: its name, its frames, their camera model.
type Described = (&'static str, Vec<Value>, Value);

/// Files and their splits.
pub(super) const SPLITS: [(&str, Split); 4] = [
    ("transforms.json", Split::Unknown),
    ("transforms_train.json", Split::Train),
    ("transforms_val.json", Split::Val),
    ("transforms_test.json", Split::Test),
];

fn file_of(split: Split) -> &'static str {
    SPLITS.iter().find(|(_, s)| *s == split).map_or(SPLITS[0].0, |(file, _)| file)
}

/// Colour of the object only: the sum over covered samples divided by the coverage; black where there is
/// none.
fn straight(color: &[[f32; 3]], alpha: &[f32]) -> Vec<[f32; 3]> {
    let unmix = |(c, &a): (&[f32; 3], &f32)| if a > 0.0 { c.map(|x| x / a) } else { [0.0; 3] };
    color.iter().zip(alpha).map(unmix).collect()
}

pub(super) fn read_json(path: &Path) -> Result<Value> {
    let bytes = crate::io::read_bytes(path, crate::io::MAX_SMALL_FILE_BYTES)?;
    crate::io::json::parse(&bytes, &path.display().to_string())
}
