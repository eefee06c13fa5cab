//! PeopleSnapshot: one camera that does not move, a person who turns.
//!
//! ```text
//! camera.pkl                  {camera_f (2), camera_c (2), camera_k (5), camera_rt (3), camera_t (3), width, height}
//! masks.hdf5                  masks (n, H, W) bytes, by LZF or deflate; not zero: person
//! reconstructed_poses.hdf5    pose (n, 72), betas (10), trans (n, 3)
//! consensus.obj               the person at rest, optional
//! images/                     the frames of the video, in the order of their numbers
//! NAME.mp4                    if there is no images/: taken apart by ffmpeg into images/
//! ```

use super::pixels::{Container, Pixels};
use super::source::{
    Layout, Plan, Range, Selection, Source, SourceShot, UP_FROM_CAMERA, distortion, three, triples,
};
use crate::io::capture::{Lens, Split, nearest_rotation, rigid};
use crate::io::hdf5::Hdf5;
use crate::io::{MAX_SMALL_FILE_BYTES, name_of, pickle, read_bytes};
use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

/// Frames of InstantAvatar's experiments, end excluded: training, test, step of both.
const PROTOCOLS: [(&str, [usize; 2], [usize; 2], usize); 4] = [
    ("male-3-casual", [0, 456], [456, 676], 4),
    ("male-4-casual", [0, 660], [660, 873], 6),
    ("female-3-casual", [0, 446], [446, 648], 4),
    ("female-4-casual", [0, 336], [335, 524], 4),
];

/// About so many training frames are taken of subjects without a protocol.
const FRAMES: usize = 120;

/// Training and test frames of a video of `count` frames. A frame that is in both is for training.
pub(super) fn frames(dir: &Path, count: usize, selection: &Selection) -> (Vec<usize>, Vec<usize>) {
    let names = super::source::called(dir);
    let is_called = |n: &str| names.iter().any(|name| name == n);
    let known =
        PROTOCOLS.iter().find(|(n, ..)| is_called(n)).map(|&(_, train, test, step)| (train, test, step));
    let cut = 3 * count / 4;
    let usual = ([0, cut], [cut, count], crate::num::order::max(cut / FRAMES, 1));
    let (train, test, step) = known.unwrap_or(usual);
    let range = |[start, end]: [usize; 2]| Range { start, step, count: (end - start).div_ceil(step) };
    let train = selection.train_frames.unwrap_or(range(train)).frames(count);
    let mut test = selection.test_frames.unwrap_or(range(test)).frames(count);
    test.retain(|f| !train.contains(f));
    (train, test)
}

