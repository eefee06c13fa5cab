//! A character from a file as the subject of a data set: `last gen --character`.
//!
//! The factors act as described in `scene::character`: u_P mixes two poses, u_O bends an elbow, u_W folds the
//! surface, u_L moves the light; further factors have no effect. The pose of a frame is a function of its
//! factors only, so the graph is the causal truth about the images; with `play`, the animations are also
//! played, one loop of the first over the video. Images of the sets use the camera of the video; they may
//! crop a pose that differs strongly from all poses of the video.

pub use super::character_settings::CharacterSettings;
use super::image_source::{ImageSource, Surfaces};
use super::points::{Dots, Points, SIGMA};
use super::settings::Settings;
use super::subject::Subject;
use crate::math::knn;
use crate::num::array::Arrays;
use crate::num::bits::Digest;
use crate::num::{order, par};
use crate::scene::camera::{Camera, Model};
use crate::scene::character::{Character, Factors, Pose, Template};
use crate::scene::from_data_gen;
use crate::scene::mesh::Object;
use crate::{Error, Result};
use data_gen::figure::factors::Drive;
use data_gen::figure::mechanism::Scm;
use data_gen::figure::samples::Frame;
use data_gen::figure::video;
use serde_json::{Value, json};

/// Height in the figure frame: 1.7 m divided by 0.85 m.
pub const HEIGHT: f64 = 2.0;

/// Largest fraction of the image that the subject may fill when it is nearest to the camera.
const FILL: f64 = 0.95;

/// Digest of the surface, the materials and their images, the weights, and the joints in every frame. It
/// distinguishes two files of the same name.
fn digest(c: &Character, poses: &[Pose]) -> u64 {
    let mut d = Digest::new();
    let object = c.object();
    let mesh = &object.mesh;
    for x in [mesh.positions.as_flattened(), mesh.normals.as_flattened(), mesh.uvs.as_flattened()]
        .into_iter()
        .flatten()
    {
        d.bytes(&x.to_bits().to_le_bytes());
    }
    mesh.triangles.as_flattened().iter().for_each(|i| d.bytes(&i.to_le_bytes()));
    object.material_of.iter().for_each(|m| d.bytes(&m.to_le_bytes()));
    for m in &object.materials {
        for x in m.base_color.iter().chain(&m.emission).chain([&m.roughness, &m.metallic]) {
            d.bytes(&x.to_bits().to_le_bytes());
        }
        let bumps = m.normal_map.as_ref().map(|(map, _)| map);
        let maps = [&m.base_color_map, &m.metallic_roughness_map, &m.emission_map].into_iter().flatten();
        for map in maps.chain(bumps) {
            d.bytes(map.texels.as_flattened());
        }
    }
    for (joints, weights) in c.influences() {
        joints.iter().for_each(|j| d.bytes(&j.to_le_bytes()));
        weights.iter().for_each(|w| d.bytes(&w.to_bits().to_le_bytes()));
    }
    for joint in c.joints() {
        d.bytes(joint.name.as_bytes());
    }
    for t in poses.iter().flat_map(|pose| c.transforms(pose)) {
        t.as_flattened().iter().for_each(|x| d.bytes(&x.to_bits().to_le_bytes()));
    }
    d.value()
}

/// A character used as the subject of a data set.
#[derive(Debug)]
pub struct CharacterSubject {
    character: Character,
    template: Template,
    dots: Dots,
    factors: Factors,
    /// Factors of the frames, shape (T).
    frames: Vec<Vec<f64>>,
    /// Poses of the frames, shape (T).
    poses: Vec<Pose>,
    /// Scale of the focal length, so that the whole character is visible in every frame.
    zoom: f64,
    record: Value,
}

