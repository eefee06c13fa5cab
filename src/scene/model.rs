//! Any `.gltf`, `.glb` or `.obj` as an [`Object`], and back.
//!
//! ```text
//! (x, y, z) of the file, y up  ──►  (x, −z, y), z up        texture coordinates: (0, 0) top left (v of OBJ is turned over)
//! node transforms, default scene, rest pose of skins  ──►  one mesh in the world
//! ```
//!
//! * Vertices that no triangle uses are left out, the others keep their order; a primitive (a group) shares none with another one.
//! * Normals are made unit. A zero one becomes the area-weighted mean of the faces around its vertex; a part without normals is flat,
//!   as glTF says, and gets zeros if another part has some.
//! * A transform that mirrors (negative determinant) turns the triangles over, so that they stay counter-clockwise from outside.
//! * Texture transforms are applied to the coordinates. All maps of a material must use one set and one transform.
//! * Back faces are as visible as front faces: `doubleSided` is not kept.
//! * Degenerate triangles stay: rays pass through them.
//!
//! # Rounding
//! World transforms and the blend of skins are f64; a position is rounded once. A mesh without transforms keeps its bits.

use super::material::{Alpha, Material, Texture, Transfer, Wrap};
use super::mesh::{Mesh, Object};
use crate::io::gltf::{self, Gltf};
use crate::io::obj::{self, Obj};
use crate::io::{atomic, gltf as file};
use crate::num::elem::f64 as elem;
use crate::num::order;
use crate::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Most vertices or triangles of a scene whose nodes repeat meshes.
pub const MAX_FLAT: usize = 1 << 26;

/// Reads and validates a model.
///
/// # Errors
/// When the extension is unknown, the file or one it refers to is bad, or nothing is to be seen.
pub fn read(path: &Path) -> Result<Object> {
    read_with_notes(path).map(|(object, _)| object)
}

/// Like [`read`], with a sentence for each kind of thing in the file that an object does not hold.
///
/// # Errors
/// See [`read`].
pub fn read_with_notes(path: &Path) -> Result<(Object, Vec<String>)> {
    let name = path.display().to_string();
    match extension(path).as_str() {
        "gltf" | "glb" => {
            let g = gltf::read(path)?;
            Ok((from_gltf(&g, &name)?, g.notes))
        }
        "obj" => {
            let o = obj::read(path)?;
            Ok((from_obj(&o, &name)?, o.notes))
        }
        other => Err(unknown(&name, other)),
    }
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

fn unknown(name: &str, extension: &str) -> Error {
    let got = if extension.is_empty() { "none".to_owned() } else { format!(".{extension}") };
    Error::input(name).at("extension").expected(".gltf, .glb or .obj").got(got)
}

/// Writes an object, whole or not at all: `.glb` with everything, or `.obj` with a material library and pictures beside it.
///
/// # Errors
/// When the extension is another one, the object is not valid, or a file cannot be written.
pub fn write(path: &Path, object: &Object) -> Result<()> {
    let name = path.display().to_string();
    object.validate(&name)?;
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    match extension(path).as_str() {
        "glb" => atomic::write_bytes(path, &file::to_glb(&to_gltf(object, &stem))?),
        "obj" => obj::write(path, &to_obj(object, &stem)),
        other => Err(Error::input(name).at("extension").expected(".glb or .obj").got(format!(".{other}"))),
    }
}

/// y up to z up.
pub fn z_up([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, -z, y]
}

/// z up to y up.
pub fn y_up([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, z, -y]
}

/// [`z_up`] as a map.
pub(super) fn z_up_map() -> DAffine3 {
    DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::new(0.0, -1.0, 0.0)))
}