/// Reads a subject.
///
/// # Errors
/// When a file is missing or malformed, counts differ, or the video must be taken apart and cannot.
pub fn read(dir: &Path, selection: &Selection) -> Result<Source> {
    let camera = Calibration::read(&dir.join("camera.pkl"))?;
    let (view, intrinsics, lens) = (camera.view()?, camera.intrinsics()?, camera.lens()?);
    let body = Hdf5::open(&dir.join("reconstructed_poses.hdf5"))?;
    let (shape, poses) = body.numbers("pose")?;
    let (count, per) = match shape[..] {
        [n, p] if p > 0 && p.is_multiple_of(3) => (n, p),
        _ => {
            return Err(Error::input(body.name())
                .at("'pose'")
                .expected("shape (n, 72)")
                .got(format!("{shape:?}")));
        }
    };
    let (_, trans) = body.numbers("trans")?;
    let masks = Hdf5::open(&dir.join("masks.hdf5"))?;
    let of_masks = masks.shape("masks")?;
    let images = pictures(dir)?;
    // Some videos are a frame longer or shorter than what was made of them.
    let counts = [
        ("poses", count),
        ("masks in masks.hdf5", of_masks.first().copied().unwrap_or(0)),
        ("translations", trans.len() / 3),
        ("images in images/", images.len()),
    ];
    for (what, n) in counts {
        if 100 * n.abs_diff(count) > count {
            return Err(Error::input(name_of(dir))
                .at(what)
                .expected(format!("{count}, as many as poses"))
                .got(n.to_string()));
        }
    }
    let usable = counts.iter().fold(count, |least, &(_, n)| Ord::min(least, n));
    let is_uneven = counts.iter().any(|&(_, n)| n != usable);
    let count = usable;
    let (train, test) = frames(dir, count, selection);
    let plan = Plan::new((&[0], &train), (&[0], &test));
    let (_, betas) = body.numbers("betas")?;
    let mut out = Source { betas, world: UP_FROM_CAMERA, ..Source::new(Layout::PeopleSnapshot) };
    if is_uneven {
        out.notes.push(format!(
            "the numbers of images, masks and poses differ; only the first {count} frames are used"
        ));
    }
    for &f in &plan.frames {
        out.moments.push(super::source::Moment {
            rotations: triples(&poses[f * per..(f + 1) * per]),
            global_rotation: [0.0; 3],
            global_translation: three(&trans[3 * f..3 * f + 3], "trans", body.name())?,
            scale: 1.0,
            transforms: None,
        });
        out.numbers.push(f as i64);
    }
    let masks = Arc::new(Container(masks));
    for &(_, frame, split) in &plan.shots {
        out.shots.push(SourceShot {
            time: plan.time(frame),
            camera: 0,
            split,
            view_from_world: view,
            intrinsics,
            lens,
            image: Pixels::Picture(images[frame].clone()),
            mask: Pixels::Row(masks.clone(), "masks".to_owned(), frame),
        });
    }
    let consensus = dir.join("consensus.obj");
    if consensus.is_file() {
        out.rest = Some(vertices(&consensus)?);
    } else {
        out.notes.push(
            "no consensus.obj: the person is the body model's shape, without clothes and hair".to_owned(),
        );
    }
    if !plan.shots.iter().any(|s| s.2 == Split::Test) {
        out.notes.push("no frames are held out".to_owned());
    }
    Ok(out)
}

/// `camera.pkl`.
pub(super) struct Calibration {
    name: String,
    values: pickle::Value,
}

impl Calibration {
    pub(super) fn read(path: &Path) -> Result<Self> {
        Ok(Self { name: name_of(path), values: pickle::read(path)? })
    }

    fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N]> {
        let (_, v) = self.values.numbers(key, &self.name)?;
        <[f64; N]>::try_from(v).map_err(|v| {
            Error::input(self.name.clone())
                .at(format!("key '{key}'"))
                .expected(format!("{N} numbers"))
                .got(v.len().to_string())
        })
    }

    /// f_x, f_y, c_x, c_y, pixel centres at halves.
    pub(super) fn intrinsics(&self) -> Result<[f64; 4]> {
        let (f, c) = (self.numbers::<2>("camera_f")?, self.numbers::<2>("camera_c")?);
        if !(f[0] > 0.0 && f[1] > 0.0) {
            return Err(Error::input(self.name.clone())
                .at("camera_f")
                .expected("positive focal lengths")
                .got(format!("{f:?}")));
        }
        Ok([f[0], f[1], c[0] + 0.5, c[1] + 0.5])
    }

    pub(super) fn lens(&self) -> Result<Lens> {
        distortion(&self.numbers::<5>("camera_k")?, &self.name)
    }

    /// View from world.
    fn view(&self) -> Result<[[f64; 4]; 4]> {
        let rotation = rodrigues(self.numbers("camera_rt")?)
            .map_err(|got| Error::input(self.name.clone()).at("camera_rt").expected("a rotation").got(got))?;
        Ok(rigid(rotation, self.numbers("camera_t")?))
    }
}

/// A rotation from its axis-angle, with std's series for small angles left to the caller's check of
/// orthonormality.
fn rodrigues(v: [f64; 3]) -> std::result::Result<[[f64; 3]; 3], String> {
    let square = (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2];
    let angle = square.sqrt();
    let (a, b) = if angle < 1e-4 {
        (1.0 - square / 6.0, 0.5 - square / 24.0)
    } else {
        (libm::sin(angle) / angle, (1.0 - libm::cos(angle)) / square)
    };
    let cross = [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]];
    let r = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let eye = if i == j { 1.0 - b * square } else { 0.0 };
            eye + a * cross[i][j] + b * v[i] * v[j]
        })
    });
    nearest_rotation(r)
}

