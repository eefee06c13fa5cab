//! Photos with cameras, ready to fit: loaded, composited, scaled, undistorted, split, and placed in a scene.

use super::camera::{Camera, Model};
use super::lens;
use super::placement::nearest_to_axes;
use crate::io::capture::{Capture, Frame, Lens, Reading, Split, read_capture_with};
use crate::io::gaussian_ply::Points;
use crate::io::image_file::{self, Encoding, Orientation, Picture};
use crate::io::memory;
use crate::num::{order, par};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// One view in this many is held out, in the order of their names: index mod 8 == 0.
pub const TEST_EVERY: usize = 8;

/// Bytes of a pixel of a view with a mask.
const PIXEL_BYTES: u64 = 4;

/// The pixels of all frames whose size is known, as they are loaded.
pub fn pixels(frames: &[Frame], options: &Options) -> u64 {
    let shrink = (options.downscale * options.downscale) as u64;
    frames.iter().filter_map(|f| f.size).fold(0, |n, [w, h]| n + w as u64 * h as u64 / shrink)
}

/// Fewer points than this are no start of a fit.
pub const FEW_POINTS: usize = 100;

/// How the pixels that a mask excludes are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Masks {
    /// They count neither in losses nor in scores.
    #[default]
    Ignore,
    /// They have the colour of the background.
    Background,
    /// Masks are not read.
    Off,
}

/// How photos are loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// sRGB-encoded colour behind transparent pixels, 0 to 1.
    pub background: [f32; 3],
    /// Average blocks of this many pixels a side; 1 leaves images as they are.
    pub downscale: usize,
    /// Refuse a capture whose list names photos that are not there, instead of leaving them out.
    pub strict: bool,
    /// How masks are applied.
    pub masks: Masks,
    /// Folder of the images, in place of the one the capture names.
    pub images: Option<PathBuf>,
    /// Accept absolute paths in the capture's files, and paths that lead out of its folder.
    pub outside: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            background: [0.0; 3],
            downscale: 1,
            strict: false,
            masks: Masks::Ignore,
            images: None,
            outside: false,
        }
    }
}

/// One photo as an ideal camera would have taken it.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Its name, with forward slashes, relative to the capture.
    pub name: String,
    /// Id of its camera.
    pub camera: Camera,
    /// (H, W, 3) sRGB-encoded bytes, row-major.
    pub rgb: Vec<u8>,
    /// (H, W): 1 where the pixel counts in losses and metrics; absent if all do.
    pub mask: Option<Vec<u8>>,
}

impl View {
    /// The image in 0..1, (H, W, 3).
    pub fn image(&self) -> Vec<f32> {
        self.rgb.iter().map(|&b| f32::from(b) / 255.0).collect()
    }
}

/// A cube in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneBox {
    /// Its centre.
    pub center: [f64; 3],
    /// Half of its side.
    pub half_size: f64,
}

/// All views of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Views {
    /// In the order of their names.
    pub views: Vec<View>,
    /// Indices of the training views.
    pub train: Vec<usize>,
    /// Indices of the held-out views; none if there is a single image.
    pub test: Vec<usize>,
    /// 1.1 times the largest distance of a training camera from the mean of their centres; 1 if that is zero.
    pub extent: f64,
    /// Cube around the point nearest to the optical axes of the training cameras.
    pub scene_box: SceneBox,
    /// Points of a reconstruction, if the capture has them.
    pub points: Option<Points>,
    /// Names of photos whose pixels were turned by their EXIF orientation, because the capture declares the size of the upright image.
    pub turned: Vec<String>,
    /// Names of photos with an EXIF orientation that was ignored, because the size that the capture declares, if any, is that of the stored pixels.
    pub not_turned: Vec<String>,
    /// Number of views with a mask that was read.
    pub masked: usize,
    /// Names of listed photos that are missing.
    pub missing: Vec<String>,
    /// Other listed files that are missing.
    pub missing_files: Vec<String>,
}

impl Views {
    /// Reads a capture and loads its photos.
    ///
    /// # Errors
    /// When the layout, a lens or a photo is bad.
    pub fn load(path: &Path, options: &Options) -> Result<Self> {
        let (images, without_masks) = (options.images.clone(), options.masks == Masks::Off);
        let reading = Reading { images, outside: options.outside, without_masks };
        Self::named(&read_capture_with(path, &reading)?, options, &path.display().to_string())
    }

