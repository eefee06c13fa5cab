//! Shading data of hits: position, normals, material.
//!
//! * The **face normal** is that of the triangle, oriented towards the ray: every surface has two sides.
//! * The **shading normal** is the interpolated vertex normal, oriented to the side of the face normal; it is
//!   the face normal if the mesh has no vertex normals or the interpolated one is zero. A normal map tilts it
//!   in the frame of the texture coordinates, x to the right of the image, y up. If it points away from the
//!   eye, it is bent until it just faces the eye, so that no visible point is black because of an invisible
//!   normal.
//! * The **offset** of rays that leave a surface, along the face normal, is 2⁻¹⁸ times the largest coordinate
//!   of the triangle: 64 units in the last place of the coordinates from which the position is computed,
//!   whatever the scale of the scene.

use super::ggx::Material;
use super::vector::{add, cross, cross_direction, dot, scale, select, sub, together, unit};
use crate::geometry::bvh::Hit;
use crate::num::lanes::{Real, f32x8};
use crate::num::order;
use crate::scene::material::{self, Alpha};
use crate::scene::mesh::Object;

/// Smallest cosine between shading normal and view after bending.
const FACING_MIN: f32 = 1e-3;
/// Offset divided by the largest coordinate of the triangle: 2⁻¹⁸.
const OFFSET: f32 = 1.0 / 262_144.0;

/// Eight surface points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    /// Position on the triangle.
    pub(super) position: [f32x8; 3],
    /// Unit face normal, oriented towards the eye.
    pub(super) face: [f32x8; 3],
    /// Unit shading normal on the visible side of the face; apart from its side it does not depend on the
    /// view.
    pub(super) mapped: [f32x8; 3],
    /// The shading normal bent towards the view, for reflection.
    pub(super) normal: [f32x8; 3],
    /// Material with textures applied.
    pub(super) material: Material<f32x8>,
    /// Emitted linear radiance.
    pub(super) emission: [f32x8; 3],
    /// Offset of rays that leave the surface.
    pub(super) offset: f32x8,
}

impl Surface {
    /// Returns the start of rays, offset to the visible side of the face.
    #[inline(always)]
    pub(super) fn start(&self) -> [f32x8; 3] {
        add(self.position, scale(self.face, self.offset))
    }

    /// Whether a direction leaves on the visible side of the face. The shading normal also reflects below the
    /// face, where an open sheet would not block light from behind.
    #[inline(always)]
    pub(super) fn before(&self, towards: [f32x8; 3]) -> f32x8 {
        Real::gt(dot(self.face, towards), f32x8::splat(0.0))
    }
}

/// Returns the texture coordinate of a hit; (0, 0) if the mesh has none.
#[inline]
fn uv_at(object: &Object, hit: &Hit) -> [f32; 2] {
    let mesh = &object.mesh;
    if mesh.uvs.is_empty() {
        return [0.0; 2];
    }
    let [a, b, c] = mesh.triangles[hit.triangle as usize].map(|i| mesh.uvs[i as usize]);
    std::array::from_fn(|k| (a[k] + hit.u * (b[k] - a[k])) + hit.v * (c[k] - a[k]))
}

/// Returns the material of a hit.
#[inline]
pub(super) fn material_at<'a>(object: &'a Object, hit: &Hit) -> &'a material::Material {
    &object.materials[usize::from(object.material_of[hit.triangle as usize])]
}

/// Returns the fraction of light that a hit transmits: 0 is opaque, 1 fully transparent.
pub(super) fn transmittance(object: &Object, hit: &Hit) -> f32 {
    let m = material_at(object, hit);
    if m.alpha == Alpha::Opaque {
        return 0.0;
    }
    let texel = m.base_color_map.as_ref().map_or(1.0, |map| map.sample(uv_at(object, hit))[3]);
    let alpha = m.base_color[3] * texel;
    match m.alpha {
        Alpha::Opaque => 0.0,
        Alpha::Mask(cut) => f32::from(u8::from(alpha < cut)),
        Alpha::Blend => 1.0 - alpha,
    }
}

/// Returns the radiance that a hit emits.
pub(super) fn emission(object: &Object, hit: &Hit) -> [f32; 3] {
    let m = material_at(object, hit);
    let glow = m.emission_map.as_ref().map(|map| map.sample(uv_at(object, hit)));
    std::array::from_fn(|k| m.emission[k] * glow.map_or(1.0, |c| c[k]))
}