/// Images of `images/` by number, made from the video if need be.
fn pictures(dir: &Path) -> Result<Vec<PathBuf>> {
    let folder = dir.join("images");
    if !folder.is_dir() {
        take_apart(dir, &folder)?;
    }
    Ok(in_order(&folder)?.into_iter().map(|(_, path)| path).collect())
}

/// Images of a folder with the numbers in their names, ascending.
pub(super) fn in_order(folder: &Path) -> Result<Vec<(usize, PathBuf)>> {
    let mut out: Vec<(usize, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| Error::os(folder, &e))? {
        let path = entry.map_err(|e| Error::os(folder, &e))?.path();
        let is_picture = path
            .extension()
            .and_then(|e| e.to_str())
            .is_some_and(|e| ["png", "jpg", "jpeg"].contains(&e.to_lowercase().as_str()));
        let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
        let digits = stem.rfind(|c: char| !c.is_ascii_digit()).map_or(stem, |i| &stem[i + 1..]);
        if let (true, Ok(n)) = (is_picture, digits.parse()) {
            out.push((n, path));
        }
    }
    out.sort();
    Ok(out)
}

/// Runs ffmpeg on the video beside the data; the folder is created atomically.
fn take_apart(dir: &Path, folder: &Path) -> Result<()> {
    let mut videos: Vec<PathBuf> = std::fs::read_dir(dir)
        .map_err(|e| Error::os(dir, &e))?
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("mp4")))
        .collect();
    videos.sort();
    let Some(video) = videos.first() else {
        return Err(Error::input(name_of(folder))
            .expected("the frames of the video, or the video beside it")
            .got("neither"));
    };
    let part = dir.join("images.part");
    std::fs::create_dir_all(&part).map_err(|e| Error::os(&part, &e))?;
    let arguments = |to: &Path| -> Vec<std::ffi::OsString> {
        [
            "-nostdin".into(),
            "-loglevel".into(),
            "error".into(),
            "-i".into(),
            video.clone().into_os_string(),
            "-start_number".into(),
            "0".into(),
            to.join("image_%04d.png").into_os_string(),
        ]
        .into()
    };
    let words: Vec<String> = arguments(folder).iter().map(|w| quoted(&w.to_string_lossy())).collect();
    let command = format!("mkdir -p {0} && ffmpeg {1}", quoted(&name_of(folder)), words.join(" "));
    let fail = |got: String| {
        let _ = std::fs::remove_dir_all(&part);
        Error::input(name_of(folder))
            .expected("the frames of the video")
            .got(got)
            .hint(format!("run: {command}"))
    };
    let outcome =
        Command::new("ffmpeg").args(arguments(&part)).stdin(Stdio::null()).stdout(Stdio::null()).output();
    match outcome {
        Ok(o) if o.status.success() => std::fs::rename(&part, folder).map_err(|e| Error::os(folder, &e)),
        Ok(o) => {
            let said = String::from_utf8_lossy(&o.stderr).lines().next().unwrap_or("nothing").to_owned();
            Err(fail(format!("ffmpeg ended with {} and printed: {said}", o.status)))
        }
        Err(e) => Err(fail(format!("no folder of that name, and ffmpeg does not start: {e}"))),
    }
}

/// A word of a command line as a POSIX shell reads it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// Positions in the order of the file: that of the body model, which a reader of surfaces need not keep.
fn vertices(path: &Path) -> Result<Vec<[f64; 3]>> {
    let (bytes, name) = (read_bytes(path, MAX_SMALL_FILE_BYTES)?, name_of(path));
    let text = String::from_utf8_lossy(&bytes);
    let mut out = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let Some(rest) = line.trim().strip_prefix("v ") else { continue };
        let values: Vec<f64> = rest
            .split_whitespace()
            .take(3)
            .filter_map(|w| w.parse().ok())
            .filter(|x: &f64| x.is_finite())
            .collect();
        match values[..] {
            [x, y, z] => out.push([x, y, z]),
            _ => {
                return Err(Error::input(name)
                    .at(format!("line {}", i + 1))
                    .expected("v and three numbers")
                    .got(line.chars().take(60).collect::<String>()));
            }
        }
    }
    if out.is_empty() { Err(Error::input(name).expected("vertices").got("none")) } else { Ok(out) }
}
