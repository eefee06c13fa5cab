//! A capture of a moving person, as plain records: the layout that all code about persons reads and every
//! importer writes.
//!
//! # Layout
//! ```text
//! transforms_train.json   cameras of the training images
//! transforms_test.json    cameras of the held-out images (also transforms_val.json, which is read and not used)
//! images/…                PNG or JPEG, sRGB-encoded, ideal pinhole or orthographic (no distortion), the person on black
//! foreground/…            PNG, one channel: the share of each pixel that the person covers
//! body.npz                template, skinning weights, joints, one pose per moment
//! ```
//!
//! `transforms_*.json` are nerfstudio's ([`super::transforms`]). At the top, `subject` describes the person:
//!
//! | key of `subject` | means | if absent |
//! |---|---|---|
//! | `kind` | `figure`, `character`, `smpl`, `smplx`, or another name | `unknown` |
//! | `metres_per_unit` | length of a scene unit | 0.85 for a figure or a character (which are 2 high), else 1 |
//! | `box_margin_m` | margin of the box around the posed points, metres | 0.05 |
//!
//! Every entry of `frames` has the keys `frame` (the moment: a row of the poses, 0 … T−1), `camera` (a number
//! of the user's choice), and `foreground_path`. No two entries share both numbers; every moment 0 … T−1 is
//! seen by some camera.
//!
//! Arrays of `body.npz` (P points, K joints, T moments; * marks required arrays):
//!
//! | array | shape | holds |
//! |---|---|---|
//! | `points` * | (P, 3) | template at rest, scene units, z up |
//! | `weights` * | (P, K) | skinning weights, ≥ 0, rows sum to 1; the four largest are used |
//! | `parents` * | (K) i32 | the parent of each joint, −1 for none; no cycle |
//! | `joints` * | (K, 3) | positions at rest |
//! | `transforms` * | (T, K, 4, 4) | posed (world) from rest, row-major, last row 0 0 0 1: x' = Σ_k w_k transforms_k · x |
//! | `normals` | (P, 3) | at rest |
//! | `faces` | (F, 3) i32 | triangles over the points |
//! | `canonical` | (K, 4, 4) | canonical pose from rest; absent: rest is canonical. SMPL: the "big pose", hips ±45°, ankles ∓30° |
//! | `pose_shapes` | (P, 3, 9(K−1)) | x moves by pose_shapes · vec(R_1 − I, …, R_{K−1} − I) before skinning, R_k = rotation of `poses` |
//! | `poses` | (T, K, 3) | axis-angle of each joint relative to its parent, rad |
//! | `global_rotation`, `global_translation` | (T, 3) | Rh, Th: the transforms hold x' = Rodrigues(Rh) x + Th after the chain |
//! | `betas` | (B) | shape coefficients the template was made with |
//! | `numbers` | (T) | numbers of the moments in the source |
//! | `factors` | (T, n) | causal factors, if known |
//! | `spacing`, `sigma`, `bone`, `rest` | | as `last gen` writes them |
//!
//! `last gen` writes this layout (with textures, light and factors of its own in further keys); `last import`
//! writes it from the layouts of `io::captures`.

use super::capture::{Frame, Split, clean, locate};
use super::{atomic, image_file, json, name_of, npz, read_bytes, transforms};
use crate::num::array::Arrays;
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The arrays of the body.
pub const BODY: &str = "body.npz";

/// Files of cameras and what they are for.
pub const SPLITS: [(&str, Split); 3] = [
    ("transforms_train.json", Split::Train),
    ("transforms_val.json", Split::Val),
    ("transforms_test.json", Split::Test),
];

/// Longest camera file that is read, in bytes.
const MAX_CAMERAS: u64 = 64 << 20;

/// One image.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Image, camera, foreground, split. Paths are those of files that were there.
    pub frame: Frame,
    /// Moment: a row of the poses.
    pub time: usize,
    /// Number of the camera.
    pub camera: usize,
}

/// Contents of the folder.
#[derive(Clone, Debug)]
pub struct Person {
    /// The folder.
    pub folder: PathBuf,
    /// Training images first, each part in the order of its file; those with a file missing are left out.
    pub shots: Vec<Shot>,
    /// Number of entries in the camera files, including those left out.
    pub entries: usize,
    /// The key `subject` of the first camera file.
    pub subject: Map<String, Value>,
    /// `body.npz`; empty if it could not be read.
    pub body: Arrays,
    /// All problems found, in the order of reading.
    pub problems: Vec<Error>,
}