/// Returns the start of a ray that passes through a hit, on its far side.
pub(super) fn beyond(object: &Object, hit: &Hit, towards: [f32; 3]) -> [f32; 3] {
    let (face, step) = (face(object, hit.triangle), offset(object, hit.triangle));
    let step = if dot(face, towards) < 0.0 { -step } else { step };
    add(position(object, hit), scale(face, step))
}

/// Returns the unit normal of a triangle, on the side from which its corners are counter-clockwise; 0 if it
/// has no area.
pub(super) fn face(object: &Object, triangle: u32) -> [f32; 3] {
    let [p0, p1, p2] = object.mesh.corners(triangle as usize);
    unit(cross_direction(sub(p1, p0), sub(p2, p0))).0
}

/// Returns the offset of rays that leave a triangle.
pub(super) fn offset(object: &Object, triangle: u32) -> f32 {
    OFFSET * reach(&object.mesh.corners(triangle as usize))
}

/// Returns the position of a hit.
pub(super) fn position(object: &Object, hit: &Hit) -> [f32; 3] {
    let [p0, p1, p2] = object.mesh.corners(hit.triangle as usize);
    add(p0, add(scale(sub(p1, p0), hit.u), scale(sub(p2, p0), hit.v)))
}

/// Returns the largest coordinate of a triangle.
#[inline]
fn reach(corners: &[[f32; 3]; 3]) -> f32 {
    let mut largest = 0.0;
    for x in corners.iter().flatten() {
        largest = order::max(largest, x.abs());
    }
    largest
}

/// Converts corner attributes of eight triangles to lanes: attribute, component.
#[inline(always)]
fn lanes<const N: usize>(rows: [[[f32; N]; 3]; 8]) -> [[f32x8; N]; 3] {
    std::array::from_fn(|corner| {
        std::array::from_fn(|k| f32x8::new(std::array::from_fn(|l| rows[l][corner][k])))
    })
}

/// Returns the surface points of eight hits seen along `view` (towards the eye); every entry is a hit.
pub(super) fn eight(object: &Object, hits: &[Hit; 8], view: [f32x8; 3]) -> Surface {
    let mesh = &object.mesh;
    let zero = f32x8::splat(0.0);
    let index: [[u32; 3]; 8] = std::array::from_fn(|l| mesh.triangles[hits[l].triangle as usize]);
    let corners: [[[f32; 3]; 3]; 8] = std::array::from_fn(|l| index[l].map(|i| mesh.positions[i as usize]));
    let [p0, p1, p2] = lanes(corners);
    let u = f32x8::new(std::array::from_fn(|l| hits[l].u));
    let v = f32x8::new(std::array::from_fn(|l| hits[l].v));
    let offset = f32x8::new(std::array::from_fn(|l| OFFSET * reach(&corners[l])));
    let (e1, e2) = (sub(p1, p0), sub(p2, p0));
    let position = add(p0, add(scale(e1, u), scale(e2, v)));
    let face = unit(cross_direction(e1, e2)).0;
    let away = Real::lt(dot(face, view), zero);
    let face = select(away, face.map(|x| -x), face);
    let mut normal = face;
    if !mesh.normals.is_empty() {
        let [n0, n1, n2] = lanes(std::array::from_fn(|l| index[l].map(|i| mesh.normals[i as usize])));
        let sum = add(n0, add(scale(sub(n1, n0), u), scale(sub(n2, n0), v)));
        let (smooth, length) = unit(sum);
        normal = select(Real::gt(length, zero), smooth, face);
        let inside = Real::lt(dot(normal, face), zero);
        normal = select(inside, normal.map(|x| -x), normal);
    }
    let (material, emission) = materials(object, hits, &index, [e1, e2], face, &mut normal);
    // Bend the normal towards the view.
    let mapped = normal;
    let facing = dot(normal, view);
    let hidden = Real::lt(facing, f32x8::splat(FACING_MIN));
    let bent = unit(add(normal, scale(view, f32x8::splat(FACING_MIN) - facing))).0;
    normal = select(hidden, bent, normal);
    Surface { position, face, mapped, normal, material, emission, offset }
}

