//! A model under some light along cameras: pictures with their passes, on disk as a capture.

use super::passes::{Recorder, Shot, Style};
use super::render::Orbit;
use crate::geometry::bvh::Bvh;
use crate::io::capture::Split;
use crate::num::order;
use crate::num::rng;
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::scene::light::Lights;
use crate::scene::mesh::{Mesh, Object};
use crate::shade::exposure;
use crate::shade::render::{Scene, Settings, render};
use crate::{Error, Result};
use serde_json::{Map, Value};
use std::path::Path;
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
    /// same when a set is continued.
    ///
    /// # Errors
    /// When model, light or a camera is not valid, a file cannot be written, two shots share a name, or `stop` was set.
    pub fn to_folder(
        &self,
        shots: &[Shot],
        dir: &Path,
        header: Map<String, Value>,
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

/// Middle of the bounds, and the largest distance of a vertex from it.
pub fn sphere(mesh: &Mesh) -> ([f32; 3], f32) {
    let [low, high] = mesh.bounds();
    let c: [f32; 3] = std::array::from_fn(|k| 0.5 * low[k] + 0.5 * high[k]);
    let square = mesh.positions.iter().fold(0.0f32, |m, p| {
        let d: [f32; 3] = std::array::from_fn(|k| p[k] - c[k]);
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
    let fits = order::max(f64::from(reach), 1e-6) / libm::sin(narrow * 0.5) * 1.02;
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