impl CharacterSubject {
    /// Reads the character and computes its frames: factors as for the built-in figure with the same
    /// settings, T frames, a template of P points.
    ///
    /// # Errors
    /// If the file is invalid or does not contain a requested name.
    pub fn new(casting: &CharacterSettings, scm: &Scm, settings: &Settings) -> Result<Self> {
        let mut character = Character::read(&casting.file)?;
        let hide: Vec<&str> = casting.hide.iter().map(String::as_str).collect();
        character.hide(&hide)?;
        character.fit(HEIGHT)?;
        let (first, second) = match casting.animations.as_slice() {
            [one] => (one, None),
            [one, two] => (one, Some(two.as_str())),
            other => {
                let e = Error::input("--animation").expected("one or two names").got(other.len().to_string());
                return Err(e.hint(format!("the file has {}", character.animations().join(", "))));
            }
        };
        let factors = Factors::of(&character, first, second, casting.elbow.as_deref())?;
        let template = character.template(settings.points, settings.seed)?;
        let dots = Dots::new(spacing(&single(template.points.iter().map(|p| p.position)))?);
        let loop_length = character.duration(factors.first.0);
        let (seed, subject, count) = (settings.seed, settings.subject, settings.frames);
        let frames: Vec<Vec<f64>> =
            (0..count).map(|t| video::frame(scm, seed, subject, t, count).u).collect();
        let poses: Vec<Pose> = frames
            .iter()
            .enumerate()
            .map(|(t, u)| {
                let later = if casting.play { t as f64 / frames.len() as f64 * loop_length } else { 0.0 };
                character.pose_of(&factors, later, u)
            })
            .collect::<Result<_>>()?;
        let reaches = par::map(frames.len(), |t| reach(&character, &poses[t], &frames[t]));
        let mut largest = 0.0f64;
        for r in reaches {
            largest = order::max(largest, r?);
        }
        // A point at distance r from the axis is at most r·R/(R − r) from the centre of an image.
        let seen = if largest < 0.8 * video::RADIUS {
            largest * video::RADIUS / (video::RADIUS - largest)
        } else {
            f64::INFINITY
        };
        if !seen.is_finite() {
            return Err(Error::input(character.name().to_owned())
                .at("animation")
                .expected("a character that stays near the vertical axis")
                .got(format!("one that moves {largest:.2} units away from it (the height of the character is {HEIGHT} units)")));
        }
        let focal = from_data_gen::camera(&video::camera(0, 2), Model::Pinhole).focal_px[0];
        let zoom = order::min(1.0, FILL * video::RADIUS / (f64::from(focal) * seen));
        let elbow = factors.elbow.map(|j| character.joints()[j].name.clone());
        let record = json!({
            "kind": "character", "file": casting.name(), "digest": format!("{:016x}", digest(&character, &poses)), "animations": casting.animations, "elbow": elbow,
            "hide": casting.hide, "play": casting.play, "joints": character.joints().iter().map(|j| &j.name).collect::<Vec<_>>(),
            "vertices": character.object().mesh.positions.len(), "triangles": character.object().mesh.triangles.len(),
        });
        Ok(Self { character, template, dots, factors, frames, poses, zoom, record })
    }

    /// The meaning of its factors.
    pub fn meaning(&self) -> &Factors {
        &self.factors
    }

    /// The character, with a height of 2.
    pub fn character(&self) -> &Character {
        &self.character
    }
}

/// The largest coordinate of a frame, and the largest distance from the vertical axis.
fn reach(c: &Character, pose: &Pose, u: &[f64]) -> Result<f64> {
    let o = c.posed(pose, &Drive::new(u))?;
    let far = |m: f64, p: &[f32; 3]| {
        let [x, y, z] = p.map(f64::from);
        order::max(m, order::max((x * x + y * y).sqrt(), z.abs()))
    };
    Ok(o.mesh.positions.iter().fold(0.0, far))
}

impl Subject for CharacterSubject {
    fn frames(&self) -> usize {
        self.frames.len()
    }

