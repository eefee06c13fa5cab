//! Emissive triangles as lights: one of their points is drawn, by power.
//!
//! ```text
//! Φ_i   = A_i · mean over triangle i of (luminance of the emission · opacity)
//! P_i   = Φ_i/Σ Φ                     probability of triangle i; a point is uniform in its area A_i
//! p(ω)  = P_i/A_i · d²/|n_i·ω|        density per steradian of the direction to it, at distance d
//! ```
//!
//! Triangles emit on both sides. The mean is exact without textures; otherwise it is taken over the centroids
//! of n² equal parts, about one per texel, n from 2 to [`PARTS`]. A bright spot that falls between them only
//! has a smaller density than it should: its light is found by BRDF samples, whose weight uses the same
//! density. A triangle with Φ = 0 is never drawn and has density 0.
//!
//! # Rounding
//! Areas, powers and the table are computed in f64. Densities are f32, in units of length in which the areas
//! of all emitters sum to 1, so that neither tiny nor huge scenes leave the range.

use crate::geometry::bvh::Hit;
use crate::num::order;
use crate::num::sum::sum16_f64;
use crate::scene::material::{Alpha, Texture};
use crate::scene::mesh::Object;
use crate::shade::alias::AliasTable;
use crate::shade::environment::luminance_f64;
use crate::shade::surface;
use crate::shade::vector::{dot, sub, unit};

/// Largest number of parts along an edge of a textured triangle.
const PARTS: usize = 64;
/// A shadow ray ends before the emitter by this fraction of its length, besides the offset of the emitter:
/// 2⁻¹⁶.
const MARGIN: f32 = 1.0 / 65_536.0;

/// Tables for drawing points of emissive triangles.
#[derive(Debug)]
pub(super) struct Emitters {
    /// Over `triangles`.
    table: AliasTable,
    /// The triangles that may be drawn.
    triangles: Vec<u32>,
    /// Density P_i/A_i of every triangle of the mesh, per `length_unit`²; 0 = never drawn.
    density: Vec<f32>,
    /// Square root of the sum of the areas.
    length_unit: f32,
}

/// A point of an emitter, seen from a surface point.
pub(super) struct EmitterSample {
    /// Unit direction towards the point.
    pub(super) towards: [f32; 3],
    /// Emitted radiance times opacity.
    pub(super) radiance: [f32; 3],
    /// Density of the direction per steradian.
    pub(super) density: f32,
    /// Length of the shadow ray.
    pub(super) reach: f32,
}

impl Emitters {
    /// Builds the tables of a validated object; `None` if no triangle emits light.
    pub(super) fn new(object: &Object) -> Option<Self> {
        let (mut triangles, mut areas) = (Vec::new(), Vec::new());
        let (mut means, mut powers) = (Vec::new(), Vec::new());
        for triangle in 0..object.mesh.triangles.len() as u32 {
            let hit = Hit { triangle, ..Hit::NONE };
            if surface::material_at(object, &hit).emission == [0.0; 3] {
                continue;
            }
            let (area, mean) = (area(object, triangle), mean_luminance(object, triangle));
            if area * mean > 0.0 {
                triangles.push(triangle);
                areas.push(area);
                means.push(mean);
                powers.push(area * mean);
            }
        }
        let (total, whole) = (sum16_f64(&powers), sum16_f64(&areas));
        if !(total > 0.0) {
            return None;
        }
        let mut density = vec![0.0; object.mesh.triangles.len()];
        for (triangle, mean) in triangles.iter().zip(means) {
            density[*triangle as usize] = order::min(mean / total * whole, f64::from(f32::MAX)) as f32;
        }
        let table = AliasTable::new(&powers, total);
        Some(Self { table, triangles, density, length_unit: whole.sqrt() as f32 })
    }

    /// Draws the emitter of a word and a point in it of two uniforms, seen from `from`; `None` where it is
    /// seen edge-on.
    #[inline]
    pub(super) fn draw(
        &self,
        object: &Object,
        from: [f32; 3],
        word: u64,
        u: [f32; 2],
    ) -> Option<EmitterSample> {
        let triangle = self.triangles[self.table.choose(word)];
        // √u₀ is the distance from the first corner at which lines parallel to the opposite edge are uniform
        // in area.
        let across = u[0].sqrt();
        let v = across * u[1];
        let hit = Hit { t: 0.0, u: across - v, v, triangle };
        let (towards, distance) = unit(sub(surface::position(object, &hit), from));
        let cosine = dot(surface::face(object, triangle), towards).abs();
        let density = self.per_steradian(triangle, distance, cosine);
        if !(density > 0.0) {
            return None;
        }
        let opacity = 1.0 - surface::transmittance(object, &hit);
        let radiance = surface::emission(object, &hit).map(|x| x * opacity);
        let end = distance - distance * MARGIN - surface::offset(object, triangle) / cosine;
        Some(EmitterSample { towards, radiance, density, reach: order::max(end, 0.0) })
    }

    /// Returns the density per steradian with which [`Self::draw`] returns the unit direction `towards` to a
    /// point of a triangle at this distance; 0 if it cannot.
    #[inline]
    pub(super) fn density(&self, object: &Object, triangle: u32, towards: [f32; 3], distance: f32) -> f32 {
        if self.density[triangle as usize] == 0.0 {
            return 0.0;
        }
        self.per_steradian(triangle, distance, dot(surface::face(object, triangle), towards).abs())
    }

    #[inline]
    fn per_steradian(&self, triangle: u32, distance: f32, cosine: f32) -> f32 {
        let d = distance / self.length_unit;
        if cosine > 0.0 { self.density[triangle as usize] * d * d / cosine } else { 0.0 }
    }
}

/// Returns the area of a triangle.
fn area(object: &Object, triangle: u32) -> f64 {
    let [a, b, c] = object.mesh.corners(triangle as usize).map(|p| p.map(f64::from));
    let (e, f): ([f64; 3], [f64; 3]) =
        (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
    let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
    0.5 * (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt()
}

/// Returns the mean over a triangle of the luminance of its emission times its opacity.
fn mean_luminance(object: &Object, triangle: u32) -> f64 {
    let n = parts(object, triangle);
    let third = 1.0 / 3.0;
    let at = |i: usize, j: usize, inset: f64| {
        let [u, v] = [i, j].map(|x| ((x as f64 + inset) / n as f64) as f32);
        let hit = Hit { t: 0.0, u, v, triangle };
        let opacity = f64::from(1.0 - surface::transmittance(object, &hit));
        luminance_f64(surface::emission(object, &hit)) * opacity
    };
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..n - i {
            sum += at(i, j, third);
            if i + j + 1 < n {
                sum += at(i, j, 2.0 * third);
            }
        }
    }
    sum / (n * n) as f64
}

/// Returns the number of parts along an edge: about one part per texel, 1 without textures.
fn parts(object: &Object, triangle: u32) -> usize {
    let material = surface::material_at(object, &Hit { triangle, ..Hit::NONE });
    let cut = material.base_color_map.as_ref().filter(|_| material.alpha != Alpha::Opaque);
    let maps = [material.emission_map.as_ref(), cut];
    let texels = |map: &Texture| (map.width * map.height) as f64;
    let finest = maps.into_iter().flatten().map(|map| texels(map)).fold(0.0, order::max);
    if finest == 0.0 || object.mesh.uvs.is_empty() {
        return 1;
    }
    let [a, b, c] =
        object.mesh.triangles[triangle as usize].map(|i| object.mesh.uvs[i as usize].map(f64::from));
    let covered = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() * finest;
    order::clamp(covered.sqrt().ceil(), 2.0, PARTS as f64) as usize
}
