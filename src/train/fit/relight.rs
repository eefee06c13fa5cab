//! Renders a model under given lighting from given cameras: images with their passes, on disk as a capture.
//!
//! The header of a set ends with a digest of model, lighting and cameras. A run is therefore continued only
//! if their contents are unchanged, independently of the paths of the files they were read from.

use super::earlier;
use super::frames;
use super::orbit::Orbit;
use super::passes::{PassSet, Recorder, Shot, Style};
use crate::geometry::bvh::Bvh;
use crate::io::capture::Split;
use crate::num::bits::Digest;
use crate::num::{order, rng};
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::scene::light::Lights;
use crate::scene::material::{Material, Texture};
use crate::scene::mesh::{Mesh, Object};
use crate::shade::exposure;
use crate::shade::render::{Scene, Settings, render};
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Purpose of the samples of an image; the item is the image.
const PURPOSE: u16 = 0x0520;

/// Factor from radiance to the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// [`exposure::auto`] of each image
    Auto,
    /// the same factor for all images
    Fixed(f32),
}

/// What to render, and the settings.
#[derive(Clone, Debug)]
pub struct Relight<'a> {
    /// The model.
    pub object: &'a Object,
    /// The lighting.
    pub lights: &'a Lights,
    /// Samples, bounces, seed; image i uses the seed that [`rng::derive`] makes of this one and i.
    pub settings: Settings,
    /// Exposure of the images.
    pub exposure: Exposure,
    /// Whether images show only the model and have an alpha channel.
    pub transparent: bool,
    /// What is written in addition to photo and foreground.
    pub passes: PassSet,
}

impl Relight<'_> {
    /// Renders the missing shots into `dir` and returns the digest of the set. `header` is the top level of
    /// `transforms.json` and must be unchanged when a set is continued; the key `contents` is added with the
    /// digest of model, lighting and cameras.
    ///
    /// With `resume`, an empty folder is started, and one with files must hold a run with the same header.
    /// Without `resume`, the results of a previous run with such a header are removed first; a capture of
    /// another kind is an error. On such errors no folder is created.
    ///
    /// # Errors
    /// When model, lighting or a camera is not valid, a file cannot be written, two shots share a name, the
    /// folder holds other files, or `stop` was set.
    pub fn to_folder(
        &self,
        shots: &[Shot],
        dir: &Path,
        mut header: Map<String, Value>,
        resume: bool,
        stop: &AtomicBool,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<u64> {
        let mut names: Vec<&str> = shots.iter().map(|s| s.name.as_str()).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
            let e = Error::input("cameras").at(format!("name '{}'", twice[0]));
            return Err(e.expected("different names").got("two cameras with the same name"));
        }
        // 52 bytes per pixel of passes, once more in tiles, and their files.
        shots.iter().try_for_each(|shot| frames::check_memory(&shot.camera, 200, 0))?;
        let bvh = Bvh::build(&self.object.mesh.positions, &self.object.mesh.triangles);
        let scene = Scene::new(self.object, &bvh, self.lights)?;
        if resume {
            earlier::check_begun(dir)?;
        } else {
            earlier::check_ours(dir, &header)?;
        }
        header.insert("contents".to_owned(), json!(format!("{:016x}", self.contents(shots))));
        let mut recorder = Recorder::open(dir, header, resume)?;
        for (i, shot) in shots.iter().enumerate() {
            if stop.load(Ordering::Relaxed) {
                return Err(Error::interrupted("rendering").hint("continue with --resume"));
            }
            progress(i, shots.len());
            if recorder.has(shot)? {
                continue;
            }
            let seed = rng::derive(self.settings.seed, i as u64, PURPOSE);
            let settings = Settings { seed, ..self.settings };
            let passes = render(&scene, &shot.camera, shot.shutter_close.as_ref(), &settings)?;
            let exposure = match self.exposure {
                Exposure::Auto => exposure::auto(&passes.color, &passes.alpha),
                Exposure::Fixed(x) => x,
            };
            recorder.put(
                shot,
                &passes,
                &Style { exposure, transparent: self.transparent, passes: self.passes },
            )?;
        }
        progress(shots.len(), shots.len());
        recorder.finish(shots)
    }
}