    /// The points of the capture, if there are enough of them to start a fit from.
    pub fn starting_points(&self) -> Option<&Points> {
        self.points.as_ref().filter(|p| p.xyz.len() >= FEW_POINTS)
    }

    /// Loads the photos of a capture, several at a time; the result does not depend on how many.
    ///
    /// Where the layout itself names training and test images, that split holds and validation images are
    /// left out; otherwise every eighth view is held out.
    ///
    /// Cameras refer to the pixels as they are stored, as COLMAP does: the EXIF orientation of a photo is ignored. It is applied only where
    /// the declared size fits the upright image and not the stored one, as in captures of programs that turn photos when they read them.
    ///
    /// # Errors
    /// When a photo or a mask is bad, or its size does not fit its lens.
    pub fn from_capture(capture: &Capture, options: &Options) -> Result<Self> {
        Self::named(capture, options, "capture")
    }

    /// [`Self::from_capture`] of a capture that errors call `name`.
    fn named(capture: &Capture, options: &Options, name: &str) -> Result<Self> {
        if options.downscale == 0 || options.downscale > image_file::MAX_SIDE {
            let e = Error::input("downscale").expected(format!("1 to {}", image_file::MAX_SIDE));
            return Err(e.got(options.downscale.to_string()));
        }
        if !options.background.iter().all(|x| (0.0..=1.0).contains(x)) {
            let e = Error::input("background").expected("colours from 0 to 1");
            return Err(e.got(format!("{:?}", options.background)));
        }
        if let (true, Some(first)) = (capture.frames.is_empty(), capture.missing.first()) {
            let e = Error::input(name).expected("photos of the frames that are listed").got(format!(
                "no file of {} frames, the first '{}'",
                capture.missing.len(),
                first.name
            ));
            return Err(match &options.images {
                None => e.hint("--images DIR names the folder of the photos"),
                Some(dir) => {
                    e.hint(format!("--images is {}: names in a capture are relative to it", dir.display()))
                }
            });
        }
        let has = |s: Split| capture.frames.iter().any(|f| f.split == s);
        let given = has(Split::Train) && has(Split::Test);
        let mut frames: Vec<&Frame> =
            capture.frames.iter().filter(|f| !given || f.split != Split::Val).collect();
        frames.sort_by(|a, b| a.name.cmp(&b.name));
        if frames.is_empty() {
            return Err(Error::input(name).expected("at least one frame").got("none"));
        }
        if let (true, Some(first)) = (options.strict, capture.missing.first()) {
            let (gone, listed) = (capture.missing.len(), capture.missing.len() + capture.frames.len());
            return Err(Error::input(name)
                .expected("a photo for every frame")
                .got(format!("none for {gone} of {listed} frames, the first '{}'", first.name))
                .hint("without --strict these frames are left out"));
        }
        let is_test =
            |i: usize| if given { frames[i].split == Split::Test } else { i.is_multiple_of(TEST_EVERY) };
        let (mut test, mut train): (Vec<usize>, Vec<usize>) = (0..frames.len()).partition(|&i| is_test(i));
        if train.is_empty() {
            // With a single image nothing can be held out: a score on what was fitted is none.
            train = std::mem::take(&mut test);
        }
        memory::check("photos", pixels(&capture.frames, options).saturating_mul(PIXEL_BYTES))
            .map_err(|e| e.hint("--downscale lowers the estimate, --max-memory raises the limit"))?;
        let loaded = par::map(frames.len(), |i| load(frames[i], options))
            .into_iter()
            .collect::<Result<Vec<Loaded>>>()?;
        let names = |turn: Turn| -> Vec<String> {
            loaded.iter().filter(|l| l.turn == turn).map(|l| l.view.name.clone()).collect()
        };
        let (turned, not_turned) = (names(Turn::Applied), names(Turn::Ignored));
        let masked = loaded.iter().filter(|l| l.is_masked).count();
        let views = loaded.into_iter().map(|l| l.view).collect();
        let poses: Vec<&Frame> = train.iter().map(|&i| frames[i]).collect();
        let (extent, scene_box) = place(&poses);
        Ok(Self {
            views,
            train,
            test,
            extent,
            scene_box,
            points: capture.points.clone(),
            turned,
            not_turned,
            masked,
            missing: capture.missing.iter().map(|frame| frame.name.clone()).collect(),
            missing_files: capture.missing_files.clone(),
        })
    }
}

