//! Captures of persons in the layouts of published data sets, as plain records; `scene::person::import` turns them into the
//! layout of [`super::person`].
//!
//! ```text
//! zju              ZJU-MoCap, original and refined: annots.npy, pictures, masks, params
//! monocap          MonoCap (the layout of Instant-NVR)
//! arah             ARAH / 3DGS-Avatar preprocessing: cam_params.json, models/*.npz
//! people_snapshot  PeopleSnapshot: camera.pkl, masks.hdf5, reconstructed_poses.hdf5, consensus.obj
//! instant_avatar   InstantAvatar's preprocessing of it: cameras.npz, poses.npz
//! anim_nerf        3DGS-Avatar's preprocessing of it: camera.pkl, animnerf_models/*.npz
//! dna              DNA-Rendering: .smc containers (HDF5)
//! annots           cameras and body parameters that ZJU-MoCap and MonoCap share
//! ```
//!
//! # Conventions that are converted
//! * Principal points are those of OpenCV, whose pixel centres are whole numbers; here they are at halves, so ½ is added.
//! * `annots.npy` has translations of cameras in millimetres; they are divided by 1000.
//! * Body models have y up. Points and joints at rest leave [`crate::io`] as they are and are turned by the importer.
//! * Worlds that are a camera's axes (y down) name a rotation to z up, [`Source::world`].
//!
//! # Splits
//! [`Selection`] overrides them; the defaults are those of the programs that the sets are known from:
//!
//! | layout | train | test | scale |
//! |---|---|---|---|
//! | `zju-refine` | camera 4, frames 0, 5, …, 495 | the other cameras, frames 0, 30, …, 480 | ½ |
//! | `zju` | camera 0 ("1"), all frames | the other cameras, every 30th frame | ½ |
//! | `monocap` | camera 0 (olek 44, vlad 66), 100 frames step 5 (olek, vlad from frame 1) | lan, marc: 1 … 10; olek: 45; vlad: 0, 10, …, 100; 17 frames step 30 | 1 |
//! | `arah` | camera 1, all frames | the other cameras, every 30th frame | to 512 |
//! | `people-snapshot`, `instant-avatar`, `anim-nerf` | one camera, the frames of InstantAvatar for the four subjects it names; else the first three quarters | the rest | 1, `anim-nerf` to 540 |
//! | `dna` | camera 26, 100 frames step 1 | cameras 24, 25, 27, 28, 20 frames step 5 | ½ |

pub mod anim_nerf;
mod annots;
pub mod arah;
pub mod dna;
pub mod instant_avatar;
pub mod monocap;
pub mod people_snapshot;
mod pixels;
pub mod zju;

use super::capture::{Lens, Split, nearest_rotation, rigid};
use super::name_of;
use super::smpl::BodyModel;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use pixels::{Container, Pixels};

/// Which layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// ZJU-MoCap as released
    Zju,
    /// ZJU-MoCap with the refined cameras of Instant-NVR
    ZjuRefine,
    /// MonoCap
    MonoCap,
    /// ARAH, 3DGS-Avatar
    Arah,
    /// PeopleSnapshot
    PeopleSnapshot,
    /// InstantAvatar's PeopleSnapshot
    InstantAvatar,
    /// 3DGS-Avatar's PeopleSnapshot
    AnimNerf,
    /// DNA-Rendering
    Dna,
}

/// All layouts with their names.
pub const LAYOUTS: [(&str, Layout); 8] = [
    ("zju", Layout::Zju),
    ("zju-refine", Layout::ZjuRefine),
    ("monocap", Layout::MonoCap),
    ("arah", Layout::Arah),
    ("people-snapshot", Layout::PeopleSnapshot),
    ("instant-avatar", Layout::InstantAvatar),
    ("anim-nerf", Layout::AnimNerf),
    ("dna", Layout::Dna),
];

impl Layout {
    /// The layout of a name.
    ///
    /// # Errors
    /// When there is none.
    pub fn parse(name: &str) -> Result<Self> {
        LAYOUTS.iter().find(|(n, _)| *n == name).map(|(_, l)| *l).ok_or_else(|| {
            let names: Vec<&str> = LAYOUTS.iter().map(|(n, _)| *n).collect();
            Error::input("layout").expected(format!("one of {}", names.join(", "))).got(name)
        })
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        LAYOUTS.iter().find(|(_, l)| *l == self).map_or("", |(n, _)| n)
    }

