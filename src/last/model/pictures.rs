//! Training data read from a folder written by `last gen` (see `last::sets` for the layout).
//!
//! An image is cropped by a [`Window`], either the square around the projected points or the whole image,
//! over black, with values in −½ … ½. A point has the template coordinate t, is decoded as (t + Δ/2, ½ + c),
//! and is weighted by 1/σ² with σ = 0.05 in space and 0.2 in colour. The paper specifies none of these
//! constants.

use super::data::{Data, Frame, Group, Item};
use super::decoder::{CODE, code};
use super::encoder::Input;
use crate::io::npz;
use crate::last::avatar::guide::{Framing, Square, Window};
use crate::last::generate::RECORD;
use crate::loss::metric::structure::matching;
use crate::num::array::{Array, Arrays};
use crate::num::par;
use crate::scene::camera::{Camera, Model};
use crate::scene::from_data_gen;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// The points at rest, in every data set with images for training.
const TEMPLATE: &str = "template.npz";
/// σ of a coordinate.
const SIGMA_SPACE: f32 = 0.05;
/// σ of a colour.
const SIGMA_COLOUR: f32 = 0.2;
/// Scale of Δ.
const REACH: f32 = 0.5;

/// Images and points of one kind of item.
#[derive(Clone, Default)]
struct Set {
    /// Images, shape (N, S, S, 3).
    images: Vec<u8>,
    /// The cropped squares of the images, shape (N).
    squares: Vec<Square>,
    /// Coordinates and colours of the points, shape (N, P, 6).
    shown: Vec<f32>,
    /// True factors, shape (N, n).
    factors: Vec<f64>,
}

/// The images of a folder.
#[derive(Clone)]
pub struct Pictures {
    side: usize,
    framing: Framing,
    members: usize,
    frame: Frame,
    groups: Vec<Group>,
    observed: Set,
    base: Set,
    after: Set,
    /// The points at rest, shape (P, 3).
    pub template: Vec<[f32; 3]>,
    skeleton: Vec<i64>,
    /// Focal length of the camera in sides of an image; `None` for the camera of the figure.
    focal: Option<f32>,
}

impl std::fmt::Debug for Pictures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pictures({} observed, {} groups of {})", self.observed(), self.groups.len(), self.members)
    }
}

/// The frame of points with the given `template`.
pub fn frame(template: &[[f32; 3]]) -> Frame {
    Frame {
        features: CODE,
        outputs: 6,
        codes: code(template),
        base: template.iter().flat_map(|t| [t[0], t[1], t[2], 0.5, 0.5, 0.5]).collect(),
        scale: vec![REACH, REACH, REACH, 1.0, 1.0, 1.0],
        precision: [SIGMA_SPACE, SIGMA_COLOUR].iter().flat_map(|s| [1.0 / (s * s); 3]).collect(),
    }
}

/// Refuses a folder that is not a data set with images for training; the error describes what it is instead.
fn check(folder: &Path) -> Result<()> {
    let has = |name: &str| folder.join(name).exists();
    if has(TEMPLATE) {
        return Ok(());
    }
    let wrong = |got: &str| {
        Error::input(folder.display().to_string())
            .expected(format!("a data set of last gen ({TEMPLATE}, observational, interventions)"))
            .got(got)
    };
    const MAKE: &str = "`lastlight last gen --out DATA` makes one";
    let is_capture = ["transforms.json", "transforms_train.json", "body.npz"].into_iter().any(has);
    let above = folder.parent().filter(|above| above.join(TEMPLATE).exists());
    Err(match above {
        _ if !folder.exists() => Error::input(folder.display().to_string())
            .got("no such folder")
            .hint("`lastlight last gen --out DATA` makes a data set to train on"),
        _ if !folder.is_dir() => wrong("a file").hint(MAKE),
        Some(above) if is_capture => {
            let above = if above.as_os_str().is_empty() { Path::new(".") } else { above };
            wrong("a capture").hint(format!("the data set that contains it is {}", above.display()))
        }
        None if is_capture => wrong("a capture").hint(MAKE),
        _ if has(RECORD) => wrong("a data set without them")
            .hint("`lastlight last gen --split training --out DATA` makes them"),
        _ => wrong("another folder").hint(MAKE),
    })
}