/// A row-major matrix as a map.
pub(super) fn affine(m: &gltf::Matrix) -> DAffine3 {
    let column = |j: usize| DVec3::new(f64::from(m[0][j]), f64::from(m[1][j]), f64::from(m[2][j]));
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// T · R · S with R of a quaternion xyzw of any length but zero.
pub(super) fn compose(t: DVec3, q: [f64; 4], s: DVec3) -> DAffine3 {
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
pub(super) fn local(l: &gltf::Local) -> DAffine3 {
    match l {
        gltf::Local::Matrix(m) => affine(m),
        gltf::Local::Trs { translation, rotation, scale } => {
            let v = |a: &[f32; 3]| DVec3::from_array(a.map(f64::from));
            compose(v(translation), rotation.map(f64::from), v(scale))
        }
    }
}

/// World transforms of all nodes from their own ones; `above` stands over the roots.
pub(super) fn globals(g: &Gltf, locals: &[DAffine3], above: DAffine3) -> Vec<DAffine3> {
    let mut out = vec![above; g.nodes.len()];
    for &i in &g.order {
        out[i] = g.nodes[i].parent.map_or(above, |p| out[p]) * locals[i];
    }
    out
}

/// A primitive of a node in the flat mesh.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Whose.
    pub(super) node: usize,
    /// Index of the mesh, and of the primitive in it.
    pub(super) mesh: usize,
    pub(super) primitive: usize,
    /// Vertices of the flat mesh.
    pub(super) vertices: std::ops::Range<usize>,
    /// Triangles of the flat mesh.
    pub(super) triangles: std::ops::Range<usize>,
    /// Vertices of the primitive that are kept.
    pub(super) kept: Vec<u32>,
}

/// The primitives of a scene one after the other, positions and normals as in the file.
pub(super) struct Flat {
    pub(super) object: Object,
    pub(super) parts: Vec<Part>,
}

/// Collects the primitives of the default scene.
///
/// # Errors
/// When nothing is to be seen, or too much.
pub(super) fn flatten(g: &Gltf, name: &str) -> Result<Flat> {
    let mut textures = Textures { g, known: BTreeMap::new() };
    let mut materials: BTreeMap<Option<usize>, u16> = BTreeMap::new();
    let mut out = Flat { object: Object::default(), parts: Vec::new() };
    let shown = |p: &&gltf::Primitive| !p.triangles.is_empty();
    let all = g
        .scene
        .iter()
        .filter_map(|&n| g.nodes[n].mesh)
        .flat_map(|m| g.meshes[m].primitives.iter().filter(shown));
    let (has_normals, has_uvs) = all
        .fold((false, false), |(n, u), p| (n || p.normals.is_some(), u || p.uvs.iter().any(Option::is_some)));
    for &node in &g.scene {
        let Some(mesh) = g.nodes[node].mesh else { continue };
        for (primitive, p) in g.meshes[mesh].primitives.iter().enumerate() {
            if p.triangles.is_empty() {
                continue;
            }
            let Object { mesh: m, material_of, materials: list } = &mut out.object;
            let material = match materials.get(&p.material) {
                Some(&known) => known,
                None => {
                    let new = u16::try_from(list.len()).map_err(|_| {
                        Error::input(name).at("materials").expected("at most 65536").got("more")
                    })?;
                    let default = gltf::Material::default();
                    list.push(textures.material(p.material.map_or(&default, |i| &g.materials[i])));
                    materials.insert(p.material, new);
                    new
                }
            };
            let (kept, place) = used(p.positions.len(), &p.triangles);
            let (first, first_triangle) = (m.positions.len(), m.triangles.len());
            if first + kept.len() > MAX_FLAT || first_triangle + p.triangles.len() > MAX_FLAT {
                let e = Error::input(name).at("scene");
                return Err(e.expected(format!("at most {MAX_FLAT} vertices and triangles")).got("more"));
            }
            m.positions.extend(kept.iter().map(|&i| p.positions[i as usize]));
            if has_normals {
                match &p.normals {
                    Some(n) => m.normals.extend(kept.iter().map(|&i| n[i as usize])),
                    None => m.normals.resize(first + kept.len(), [0.0; 3]),
                }
            }
            if has_uvs {
                let default = gltf::Material::default();
                uvs(p, p.material.map_or(&default, |i| &g.materials[i]), &kept, &mut m.uvs)
                    .map_err(|e| e.within(name))?;
            }
            m.triangles.extend(p.triangles.iter().map(|t| t.map(|i| place[i as usize] + first as u32)));
            material_of.resize(m.triangles.len(), material);
            out.parts.push(Part {
                node,
                mesh,
                primitive,
                vertices: first..m.positions.len(),
                triangles: first_triangle..m.triangles.len(),
                kept,
            });
        }
    }
    if out.parts.is_empty() {
        return Err(Error::input(name).at("scene").expected("triangles").got("none"));
    }
    Ok(out)
}

/// Vertices that triangles use, in order, and the new index of each old one.
fn used(vertices: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut place = vec![u32::MAX; vertices];
    triangles.iter().flatten().for_each(|&i| place[i as usize] = 0);
    let kept: Vec<u32> = (0..vertices as u32).filter(|&i| place[i as usize] == 0).collect();
    kept.iter().enumerate().for_each(|(new, &old)| place[old as usize] = new as u32);
    (kept, place)
}

/// Appends the texture coordinates of a primitive that its material looks at.
fn uvs(p: &gltf::Primitive, m: &gltf::Material, kept: &[u32], out: &mut Vec<[f32; 2]>) -> Result<()> {
    let maps = [
        m.base_color_texture,
        m.metallic_roughness_texture,
        m.normal_texture.map(|(t, _)| t),
        m.emission_texture,
    ];
    let mut maps = maps.into_iter().flatten();
    let end = out.len() + kept.len();
    let Some(first) = maps.next() else {
        match p.uvs.first() {
            Some(Some(rows)) => out.extend(kept.iter().map(|&i| rows[i as usize])),
            _ => out.resize(end, [0.0; 2]),
        }
        return Ok(());
    };
    if maps.any(|t| t.uv_set != first.uv_set || t.transform != first.transform) {
        return Err(Error::input(format!("material '{}'", m.name))
            .expected("maps with one set of texture coordinates and one transform")
            .got("several")
            .hint("bake the maps to one set"));
    }
    let Some(Some(rows)) = p.uvs.get(first.uv_set) else {
        let e = Error::input(format!("material '{}'", m.name));
        return Err(e.expected(format!("texture coordinates of set {}", first.uv_set)).got("none"));
    };
    let t = first.transform;
    if t == gltf::UvTransform::IDENTITY {
        out.extend(kept.iter().map(|&i| rows[i as usize]));
        return Ok(());
    }
    let (s, c) = (elem::sin(f64::from(t.rotation)), elem::cos(f64::from(t.rotation)));
    for &i in kept {
        let [u, v] = rows[i as usize].map(f64::from);
        let (u, v) = (u * f64::from(t.scale[0]), v * f64::from(t.scale[1]));
        out.push([
            (c * u + s * v + f64::from(t.offset[0])) as f32,
            (-s * u + c * v + f64::from(t.offset[1])) as f32,
        ]);
    }
    Ok(())
}

/// Materials of a file as ours; a picture used twice in the same way is one texture.
struct Textures<'a> {
    g: &'a Gltf,
    known: BTreeMap<(usize, bool, [u8; 2]), Arc<Texture>>,
}

