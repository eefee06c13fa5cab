//! Positions of vertices under nodes and skins.

use super::flatten::{Part, flatten};
use super::z_up;
use crate::Result;
use crate::io::gltf::{self, Gltf};
use crate::math::vector::unit;
use crate::scene::mesh::{Mesh, Object};
use glam::{DAffine3, DMat3, DVec3};

/// [`z_up`] as a map.
pub(in crate::scene) fn z_up_map() -> DAffine3 {
    DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::new(0.0, -1.0, 0.0)))
}

/// A row-major matrix as a map.
pub(in crate::scene) fn affine(m: &gltf::Matrix) -> DAffine3 {
    let column = |j: usize| DVec3::new(f64::from(m[0][j]), f64::from(m[1][j]), f64::from(m[2][j]));
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// T · R · S with R of a quaternion xyzw of any length but zero.
pub(in crate::scene) fn compose(t: DVec3, q: [f64; 4], s: DVec3) -> DAffine3 {
    let n = (((q[0] * q[0] + q[1] * q[1]) + q[2] * q[2]) + q[3] * q[3]).sqrt();
    let [x, y, z, w] = q.map(|c| c / n);
    let r = DMat3::from_cols(
        DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        DVec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
    DAffine3 { matrix3: DMat3::from_cols(r.x_axis * s.x, r.y_axis * s.y, r.z_axis * s.z), translation: t }
}

/// A node's own transform.
pub(in crate::scene) fn local(l: &gltf::Local) -> DAffine3 {
    match l {
        gltf::Local::Matrix(m) => affine(m),
        gltf::Local::Trs { translation, rotation, scale } => {
            let v = |a: &[f32; 3]| DVec3::from_array(a.map(f64::from));
            compose(v(translation), rotation.map(f64::from), v(scale))
        }
    }
}

/// World transforms of all nodes from their own ones; `above` is the parent of the roots.
pub(in crate::scene) fn globals(g: &Gltf, locals: &[DAffine3], above: DAffine3) -> Vec<DAffine3> {
    let mut out = vec![above; g.nodes.len()];
    for &i in &g.order {
        out[i] = g.nodes[i].parent.map_or(above, |p| out[p]) * locals[i];
    }
    out
}

/// The default scene in its rest pose as one object; `name` is the file name in errors.
///
/// # Errors
/// When there is no visible geometry, a material uses several texture transforms, or a number leaves the
/// range of f32.
pub fn from_gltf(g: &Gltf, name: &str) -> Result<Object> {
    let mut flat = flatten(g, name)?;
    let locals: Vec<DAffine3> = g.nodes.iter().map(|n| local(&n.local)).collect();
    let globals = globals(g, &locals, DAffine3::IDENTITY);
    for part in &flat.parts {
        let p = &g.meshes[part.mesh].primitives[part.primitive];
        match g.nodes[part.node].skin.filter(|_| !p.joints.is_empty()) {
            None => transform(
                &mut flat.object.mesh,
                part,
                &|_| globals[part.node],
                globals[part.node] == DAffine3::IDENTITY,
            ),
            Some(skin) => {
                let s = &g.skins[skin];
                let maps: Vec<DAffine3> =
                    s.joints.iter().zip(&s.inverse_bind).map(|(&j, m)| globals[j] * affine(m)).collect();
                let blend = |v: usize| {
                    let mut sum = DAffine3::ZERO;
                    for (joints, weights) in p.joints.iter().zip(&p.weights) {
                        for (&j, &w) in joints[v].iter().zip(&weights[v]).filter(|(_, w)| **w > 0.0) {
                            let m = &maps[usize::from(j)];
                            sum.matrix3 += m.matrix3 * f64::from(w);
                            sum.translation += m.translation * f64::from(w);
                        }
                    }
                    let total = p.weights.iter().flat_map(|w| w[v]).fold(0.0, |s, w| s + f64::from(w));
                    DAffine3 { matrix3: sum.matrix3 * (1.0 / total), translation: sum.translation / total }
                };
                transform(&mut flat.object.mesh, part, &blend, false);
            }
        }
    }
    finish(flat.object, name)
}

/// Maps the vertices of a part; `of` gives the map of a vertex of the primitive.
fn transform(mesh: &mut Mesh, part: &Part, of: &dyn Fn(usize) -> DAffine3, identity: bool) {
    if identity {
        return;
    }
    let mut turned = false;
    for (i, &old) in part.vertices.clone().zip(&part.kept) {
        let map = of(old as usize);
        turned = map.matrix3.determinant() < 0.0;
        let p = map.transform_point3(DVec3::from_array(mesh.positions[i].map(f64::from)));
        mesh.positions[i] = p.to_array().map(|x| x as f32);
        if let Some(n) = mesh.normals.get_mut(i) {
            *n = normal(&map.matrix3, *n);
        }
    }
    if turned {
        mesh.triangles[part.triangles.clone()].iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// A normal under a linear map: the cofactor matrix det(M)·M⁻ᵀ, which exists for every M, with the sign of
/// det(M) taken out.
pub(in crate::scene) fn normal(m: &DMat3, n: [f32; 3]) -> [f32; 3] {
    let cofactor =
        DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let mapped = cofactor * DVec3::from_array(n.map(f64::from)) * sign;
    unit(mapped.to_array()).map(|x| x as f32)
}

/// z up, unit normals, validated.
pub(super) fn finish(mut object: Object, name: &str) -> Result<Object> {
    normals(&mut object.mesh);
    object.mesh.positions.iter_mut().for_each(|p| *p = z_up(*p));
    object.mesh.normals.iter_mut().for_each(|n| *n = z_up(*n));
    object.validate(name)?;
    Ok(object)
}

/// Makes normals unit, and those that are zero among others the mean of their faces. Parts without any stay
/// zero.
pub(in crate::scene) fn normals(mesh: &mut Mesh) {
    // A vertex whose whole part has no normals keeps zero; parts share no vertices, so its faces have none
    // either.
    let zero = |n: &[f32; 3]| *n == [0.0; 3];
    let mut mean = vec![[0.0f64; 3]; if mesh.normals.iter().any(zero) { mesh.positions.len() } else { 0 }];
    if !mean.is_empty() {
        for t in &mesh.triangles {
            let corner = t.map(|i| mesh.normals[i as usize]);
            if corner.iter().all(zero) {
                continue;
            }
            let [a, b, c] = t.map(|i| DVec3::from_array(mesh.positions[i as usize].map(f64::from)));
            let face = (b - a).cross(c - a).to_array();
            for &i in t {
                let m = &mut mean[i as usize];
                *m = std::array::from_fn(|k| m[k] + face[k]);
            }
        }
    }
    for (i, n) in mesh.normals.iter_mut().enumerate() {
        let wide = n.map(f64::from);
        let length = ((wide[0] * wide[0] + wide[1] * wide[1]) + wide[2] * wide[2]).sqrt();
        if zero(n) {
            *n = unit(mean[i]).map(|x| x as f32);
        } else if !((length - 1.0).abs() <= 1e-6) {
            // A unit normal keeps its bits.
            *n = unit(wide).map(|x| x as f32);
        }
    }
}