    /// What a folder looks like, if it looks like one of them. ZJU-MoCap's two releases differ in numbers, not in names: it is taken for the
    /// refined one where there is no `mask_cihp`.
    pub fn detect(dir: &Path) -> Option<Self> {
        let has = |n: &str| dir.join(n).exists();
        let smc = || {
            std::fs::read_dir(dir)
                .ok()?
                .filter_map(|e| e.ok()?.file_name().into_string().ok())
                .any(|n| n.ends_with(".smc"))
                .then_some(())
        };
        if dir.extension().is_some_and(|e| e == "smc") || smc().is_some() {
            Some(Self::Dna)
        } else if has("cam_params.json") {
            Some(Self::Arah)
        } else if has("cameras.npz") {
            Some(Self::InstantAvatar)
        } else if has("animnerf_models") {
            Some(Self::AnimNerf)
        } else if has("camera.pkl") {
            Some(Self::PeopleSnapshot)
        } else if has("annots.npy") {
            let monocap = monocap::subject(dir).is_some();
            Some(if monocap {
                Self::MonoCap
            } else if has("mask_cihp") {
                Self::Zju
            } else {
                Self::ZjuRefine
            })
        } else {
            None
        }
    }
}

/// Frames: first, step, how many at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// First.
    pub start: usize,
    /// At least 1.
    pub step: usize,
    /// At most so many; fewer if there are no more.
    pub count: usize,
}

impl Range {
    /// From `START:STEP:COUNT`.
    ///
    /// # Errors
    /// When it is written otherwise, or the step or the count is 0.
    pub fn parse(text: &str) -> Result<Self> {
        let parts: Option<Vec<usize>> = text.split(':').map(|p| p.parse().ok()).collect();
        match parts.as_deref() {
            Some(&[start, step, count]) if step > 0 && count > 0 => Ok(Self { start, step, count }),
            _ => Err(Error::input("frames")
                .expected("START:STEP:COUNT, such as 0:5:100, with a step and a count of at least 1")
                .got(text)),
        }
    }

    /// Those below `end`.
    pub fn frames(&self, end: usize) -> Vec<usize> {
        (self.start..end).step_by(self.step).take(self.count).collect()
    }
}

/// What the user wants otherwise than the layout's protocol has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Cameras to learn from.
    pub train_cameras: Option<Vec<usize>>,
    /// Cameras held out.
    pub test_cameras: Option<Vec<usize>>,
    /// Frames to learn from.
    pub train_frames: Option<Range>,
    /// Frames held out.
    pub test_frames: Option<Range>,
}

/// One picture of a source, as it is in the files.
#[derive(Clone, Debug)]
pub struct SourceShot {
    /// Index of the moment.
    pub time: usize,
    /// The data set's number of the camera.
    pub camera: usize,
    /// Train or test.
    pub split: Split,
    /// World to camera, in the source's world.
    pub view_from_world: [[f64; 4]; 4],
    /// f_x, f_y, c_x, c_y of the picture as it is, pixel centres at halves.
    pub intrinsics: [f64; 4],
    /// Distortion.
    pub lens: Lens,
    /// The photograph.
    pub image: Pixels,
    /// Not zero where the person is.
    pub mask: Pixels,
}

/// The body at one moment, in the body model's axes and metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// (K) axis-angles; the root's turns the body about its root joint
    pub rotations: Vec<[f64; 3]>,
    /// Rh: turns everything about the origin
    pub global_rotation: [f64; 3],
    /// Th
    pub global_translation: [f64; 3],
    /// Of the body before it is moved; 1 but for DNA-Rendering.
    pub scale: f64,
    /// Transforms from rest that the data set brings itself, before Rh and Th.
    pub transforms: Option<Vec<[[f64; 4]; 3]>>,
}

/// A capture as the files have it.
#[derive(Clone, Debug)]
pub struct Source {
    /// Which layout it is.
    pub layout: Layout,
    /// `smpl` or `smplx`.
    pub kind: &'static str,
    /// Its pictures.
    pub shots: Vec<SourceShot>,
    /// Its moments, by number.
    pub moments: Vec<Moment>,
    /// (T) numbers of the moments
    pub numbers: Vec<i64>,
    /// Which of several bodies is the person's: `neutral`, `female`, `male`
    pub gender: String,
    /// Coefficients of shape (and expression)
    pub betas: Vec<f64>,
    /// Points at rest that belong to this person; else the model's under `betas`
    pub rest: Option<Vec<[f64; 3]>>,
    /// A body model that came with the data
    pub model: Option<BodyModel>,
    /// Posed points that came with the data, of a moment: file, moment, points. The posed body is compared with them.
    pub reference: Option<(PathBuf, usize, Vec<[f64; 3]>)>,
    /// Larger side that pictures are reduced to, if they are larger by a whole factor; 0 leaves them
    pub target: usize,
    /// Pictures are reduced by this factor
    pub downscale: usize,
    /// Of the box, metres
    pub margin_m: f64,
    /// Our world from the source's
    pub world: [[f64; 3]; 3],
    /// Rotations of the hands come on top of the body model's mean hands
    pub on_mean_hands: bool,
    /// What the user should know, a sentence each
    pub notes: Vec<String>,
}