/// Extent and box of the cameras.
///
/// The box: around the point nearest to the optical axes ([`nearest_to_axes`]). If the axes are parallel
/// there is no such point, and the centre is one extent in front of the mean centre of the cameras.
fn place(frames: &[&Frame]) -> (f64, SceneBox) {
    let n = frames.len() as f64;
    let mut axes = Vec::with_capacity(frames.len());
    for f in frames {
        let m = &f.view_from_world;
        let c: [f64; 3] =
            std::array::from_fn(|i| -(m[0][i] * m[0][3] + m[1][i] * m[1][3] + m[2][i] * m[2][3]));
        axes.push((c, [m[2][0], m[2][1], m[2][2]]));
    }
    let distance = |a: &[f64; 3], b: &[f64; 3]| {
        let d: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
        (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
    };
    let (mut mean, mut ahead) = ([0.0; 3], [0.0; 3]);
    for (c, d) in &axes {
        for i in 0..3 {
            mean[i] += c[i];
            ahead[i] += d[i];
        }
    }
    mean = mean.map(|x| x / n);
    let farthest = axes.iter().fold(0.0, |far, (c, _)| order::max(far, distance(c, &mean)));
    let extent = if farthest > 0.0 { 1.1 * farthest } else { 1.0 };
    let center = nearest_to_axes(&axes).unwrap_or_else(|| {
        let length = order::max(distance(&ahead, &[0.0; 3]), f64::MIN_POSITIVE);
        std::array::from_fn(|i| mean[i] + ahead[i] / length * extent)
    });
    let total = axes.iter().fold(0.0, |s, (c, _)| s + distance(c, &center));
    let half_size = if total > 0.0 { total / n } else { extent };
    (extent, SceneBox { center, half_size })
}

/// What became of the EXIF orientation of a photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// There is none.
    None,
    /// The pixels were turned.
    Applied,
    /// The pixels are as stored.
    Ignored,
}

/// Turns a photo upright if only then it has the declared size.
fn turn(frame: &Frame, picture: Picture) -> (Picture, Turn) {
    if picture.orientation == Orientation::STORED {
        return (picture, Turn::None);
    }
    let (w, h) = (picture.width, picture.height);
    if picture.orientation.swaps_sides() && !frame.fits(w, h) && frame.fits(h, w) {
        return (picture.upright(), Turn::Applied);
    }
    (picture, Turn::Ignored)
}

/// A photo that was read.
struct Loaded {
    view: View,
    /// Whether its mask was read.
    is_masked: bool,
    turn: Turn,
}

fn load(frame: &Frame, options: &Options) -> Result<Loaded> {
    let name = frame.image.display().to_string();
    let stored = image_file::read(&frame.image)?;
    let orientation = stored.orientation;
    let (picture, turn) = turn(frame, stored);
    if picture.encoding != Encoding::Srgb {
        return Err(Error::input(name)
            .at("encoding")
            .expected("an sRGB-encoded photo (PNG, JPEG, WebP, TIFF or BMP)")
            .got("linear values"));
    }
    let (full_w, full_h) = (picture.width, picture.height);
    let k = frame.intrinsics(full_w, full_h)?;
    let by = if turn == Turn::Applied { orientation } else { Orientation::STORED };
    let mask = frame.mask.as_ref().filter(|_| options.masks != Masks::Off);
    let mut mask = mask.map(|path| load_mask(path, [full_w, full_h], by)).transpose()?;
    let is_masked = mask.is_some();
    let s = options.downscale;
    let (width, height) = (full_w / s, full_h / s);
    if width == 0 || height == 0 {
        let e = Error::input(name).at("image size");
        return Err(e
            .expected(format!("at least {s} pixels a side, to be scaled down"))
            .got(format!("{full_w}x{full_h}")));
    }
    let mut rgb = composite(&picture, options.background);
    if options.masks == Masks::Background
        && let Some(mask) = mask.take()
    {
        for (pixel, _) in rgb.chunks_exact_mut(3).zip(&mask).filter(|(_, m)| **m == 0) {
            pixel.copy_from_slice(&options.background);
        }
    }
    let rgb = box_mean(&rgb, full_w, width, height, s);
    let mut mask = mask.map(|m| box_all(&m, full_w, width, height, s));
    // Pixel edges keep their places, so focal lengths and centre scale alike.
    let k = k.map(|x| x / s as f64);
    let rgb = if frame.lens.is_ideal() {
        rgb
    } else {
        let r = lens::undistort(&rgb, mask.as_deref(), width, height, k, frame.lens);
        mask = Some(r.mask);
        r.rgb
    };
    let mask = mask.filter(|m| m.contains(&0));
    if mask.as_ref().is_some_and(|m| !m.contains(&1)) {
        return Err(Error::input(name)
            .at("mask and lens")
            .expected("at least one pixel that counts")
            .got("none"));
    }
    let v = frame.view_from_world.map(|row| row.map(|x| x as f32));
    let camera = Camera {
        rotation: std::array::from_fn(|i| [v[i][0], v[i][1], v[i][2]]),
        translation: std::array::from_fn(|i| v[i][3]),
        focal_px: [k[0] as f32, k[1] as f32],
        center_px: [k[2] as f32, k[3] as f32],
        width,
        height,
        model: if matches!(frame.lens, Lens::Fisheye { .. }) { Model::Fisheye } else { Model::Pinhole },
    };
    camera.validate().map_err(|e| e.within(name))?;
    let rgb = image_file::to_u8(&rgb)?;
    Ok(Loaded { view: View { name: frame.name.clone(), camera, rgb, mask }, is_masked, turn })
}

