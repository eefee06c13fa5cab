//! The subject of a data set: an object, built-in or from a file, and its environment light.

use super::settings::Settings;
use crate::num::rng::Rng;
use crate::num::{order, par};
use crate::scene::environment_file::{self, Options};
use crate::scene::from_data_gen;
use crate::scene::light::Environment;
use crate::scene::mesh::Object;
use crate::scene::model;
use crate::shade::axes;
use crate::shade::environment::solid_angles;
use crate::{Error, Result};
use data_gen::{environments, objects};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Factor of the roughness of a shiny version; the item is the object.
const GLOSS_PURPOSE: u16 = 0x0310;
/// Rotation (draw 0) and brightness (draw 1) of a map from a file; the item is the object.
const MAP_PURPOSE: u16 = 0x0421;

/// The last part of a path, so that records do not depend on the location of a file.
fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// An object inside the ball of radius ½ around the origin.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The object, ready to render.
    pub object: Object,
    /// The record of its source and parameters.
    pub record: Value,
}

impl Subject {
    /// Object k of the settings: file k mod their number, or a built-in object.
    ///
    /// # Errors
    /// If the file cannot be used.
    pub fn new(settings: &Settings, k: u64) -> Result<Self> {
        match settings.meshes.len() {
            0 => Ok(Self::built_in(settings, k)),
            n => {
                let path = &settings.meshes[(k % n as u64) as usize];
                let name = path.display().to_string();
                let (object, notes) = model::read_with_notes(path)?;
                let (object, center, scale) = normalised(object, &name)?;
                let record = json!({
                    "name": path.file_stem().map(|s| s.to_string_lossy()),
                    "file": file_name(path),
                    "center": center,
                    "scale": scale,
                    "transform": "position = (position of the file, z up, − center) × scale",
                    "notes": notes,
                });
                Ok(Self { object, record })
            }
        }
    }

    fn built_in(settings: &Settings, k: u64) -> Self {
        let made = objects::build(settings.seed, k, settings.texture);
        let parameters: Map<String, Value> =
            made.parameters.into_iter().map(|(name, x)| (name, json!(x))).collect();
        let record = json!({ "name": made.generator, "parameters": parameters, "materials": made.materials });
        Self { object: from_data_gen::object(&made.surfaces), record }
    }

    /// The object at half its size, its centre moved by a quarter along x, to the side of the sign; the other
    /// half of the ball is free.
    #[must_use]
    pub fn on_side(mut self, sign: f32) -> Self {
        for p in &mut self.object.mesh.positions {
            *p = [0.5 * p[0] + 0.25 * sign, 0.5 * p[1], 0.5 * p[2]];
        }
        self
    }

    /// Two objects as one.
    ///
    /// # Errors
    /// If they have more than 65 535 materials, or only one of them has normals or texture coordinates.
    pub fn with(mut self, other: &Self) -> Result<Self> {
        let (own, added) = (&mut self.object, &other.object);
        let (vertices, materials) = (own.mesh.positions.len() as u32, own.materials.len());
        own.mesh.positions.extend(&added.mesh.positions);
        own.mesh.normals.extend(&added.mesh.normals);
        own.mesh.uvs.extend(&added.mesh.uvs);
        own.mesh.triangles.extend(added.mesh.triangles.iter().map(|t| t.map(|i| i + vertices)));
        let first = u16::try_from(materials + added.materials.len()).map(|_| materials as u16);
        let first = first.map_err(|e| Error::input("materials of two objects").got(e.to_string()))?;
        own.material_of.extend(added.material_of.iter().map(|m| m + first));
        own.materials.extend(added.materials.iter().cloned());
        self.record = json!([self.record, other.record]);
        self.object.validate("two objects")?;
        Ok(self)
    }

    /// The roughness factor of the shiny version of object k, U(0.3, 0.6).
    pub fn gloss(&self, seed: u64, k: u64) -> f32 {
        0.3 + 0.3 * Rng::new(seed).uniform_f32(k, 0, GLOSS_PURPOSE, 0)
    }

