//! The surface of a field as a mesh with baked textures.
//!
//! ```text
//! s on a grid ─► cavities filled ─► marching cubes ─► small parts removed ─► Taubin smoothing ─► normals
//!                                                            ─► texture atlas ─► values at texel positions ─► maps
//! ```
//!
//! A point of the grid is outside if s ≥ 0, and so is everything beyond the box, so that the mesh is closed. A cavity
//! (a region outside that the boundary of the grid cannot reach) cannot be seen, and is filled.
//!
//! | [`Base`] | base colour | roughness, metallic | emission |
//! |---|---|---|---|
//! | `Albedo` | albedo; of a field without it, the colour | material; of a field without it, 1 and 0 | none |
//! | `Color` | black | 1, 1 | colour |
//!
//! Normals of vertices ([`Normals`]) are those of the normal head where the field has one: s is the weaker source, because its differences show the cells
//! of the planes and the passes of a fit reach them in the last stage alone. A vertex whose head points into the surface keeps the mean of its triangles' normals.
//!
//! All are values of the heads at the position of each texel; with an embedding, the colour is the one seen along the
//! normal. The colour contains the light of the images. As an emission it is shown as it is: a black metal reflects nothing
//! but the Fresnel term at grazing angles. As a base colour it would be lit a second time.

use super::scene::{self, Weights};
use crate::field::occupancy::{Bounded, Learned};
use crate::field::render::{Rays, Scene};
use crate::field::{embed, fetch, normal_head, value_head};
use crate::geometry::atlas::{self, unwrap};
use crate::geometry::components::{Keep, fill_cavities, keep};
use crate::geometry::marching::{Volume, surface};
use crate::geometry::smooth::{Smoothing, normals, smooth};
use crate::geometry::texels::{Texel, cover, fill};
use crate::num::{order, par};
use crate::scene::field::Field;
use crate::scene::material::{Material, Texture, Transfer, Wrap};
use crate::scene::mesh::{Mesh, Object};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::sync::Arc;

/// Points per task.
const POINTS: usize = 8192;
/// Texels between charts.
const GUTTER: usize = 4;

/// What the maps of a mesh hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Base {
    /// Albedo, roughness and metallic: a surface that is lit.
    #[default]
    Albedo,
    /// The colour of the images as an emission: a surface that looks as it was seen.
    Color,
}

impl Base {
    /// Names of the values.
    pub const NAMES: [&'static str; 2] = ["albedo", "color"];

    /// Returns the name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => Self::NAMES[0],
            Self::Color => Self::NAMES[1],
        }
    }

    /// Returns the value of that name.
    ///
    /// # Errors
    /// Lists the names if there is none.
    pub fn parse(name: &str) -> Result<Self> {
        let known = [Self::Albedo, Self::Color].into_iter().find(|base| base.name() == name);
        known.ok_or_else(|| Error::input("--base").expected(Self::NAMES.join(" or ")).got(name))
    }
}

/// Where normals of vertices come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normals {
    /// The normal head, where the field has one.
    #[default]
    Head,
    /// The triangles.
    Surface,
}

impl Normals {
    /// Returns the name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Head => "head",
            Self::Surface => "surface",
        }
    }

    /// Returns the value of that name.
    ///
    /// # Errors
    /// Lists the names if there is none.
    pub fn parse(name: &str) -> Result<Self> {
        let known = [Self::Head, Self::Surface].into_iter().find(|normals| normals.name() == name);
        known.ok_or_else(|| Error::input("--vertex-normals").expected("head or surface").got(name))
    }
}

/// How a mesh is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Points of the grid along each axis.
    pub side: usize,
    /// Texels per side of the maps.
    pub texture: usize,
    /// Passes of Taubin smoothing; 0 for none.
    pub smoothing: usize,
    /// Smallest part that is kept, as a fraction of the area of the largest.
    pub least_part: f64,
    /// Where normals of vertices come from.
    pub normals: Normals,
    /// What the maps hold.
    pub base: Base,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            side: 256,
            texture: 1024,
            smoothing: 10,
            least_part: 0.01,
            normals: Normals::Head,
            base: Base::Albedo,
        }
    }
}

impl Settings {
    /// Checks ranges.
    ///
    /// # Errors
    /// Names the option.
    pub fn validate(&self) -> Result<()> {
        let within = |option: &str, x: f64, range: std::ops::RangeInclusive<f64>| {
            if range.contains(&x) {
                return Ok(());
            }
            Err(Error::input(option)
                .expected(format!("{} to {}", range.start(), range.end()))
                .got(x.to_string()))
        };
        within("--side", self.side as f64, 8.0..=1024.0)?;
        within("--texture", self.texture as f64, 64.0..=8192.0)?;
        within("--smoothing", self.smoothing as f64, 0.0..=1000.0)?;
        within("--least-part", self.least_part, 0.0..=1.0)
    }

