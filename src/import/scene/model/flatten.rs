//! The primitives of a glTF scene one after the other, with their materials and texture coordinates.

use super::MAX_FLAT;
use crate::io::gltf::{self, Gltf};
use crate::num::elem::f64 as elem;
use crate::scene::material::{Alpha, Material, Texture, Transfer, Wrap};
use crate::scene::mesh::Object;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A primitive of a node in the flat mesh.
#[derive(Clone, Debug)]
pub(in crate::scene) struct Part {
    /// Whose.
    pub(in crate::scene) node: usize,
    /// Index of the mesh, and of the primitive in it.
    pub(in crate::scene) mesh: usize,
    pub(in crate::scene) primitive: usize,
    /// Vertices of the flat mesh.
    pub(in crate::scene) vertices: std::ops::Range<usize>,
    /// Triangles of the flat mesh.
    pub(in crate::scene) triangles: std::ops::Range<usize>,
    /// Vertices of the primitive that are kept.
    pub(in crate::scene) kept: Vec<u32>,
}

/// The primitives of a scene one after the other, positions and normals as in the file.
pub(in crate::scene) struct FlatScene {
    pub(in crate::scene) object: Object,
    pub(in crate::scene) parts: Vec<Part>,
}

/// Collects the primitives of the default scene.
///
/// # Errors
/// When there is no visible geometry, or more than the limits allow.
pub(in crate::scene) fn flatten(g: &Gltf, name: &str) -> Result<FlatScene> {
    let mut textures = Textures { g, known: BTreeMap::new() };
    let mut materials: BTreeMap<Option<usize>, u16> = BTreeMap::new();
    let mut out = FlatScene { object: Object::default(), parts: Vec::new() };
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

/// Appends the texture coordinates that the material of a primitive uses.
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

/// Materials of a file as ours; an image used twice in the same way is one texture.
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