/// The folder with the cameras: `path`, or `path/video` if that is where the body is (the output of
/// `last gen`).
pub fn folder_of(path: &Path) -> PathBuf {
    let inner = path.join("video");
    let has = |p: &Path| p.join(BODY).is_file() || p.join(SPLITS[0].0).is_file();
    if !has(path) && has(&inner) { inner } else { path.to_path_buf() }
}

/// Whether a folder looks like this layout.
pub fn is_person(path: &Path) -> bool {
    folder_of(path).join(BODY).is_file()
}

/// Reads the records. Missing or malformed parts are listed in [`Person::problems`], so that all of them are
/// reported together.
///
/// # Errors
/// When there is no camera file to read at all.
pub fn read(path: &Path) -> Result<Person> {
    let folder = folder_of(path);
    if !folder.join(SPLITS[0].0).is_file() {
        let got = match (path.exists(), path.is_dir()) {
            (false, _) => "no such file or folder",
            (true, true) => "a folder without it",
            _ => "a file",
        };
        return Err(Error::input(name_of(path))
            .expected("the folder of a person's capture, with transforms_train.json and body.npz")
            .got(got)
            .hint("last gen makes one, last import makes one from other layouts"));
    }
    let mut out = Person {
        shots: Vec::new(),
        entries: 0,
        subject: Map::new(),
        body: Arrays::new(),
        problems: Vec::new(),
        folder,
    };
    for (file, split) in SPLITS {
        let file = out.folder.join(file);
        if file.is_file()
            && let Err(e) = cameras(&file, split, &mut out)
        {
            out.problems.push(e);
        }
    }
    let body = out.folder.join(BODY);
    match npz::read(&body) {
        Ok(arrays) => out.body = arrays,
        Err(e) => out.problems.push(if body.exists() {
            e
        } else {
            Error::input(name_of(&body))
                .expected("the template, its weights and the poses")
                .got("no such file")
        }),
    }
    Ok(out)
}

/// Adds the entries of one camera file.
fn cameras(file: &Path, split: Split, out: &mut Person) -> Result<()> {
    let name = name_of(file);
    let bytes = read_bytes(file, MAX_CAMERAS)?;
    let parsed = transforms::parse(&bytes, &name)?;
    // Valid: it has just been parsed.
    let value = json::parse(&bytes, &name)?;
    if out.subject.is_empty()
        && let Some(subject) = value["subject"].as_object()
    {
        out.subject = subject.clone();
    }
    let entries = value["frames"].as_array().map_or(&[][..], Vec::as_slice);
    for (i, (mut frame, entry)) in parsed.frames.into_iter().zip(entries).enumerate() {
        out.entries += 1;
        let place = |key: &str| Error::input(name.clone()).at(format!("frames[{i}].{key}"));
        let number = |key: &str| {
            entry[key].as_u64().filter(|&n| n < 1 << 32).map(|n| n as usize).ok_or_else(|| {
                place(key).expected("an integer").got(match &entry[key] {
                    Value::Null => "nothing".to_owned(),
                    other => other.to_string().chars().take(60).collect(),
                })
            })
        };
        let folder = &out.folder;
        let find = |p: &Path, key: &str| {
            let relative = p.to_string_lossy();
            locate(folder, &relative).ok_or_else(|| {
                place(key)
                    .expected(format!("a file in {}", folder.display()))
                    .got(format!("'{relative}', which is not there"))
            })
        };
        let whole = || -> Result<Shot> {
            frame.split = split;
            frame.image = find(&frame.image, "file_path")?;
            frame.mask = frame.mask.take().map(|p| find(&p, "mask_path")).transpose()?;
            let foreground =
                frame.passes.foreground.take().ok_or_else(|| {
                    place("foreground_path").expected("the mask of the person").got("nothing")
                })?;
            let mut passes = super::capture::Passes {
                foreground: Some(find(&foreground, "foreground_path")?),
                exposure: frame.passes.exposure,
                ..Default::default()
            };
            std::mem::swap(&mut passes, &mut frame.passes);
            Ok(Shot { time: number("frame")?, camera: number("camera")?, frame })
        };
        match whole() {
            Ok(shot) => out.shots.push(shot),
            Err(e) => out.problems.push(e),
        }
    }
    Ok(())
}

/// An image to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct NewShot {
    /// Without folder and extension; letters, digits, `_`, `-`.
    pub name: String,
    /// Moment: a row of the poses.
    pub time: usize,
    /// Number of the camera.
    pub camera: usize,
    /// Train, val or test.
    pub split: Split,
    /// World to camera.
    pub view_from_world: [[f64; 4]; 4],
    /// f_x, f_y, c_x, c_y in pixels.
    pub intrinsics: [f64; 4],
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
}