impl Textures<'_> {
    fn texture(&mut self, t: &gltf::TextureRef, srgb: bool) -> Option<Arc<Texture>> {
        let image = self.g.images[t.image].as_ref()?;
        let known = self.known.entry((t.image, srgb, t.wrap.map(|w| w as u8)));
        Some(Arc::clone(known.or_insert_with(|| {
            Arc::new(Texture {
                width: image.width,
                height: image.height,
                texels: image.texels.clone(),
                transfer: if srgb { Transfer::Srgb } else { Transfer::Linear },
                wrap: t.wrap.map(|w| match w {
                    gltf::Wrap::Repeat => Wrap::Repeat,
                    gltf::Wrap::Mirror => Wrap::Mirror,
                    gltf::Wrap::Clamp => Wrap::Clamp,
                }),
            })
        })))
    }

    fn material(&mut self, m: &gltf::Material) -> Material {
        let mut get = |t: Option<gltf::TextureRef>, srgb| t.and_then(|t| self.texture(&t, srgb));
        Material {
            name: m.name.clone(),
            base_color: m.base_color,
            base_color_map: get(m.base_color_texture, true),
            roughness: m.roughness,
            metallic: m.metallic,
            metallic_roughness_map: get(m.metallic_roughness_texture, false),
            normal_map: m.normal_texture.and_then(|(t, scale)| Some((get(Some(t), false)?, scale))),
            emission: m.emission,
            emission_map: get(m.emission_texture, true),
            alpha: match m.alpha {
                gltf::Alpha::Opaque => Alpha::Opaque,
                gltf::Alpha::Mask(t) => Alpha::Mask(t),
                gltf::Alpha::Blend => Alpha::Blend,
            },
        }
    }
}