    /// The object with every roughness multiplied by `factor`.
    pub fn with_roughness(&self, factor: f32) -> Object {
        let mut object = self.object.clone();
        for m in &mut object.materials {
            m.roughness *= factor;
        }
        object
    }
}

/// The object moved and scaled into the ball of radius ½, with the centre and the factor of this transform.
fn normalised(mut object: Object, name: &str) -> Result<(Object, [f64; 3], f64)> {
    let wide: Vec<[f64; 3]> = object.mesh.positions.iter().map(|p| p.map(f64::from)).collect();
    let (center, radius) = objects::enclosing_ball(&wide);
    let scale = objects::RADIUS / radius;
    if !(radius > 0.0 && scale.is_finite()) {
        return Err(Error::input(name).expected("a model of non-zero size").got("all vertices at one point"));
    }
    for (p, w) in object.mesh.positions.iter_mut().zip(&wide) {
        *p = std::array::from_fn(|i| ((w[i] - center[i]) * scale) as f32);
    }
    Ok((object, center, scale))
}

/// An environment map and the record of its source.
#[derive(Clone, Debug)]
pub struct Light {
    /// The map in the orientation of this project.
    pub map: Environment,
    /// The record of its source and parameters.
    pub record: Value,
}

impl Light {
    /// The map of object k: file k mod their number, rotated about the vertical and scaled to a mean radiance
    /// of U(0.6, 1.4), or built-in environment k, or the unchanged axes map.
    ///
    /// # Errors
    /// If the file cannot be used, or is black.
    pub fn new(settings: &Settings, k: u64) -> Result<Self> {
        match settings.maps.len() {
            _ if settings.axes => Ok(Self::axes(settings)),
            0 => Ok(Self::built_in(settings, k)),
            n => {
                let path = &settings.maps[(k % n as u64) as usize];
                let rng = Rng::new(settings.seed);
                let turn = 360.0 * rng.uniform_f64(k, 0, MAP_PURPOSE, 0);
                let rotate = settings.map_options.rotate + turn;
                let mut map =
                    environment_file::read(path, &Options { rotate, ..settings.map_options.clone() })?;
                let mean = mean_luminance(&map);
                if !(mean > 0.0) {
                    return Err(Error::input(path.display().to_string())
                        .expected("a map with light")
                        .got("a black map"));
                }
                let level = (0.6 + 0.8 * rng.uniform_f64(k, 0, MAP_PURPOSE, 1)) / mean;
                // The sum of many texels; a single texel may still be out of range.
                let scale = order::min(level, f64::from(f32::MAX)) as f32;
                map.radiance.iter_mut().for_each(|c| *c = c.map(|x| order::min(x * scale, f32::MAX)));
                let record = json!({
                    "file": file_name(path), "rotate_deg": rotate, "scale": f64::from(scale),
                });
                Ok(Self { map, record })
            }
        }
    }

    fn axes(settings: &Settings) -> Self {
        let map = axes::map(Ord::max(settings.map_width / 2, 1));
        let map = environment_file::orient(map, &settings.map_options);
        Self { map, record: json!({ "kind": "axes", "rotate_deg": settings.map_options.rotate }) }
    }

    fn built_in(settings: &Settings, k: u64) -> Self {
        let scene = environments::scene(settings.seed, k);
        let (w, h) = (settings.map_width, Ord::max(settings.map_width / 2, 1));
        let radiance = par::map(h, |row| scene.row(row, w, h)).concat();
        let mut record = json!({ "kind": scene.kind(), "index": k });
        if let Some(b) = scene.brightest() {
            record["towards_brightest"] = json!(b);
        }
        Self { map: Environment { width: w, height: h, radiance }, record }
    }
}

/// Mean over the sphere: texels of a row by a left fold, then rows.
fn mean_luminance(map: &Environment) -> f64 {
    let (solid, _) = solid_angles(map.width, map.height);
    let mut sum = 0.0;
    for (row, solid) in map.radiance.chunks(map.width).zip(&solid) {
        let mut along = 0.0;
        for c in row {
            let [r, g, b] = c.map(f64::from);
            along += (0.2126 * r + 0.7152 * g) + 0.0722 * b;
        }
        sum += solid * along;
    }
    sum / (4.0 * std::f64::consts::PI)
}
