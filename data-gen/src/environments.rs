//! Procedural environment maps: skies with a sun, overcast skies, studios, rooms, nights.
//!
//! A map is a function of direction, evaluated at texel centres row by row ([`Scene::row`]), so rows can be
//! computed in any order. The mean radiance over the sphere is 0.6 to 1.4; a sun is about 10⁴ times brighter
//! than its sky, a lamp or a window 10 to 200 times brighter than the walls. Soft edges are one texel wide;
//! the irradiance of the sun does not depend on the size of the map.

mod room;
mod sky;
mod studio;

use crate::draws::Draws;
use crate::light::{Map, direction};
use crate::space::V3;
use room::Room;
use sky::Sky;
use studio::StudioLight;

/// Purpose numbers of random draws. The item is the number of the map.
pub mod purpose {
    /// Kind and parameters.
    pub const ENVIRONMENT: u16 = 0x0400;
    /// The noise of clouds, ground and walls.
    pub const NOISE: u16 = 0x0401;
    /// The mean radiance.
    pub const LEVEL: u16 = 0x0402;
}

/// Names of the kinds.
pub const KINDS: [&str; 6] = ["clear sky", "low sun", "overcast", "studio", "room", "night"];

/// An environment as a function of direction.
#[derive(Clone, Debug)]
pub struct Scene {
    kind: &'static str,
    world: World,
    level: f64,
}

#[derive(Clone, Debug)]
enum World {
    Sky(Box<Sky>),
    StudioLight(StudioLight),
    Room(Box<Room>),
}

/// Environment k of a seed.
pub fn scene(seed: u64, k: u64) -> Scene {
    let mut draws = Draws::new(seed, k, 0, purpose::ENVIRONMENT);
    let drawn = draws.weighted(&[1.2, 0.9, 0.7, 1.3, 1.3, 0.6]);
    let kind = usize::try_from(k).ok().filter(|&k| k < KINDS.len()).unwrap_or(drawn);
    let mut noise = Draws::new(seed, k, 0, purpose::NOISE);
    let world = match kind {
        0 => World::Sky(Box::new(Sky::clear(&mut draws, &mut noise))),
        1 => World::Sky(Box::new(Sky::low_sun(&mut draws, &mut noise))),
        2 => World::Sky(Box::new(Sky::overcast(&mut draws, &mut noise))),
        3 => World::StudioLight(StudioLight::daylight(&mut draws)),
        4 => World::Room(Box::new(Room::new(&mut draws, &mut noise))),
        _ => World::StudioLight(StudioLight::night(&mut draws)),
    };
    let mut scene = Scene { kind: KINDS[kind], world, level: 1.0 };
    let wanted = Draws::new(seed, k, 0, purpose::LEVEL).range(0.6, 1.4);
    scene.level = wanted / scene.mean();
    scene
}

impl Scene {
    /// The kind, one of [`KINDS`].
    pub fn kind(&self) -> &'static str {
        self.kind
    }

    /// Direction towards the middle of the brightest source, if there is a distinct one.
    pub fn brightest(&self) -> Option<V3> {
        match &self.world {
            World::Sky(s) => s.sun(),
            World::StudioLight(s) => s.brightest(),
            World::Room(_) => None,
        }
    }

    /// Radiance of a row of a map, shape (W).
    pub fn row(&self, row: usize, width: usize, height: usize) -> Vec<[f32; 3]> {
        let step = std::f64::consts::PI / height as f64;
        let v = (row as f64 + 0.5) / height as f64;
        (0..width)
            .map(|column| {
                let towards = direction((column as f64 + 0.5) / width as f64, v);
                let c = match &self.world {
                    World::Sky(s) => s.radiance(towards, step),
                    World::StudioLight(s) => s.radiance(towards, step),
                    World::Room(s) => s.radiance(towards),
                };
                c.map(|x| (self.level * x) as f32)
            })
            .collect()
    }

    /// Mean luminance over the sphere, from 64 × 32 texels: rows in order, a left fold over each.
    fn mean(&self) -> f64 {
        let (w, h) = (64, 32);
        let (mut sum, mut weight) = (0.0, 0.0);
        for row in 0..h {
            let solid = reference::num::elem::sin(std::f64::consts::PI * (row as f64 + 0.5) / h as f64);
            for c in self.row(row, w, h) {
                let [r, g, b] = c.map(f64::from);
                sum += solid * (0.2126 * r + 0.7152 * g + 0.0722 * b);
                weight += solid;
            }
        }
        sum / weight
    }

    /// The whole map.
    pub fn map(&self, width: usize, height: usize) -> Map {
        let radiance = (0..height).flat_map(|row| self.row(row, width, height)).collect();
        Map { width, height, radiance, kind: self.kind, brightest: self.brightest() }
    }
}

/// Environment k of a seed as a map.
pub fn make(seed: u64, k: u64, width: usize, height: usize) -> Map {
    scene(seed, k).map(width, height)
}

/// A white dome.
pub fn uniform() -> Map {
    Map::constant([1.0; 3])
}