/// Shards of a set, in order.
fn shards(folder: &Path) -> Result<Vec<PathBuf>> {
    let none = |got: &str| {
        Error::input(folder.display().to_string())
            .expected("shards 0000.npz, 0001.npz, …")
            .got(got)
            .hint("`lastlight last gen --split training --out DATA` makes them; --supervision none needs no interventions")
    };
    if !folder.exists() {
        return Err(none("no such folder"));
    }
    let entries = std::fs::read_dir(folder).map_err(|e| Error::os(folder, &e))?;
    let mut paths = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::os(folder, &e))?.path();
        if path.extension().is_some_and(|e| e == "npz") {
            paths.push(path);
        }
    }
    paths.sort();
    if paths.is_empty() { Err(none("none")) } else { Ok(paths) }
}

/// Settings of the crop.
struct Seeing {
    camera: Camera,
    framing: Framing,
}

impl Seeing {
    /// The crop of an image of points; the whole image if the points have no projection in it.
    fn square(&self, points: &[[f32; 3]]) -> Square {
        let size = [self.camera.height, self.camera.width];
        let person = Square::around(&self.camera, points);
        self.framing.square(size, person).unwrap_or_else(|| Square::whole(size))
    }
}

impl Set {
    /// Adds the items of a shard: arrays `prefix`images, points, rgb, u.
    fn take(&mut self, arrays: &Arrays, prefix: &str, how: &Seeing, points: usize) -> Result<()> {
        let side = how.camera.width;
        let need = |name: &str| arrays.need(&format!("{prefix}{name}"));
        let images = need("images")?;
        let [cloud, rgb] = [need("points")?, need("rgb")?];
        let items = images.len() / (side * side * 3);
        let fits = images.len() == items * side * side * 3
            && cloud.len() == items * points * 3
            && rgb.len() == cloud.len();
        if !fits || images.shape().iter().rev().take(3).ne([3, side, side].iter()) {
            return Err(Error::input(format!("arrays '{prefix}images', '{prefix}points', '{prefix}rgb'"))
                .expected(format!("images of {side}×{side} and {points} points each"))
                .got(format!("{:?}, {:?}, {:?}", images.shape(), cloud.shape(), rgb.shape())));
        }
        arrays.finite([&*format!("{prefix}points"), &format!("{prefix}rgb"), &format!("{prefix}u")])?;
        self.images.extend(images.to_i64().into_iter().flatten().map(|b| b as u8));
        let cloud = cloud.to_f32();
        self.squares
            .extend(par::map(items, |i| how.square(cloud[i * points * 3..][..points * 3].as_chunks().0)));
        for (x, c) in cloud.chunks_exact(3).zip(rgb.to_f32().chunks_exact(3)) {
            self.shown.extend_from_slice(x);
            self.shown.extend_from_slice(c);
        }
        let factors = need("u")?;
        let each = factors.shape().last().copied().unwrap_or(0);
        if each > matching::MOST || factors.len() != items * each {
            return Err(Error::input(format!("array '{prefix}u'"))
                .expected(format!("up to {} factors of {items} images", matching::MOST))
                .got(format!("{:?}", factors.shape())));
        }
        self.factors.extend(factors.to_f64());
        Ok(())
    }
}

impl Pictures {
    /// Reads a folder; `groups` determines whether interventions are required, `framing` which part of an
    /// image is used.
    ///
    /// # Errors
    /// If the folder is not a data set, a file is missing or malformed, or images or point sets have different
    /// sizes.
    pub fn read(folder: &Path, groups: bool, framing: Framing) -> Result<Self> {
        check(folder)?;
        let path = folder.join(TEMPLATE);
        let rest = npz::read(&path)?;
        let points = rest.need("points").map_err(|e| e.within(path.display().to_string()))?;
        let focal = rest.get("focal").and_then(|f| f.to_f32().first().copied());
        let skeleton = rest.get("parents").and_then(Array::to_i64).unwrap_or_default();
        let template: Vec<[f32; 3]> = points.to_f32().chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        let p = template.len();
        let mut all = Self {
            side: 0,
            framing,
            members: 0,
            frame: frame(&template),
            groups: Vec::new(),
            observed: Set::default(),
            base: Set::default(),
            after: Set::default(),
            template,
            skeleton,
            focal,
        };
        for path in shards(&folder.join("observational"))? {
            let arrays = npz::read(&path)?;
            let within = |e: Error| e.within(path.display().to_string());
            if all.side == 0 {
                all.side = arrays.need("images").map_err(within)?.shape().get(1).copied().unwrap_or(0);
            }
            if all.side == 0 {
                return Err(within(
                    Error::input("array 'images'").expected("images").got("images with a side of 0 pixels"),
                ));
            }
            let how = all.seeing();
            all.observed.take(&arrays, "", &how, p).map_err(within)?;
        }
        if groups {
            for path in shards(&folder.join("interventions"))? {
                let arrays = npz::read(&path)?;
                all.take_groups(&arrays).map_err(|e| e.within(path.display().to_string()))?;
            }
        }
        Ok(all)
    }

