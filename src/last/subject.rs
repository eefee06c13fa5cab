//! The interface of a moving person as a subject, and the capture generated from it.
//!
//! # Layout of a subject's capture
//! ```text
//! transforms_train.json   the training camera in every frame          see `fit::passes`
//! transforms_test.json    the test cameras in every 30th frame
//! images/cCC_fTTTT.png    camera CC, frame TTTT, sRGB-encoded on black
//! foreground/…            coverage
//! body.npz                template, weights, poses, factors
//! ```
//! Frames of `transforms_*.json` have the additional keys `frame` (0 … T−1), `time` (frame/T), `camera`
//! (number on the ring) and `factors`.
//!
//! `body.npz`: `points`, `normals` (P,3) at rest, `weights` (P,K), `bone` (P) i32 (figure: the bone on which
//! a point lies; character: the joint of largest weight, the first of several), `parents` (K) i32 (−1: none),
//! `joints` (K,3) at rest, `spacing` (P) mean distance to the three nearest points at rest, `sigma` (P)
//! standard deviation of the isotropic Gaussians that represent the points ([`figure::SIGMA`] × spacing,
//! opacity [`figure::OPACITY`]), `rest` (K,4,4) world-from-bone at rest, `transforms` (T,K,4,4) posed from
//! rest, `factors` (T,n) f64. A posed point is Σ_b w_b transforms_b · x; displacements of the surface (folds,
//! width, skirt) are applied to x before that, see `data_gen::figure::template::Template::canonical`.

use super::figure::{self, ClothedFigure, Figures, Photo, Points, Rendering};
use super::folder::digest;
use super::progress::{Progress, check_stop};
use super::settings::Settings;
use crate::fit::passes::{PassSet, Recorder, Shot, Style};
use crate::geometry::bvh::Bvh;
use crate::io::capture::Split;
use crate::io::{atomic, npz};
use crate::num::array::Arrays;
use crate::scene::camera::{Camera, Model};
use crate::scene::from_data_gen;
use crate::scene::material::linear_of_srgb;
use crate::scene::mesh::Object;
use crate::shade::render::Passes;
use crate::{Error, Result};
use data_gen::figure::appearance::Appearance;
use data_gen::figure::factors::Drive;
use data_gen::figure::mechanism::Scm;
use data_gen::figure::purpose::PICTURE_VIDEO;
use data_gen::figure::samples::Frame;
use data_gen::figure::skeleton::{BONES, bones, pose};
use data_gen::figure::video;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// A moving person: the built-in figure, or a character from a file.
pub trait Subject: Sync {
    /// Number of frames T.
    fn frames(&self) -> usize;

    /// The arrays of `body.npz` that do not depend on the frame: all except `transforms` and `factors`.
    fn body(&self) -> Arrays;

    /// Posed-from-rest transforms of the K bones in frame t, row-major.
    fn transforms(&self, t: usize) -> Vec<[[f32; 4]; 4]>;

    /// Factors of frame t.
    fn factors(&self, t: usize) -> Vec<f64>;

    /// Surfaces in frame t.
    ///
    /// # Errors
    /// If the surfaces cannot be generated.
    fn object(&self, t: usize) -> Result<Object>;

    /// Azimuth of the sun in frame t, rad; 0 is in front of the subject.
    fn light_azimuth(&self, t: usize) -> f64;

    /// Camera `index` of the ring, where 0 is the training camera; images are square with the given side.
    fn camera(&self, index: usize, side: usize) -> Camera;

    /// The description of the subject in the record of the data.
    fn record(&self) -> Value;

    /// Render passes of frame t from several cameras, each with the seed of its samples, over black; `taken`
    /// receives those of camera 0, 1, … as soon as they are rendered.
    ///
    /// # Errors
    /// If surfaces or cameras are invalid, or `taken` fails.
    fn passes(&self, t: usize, cameras: &[(Camera, u64)], samples: u32, taken: &mut Taken<'_>) -> Result<()> {
        surfaces(&self.object(t)?, self.light_azimuth(t), cameras, samples, taken)
    }
}

/// A function that receives the number of a camera and its passes.
pub type Taken<'a> = dyn FnMut(usize, Passes) -> Result<()> + 'a;

/// Passes of an object under sun and sky, with direct light and one bounce.
fn surfaces(
    object: &Object,
    azimuth: f64,
    cameras: &[(Camera, u64)],
    samples: u32,
    taken: &mut Taken<'_>,
) -> Result<()> {
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    cameras.iter().enumerate().try_for_each(|(i, (camera, seed))| {
        taken(i, figure::passes(object, &bvh, azimuth, camera, &figure::lighting(samples, *seed))?)
    })
}

