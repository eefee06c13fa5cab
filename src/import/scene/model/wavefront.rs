//! OBJ files as objects.

use super::placed::finish;
use crate::io::obj::{self, Obj};
use crate::scene::material::{Alpha, Material, Texture, Transfer, Wrap};
use crate::scene::mesh::{Mesh, Object};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::sync::Arc;

/// An OBJ file as an object; `name` is the file name in errors.
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
    // Vertices are made by corners of faces; vertices used only by points and lines are absent.
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
    // Two images become one: G roughness, B metallic.
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
