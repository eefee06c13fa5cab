//! PLY meshes as objects.
//!
//! Colours of vertices become a texture: every triangle has 2×2 texels of its own, in which bilinear interpolation is the linear
//! interpolation between its corners, c₀(1−u−v) + c₁u + c₂v. The fourth texel c₁ + c₂ − c₀ is limited to 0..1.

use super::placed::finish;
use crate::io::ply_mesh::PlyMesh;
use crate::num::order;
use crate::scene::material::{Material, Texture, Transfer, Wrap, linear_of_srgb};
use crate::scene::mesh::{Mesh, Object};
use crate::{Error, Result};
use std::sync::Arc;

/// A PLY mesh as an object; `name` is the file name in errors.
///
/// # Errors
/// When a number is out of range.
pub fn from_ply(p: &PlyMesh, name: &str) -> Result<Object> {
    let mesh = Mesh {
        positions: p.positions.clone(),
        normals: p.normals.clone(),
        uvs: p.uvs.iter().map(|&[u, v]| [u, 1.0 - v]).collect(),
        triangles: p.triangles.clone(),
    };
    let plain = |name: &str| Material { name: name.into(), ..Material::default() };
    let object = if !p.images.is_empty() {
        let textured = |image: &Arc<crate::io::gltf::Image>| Material {
            base_color_map: Some(Arc::new(Texture {
                width: image.width,
                height: image.height,
                texels: image.texels.clone(),
                transfer: Transfer::Srgb,
                wrap: [Wrap::Repeat; 2],
            })),
            ..plain(&image.name)
        };
        if p.images.len() > usize::from(u16::MAX) {
            return Err(Error::input(name).at("textures").expected("at most 65535").got("more"));
        }
        let material_of = p.image_of.iter().map(|&i| i as u16).collect();
        Object { mesh, material_of, materials: p.images.iter().map(textured).collect() }
    } else if p.colors.is_empty() {
        Object { material_of: vec![0; mesh.triangles.len()], mesh, materials: vec![plain("default")] }
    } else {
        colored(&mesh, &p.colors, plain("vertex colours"))
    };
    finish(object, name)
}

/// The mesh with vertices of their own for every triangle, and a texture of their colours.
fn colored(mesh: &Mesh, colors: &[[u8; 3]], material: Material) -> Object {
    let count = mesh.triangles.len();
    let across = Ord::max((count as f64).sqrt().ceil() as usize, 1);
    let (width, height) = (2 * across, 2 * count.div_ceil(across));
    let mut texels = vec![[0, 0, 0, 255]; width * height];
    let mut out = Mesh::default();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let (x, y) = (2 * (t % across), 2 * (t / across));
        let [a, b, c] = corners.map(|i| colors[i as usize]);
        let opaque = |[r, g, b]: [u8; 3]| [r, g, b, 255];
        texels[y * width + x] = opaque(a);
        texels[y * width + x + 1] = opaque(b);
        texels[(y + 1) * width + x] = opaque(c);
        texels[(y + 1) * width + x + 1] = opaque(fourth(a, b, c));
        let base = out.positions.len() as u32;
        let at = |dx: f32, dy: f32| [(x as f32 + dx) / width as f32, (y as f32 + dy) / height as f32];
        out.uvs.extend([at(0.5, 0.5), at(1.5, 0.5), at(0.5, 1.5)]);
        out.positions.extend(corners.map(|i| mesh.positions[i as usize]));
        if !mesh.normals.is_empty() {
            out.normals.extend(corners.map(|i| mesh.normals[i as usize]));
        }
        out.triangles.push([base, base + 1, base + 2]);
    }
    let map = Texture { width, height, texels, transfer: Transfer::Srgb, wrap: [Wrap::Clamp; 2] };
    let material = Material { base_color_map: Some(Arc::new(map)), ..material };
    Object { material_of: vec![0; count], mesh: out, materials: vec![material] }
}

/// The byte nearest to b + c − a in linear values.
fn fourth(a: [u8; 3], b: [u8; 3], c: [u8; 3]) -> [u8; 3] {
    let linear = linear_of_srgb();
    std::array::from_fn(|k| {
        let [a, b, c] = [a[k], b[k], c[k]].map(|x| linear[usize::from(x)]);
        let sum = order::clamp(b + c - a, 0.0, 1.0);
        let above = linear.partition_point(|x| *x < sum);
        let below = above.saturating_sub(1);
        let nearest = if above > 255 || sum - linear[below] < linear[above] - sum { below } else { above };
        nearest as u8
    })
}
