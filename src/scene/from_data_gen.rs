//! Generated records as scenes: `data_gen` authors in f64, everything here is one rounding to f32.

use super::camera::{Camera, Model};
use super::light::Environment;
use super::material::{Alpha, Material, Texture, Transfer, Wrap};
use super::mesh::{Mesh, Object};
use data_gen::light::Map;
use data_gen::splats::View;
use data_gen::surface::{self, Picture, Surface};
use std::sync::Arc;

/// One object of several surfaces, in their order; each keeps a material of its own, textures repeat.
///
/// A surface without normals among surfaces that have them gets zero normals (its triangles stay flat); one
/// without texture coordinates among surfaces that have them gets zeros.
///
/// # Panics
/// With more than 65 535 surfaces or 2³² vertices.
pub fn object(surfaces: &[Surface]) -> Object {
    let has_normals = surfaces.iter().any(|s| !s.normals.is_empty());
    let has_uvs = surfaces.iter().any(|s| !s.uvs.is_empty());
    let mut object = Object::default();
    for (index, s) in surfaces.iter().enumerate() {
        let first = u32::try_from(object.mesh.positions.len()).expect("vertices are counted in 32 bits");
        let index = u16::try_from(index).expect("materials are counted in 16 bits");
        let Mesh { positions, normals, uvs, triangles } = &mut object.mesh;
        positions.extend(s.positions.iter().map(|p| p.map(|x| x as f32)));
        if has_normals {
            normals.extend(s.normals.iter().map(|n| n.map(|x| x as f32)));
            normals.resize(positions.len(), [0.0; 3]);
        }
        if has_uvs {
            uvs.extend(s.uvs.iter().map(|t| t.map(|x| x as f32)));
            uvs.resize(positions.len(), [0.0; 2]);
        }
        triangles.extend(s.triangles.iter().map(|t| t.map(|i| i + first)));
        object.material_of.resize(triangles.len(), index);
        object.materials.push(material(&s.material));
    }
    object
}

/// A generated material: opaque, without relief or emission.
pub fn material(m: &surface::Material) -> Material {
    let [r, g, b] = m.base_color.map(|x| x as f32);
    Material {
        name: m.name.clone(),
        base_color: [r, g, b, 1.0],
        base_color_map: m.base_color_map.as_ref().map(texture),
        roughness: m.roughness as f32,
        metallic: m.metallic as f32,
        metallic_roughness_map: m.metallic_roughness_map.as_ref().map(texture),
        alpha: Alpha::Opaque,
        ..Material::default()
    }
}

fn texture(p: &Picture) -> Arc<Texture> {
    Arc::new(Texture {
        width: p.width,
        height: p.height,
        texels: p.texels.clone(),
        transfer: match p.transfer {
            surface::Transfer::Srgb => Transfer::Srgb,
            surface::Transfer::Linear => Transfer::Linear,
        },
        wrap: [Wrap::Repeat; 2],
    })
}

/// A generated map; both use one orientation.
pub fn environment(map: &Map) -> Environment {
    Environment { width: map.width, height: map.height, radiance: map.radiance.clone() }
}

/// A generated view under a projection model.
pub fn camera(view: &View, model: Model) -> Camera {
    let view_from_world = view.view_from_world.map(|x| x as f32);
    let intrinsics = view.intrinsics.map(|x| x as f32);
    Camera::from_matrices(&view_from_world, &intrinsics, view.width, view.height, model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_become_one_object_with_a_material_each() {
        let triangle = |x: f64, normals: Vec<[f64; 3]>| Surface {
            positions: vec![[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]],
            normals,
            uvs: Vec::new(),
            triangles: vec![[0, 1, 2]],
            material: surface::Material {
                name: format!("m{x}"),
                base_color: [0.5, 0.25, 1.0],
                base_color_map: None,
                roughness: 0.3,
                metallic: 1.0,
                metallic_roughness_map: None,
            },
        };
        let o = object(&[triangle(0.0, Vec::new()), triangle(2.0, vec![[0.0, 0.0, 1.0]; 3])]);
        o.validate("two triangles").expect("a valid object");
        assert_eq!(o.mesh.triangles, [[0, 1, 2], [3, 4, 5]], "indices shifted");
        assert_eq!(o.material_of, [0, 1], "one material per surface");
        assert_eq!(o.mesh.normals[2..4], [[0.0; 3], [0.0, 0.0, 1.0]], "zero normals stand for flat");
        assert!(o.mesh.uvs.is_empty(), "no texture coordinates at all");
        assert_eq!(o.materials[1].base_color, [0.5, 0.25, 1.0, 1.0], "opaque");
    }
}