    /// Returns an estimate of the memory that a mesh takes, in bytes: the grid twice, and what a texel is made of.
    pub fn memory_estimate(&self) -> u64 {
        let (points, texels) =
            ((self.side * self.side * self.side) as u64, (self.texture * self.texture) as u64);
        12 * points + 128 * texels
    }

    /// As a JSON record.
    pub fn json(&self) -> Value {
        json!({
            "side": self.side, "texture": self.texture, "smoothing": self.smoothing, "least_part": self.least_part,
            "normals": self.normals.name(), "base": self.base.name(),
        })
    }
}

/// A mesh with its maps, and what was done to make it.
#[derive(Clone, Debug)]
pub struct Baked {
    /// In units of the world.
    pub object: Object,
    /// Points of the grid in cavities that were filled.
    pub cavities: usize,
    /// Parts of the surface before small ones were removed.
    pub parts: usize,
    /// Charts of the atlas.
    pub charts: usize,
    /// Part of the texels that a chart covers.
    pub used: f64,
}

/// Returns s on a grid of `side`³ points from corner to corner of the box.
fn distances(field: &Field, side: usize) -> Result<Vec<f32>> {
    let weights = Weights::of(field);
    let learned = Learned::new(scene::planes(field), scene::combine(field), &weights.sdf())?;
    let half = field.settings.half_size;
    let at = |i: usize| half * (2.0 * i as f32 / (side - 1) as f32 - 1.0);
    let n = side * side * side;
    let parts = par::map(n.div_ceil(POINTS), |c| {
        let index = c * POINTS..Ord::min((c + 1) * POINTS, n);
        let points: Vec<[f32; 3]> =
            index.map(|i| [at(i / (side * side)), at(i / side % side), at(i % side)]).collect();
        let mut sdf = Vec::new();
        learned.values(&points, &mut sdf);
        sdf
    });
    Ok(parts.concat())
}

/// Returns the surface of a field in its units: closed, without cavities and small parts; with the number of
/// cavities and of all parts. `None` if no signed distance in the box is negative: there is no surface.
///
/// # Errors
/// When a setting is out of its range, or a value is not finite.
pub fn shape(field: &Field, settings: &Settings) -> Result<Option<(Mesh, usize, usize)>> {
    settings.validate()?;
    let side = settings.side;
    let half = field.settings.half_size;
    let (size, origin) = ([side; 3], [-half; 3]);
    let spacing = [2.0 * half / (side - 1) as f32; 3];
    let values = distances(field, side)?;
    if !values.iter().any(|s| *s < 0.0) {
        return Ok(None);
    }
    let (values, cavities) = fill_cavities(&Volume { values: &values, size, origin, spacing })?;
    let whole = surface(&Volume { values: &values, size, origin, spacing })?;
    let parts = crate::geometry::components::components(&whole.triangles, whole.positions.len()).count;
    let mut mesh = keep(&whole, Keep::Fraction(settings.least_part))?;
    if settings.smoothing > 0 {
        // Taubin's factors: no shrinking of what is smooth.
        let how = Smoothing { factor: 0.5, inverse: -0.53, iterations: settings.smoothing };
        mesh.positions = smooth(&mesh.positions, &mesh.triangles, &how)?;
    }
    mesh.normals = normals(&mesh);
    if settings.normals == Normals::Head {
        take_heads(field, &mut mesh);
    }
    Ok(Some((mesh, cavities, parts)))
}

/// Replaces normals by those of the normal head, if there is one, where both lie on the same side.
fn take_heads(field: &Field, mesh: &mut Mesh) {
    let weights = Weights::of(field);
    let made = weights.scene(Rays { origins: &[], directions: &[] });
    let Some(head) = &made.heads.normal else { return };
    let (planes, combine) = (scene::planes(field), made.settings.combine);
    let points = &mesh.positions;
    par::chunks_mut(&mut mesh.normals, POINTS, |c, normals| {
        let points = &points[c * POINTS..][..normals.len()];
        let mut features = vec![0.0; points.len() * combine.width(planes.channels)];
        fetch::forward(&planes, combine, points, &mut features);
        for (normal, head) in normals.iter_mut().zip(normal_head::forward(head, &features, points).0) {
            if (normal[0] * head[0] + normal[1] * head[1]) + normal[2] * head[2] > 0.0 {
                *normal = head;
            }
        }
    });
}

/// Colour (albedo or colour, sRGB-encoded), roughness and metallic of a texel, 0..1.
type Value5 = [f32; 5];

