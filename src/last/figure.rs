//! The built-in person: images of its points and of its surfaces.
//!
//! The light is the same for points and surfaces: a sun at azimuth 0.8 u_L and elevation 30°, and an ambient
//! fraction of 0.35. Points are shaded by Lambert's law in `data_gen`; surfaces are rendered under a sun of
//! irradiance 0.65π and a sky of mean radiance about 0.35, so that a white surface facing the sun is white in
//! both.

use super::image_source::{ImageSource, Surfaces};
use super::points::single;
pub use super::points::{DISC, Dots, OPACITY, Photo, Points, Rendering, SIGMA};
use super::settings::BOUNCES;
use crate::Result;
use crate::geometry::bvh::Bvh;
use crate::io::image_file;
use crate::num::array::Arrays;
use crate::num::par;
use crate::num::rng::Rng;
use crate::scene::camera::{Camera, Model};
use crate::scene::from_data_gen;
use crate::scene::light::{Environment, Lamp, Lights};
use crate::scene::mesh::Object;
use crate::shade::render::{self, Passes, Scene};
use crate::shade::tonemap;
use data_gen::figure::appearance::Appearance;
use data_gen::figure::factors::{AMBIENT, Drive};
use data_gen::figure::samples::Frame;
use data_gen::figure::skeleton::{BONES, bones};
use data_gen::figure::surface::Figure;
use data_gen::figure::template::Template;
use data_gen::figure::video;

/// The persons of the sets, with a common template and different appearances.
#[derive(Clone, Debug)]
pub struct Figures {
    /// The template at rest.
    pub template: Template,
    /// Sizes at which its points are drawn.
    pub dots: Dots,
    /// Seed of the appearances.
    pub seed: u64,
}

impl Figures {
    /// Creates the persons with a template of P points.
    pub fn new(p: usize, seed: u64) -> Self {
        let template = Template::new(p);
        Self { dots: Dots::new(template.spacing()), template, seed }
    }
}

impl ImageSource for Figures {
    fn dots(&self) -> &Dots {
        &self.dots
    }

    fn rest(&self) -> Arrays {
        template_arrays(self)
    }

    fn points(&self, frame: &Frame) -> Result<Points> {
        let look = Appearance::new(self.seed, frame.appearance);
        Ok(Points::from(&self.template.posed(&Drive::new(&frame.u), &look)))
    }

    fn camera(&self, side: usize) -> Camera {
        from_data_gen::camera(&video::camera(0, side), Model::Pinhole)
    }

    fn surfaces<'a>(&'a self, frames: &'a [&'a Frame]) -> Surfaces<'a> {
        let mut looks: Vec<u64> = frames.iter().map(|f| f.appearance).collect();
        looks.sort_unstable();
        looks.dedup();
        // Creating the clothes takes longer than posing them, so they are created once per appearance.
        let wardrobe = par::map(looks.len(), |i| ClothedFigure::new(&Appearance::new(self.seed, looks[i])));
        Box::new(move |i| {
            let look = looks.binary_search(&frames[i].appearance).expect("the look of one of these frames");
            Ok(wardrobe[look].object(&Drive::new(&frames[i].u)))
        })
    }
}

/// A soft sky: brighter and bluer above, warmer and darker below, with one colour within 45° of the horizon.
fn sky() -> Environment {
    const ROWS: usize = 16;
    let row = |i: usize| -> [f32; 3] {
        match i {
            0..=1 => [0.50, 0.54, 0.60],
            2..=3 => [0.44, 0.47, 0.51],
            12..=15 => [0.20, 0.19, 0.18],
            _ => [0.33, 0.35, 0.37],
        }
    };
    let radiance = (0..ROWS).flat_map(|i| [row(i); 2]).collect();
    Environment { width: 2, height: ROWS, radiance }
}

/// Sun and sky for an azimuth of the sun in rad: 0 is in front of the figure, positive values are towards its
/// left.
pub fn lights(azimuth: f64) -> Lights {
    let drive = Drive { light_azimuth: azimuth, ..Drive::new(&[]) };
    let sun = std::f64::consts::PI * (1.0 - AMBIENT);
    let irradiance = [1.02 * sun, sun, 0.94 * sun].map(|x| x as f32);
    let towards = drive.towards_light().map(|x| x as f32);
    Lights { environment: Some(sky()), lamps: vec![Lamp::Distant { towards, irradiance }] }
}

/// A person with the surfaces of its appearance, ready to be posed.
#[derive(Debug)]
pub struct ClothedFigure {
    figure: Figure,
    /// The object at rest; its materials are those without a shift of the hue.
    rest: Object,
}

