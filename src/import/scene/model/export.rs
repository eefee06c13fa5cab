//! Objects as records of glTF and OBJ.

use super::y_up;
use crate::io::gltf::{self, Gltf};
use crate::io::obj::{self, Obj};
use crate::scene::material::{Alpha, Material, Texture, Wrap};
use crate::scene::mesh::Object;
use std::sync::Arc;

/// The textures of an object, each once, as images.
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

/// One node with one mesh, a primitive per material. Where no corner has a normal the primitive has none, and
/// is flat.
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
    // Normals of primitives that have some; a file may contain only unit vectors, so unused rows point up.
    let zero = |i: u32| m.normals.get(i as usize).is_none_or(|n| *n == [0.0; 3]);
    let mut is_smooth = vec![false; object.materials.len()];
    for (t, &k) in m.triangles.iter().zip(&object.material_of) {
        is_smooth[usize::from(k)] |= !t.iter().all(|&i| zero(i));
    }
    let mut rows = vec![[0.0, 1.0, 0.0]; m.normals.len()];
    for (t, _) in m.triangles.iter().zip(&object.material_of).filter(|(_, k)| is_smooth[usize::from(**k)]) {
        t.iter().for_each(|&i| rows[i as usize] = y_up(m.normals[i as usize]));
    }
    let normals = Arc::new(rows);
    let uvs = if m.uvs.is_empty() { Vec::new() } else { vec![Some(Arc::new(m.uvs.clone()))] };
    let primitives = (0..object.materials.len()).map(|k| gltf::Primitive {
        positions: Arc::clone(&positions),
        normals: is_smooth[k].then(|| Arc::clone(&normals)),
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

/// Groups by runs of one material. Roughness and metallic maps become two images, normal factors and cut-offs
/// are not kept.
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
