//! A published capture as records, and what its readers have in common.

use super::pixels::Pixels;
use crate::io::capture::{Lens, Split, nearest_rotation, rigid};
use crate::io::name_of;
use crate::io::smpl::BodyModel;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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

/// One image of a source, as it is in the files.
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
    /// f_x, f_y, c_x, c_y of the image as it is, pixel centres at halves.
    pub intrinsics: [f64; 4],
    /// Distortion.
    pub lens: Lens,
    /// The photo.
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
    /// Its images.
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
    /// Posed points that came with the data, of a moment: file, moment, points. The posed body is compared
    /// with them.
    pub reference: Option<(PathBuf, usize, Vec<[f64; 3]>)>,
    /// Larger side that images are reduced to, if they are larger by an integer factor; 0 leaves them
    pub target: usize,
    /// Images are reduced by this factor
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
    /// Without images and moments.
    pub(super) fn new(layout: Layout) -> Self {
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
    pub(super) fn same_shape(&mut self, betas: &[f64], number: i64) {
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

/// Names by which a subject is known: those of its folder and of the one above, lower case, however the path
/// is spelled.
pub(super) fn called(dir: &Path) -> Vec<String> {
    let full = dir.canonicalize().unwrap_or_else(|_| dir.to_path_buf());
    full.components().rev().take(2).map(|c| c.as_os_str().to_string_lossy().to_lowercase()).collect()
}

/// No rotation.
pub(super) const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// z up from a camera's axes (x right, y down, z forward): (x, y, z) → (x, z, −y).
pub(super) const UP_FROM_CAMERA: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];

/// Which camera sees which frame, and for what.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plan {
    /// (camera, frame, split), training first; no pair twice
    pub(super) shots: Vec<(usize, usize, Split)>,
    /// Frames in use, ascending
    pub(super) frames: Vec<usize>,
}

impl Plan {
    pub(super) fn new(train: (&[usize], &[usize]), test: (&[usize], &[usize])) -> Self {
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
    pub(super) fn time(&self, frame: usize) -> usize {
        self.frames.partition_point(|&f| f < frame)
    }
}

/// Rotation and translation as files write them, made orthonormal.
pub(super) fn pose(rotation: &[f64], translation: &[f64], name: &str) -> Result<[[f64; 4]; 4]> {
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
pub(super) fn intrinsics(k: &[f64], name: &str) -> Result<[f64; 4]> {
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
pub(super) fn distortion(d: &[f64], name: &str) -> Result<Lens> {
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

/// Files of a folder whose names are integers, or begin with `prefix` and go on with one.
pub(super) fn numbered(dir: &Path, prefix: &str) -> Result<BTreeMap<usize, PathBuf>> {
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
pub(super) fn numbered_file(
    files: &BTreeMap<usize, PathBuf>,
    n: usize,
    dir: &Path,
    what: &str,
) -> Result<PathBuf> {
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
pub(super) fn first_folder(dir: &Path, names: &[&str], what: &str) -> Result<PathBuf> {
    names.iter().map(|n| dir.join(n)).find(|p| p.is_dir()).ok_or_else(|| {
        Error::input(name_of(dir))
            .expected(format!("{what} in one of the folders {}", names.join(", ")))
            .got("none of them")
    })
}

/// Triples of a flat array of 3 K numbers.
pub(super) fn triples(flat: &[f64]) -> Vec<[f64; 3]> {
    flat.as_chunks::<3>().0.to_vec()
}

/// Three numbers.
pub(super) fn three(values: &[f64], key: &str, name: &str) -> Result<[f64; 3]> {
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