impl ClothedFigure {
    /// Creates the person with an appearance.
    pub fn new(appearance: &Appearance) -> Self {
        let figure = Figure::new(appearance);
        let materials = figure.materials(&Drive::new(&[])).iter().map(from_data_gen::material).collect();
        let mut rest = Object { materials, ..Object::default() };
        for part in &figure.parts {
            let first = rest.mesh.positions.len() as u32;
            rest.mesh.positions.extend(part.positions.iter().map(single));
            rest.mesh.normals.extend(part.normals.iter().map(single));
            rest.mesh.uvs.extend(part.uvs.iter().map(|t| t.map(|x| x as f32)));
            rest.mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
            rest.material_of.resize(rest.mesh.triangles.len(), part.material as u16);
        }
        Self { figure, rest }
    }

    /// The person as an object under the factors.
    pub fn object(&self, drive: &Drive) -> Object {
        let mut object = self.rest.clone();
        let mesh = &mut object.mesh;
        let posed = self.figure.posed(drive);
        for (to, x) in mesh.positions.iter_mut().zip(posed.iter().flat_map(|part| &part.positions)) {
            *to = single(x);
        }
        for (to, n) in mesh.normals.iter_mut().zip(posed.iter().flat_map(|part| &part.normals)) {
            *to = single(n);
        }
        if drive.hue != 0.0 {
            for (place, material) in self.figure.dyed(drive) {
                object.materials[place] = from_data_gen::material(&material);
            }
        }
        object
    }
}

/// Seed of the light samples of an image: one Philox block of the run's seed, so that images of different
/// runs share samples only by coincidence.
pub fn picture_seed(seed: u64, purpose: u16, item: u64) -> u64 {
    let [low, high, ..] = Rng::new(seed).block(item, 0, purpose, 0);
    u64::from(high) << 32 | u64::from(low)
}

/// Render settings of surfaces, for video and sets: [`BOUNCES`] bounces; the sky emits light but is not
/// visible.
pub fn lighting(samples: u32, seed: u64) -> render::Settings {
    render::Settings { samples, bounces: BOUNCES, seed, environment_visible: false, ..Default::default() }
}

/// Render passes of an object lit by [`lights`], over black if the settings are those of [`lighting`].
///
/// # Errors
/// If the object or the camera is invalid.
pub fn passes(
    object: &Object,
    bvh: &Bvh,
    azimuth: f64,
    camera: &Camera,
    settings: &render::Settings,
) -> Result<Passes> {
    let lights = lights(azimuth);
    let scene = Scene::new(object, bvh, &lights)?;
    render::render(&scene, camera, None, settings)
}

/// A small image of surfaces.
///
/// # Errors
/// If the object or the camera is invalid.
pub fn photo(object: &Object, azimuth: f64, camera: &Camera, settings: &render::Settings) -> Result<Photo> {
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    let passes = passes(object, &bvh, azimuth, camera, settings)?;
    let alpha = image_file::to_u8(&passes.alpha)?;
    Ok(Photo { image: tonemap::srgb_u8(&passes.color, 1.0), mask: alpha })
}

/// The template of the figure as arrays.
pub fn template_arrays(figures: &Figures) -> Arrays {
    let (t, dots) = (&figures.template, &figures.dots);
    let p = t.points.len();
    let flat = |x: &[[f64; 3]]| -> Vec<f32> { x.iter().flatten().map(|&x| x as f32).collect() };
    let bones = bones();
    let joints: Vec<[f64; 3]> = bones.iter().map(|b| b.joint).collect();
    let rest = joints.iter().flat_map(|j| {
        let [x, y, z] = j.map(|x| x as f32);
        [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, y, 0.0, 0.0, 1.0, z, 0.0, 0.0, 0.0, 1.0]
    });
    Arrays::new()
        .with("points", &[p, 3], flat(&t.points))
        .with("normals", &[p, 3], flat(&t.normals))
        .with("weights", &[p, BONES], t.weights.iter().flatten().map(|&w| w as f32).collect::<Vec<f32>>())
        .with("bone", &[p], t.bone_of.iter().map(|&b| b as i32).collect::<Vec<i32>>())
        .with(
            "parents",
            &[BONES],
            bones.iter().map(|b| b.parent.map_or(-1, |p| p as i32)).collect::<Vec<i32>>(),
        )
        .with("joints", &[BONES, 3], flat(&joints))
        .with("spacing", &[p], dots.spacing.iter().map(|&s| s as f32).collect::<Vec<f32>>())
        .with("sigma", &[p], dots.spacing.iter().map(|s| (SIGMA * s) as f32).collect::<Vec<f32>>())
        .with("rest", &[BONES, 4, 4], rest.collect::<Vec<f32>>())
}