/// An image of points as passes: its colours converted to linear, and its mask.
fn flat(photo: &Photo, camera: &Camera) -> Passes {
    let table = linear_of_srgb();
    let pixels = camera.width * camera.height;
    Passes {
        width: camera.width,
        height: camera.height,
        color: photo.image.as_chunks::<3>().0.iter().map(|c| c.map(|b| table[usize::from(b)])).collect(),
        alpha: photo.mask.iter().map(|&b| f32::from(b) * (1.0 / 255.0)).collect(),
        depth_z: vec![0.0; pixels],
        normal: vec![[0.0; 3]; pixels],
        albedo: vec![[0.0; 3]; pixels],
        roughness: vec![0.0; pixels],
        metallic: vec![0.0; pixels],
    }
}

/// Settings of the images of a subject.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureJob {
    /// Side in pixels.
    pub size: usize,
    /// Number of samples per pixel.
    pub samples: u32,
    /// Numbers of the test cameras on the ring.
    pub test_cameras: Vec<usize>,
    /// Test cameras render every n-th frame, with this n.
    pub test_step: usize,
    /// Whether to include depth, normals, albedo, material and linear radiance.
    pub passes: PassSet,
    /// Seed of the draws.
    pub seed: u64,
}

impl CaptureJob {
    /// The shots of frame t.
    fn shots(&self, subject: &dyn Subject, t: usize) -> Vec<(Shot, u64)> {
        let train = std::iter::once((0, Split::Train));
        let is_test = t.is_multiple_of(self.test_step);
        let test = self.test_cameras.iter().filter(|_| is_test).map(|&c| (c, Split::Test));
        let (count, factors) = (subject.frames(), subject.factors(t));
        train
            .chain(test)
            .map(|(c, split)| {
                let extra: Map<String, Value> = [
                    ("frame", json!(t)),
                    ("time", json!(t as f64 / count as f64)),
                    ("camera", json!(c)),
                    ("factors", json!(factors)),
                ]
                .map(|(key, value)| (key.to_owned(), value))
                .into_iter()
                .collect();
                let camera = subject.camera(c, self.size);
                let shot =
                    Shot { name: format!("c{c:02}_f{t:04}"), camera, shutter_close: None, split, extra };
                // One stream of samples per image.
                let seed = figure::picture_seed(self.seed, PICTURE_VIDEO, (t * 64 + c) as u64);
                (shot, seed)
            })
            .collect()
    }
}

/// Generates the capture of a subject in a folder; returns the paths of written files, relative to the parent
/// folder, with digests: the folder with all images and cameras ([`Recorder::finish`]), and `body.npz`.
///
/// # Errors
/// If an image cannot be rendered or written, the folder contains another set, or `stop` was set.
pub fn write(
    subject: &dyn Subject,
    shoot: &CaptureJob,
    dir: &Path,
    resume: bool,
    stop: &AtomicBool,
    progress: &mut Progress<'_>,
) -> Result<Vec<(PathBuf, u64)>> {
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    let header = Map::from_iter([
        ("subject".to_owned(), subject.record()),
        (
            "shoot".to_owned(),
            json!({
                "frames": subject.frames(), "size": shoot.size, "samples": shoot.samples, "seed": shoot.seed,
                "test_cameras": shoot.test_cameras, "test_step": shoot.test_step, "passes": shoot.passes.record(),
            }),
        ),
    ]);
    let mut recorder = Recorder::open(dir, header, resume)?;
    let style = Style { exposure: 1.0, transparent: false, passes: shoot.passes };
    let frames: Vec<Vec<(Shot, u64)>> = (0..subject.frames()).map(|t| shoot.shots(subject, t)).collect();
    let total = frames.iter().fold(0, |sum, shots| sum + shots.len());
    let mut done = 0;
    for (t, shots) in frames.iter().enumerate() {
        check_stop(stop)?;
        progress(done, total, "video");
        let mut missing = Vec::new();
        for shot in shots {
            if !recorder.has(&shot.0)? {
                missing.push(shot);
            }
        }
        done += shots.len() - missing.len();
        if missing.is_empty() {
            continue;
        }
        let cameras: Vec<(Camera, u64)> = missing.iter().map(|(s, seed)| (s.camera.clone(), *seed)).collect();
        subject.passes(t, &cameras, shoot.samples, &mut |i, passes| {
            recorder.put(&missing[i].0, &passes, &style)?;
            done += 1;
            progress(done, total, "video");
            check_stop(stop)
        })?;
    }
    let body = npz::to_bytes(&body_arrays(subject), npz::Packing::Stored)?;
    atomic::write_bytes(&dir.join("body.npz"), &body)?;
    let order: Vec<Shot> = frames.into_iter().flatten().map(|(shot, _)| shot).collect();
    let pictures = recorder.finish(&order)?;
    progress(total, total, "video");
    let folder = PathBuf::from(dir.file_name().unwrap_or_default());
    let body_file = folder.join("body.npz");
    Ok(vec![(folder, pictures), (body_file, digest(&body))])
}