impl Source {
    /// Without pictures and moments.
    fn new(layout: Layout) -> Self {
        Self {
            layout,
            kind: "smpl",
            shots: Vec::new(),
            moments: Vec::new(),
            numbers: Vec::new(),
            gender: "neutral".to_owned(),
            betas: Vec::new(),
            rest: None,
            model: None,
            reference: None,
            target: 0,
            downscale: 1,
            margin_m: 0.05,
            world: IDENTITY,
            on_mean_hands: false,
            notes: Vec::new(),
        }
    }

    /// Notes when the shape of a moment is not that of the first.
    fn same_shape(&mut self, betas: &[f64], number: i64) {
        if self.betas.is_empty() {
            self.betas = betas.to_vec();
        }
        let differs = betas.len() != self.betas.len()
            || betas.iter().zip(&self.betas).any(|(a, b)| (a - b).abs() > 1e-4);
        let note = "shape coefficients change over time; those of the first moment are used";
        if differs && !self.notes.iter().any(|n| n.starts_with(note)) {
            self.notes.push(format!("{note} (first at frame {number})"));
        }
    }
}

/// Names by which a subject is known: those of its folder and of the one above, lower case, however the path is spelled.
pub(super) fn called(dir: &Path) -> Vec<String> {
    let full = dir.canonicalize().unwrap_or_else(|_| dir.to_path_buf());
    full.components().rev().take(2).map(|c| c.as_os_str().to_string_lossy().to_lowercase()).collect()
}

/// No rotation.
pub(super) const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// z up from a camera's axes (x right, y down, z forward): (x, y, z) → (x, z, −y).
pub(super) const UP_FROM_CAMERA: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];

/// Reads a capture of a layout. `gender` is the person's, which chooses among bodies; without one it is what the layout says.
///
/// # Errors
/// When a file is missing or malformed, or nothing is selected.
pub fn read(layout: Layout, dir: &Path, selection: &Selection, gender: Option<&str>) -> Result<Source> {
    if !dir.exists() {
        return Err(Error::input(name_of(dir))
            .expected(format!("a capture in the layout {}", layout.name()))
            .got("nothing there"));
    }
    let mut source = match layout {
        Layout::Zju | Layout::ZjuRefine => zju::read(layout, dir, selection),
        Layout::MonoCap => monocap::read(dir, selection),
        Layout::Arah => arah::read(dir, selection, gender),
        Layout::PeopleSnapshot => people_snapshot::read(dir, selection),
        Layout::InstantAvatar => instant_avatar::read(dir, selection),
        Layout::AnimNerf => anim_nerf::read(dir, selection, gender),
        Layout::Dna => dna::read(dir, selection),
    }?;
    if let Some(given) = gender {
        given.clone_into(&mut source.gender);
    }
    if !source.shots.iter().any(|s| s.split == Split::Train) {
        return Err(Error::input(name_of(dir))
            .expected("at least one picture to learn from")
            .got("none in the cameras and frames that were selected"));
    }
    Ok(source)
}

/// Which camera sees which frame, and for what.
#[derive(Clone, Debug, PartialEq)]
struct Plan {
    /// (camera, frame, split), training first; no pair twice
    shots: Vec<(usize, usize, Split)>,
    /// Frames in use, ascending
    frames: Vec<usize>,
}

impl Plan {
    fn new(train: (&[usize], &[usize]), test: (&[usize], &[usize])) -> Self {
        let mut shots: Vec<(usize, usize, Split)> = Vec::new();
        let mut seen = std::collections::BTreeSet::new();
        for ((cameras, frames), split) in [(train, Split::Train), (test, Split::Test)] {
            for &c in cameras {
                for &f in frames {
                    if seen.insert((c, f)) {
                        shots.push((c, f, split));
                    }
                }
            }
        }
        let mut frames: Vec<usize> = shots.iter().map(|s| s.1).collect();
        frames.sort_unstable();
        frames.dedup();
        Self { shots, frames }
    }

    /// Index of a frame among those in use.
    fn time(&self, frame: usize) -> usize {
        self.frames.partition_point(|&f| f < frame)
    }
}

/// Rotation and translation as files write them, made orthonormal.
fn pose(rotation: &[f64], translation: &[f64], name: &str) -> Result<[[f64; 4]; 4]> {
    let wrong =
        |got: String| Error::input(name).at("camera").expected("a rotation and a translation").got(got);
    if rotation.len() != 9 || translation.len() != 3 {
        return Err(wrong(format!("{} and {} numbers", rotation.len(), translation.len())));
    }
    let r = nearest_rotation(std::array::from_fn(|i| std::array::from_fn(|j| rotation[3 * i + j])))
        .map_err(wrong)?;
    Ok(rigid(r, [translation[0], translation[1], translation[2]]))
}