/// Returns the colours of the heads at points, seen along the normal.
fn colors(made: &Scene<'_>, features: &[f32], points: &[[f32; 3]]) -> Vec<f32> {
    let heads = &made.heads;
    let Some(color) = &heads.color else {
        // A trunk: the last three outputs.
        let all = value_head::forward(&heads.sdf, features).0;
        return all.chunks_exact(4).flat_map(|v| [v[1], v[2], v[3]]).collect();
    };
    let (Some(panoramas), Some(normal), Some(rho)) = (&made.panoramas, &heads.normal, &heads.rho) else {
        return value_head::forward(color, features).0;
    };
    let normals = normal_head::forward(normal, features, points).0;
    let rhos = value_head::forward(rho, features).0;
    let (width, h) = (features.len() / points.len(), panoramas.channels);
    let mut joined = Vec::with_capacity(points.len() * color.inputs);
    let mut embedded = vec![0.0; h];
    for ((row, n), rho) in features.chunks_exact(width).zip(&normals).zip(&rhos) {
        let place = panoramas.place(embed::reflect(*n, None), *rho, None);
        panoramas.features(&place, &mut embedded);
        joined.extend_from_slice(row);
        joined.extend_from_slice(&embedded);
        if color.inputs > width + h {
            joined.push(1.0); // the cosine of a reflection along the normal
        }
    }
    value_head::forward(color, &joined).0
}

/// Returns the values of the heads at points.
fn values(field: &Field, points: &[[f32; 3]], base: Base) -> Vec<Value5> {
    let planes = scene::planes(field);
    let weights = Weights::of(field);
    let made = weights.scene(Rays { origins: &[], directions: &[] });
    let combine = made.settings.combine;
    let mut features = vec![0.0; points.len() * combine.width(planes.channels)];
    fetch::forward(&planes, combine, points, &mut features);
    let colors = match (&made.heads.albedo, base) {
        (Some(albedo), Base::Albedo) => value_head::forward(albedo, &features).0,
        _ => colors(&made, &features, points),
    };
    let materials = made.heads.material.as_ref().map(|m| value_head::forward(m, &features).0);
    let color = colors.chunks_exact(3);
    color
        .enumerate()
        .map(|(i, c)| {
            let [r, m] = materials.as_ref().map_or([1.0, 0.0], |v| [v[2 * i], v[2 * i + 1]]);
            [c[0], c[1], c[2], r, m]
        })
        .collect()
}

fn maps(field: &Field, texels: &[Texel], size: usize, base: Base) -> Material {
    let baked: Vec<Value5> = par::map(texels.len().div_ceil(POINTS), |c| {
        let texels = &texels[c * POINTS..Ord::min((c + 1) * POINTS, texels.len())];
        let points: Vec<[f32; 3]> = texels.iter().map(|t| t.position).collect();
        values(field, &points, base)
    })
    .concat();
    let sources = fill(texels, [size; 2], 2 * size);
    let byte = |x: f32| (order::clamp(x, 0.0, 1.0) * 255.0 + 0.5) as u8;
    let map = |transfer: Transfer, value: &dyn Fn(&Value5) -> [u8; 4]| {
        let texels = sources.iter().map(|s| value(&baked[*s as usize])).collect();
        Some(Arc::new(Texture { width: size, height: size, texels, transfer, wrap: [Wrap::Clamp; 2] }))
    };
    let color = map(Transfer::Srgb, &|v| [byte(v[0]), byte(v[1]), byte(v[2]), 255]);
    let common = Material { name: "baked".into(), roughness: 1.0, metallic: 1.0, ..Material::default() };
    match base {
        Base::Albedo => Material {
            base_color_map: color,
            metallic_roughness_map: map(Transfer::Linear, &|v| [255, byte(v[3]), byte(v[4]), 255]),
            ..common
        },
        Base::Color => {
            Material { base_color: [0.0, 0.0, 0.0, 1.0], emission: [1.0; 3], emission_map: color, ..common }
        }
    }
}

/// Makes a mesh with texture coordinates and maps.
///
/// # Errors
/// When the field has no surface, or the charts do not fit the maps.
pub fn bake(field: &Field, settings: &Settings) -> Result<Baked> {
    try_bake(field, settings)?.ok_or_else(|| {
        Error::check("field mesh")
            .at("surface")
            .expected("a negative signed distance somewhere in the box")
            .got("none: the field is empty")
    })
}

/// [`bake`], but `None` where the field has no surface.
///
/// # Errors
/// When a setting is out of its range, a value is not finite, or the charts do not fit the maps.
pub fn try_bake(field: &Field, settings: &Settings) -> Result<Option<Baked>> {
    let Some((mesh, cavities, parts)) = shape(field, settings)? else { return Ok(None) };
    let size = settings.texture;
    let made = unwrap(&mesh, &atlas::Settings { size, gutter: GUTTER })?;
    let texels = cover(&made.mesh, &made.chart_of, [size; 2])?;
    let material = maps(field, &texels, size, settings.base);
    let mut mesh = made.mesh;
    for x in &mut mesh.positions {
        *x = field.placement.to_world(x.map(f64::from)).map(|x| x as f32);
    }
    if field.placement.is_turned() {
        for n in &mut mesh.normals {
            *n = field.placement.direction_to_world(n.map(f64::from)).map(|x| x as f32);
        }
    }
    let used = texels.len() as f64 / (size * size) as f64;
    let object = Object { material_of: vec![0; mesh.triangles.len()], mesh, materials: vec![material] };
    Ok(Some(Baked { object, cavities, parts, charts: made.charts, used }))
}