/// Evaluates materials with their textures; tilts the normals that have a normal map.
#[inline(always)]
fn materials(
    object: &Object,
    hits: &[Hit; 8],
    index: &[[u32; 3]; 8],
    edges: [[f32x8; 3]; 2],
    face: [f32x8; 3],
    normal: &mut [f32x8; 3],
) -> (Material<f32x8>, [f32x8; 3]) {
    let (mut albedo, mut emission) = ([[0.0_f32; 8]; 3], [[0.0_f32; 8]; 3]);
    let (mut roughness, mut metallic) = ([0.0_f32; 8], [0.0_f32; 8]);
    let mut tilt = [[0.0_f32; 8], [0.0; 8], [1.0; 8]];
    let mut tilted = [0.0_f32; 8];
    for l in 0..8 {
        let m = material_at(object, &hits[l]);
        let mapped = m.base_color_map.is_some()
            || m.metallic_roughness_map.is_some()
            || m.emission_map.is_some()
            || m.normal_map.is_some();
        let uv = if mapped { uv_at(object, &hits[l]) } else { [0.0; 2] };
        let color = m.base_color_map.as_ref().map(|map| map.sample(uv));
        let glow = m.emission_map.as_ref().map(|map| map.sample(uv));
        for k in 0..3 {
            albedo[k][l] = m.base_color[k] * color.map_or(1.0, |c| c[k]);
            emission[k][l] = m.emission[k] * glow.map_or(1.0, |c| c[k]);
        }
        let rm = m.metallic_roughness_map.as_ref().map(|map| map.sample(uv));
        roughness[l] = m.roughness * rm.map_or(1.0, |c| c[1]);
        metallic[l] = m.metallic * rm.map_or(1.0, |c| c[2]);
        if let Some((map, strength)) = &m.normal_map
            && !object.mesh.uvs.is_empty()
        {
            let t = map.sample(uv);
            tilt[0][l] = (2.0 * t[0] - 1.0) * strength;
            tilt[1][l] = (2.0 * t[1] - 1.0) * strength;
            tilt[2][l] = 2.0 * t[2] - 1.0;
            tilted[l] = 1.0;
        }
    }
    if tilted.contains(&1.0) {
        let uvs = lanes(std::array::from_fn(|l| index[l].map(|i| object.mesh.uvs[i as usize])));
        let new = tilt_normal(uvs, edges, *normal, face, tilt.map(f32x8::new));
        *normal = select(Real::gt(f32x8::new(tilted), f32x8::splat(0.5)), new, *normal);
    }
    let m = Material {
        albedo: albedo.map(f32x8::new),
        roughness: f32x8::new(roughness),
        metallic: f32x8::new(metallic),
    };
    (m, emission.map(f32x8::new))
}

/// Returns the normal of a normal map: `t` in the frame (right, up, normal) of the image on the surface. If
/// the texture coordinates span no area, or the map contains a zero vector, the normal is not changed.
#[inline(always)]
fn tilt_normal(
    [a, b, c]: [[f32x8; 2]; 3],
    edges: [[f32x8; 3]; 2],
    normal: [f32x8; 3],
    face: [f32x8; 3],
    t: [f32x8; 3],
) -> [f32x8; 3] {
    let zero = f32x8::splat(0.0);
    let [e1, e2] = together(edges);
    let (u1, v1, u2, v2) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
    let area = u1 * v2 - u2 * v1;
    let sign = Real::select(Real::lt(area, zero), f32x8::splat(-1.0), f32x8::splat(1.0));
    // Directions in which u increases and in which v decreases, up to a positive factor.
    let right = scale(sub(scale(e1, v2), scale(e2, v1)), sign);
    let up = scale(sub(scale(e1, u2), scale(e2, u1)), sign);
    let across = |d: [f32x8; 3]| unit(sub(d, scale(normal, dot(d, normal))));
    let (right, length) = across(right);
    let square = cross(normal, right);
    let upwards = Real::lt(dot(square, up), zero);
    let up = select(upwards, square.map(|x| -x), square);
    let (new, there) = unit(add(add(scale(right, t[0]), scale(up, t[1])), scale(normal, t[2])));
    let flat = f32x8::and(Real::gt(length, zero), Real::gt(there, zero));
    let new = select(flat, new, normal);
    // A tilt beyond the horizon of the face is limited to its side.
    let below = Real::lt(dot(new, face), zero);
    let lifted = unit(sub(new, scale(face, dot(new, face)))).0;
    select(below, lifted, new)
}