    fn body(&self) -> Arrays {
        let (p, k) = (self.template.points.len(), self.character.joints().len());
        let mut weights = vec![0.0f32; p * k];
        for (i, point) in self.template.points.iter().enumerate() {
            for (&j, &w) in point.joints.iter().zip(&point.weights) {
                if w > 0.0 {
                    weights[i * k + usize::from(j)] = w as f32;
                }
            }
        }
        let points = &self.template.points;
        let bone: Vec<i32> = weights.chunks_exact(k).map(|w| first_largest(w) as i32).collect();
        let joints = self.character.joints();
        let rest: Vec<f32> = joints.iter().flat_map(|j| square(&j.rest())).flatten().collect();
        Arrays::new()
            .with("points", &[p, 3], single(points.iter().map(|p| p.position)).into_flattened())
            .with("normals", &[p, 3], single(points.iter().map(|p| p.normal)).into_flattened())
            .with("weights", &[p, k], weights)
            .with("bone", &[p], bone)
            .with(
                "parents",
                &[k],
                joints.iter().map(|j| j.parent.map_or(-1, |p| p as i32)).collect::<Vec<i32>>(),
            )
            .with("joints", &[k, 3], single(joints.iter().map(|j| j.position())).into_flattened())
            .with("spacing", &[p], self.dots.spacing.iter().map(|&s| s as f32).collect::<Vec<f32>>())
            .with("sigma", &[p], self.dots.spacing.iter().map(|s| (SIGMA * s) as f32).collect::<Vec<f32>>())
            .with("rest", &[k, 4, 4], rest)
    }

    fn transforms(&self, t: usize) -> Vec<[[f32; 4]; 4]> {
        self.character.transforms(&self.poses[t]).iter().map(square).collect()
    }

    fn factors(&self, t: usize) -> Vec<f64> {
        self.frames[t].clone()
    }

    fn object(&self, t: usize) -> Result<Object> {
        self.character.posed(&self.poses[t], &Drive::new(&self.frames[t]))
    }

    fn light_azimuth(&self, t: usize) -> f64 {
        Drive::new(&self.frames[t]).light_azimuth
    }

    fn camera(&self, index: usize, side: usize) -> Camera {
        let mut camera = from_data_gen::camera(&video::camera(index, side), Model::Pinhole);
        camera.focal_px = camera.focal_px.map(|f| (f64::from(f) * self.zoom) as f32);
        camera
    }

    fn record(&self) -> Value {
        self.record.clone()
    }
}

impl ImageSource for CharacterSubject {
    fn dots(&self) -> &Dots {
        &self.dots
    }

    fn rest(&self) -> Arrays {
        let mut arrays = self.body();
        let side = 2;
        arrays.put("focal", &[1], vec![ImageSource::camera(self, side).focal_px[0] / side as f32]);
        arrays
    }

    fn points(&self, frame: &Frame) -> Result<Points> {
        let pose = self.character.pose_of(&self.factors, 0.0, &frame.u)?;
        Ok(Points::from(&self.character.cloud(&self.template, &pose, &Drive::new(&frame.u))))
    }

    fn camera(&self, side: usize) -> Camera {
        Subject::camera(self, 0, side)
    }

    fn surfaces<'a>(&'a self, frames: &'a [&'a Frame]) -> Surfaces<'a> {
        Box::new(|i| {
            let pose = self.character.pose_of(&self.factors, 0.0, &frames[i].u)?;
            self.character.posed(&pose, &Drive::new(&frames[i].u))
        })
    }
}

fn single(rows: impl Iterator<Item = [f64; 3]>) -> Vec<[f32; 3]> {
    rows.map(|r| r.map(|x| x as f32)).collect()
}

/// Mean distance to the three nearest other points, summed from the nearest, shape (P); to fewer if there are
/// not enough points.
fn spacing(points: &[[f32; 3]]) -> Result<Vec<f64>> {
    let mean = |near: &[(f64, u32); 3]| {
        let there = near.iter().filter(|n| **n != knn::NONE);
        let (sum, count) = there.fold((0.0, 0.0), |(s, n), (square, _)| (s + square.sqrt(), n + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    };
    Ok(knn::neighbours::<3>(points)?.iter().map(mean).collect())
}

/// Index of the first of the largest entries.
fn first_largest(row: &[f32]) -> usize {
    (1..row.len()).fold(0, |best, i| if row[i] > row[best] { i } else { best })
}

/// The matrix with its last row, in single precision.
fn square(a: &[[f64; 4]; 3]) -> [[f32; 4]; 4] {
    let row = |r: [f64; 4]| r.map(|x| x as f32);
    [row(a[0]), row(a[1]), row(a[2]), [0.0, 0.0, 0.0, 1.0]]
}