/// The default scene in its rest pose as one object; `name` stands for the file.
///
/// # Errors
/// When nothing is to be seen, a material uses several texture transforms, or a number leaves the range of f32.
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

/// A normal under a linear map: the cofactor matrix det(M)·M⁻ᵀ, which exists for every M, with the sign of det(M) taken out.
pub(super) fn normal(m: &DMat3, n: [f32; 3]) -> [f32; 3] {
    let cofactor =
        DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let mapped = cofactor * DVec3::from_array(n.map(f64::from)) * sign;
    unit(mapped.to_array()).map(|x| x as f32)
}

/// Length 1, or zero.
pub(super) fn unit(v: [f64; 3]) -> [f64; 3] {
    let largest = v.iter().fold(0.0f64, |a, x| order::max(a, x.abs()));
    if !(largest > 0.0) {
        return [0.0; 3];
    }
    let v = v.map(|x| x / largest);
    let n = ((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]).sqrt();
    v.map(|x| x / n)
}

/// z up, unit normals, validated.
fn finish(mut object: Object, name: &str) -> Result<Object> {
    normals(&mut object.mesh);
    object.mesh.positions.iter_mut().for_each(|p| *p = z_up(*p));
    object.mesh.normals.iter_mut().for_each(|n| *n = z_up(*n));
    object.validate(name)?;
    Ok(object)
}