/// f_x, f_y, c_x, c_y of OpenCV's 3×3 matrix, pixel centres moved to halves.
fn intrinsics(k: &[f64], name: &str) -> Result<[f64; 4]> {
    match k {
        &[fx, _, cx, _, fy, cy, ..] if k.len() == 9 && fx > 0.0 && fy > 0.0 => {
            Ok([fx, fy, cx + 0.5, cy + 0.5])
        }
        _ => Err(Error::input(name)
            .at("K")
            .expected("a 3x3 matrix with positive focal lengths")
            .got(format!("{k:?}"))),
    }
}

/// OpenCV's k₁ k₂ p₁ p₂ k₃ (k₄ k₅ k₆), or fewer.
fn distortion(d: &[f64], name: &str) -> Result<Lens> {
    if d.len() > 8 || d.iter().any(|x| !(x.abs() <= 1e6)) {
        return Err(Error::input(name)
            .at("D")
            .expected("at most 8 coefficients of OpenCV's model")
            .got(format!("{d:?}")));
    }
    let at = |i: usize| d.get(i).copied().unwrap_or(0.0);
    Ok(Lens::Perspective {
        numerator: [at(0), at(1), at(4), 0.0],
        denominator: [at(5), at(6), at(7)],
        tangential: [at(2), at(3)],
    })
}

/// Files of a folder whose names are whole numbers, or begin with `prefix` and go on with one.
fn numbered(dir: &Path, prefix: &str) -> Result<BTreeMap<usize, PathBuf>> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(dir).map_err(|e| Error::os(dir, &e))? {
        let path = entry.map_err(|e| Error::os(dir, &e))?.path();
        let stem = if path.is_dir() { path.file_name() } else { path.file_stem() };
        let digits = stem.and_then(|s| s.to_str()).and_then(|s| s.strip_prefix(prefix));
        let digits = digits.filter(|d| !d.is_empty() && d.bytes().all(|b| b.is_ascii_digit()));
        if let Some(n) = digits.and_then(|d| d.parse().ok()) {
            // Two files of one number: the first in the order of names, whatever the system lists first.
            match out.entry(n) {
                std::collections::btree_map::Entry::Vacant(e) => {
                    e.insert(path);
                }
                std::collections::btree_map::Entry::Occupied(mut e) if path < *e.get() => {
                    e.insert(path);
                }
                std::collections::btree_map::Entry::Occupied(_) => {}
            }
        }
    }
    Ok(out)
}

/// The entry of a map of numbered files.
fn numbered_file(files: &BTreeMap<usize, PathBuf>, n: usize, dir: &Path, what: &str) -> Result<PathBuf> {
    files.get(&n).cloned().ok_or_else(|| {
        Error::input(name_of(dir)).expected(format!("{what} {n}")).got(
            match (files.keys().next(), files.keys().last()) {
                (Some(a), Some(b)) => format!("{} files, {a} to {b}", files.len()),
                _ => "none".to_owned(),
            },
        )
    })
}

/// The first of some folders that is there.
fn first_folder(dir: &Path, names: &[&str], what: &str) -> Result<PathBuf> {
    names.iter().map(|n| dir.join(n)).find(|p| p.is_dir()).ok_or_else(|| {
        Error::input(name_of(dir))
            .expected(format!("{what} in one of the folders {}", names.join(", ")))
            .got("none of them")
    })
}

/// Triples of a flat array of 3 K numbers.
fn triples(flat: &[f64]) -> Vec<[f64; 3]> {
    flat.as_chunks::<3>().0.to_vec()
}

/// Three numbers.
fn three(values: &[f64], key: &str, name: &str) -> Result<[f64; 3]> {
    <[f64; 3]>::try_from(values).map_err(|_| {
        Error::input(name).at(format!("'{key}'")).expected("three numbers").got(values.len().to_string())
    })
}

#[cfg(test)]
mod tests {
    use super::called;
    use std::path::Path;

    #[test]
    fn a_folder_has_its_name_however_its_path_is_spelled() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let dir = folder.path().join("People-Snapshot/Female-4-Casual");
        std::fs::create_dir_all(dir.join("images")).expect("made");
        for path in
            [dir.clone(), dir.join("images/.."), dir.join("."), dir.join("images/../../Female-4-Casual")]
        {
            assert_eq!(called(&path), ["female-4-casual", "people-snapshot"], "{}", path.display());
        }
        assert_eq!(called(Path::new("src")).first().map(String::as_str), Some("src"), "a relative one");
        assert_eq!(called(Path::new("nowhere/x")), ["x", "nowhere"], "one that is not there");
    }
}