/// (H, W): 1 where the first channel (or alpha, where there is one) is at least one half. A mask of the photo before it was reduced is
/// sampled at the nearest pixels, and a mask of the stored pixels is turned as the photo is.
fn load_mask(path: &Path, [width, height]: [usize; 2], turn: Orientation) -> Result<Vec<u8>> {
    let fits =
        |w: usize, h: usize| (w * height).abs_diff(h * width) <= Ord::max(w, h) && w >= width && h >= height;
    let mut m = image_file::read(path)?;
    if turn.swaps_sides() && !fits(m.width, m.height) && fits(m.height, m.width) {
        m = m.turned(turn);
    }
    if !fits(m.width, m.height) {
        return Err(Error::input(path.display().to_string())
            .at("mask size")
            .expected(format!("{width}x{height} as the photo, or a multiple of it"))
            .got(format!("{}x{}", m.width, m.height)));
    }
    let c = m.channels.len();
    let channel = if c.is_multiple_of(2) { c - 1 } else { 0 };
    let at = |i: usize| (i / width * m.height / height) * m.width + i % width * m.width / width;
    Ok((0..width * height).map(|i| u8::from(m.value(at(i) * c + channel) >= 0.5)).collect())
}

/// (H, W, 3): grey spread to three channels; straight alpha laid over the background.
fn composite(p: &Picture, background: [f32; 3]) -> Vec<f32> {
    let c = p.channels.len();
    let mut out = Vec::with_capacity(p.width * p.height * 3);
    for i in 0..p.width * p.height {
        let alpha = if c.is_multiple_of(2) { p.value(i * c + c - 1) } else { 1.0 };
        for channel in 0..3 {
            let x = p.value(i * c + if c < 3 { 0 } else { channel });
            out.push(if alpha == 1.0 { x } else { x * alpha + background[channel] * (1.0 - alpha) });
        }
    }
    out
}

/// Mean of s×s blocks: left fold over rows, then columns. Incomplete blocks at the right and bottom are cut
/// off.
fn box_mean(rgb: &[f32], stride: usize, width: usize, height: usize, s: usize) -> Vec<f32> {
    if s == 1 {
        return rgb.to_vec();
    }
    let count = (s * s) as f32;
    let mut out = Vec::with_capacity(width * height * 3);
    for row in 0..height {
        for column in 0..width {
            for c in 0..3 {
                let mut sum = 0.0f32;
                for y in row * s..(row + 1) * s {
                    for x in column * s..(column + 1) * s {
                        sum += rgb[3 * (y * stride + x) + c];
                    }
                }
                out.push(sum / count);
            }
        }
    }
    out
}

/// 1 where the whole block is 1.
fn box_all(mask: &[u8], stride: usize, width: usize, height: usize, s: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let all = (row * s..(row + 1) * s)
                .all(|y| (column * s..(column + 1) * s).all(|x| mask[y * stride + x] == 1));
            out.push(u8::from(all));
        }
    }
    out
}