/// Makes normals unit, and those that are zero among others the mean of their faces. Parts without any stay zero.
pub(super) fn normals(mesh: &mut Mesh) {
    // A vertex whose whole part has no normals keeps zero; parts share no vertices, so its faces have none either.
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

/// An OBJ file as an object; `name` stands for the file.
///
/// # Errors
/// When it has no triangles or a number is out of range.
pub fn from_obj(o: &Obj, name: &str) -> Result<Object> {
    if o.triangles.is_empty() {
        return Err(Error::input(name).expected("faces").got("none"));
    }
    let mut mesh = Mesh {
        positions: o.positions.clone(),
        normals: o.normals.clone(),
        uvs: o.uvs.iter().map(|&[u, v]| [u, 1.0 - v]).collect(),
        triangles: o.triangles.clone(),
    };
    // Vertices are made by corners of faces; those of points and lines alone are not there.
    let mut object = Object::default();
    let mut places: BTreeMap<Option<usize>, u16> = BTreeMap::new();
    let mut known = BTreeMap::new();
    for g in &o.groups {
        let place = match places.get(&g.material) {
            Some(&p) => p,
            None => {
                let new = u16::try_from(object.materials.len())
                    .map_err(|_| Error::input(name).at("materials").expected("at most 65536").got("more"))?;
                object.materials.push(match g.material {
                    None => Material { name: "default".into(), ..Material::default() },
                    Some(m) => obj_material(o, &o.materials[m], &mut known, name)?,
                });
                places.insert(g.material, new);
                new
            }
        };
        object.material_of.extend(g.triangles.clone().map(|_| place));
    }
    std::mem::swap(&mut object.mesh, &mut mesh);
    finish(object, name)
}

type Known = BTreeMap<(usize, u8, bool), Arc<Texture>>;

fn obj_material(o: &Obj, m: &obj::Material, known: &mut Known, name: &str) -> Result<Material> {
    let mut get = |map: Option<obj::Map>, srgb: bool| {
        map.map(|map| {
            let image = &o.images[map.image];
            let entry = known.entry((map.image, u8::from(srgb), map.clamp));
            Arc::clone(entry.or_insert_with(|| {
                let wrap = if map.clamp { Wrap::Clamp } else { Wrap::Repeat };
                let transfer = if srgb { Transfer::Srgb } else { Transfer::Linear };
                let texels = image.texels.clone();
                Arc::new(Texture {
                    width: image.width,
                    height: image.height,
                    texels,
                    transfer,
                    wrap: [wrap; 2],
                })
            }))
        })
    };
    // Two pictures become one: G roughness, B metallic.
    let metallic_roughness_map = match (m.roughness_map, m.metallic_map) {
        (None, None) => None,
        (r, metal) => {
            let size = |map: obj::Map| [o.images[map.image].width, o.images[map.image].height];
            let first = r.or(metal).map(size).unwrap_or([1, 1]);
            if let (Some(a), Some(b)) = (r, metal)
                && (size(a) != size(b) || a.clamp != b.clamp)
            {
                return Err(Error::input(name)
                    .at(format!("material '{}'", m.name))
                    .expected("map_Pr and map_Pm of one size and wrapping")
                    .got(format!("{:?} and {:?}", size(a), size(b))));
            }
            let value =
                |map: Option<obj::Map>, i: usize| map.map_or(255, |map| o.images[map.image].texels[i][0]);
            let texels = (0..first[0] * first[1]).map(|i| [255, value(r, i), value(metal, i), 255]).collect();
            let clamp = r.or(metal).is_some_and(|map| map.clamp);
            let wrap = [if clamp { Wrap::Clamp } else { Wrap::Repeat }; 2];
            Some(Arc::new(Texture {
                width: first[0],
                height: first[1],
                texels,
                transfer: Transfer::Linear,
                wrap,
            }))
        }
    };
    let [r, g, b] = m.base_color;
    Ok(Material {
        name: m.name.clone(),
        base_color: [r, g, b, m.alpha],
        base_color_map: get(m.base_color_map, true),
        roughness: m.roughness,
        metallic: m.metallic,
        metallic_roughness_map,
        normal_map: get(m.normal_map, false).map(|t| (t, 1.0)),
        emission: m.emission,
        emission_map: get(m.emission_map, true),
        alpha: if m.alpha < 1.0 { Alpha::Blend } else { Alpha::Opaque },
    })
}

/// The textures of an object, each once, as pictures.
fn pictures(object: &Object) -> (Vec<Arc<Texture>>, Vec<Arc<gltf::Image>>) {
    let mut list: Vec<Arc<Texture>> = Vec::new();
    for m in &object.materials {
        let maps = [&m.base_color_map, &m.metallic_roughness_map, &m.emission_map];
        for t in maps.into_iter().flatten().chain(m.normal_map.as_ref().map(|(t, _)| t)) {
            if !list.iter().any(|known| Arc::ptr_eq(known, t)) {
                list.push(Arc::clone(t));
            }
        }
    }
    let image = |(i, t): (usize, &Arc<Texture>)| {
        Arc::new(gltf::Image {
            name: format!("image {i}"),
            width: t.width,
            height: t.height,
            texels: t.texels.clone(),
        })
    };
    let images = list.iter().enumerate().map(image).collect();
    (list, images)
}

/// One node with one mesh, a primitive per material.
pub fn to_gltf(object: &Object, name: &str) -> Gltf {
    let (list, images) = pictures(object);
    let texture = |t: &Arc<Texture>| gltf::TextureRef {
        image: list.iter().position(|known| Arc::ptr_eq(known, t)).unwrap_or(0),
        wrap: t.wrap.map(|w| match w {
            Wrap::Repeat => gltf::Wrap::Repeat,
            Wrap::Mirror => gltf::Wrap::Mirror,
            Wrap::Clamp => gltf::Wrap::Clamp,
        }),
        uv_set: 0,
        transform: gltf::UvTransform::IDENTITY,
    };
    let material = |m: &Material| gltf::Material {
        name: m.name.clone(),
        base_color: m.base_color,
        base_color_texture: m.base_color_map.as_ref().map(texture),
        metallic: m.metallic,
        roughness: m.roughness,
        metallic_roughness_texture: m.metallic_roughness_map.as_ref().map(texture),
        normal_texture: m.normal_map.as_ref().map(|(t, scale)| (texture(t), *scale)),
        emission: m.emission,
        emission_texture: m.emission_map.as_ref().map(texture),
        alpha: match m.alpha {
            Alpha::Opaque => gltf::Alpha::Opaque,
            Alpha::Mask(t) => gltf::Alpha::Mask(t),
            Alpha::Blend => gltf::Alpha::Blend,
        },
        double_sided: true,
    };
    let m = &object.mesh;
    let positions = Arc::new(m.positions.iter().map(|p| y_up(*p)).collect::<Vec<_>>());
    let normals =
        (!m.normals.is_empty()).then(|| Arc::new(m.normals.iter().map(|n| y_up(*n)).collect::<Vec<_>>()));
    let uvs = if m.uvs.is_empty() { Vec::new() } else { vec![Some(Arc::new(m.uvs.clone()))] };
    let primitives = (0..object.materials.len()).map(|k| gltf::Primitive {
        positions: Arc::clone(&positions),
        normals: normals.clone(),
        uvs: uvs.clone(),
        joints: Vec::new(),
        weights: Vec::new(),
        triangles: m
            .triangles
            .iter()
            .zip(&object.material_of)
            .filter(|(_, of)| usize::from(**of) == k)
            .map(|(t, _)| *t)
            .collect(),
        material: Some(k),
    });
    let primitives = primitives.filter(|p| !p.triangles.is_empty()).collect();
    let identity =
        gltf::Local::Trs { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0], scale: [1.0; 3] };
    Gltf {
        nodes: vec![gltf::Node {
            name: name.into(),
            parent: None,
            children: Vec::new(),
            local: identity,
            mesh: Some(0),
            skin: None,
        }],
        order: vec![0],
        scene: vec![0],
        meshes: vec![gltf::Mesh { name: name.into(), primitives }],
        materials: object.materials.iter().map(material).collect(),
        images: images.into_iter().map(Some).collect(),
        ..Gltf::default()
    }
}

