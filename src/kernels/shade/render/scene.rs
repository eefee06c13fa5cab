//! The validated scene: an object, its tree and its light.

use super::emitters::Emitters;
use crate::geometry::bvh::Bvh;
use crate::scene::light::{Lamp, Lights, MAX_RADIANCE};
use crate::scene::material::Alpha;
use crate::scene::mesh::{MAX_COORDINATE, Object};
use crate::shade::environment::Sky;
use crate::shade::vector::dot;
use crate::{Error, Result};

/// An object, its tree and its light, validated and prepared.
#[derive(Debug)]
pub struct Scene<'a> {
    pub(super) object: &'a Object,
    pub(super) bvh: &'a Bvh,
    pub(super) lamps: &'a [Lamp],
    /// The map with its tables, if there is one.
    pub(super) sky: Option<Sky<'a>>,
    /// Whether some material transmits light.
    pub(super) transparent: bool,
    /// Whether some material emits light.
    pub(super) emissive: bool,
    /// The triangles that emit light, if there are any.
    pub(super) emitters: Option<Emitters>,
}

impl<'a> Scene<'a> {
    /// Validates object and light and computes the tables of the map and of emissive triangles. `bvh` must be built from the object's
    /// mesh.
    ///
    /// # Errors
    /// Returns an error that names the invalid input.
    pub fn new(object: &'a Object, bvh: &'a Bvh, lights: &'a Lights) -> Result<Self> {
        object.validate("object")?;
        if bvh.triangles() != object.mesh.triangles.len() {
            return Err(Error::input("scene")
                .at("tree")
                .expected(format!("one over the {} triangles of the object", object.mesh.triangles.len()))
                .got(format!("one over {}", bvh.triangles())));
        }
        if let Some(map) = &lights.environment {
            map.validate("environment")?;
        }
        for (i, lamp) in lights.lamps.iter().enumerate() {
            validate(lamp).map_err(|e| e.within(format!("lamp {i}")))?;
        }
        Ok(Self {
            object,
            bvh,
            lamps: &lights.lamps,
            sky: lights.environment.as_ref().map(Sky::new),
            transparent: object.materials.iter().any(|m| m.alpha != Alpha::Opaque),
            emissive: object.materials.iter().any(|m| m.emission != [0.0; 3]),
            emitters: Emitters::new(object),
        })
    }

    /// Returns the number of lights from which one is drawn per vertex: the map unless black, and the lamps.
    /// Emissive triangles are drawn in addition.
    pub(super) fn lights(&self) -> usize {
        self.lamps.len() + usize::from(self.lit_by_sky())
    }

    /// Returns the probability with which each light is drawn; 1 if there is none.
    pub(super) fn choice(&self) -> f32 {
        1.0 / Ord::max(self.lights(), 1) as f32
    }

    /// Whether the map emits light.
    pub(super) fn lit_by_sky(&self) -> bool {
        self.sky.as_ref().is_some_and(|s| !s.is_black())
    }
}

fn validate(lamp: &Lamp) -> Result<()> {
    let (place, power) = match lamp {
        Lamp::Point { position, intensity } => (position, intensity),
        Lamp::Distant { towards, irradiance } => (towards, irradiance),
    };
    if !power.iter().all(|x| (0.0..=MAX_RADIANCE).contains(x)) {
        let e = Error::input("light").expected(format!("0 to {MAX_RADIANCE:e}"));
        return Err(e.got(format!("{power:?}")));
    }
    let fine = match lamp {
        Lamp::Point { .. } => place.iter().all(|x| x.abs() <= MAX_COORDINATE),
        Lamp::Distant { .. } => (dot(*place, *place) - 1.0).abs() <= 1e-4,
    };
    if fine {
        return Ok(());
    }
    Err(Error::input("place")
        .expected("a position within the scene's range, or a unit vector")
        .got(format!("{place:?}")))
}