    fn take_groups(&mut self, arrays: &Arrays) -> Result<()> {
        let targets = arrays.need("target")?;
        let values = arrays.need("value")?.to_f64();
        let members = arrays.need("base_images")?.shape().get(1).copied().unwrap_or(0);
        let targets = targets.to_i64().unwrap_or_default();
        let negative = targets.iter().any(|&t| t < 0);
        if negative || targets.len() != values.len() || (self.members != 0 && self.members != members) {
            return Err(Error::input("arrays 'target', 'value', 'base_images'")
                .expected("one factor and one value per group, groups of one size")
                .got(format!("{} factors, {} values, groups of {members}", targets.len(), values.len())));
        }
        self.members = members;
        let group = |(&target, &value): (&i64, &f64)| Group { target: target as usize, value };
        self.groups.extend(targets.iter().zip(&values).map(group));
        let how = self.seeing();
        self.base.take(arrays, "base_", &how, self.template.len())?;
        self.after.take(arrays, "after_", &how, self.template.len())
    }

    fn seeing(&self) -> Seeing {
        Seeing { camera: self.camera(), framing: self.framing }
    }

    /// Side of the images.
    pub fn side(&self) -> usize {
        self.side
    }

    /// The camera of the images.
    pub fn camera(&self) -> Camera {
        let camera = from_data_gen::camera(&data_gen::figure::video::camera(0, self.side), Model::Pinhole);
        let focal_px = self.focal.map_or(camera.focal_px, |f| [f * self.side as f32; 2]);
        Camera { focal_px, ..camera }
    }

    fn find(&self, item: Item) -> (&Set, usize) {
        match item {
            Item::Observed(i) => (&self.observed, i),
            Item::Base(g, m) => (&self.base, g * self.members + m),
            Item::After(g, m) => (&self.after, g * self.members + m),
        }
    }

    /// The window that crops an image.
    pub fn window(&self, item: Item) -> Window {
        let (set, at) = self.find(item);
        set.squares[at].window(self.side, [self.side; 2])
    }

    /// The encoder input (S, S, 3) of an item, with values in 0 … 1.
    pub fn seen(&self, item: Item) -> Vec<f32> {
        let (set, at) = self.find(item);
        let size = self.side * self.side * 3;
        let picture: Vec<f32> =
            set.images[at * size..][..size].iter().map(|b| f32::from(*b) / 255.0).collect();
        self.window(item).take(&picture)
    }
}

impl Data for Pictures {
    fn input(&self) -> Input {
        Input::Picture { side: self.side }
    }

    fn observed(&self) -> usize {
        self.observed.squares.len()
    }

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn members(&self) -> usize {
        self.members
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn template(&self) -> &[[f32; 3]] {
        &self.template
    }

    fn skeleton(&self) -> &[i64] {
        &self.skeleton
    }

    fn write_input(&self, item: Item, into: &mut [f32]) {
        for (into, seen) in into.iter_mut().zip(self.seen(item)) {
            *into = seen - 0.5;
        }
    }

    fn true_factors(&self) -> usize {
        self.observed.factors.len() / Ord::max(1, self.observed())
    }

    fn truth(&self, item: Item) -> &[f64] {
        let (set, at) = self.find(item);
        let n = self.true_factors();
        &set.factors[at * n..(at + 1) * n]
    }

    fn shown(&self, item: Item) -> &[f32] {
        let (set, at) = self.find(item);
        let size = self.template.len() * 6;
        &set.shown[at * size..][..size]
    }
}