/// Writes the layout: images in any order, cameras and body last, so that a folder with cameras is complete.
#[derive(Debug)]
pub struct Writer {
    dir: PathBuf,
    frames: Vec<(Split, Value)>,
    /// images that are written, for [`Self::discard`]
    written: Mutex<Vec<PathBuf>>,
}

impl Writer {
    /// Makes the folder; camera files and body of an earlier capture in it are removed first.
    ///
    /// # Errors
    /// When a folder cannot be made or a file not removed.
    pub fn create(dir: &Path) -> Result<Self> {
        for folder in ["images", "foreground"] {
            let folder = dir.join(folder);
            std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
        }
        for file in SPLITS.iter().map(|(f, _)| *f).chain([BODY]) {
            atomic::remove(&dir.join(file))?;
        }
        atomic::sweep(dir)?;
        Ok(Self { dir: dir.to_path_buf(), frames: Vec::new(), written: Mutex::new(Vec::new()) })
    }

    /// Writes the two images of a shot: bytes (H, W, 3) and (H, W). May be called from several threads; see
    /// [`Self::add`].
    ///
    /// # Errors
    /// When the sizes disagree or a file cannot be written.
    pub fn pictures(&self, shot: &NewShot, rgb: &[u8], mask: &[u8]) -> Result<()> {
        let (w, h) = (shot.width, shot.height);
        let image = image_file::png_bytes(w, h, 3, rgb)?;
        let mask = image_file::png_bytes(w, h, 1, mask)?;
        for (folder, bytes) in [("images", image), ("foreground", mask)] {
            let path = self.dir.join(format!("{folder}/{}.png", shot.name));
            atomic::write_unflushed(&path, &bytes)?;
            self.written.lock().unwrap_or_else(PoisonError::into_inner).push(path);
        }
        Ok(())
    }

    /// Removes the images written so far, and the folders that are empty then: a refused source leaves no half capture.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn discard(self) -> Result<()> {
        let written = self.written.into_inner().unwrap_or_else(PoisonError::into_inner);
        written.iter().try_for_each(|path| atomic::remove(path))?;
        for folder in ["images", "foreground"] {
            // It holds something else, or is gone.
            let _kept = std::fs::remove_dir(self.dir.join(folder));
        }
        Ok(())
    }

    /// Adds the camera of a shot whose images are there.
    pub fn add(&mut self, s: &NewShot) {
        let v = &s.view_from_world;
        // OpenGL axes: the inverse, with the columns of y and z negated.
        let row = |i: usize| {
            let c = -((v[0][i] * v[0][3] + v[1][i] * v[1][3]) + v[2][i] * v[2][3]);
            json!([v[0][i], -v[1][i], -v[2][i], c])
        };
        let [fx, fy, cx, cy] = s.intrinsics;
        self.frames.push((
            s.split,
            json!({
                "file_path": format!("images/{}.png", s.name), "foreground_path": format!("foreground/{}.png", s.name),
                "frame": s.time, "camera": s.camera, "w": s.width, "h": s.height,
                "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
                "transform_matrix": [row(0), row(1), row(2), json!([0.0, 0.0, 0.0, 1.0])],
            }),
        ));
    }

    /// Writes the body and the cameras.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn finish(self, subject: &Value, body: &Arrays) -> Result<()> {
        npz::write(&self.dir.join(BODY), body)?;
        // The training cameras last: their presence marks the capture as complete.
        for (file, split) in SPLITS.iter().rev() {
            let frames: Vec<&Value> =
                self.frames.iter().filter(|(s, _)| s == split).map(|(_, f)| f).collect();
            if frames.is_empty() && *split != Split::Train {
                continue;
            }
            let top = json!({"subject": subject, "camera_model": "PINHOLE", "frames": frames});
            atomic::write_bytes(&self.dir.join(file), format!("{top:#}\n").as_bytes())?;
        }
        Ok(())
    }
}

/// A relative path of a data set, looked up below a folder: cleaned, with another extension or case if need
/// be.
pub fn find_below(root: &Path, relative: &str, what: &str) -> Result<PathBuf> {
    let fail = |got: String| Error::input(what).expected(format!("a file in {}", root.display())).got(got);
    let cleaned = clean(relative).map_err(|why| fail(format!("'{relative}', {why}")))?;
    locate(root, &cleaned).ok_or_else(|| fail(format!("'{relative}', which is not there")))
}