fn body_arrays(subject: &dyn Subject) -> Arrays {
    let count = subject.frames();
    let poses: Vec<Vec<[[f32; 4]; 4]>> = (0..count).map(|t| subject.transforms(t)).collect();
    let factors: Vec<Vec<f64>> = (0..count).map(|t| subject.factors(t)).collect();
    let (k, n) = (poses.first().map_or(0, Vec::len), factors.first().map_or(0, Vec::len));
    let mut arrays = subject.body();
    arrays.put(
        "transforms",
        &[count, k, 4, 4],
        poses.iter().flatten().flatten().flatten().copied().collect::<Vec<f32>>(),
    );
    arrays.put("factors", &[count, n], factors.into_iter().flatten().collect::<Vec<f64>>());
    arrays
}

/// The built-in figure as a subject.
#[derive(Debug)]
pub struct BuiltIn {
    frames: Vec<Frame>,
    appearance: Appearance,
    person: ClothedFigure,
    figures: Figures,
    look: Rendering,
    number: u64,
}

impl BuiltIn {
    /// The subject that the settings describe.
    pub fn new(settings: &Settings, scm: &Scm) -> Self {
        let appearance = Appearance::new(settings.seed, settings.subject);
        Self {
            frames: (0..settings.frames)
                .map(|t| video::frame(scm, settings.seed, settings.subject, t, settings.frames))
                .collect(),
            person: ClothedFigure::new(&appearance),
            appearance,
            figures: Figures::new(settings.points, settings.seed),
            look: settings.video_look,
            number: settings.subject,
        }
    }

    fn drive(&self, t: usize) -> Drive {
        Drive::new(&self.frames[t].u)
    }
}

impl Subject for BuiltIn {
    fn frames(&self) -> usize {
        self.frames.len()
    }

    fn body(&self) -> Arrays {
        figure::template_arrays(&self.figures)
    }

    fn transforms(&self, t: usize) -> Vec<[[f32; 4]; 4]> {
        let posed: [_; BONES] = pose(&bones(), &self.drive(t));
        let single = |row: [f64; 4]| row.map(|x| x as f32);
        posed.map(|g| [single(g[0]), single(g[1]), single(g[2]), [0.0, 0.0, 0.0, 1.0]]).to_vec()
    }

    fn factors(&self, t: usize) -> Vec<f64> {
        self.frames[t].u.clone()
    }

    fn object(&self, t: usize) -> Result<Object> {
        Ok(self.person.object(&self.drive(t)))
    }

    fn light_azimuth(&self, t: usize) -> f64 {
        self.drive(t).light_azimuth
    }

    fn camera(&self, index: usize, side: usize) -> Camera {
        from_data_gen::camera(&video::camera(index, side), Model::Pinhole)
    }

    fn record(&self) -> Value {
        let a = &self.appearance;
        json!({
            "kind": "figure", "number": self.number, "look": self.look.name(),
            "pattern": format!("{:?}", a.pattern).to_lowercase(), "bottom": format!("{:?}", a.bottom).to_lowercase(),
            "long_hair": a.long_hair, "long_sleeves": a.long_sleeves,
        })
    }

    fn passes(&self, t: usize, cameras: &[(Camera, u64)], samples: u32, taken: &mut Taken<'_>) -> Result<()> {
        if self.look == Rendering::Mesh {
            return surfaces(&self.object(t)?, self.light_azimuth(t), cameras, samples, taken);
        }
        let points = Points::from(&self.figures.template.posed(&self.drive(t), &self.appearance));
        cameras.iter().enumerate().try_for_each(|(i, (camera, _))| {
            taken(i, flat(&self.figures.dots.photo(&points, camera, self.look)?, camera))
        })
    }
}