impl Relight<'_> {
    /// FNV-1a 64 of everything that the images depend on except the settings: surface, materials and their
    /// textures, lighting, cameras.
    fn contents(&self, shots: &[Shot]) -> u64 {
        let mut d = Digest::new();
        let mesh = &self.object.mesh;
        let rows = [mesh.positions.as_flattened(), mesh.normals.as_flattened(), mesh.uvs.as_flattened()];
        rows.into_iter().for_each(|x| floats(&mut d, x));
        d.u64(mesh.triangles.len() as u64);
        mesh.triangles.as_flattened().iter().for_each(|i| d.bytes(&i.to_le_bytes()));
        self.object.material_of.iter().for_each(|m| d.bytes(&m.to_le_bytes()));
        let mut seen = Vec::new();
        self.object.materials.iter().for_each(|m| material(&mut d, m, &mut seen));
        if let Some(map) = &self.lights.environment {
            d.u64(map.width as u64);
            floats(&mut d, map.radiance.as_flattened());
        }
        d.bytes(format!("{:?} {shots:?}", self.lights.lamps).as_bytes());
        d.value()
    }
}

/// Their number, then their bits.
fn floats(d: &mut Digest, x: &[f32]) {
    d.u64(x.len() as u64);
    x.iter().for_each(|x| d.bytes(&x.to_bits().to_le_bytes()));
}

/// Factors, then for each map its index among the textures `seen` so far, and the texels of a new one.
fn material<'a>(d: &mut Digest, m: &'a Material, seen: &mut Vec<&'a Arc<Texture>>) {
    let strength = m.normal_map.as_ref().map(|(_, x)| *x);
    let factors = (m.base_color, m.roughness, m.metallic, m.emission, m.alpha, strength);
    d.bytes(format!("{factors:?}").as_bytes());
    let normal = m.normal_map.as_ref().map(|(map, _)| map);
    for map in [m.base_color_map.as_ref(), m.metallic_roughness_map.as_ref(), normal, m.emission_map.as_ref()]
    {
        let Some(map) = map else {
            d.u64(u64::MAX);
            continue;
        };
        let place = seen.iter().position(|t| Arc::ptr_eq(t, map));
        d.u64(place.unwrap_or(seen.len()) as u64);
        if place.is_none() {
            seen.push(map);
            d.bytes(format!("{} {} {:?} {:?}", map.width, map.height, map.transfer, map.wrap).as_bytes());
            d.bytes(map.texels.as_flattened());
        }
    }
}

/// Centre of the bounds, and the largest distance of a vertex from it; in f64, where the square of any
/// coordinate is finite.
pub fn sphere(mesh: &Mesh) -> ([f32; 3], f64) {
    let [low, high] = mesh.bounds();
    let c: [f32; 3] = std::array::from_fn(|k| 0.5 * low[k] + 0.5 * high[k]);
    let square = mesh.positions.iter().fold(0.0f64, |m, p| {
        let d: [f64; 3] = std::array::from_fn(|k| f64::from(p[k]) - f64::from(c[k]));
        order::max(m, (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2])
    });
    (c, square.sqrt())
}

/// A circle of cameras around a mesh, directed at the centre of its bounds, at a distance from which all of
/// it is visible; `orbit.center` and `orbit.radius` take precedence.
///
/// # Errors
/// Those of [`Orbit::shots`].
pub fn around(mesh: &Mesh, orbit: &Orbit) -> Result<Vec<Shot>> {
    let (center, reach) = sphere(mesh);
    let [w, h] = orbit.size.map(|s| s as f64);
    let narrow = order::min(orbit.fov_x_rad, 2.0 * libm::atan(libm::tan(orbit.fov_x_rad * 0.5) * h / w));
    let fits = order::max(reach, 1e-6) / libm::sin(narrow * 0.5) * 1.02;
    let orbit = Orbit {
        center: Some(orbit.center.unwrap_or(center)),
        radius: Some(orbit.radius.unwrap_or(fits as f32)),
        ..*orbit
    };
    Ok(orbit.shots(&Gaussians::default())?.into_iter().map(|s| still(s.name, s.camera)).collect())
}

/// A shot of a camera that does not move.
pub fn still(name: String, camera: Camera) -> Shot {
    Shot { name, camera, shutter_close: None, split: Split::Unknown, extra: Map::new() }
}