/// Groups by runs of one material. Roughness and metallic maps become two pictures, normal factors and cut-offs are not kept.
pub fn to_obj(object: &Object, name: &str) -> Obj {
    let (list, mut images) = pictures(object);
    let find = |t: &Arc<Texture>| obj::Map {
        image: list.iter().position(|known| Arc::ptr_eq(known, t)).unwrap_or(0),
        clamp: t.wrap == [Wrap::Clamp; 2],
    };
    let mut materials = Vec::new();
    for m in &object.materials {
        let mut channel = |c: usize| {
            m.metallic_roughness_map.as_ref().map(|t| {
                let texels = t.texels.iter().map(|x| [x[c], x[c], x[c], 255]).collect();
                images.push(Arc::new(gltf::Image {
                    name: String::new(),
                    width: t.width,
                    height: t.height,
                    texels,
                }));
                obj::Map { image: images.len() - 1, clamp: t.wrap == [Wrap::Clamp; 2] }
            })
        };
        let (roughness_map, metallic_map) = (channel(1), channel(2));
        let [r, g, b, alpha] = m.base_color;
        materials.push(obj::Material {
            name: m.name.clone(),
            base_color: [r, g, b],
            base_color_map: m.base_color_map.as_ref().map(find),
            alpha: if m.alpha == Alpha::Opaque { 1.0 } else { alpha },
            roughness: m.roughness,
            roughness_map,
            metallic: m.metallic,
            metallic_map,
            normal_map: m.normal_map.as_ref().map(|(t, _)| find(t)),
            emission: m.emission,
            emission_map: m.emission_map.as_ref().map(find),
        });
    }
    let mut groups: Vec<obj::Group> = Vec::new();
    for (i, &m) in object.material_of.iter().enumerate() {
        match groups.last_mut() {
            Some(g) if g.material == Some(usize::from(m)) => g.triangles.end = i + 1,
            _ => groups.push(obj::Group {
                name: name.into(),
                triangles: i..i + 1,
                material: Some(usize::from(m)),
            }),
        }
    }
    Obj {
        positions: object.mesh.positions.iter().map(|p| y_up(*p)).collect(),
        normals: object.mesh.normals.iter().map(|n| y_up(*n)).collect(),
        uvs: object.mesh.uvs.iter().map(|&[u, v]| [u, 1.0 - v]).collect(),
        triangles: object.mesh.triangles.clone(),
        groups,
        materials,
        images,
        notes: Vec::new(),
    }
}
