//! A model under some light along cameras: pictures with their passes, on disk as a capture.
//!
//! What is rendered is known by its contents: the header of a set ends with a digest of model, light and cameras. So a run is
//! continued only where all of them are what they were, whatever files they came from and wherever those lie.

use super::earlier;
use super::orbit::Orbit;
use super::passes::{Recorder, Shot, Style};
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

/// Samples of a picture; the item is the picture.
const PURPOSE: u16 = 0x0520;

/// Factor from radiance to the photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// [`exposure::auto`] of each picture
    Auto,
    /// the same for all
    Fixed(f32),
}

/// What is rendered, how.
#[derive(Clone, Debug)]
pub struct Relight<'a> {
    /// The model.
    pub object: &'a Object,
    /// Its light.
    pub lights: &'a Lights,
    /// Samples, bounces, seed; picture i draws from the seed that [`rng::derive`] makes of this one and i.
    pub settings: Settings,
    /// Brightness of the photographs.
    pub exposure: Exposure,
    /// Photographs show the model alone and have an alpha channel.
    pub transparent: bool,
    /// Also radiance, depth, normals, albedo, material.
    pub passes: bool,
}

impl Relight<'_> {
    /// Renders what is missing of the shots into `dir`; gives the digest of the set. `header` is the top of `transforms.json`, and must be the
    /// same when a set is continued; it gets one more key, `contents`, with the digest of model, light and cameras.
    ///
    /// With `resume` an empty folder is begun, one with files must hold a run of the same header. Without, what an earlier run of such a
    /// header left is removed first, and a capture of another kind is refused. A refused run makes no folder.
    ///
    /// # Errors
    /// When model, light or a camera is not valid, a file cannot be written, two shots share a name, the folder holds something else,
    /// or `stop` was set.
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
            return Err(e.expected("different names").got("two cameras of one name"));
        }
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
    /// FNV-1a 64 of everything that pictures depend on but the settings: surface, materials and their pictures, light, cameras.
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

/// Factors, then for each map its place among the pictures `seen` so far, and a new one's texels.
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

/// Middle of the bounds, and the largest distance of a vertex from it; in f64, where the square of any coordinate is finite.
pub fn sphere(mesh: &Mesh) -> ([f32; 3], f64) {
    let [low, high] = mesh.bounds();
    let c: [f32; 3] = std::array::from_fn(|k| 0.5 * low[k] + 0.5 * high[k]);
    let square = mesh.positions.iter().fold(0.0f64, |m, p| {
        let d: [f64; 3] = std::array::from_fn(|k| f64::from(p[k]) - f64::from(c[k]));
        order::max(m, (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2])
    });
    (c, square.sqrt())
}

/// A circle of cameras around a mesh, looking at the middle of its bounds from where all of it is seen; `orbit.center` and `orbit.radius` win.
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

/// A shot of a resting camera.
pub fn still(name: String, camera: Camera) -> Shot {
    Shot { name, camera, shutter_close: None, split: Split::Unknown, extra: Map::new() }
}
