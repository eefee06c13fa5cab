//! [`Gltf`] to the bytes of a GLB.

use super::{Alpha, Gltf, Local, Matrix, TextureRef, UvTransform, Wrap};
use crate::io::image_file;
use crate::num::order;
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// The buffer while it grows, with the views and accessors into it.
#[derive(Default)]
struct Bin {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// Shared arrays already written: address, accessor.
    written: Vec<(usize, usize)>,
}

impl Bin {
    /// A view of its own; `target` 34962 for vertices, 34963 for indices, 0 for neither.
    fn view(&mut self, bytes: &[u8], target: u32) -> usize {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let mut view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        if target != 0 {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    /// An accessor of float rows, with bounds as viewers expect them.
    fn floats<const N: usize>(&mut self, rows: &Arc<Vec<[f32; N]>>, kind: &str, bounds: bool) -> usize {
        let address = Arc::as_ptr(rows) as usize;
        if let Some(&(_, known)) = self.written.iter().find(|(a, _)| *a == address) {
            return known;
        }
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, 34962);
        let mut accessor =
            json!({ "bufferView": view, "componentType": 5126, "count": rows.len(), "type": kind });
        if bounds && let Some(first) = rows.first() {
            let (mut low, mut high) = (*first, *first);
            for row in rows.iter() {
                for k in 0..N {
                    low[k] = order::min(low[k], row[k]);
                    high[k] = order::max(high[k], row[k]);
                }
            }
            accessor["min"] = json!(low.to_vec());
            accessor["max"] = json!(high.to_vec());
        }
        self.accessors.push(accessor);
        self.written.push((address, self.accessors.len() - 1));
        self.accessors.len() - 1
    }

    fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let bytes: Vec<u8> = triangles.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, 34963);
        let count = triangles.len() * 3;
        self.accessors
            .push(json!({ "bufferView": view, "componentType": 5125, "count": count, "type": "SCALAR" }));
        self.accessors.len() - 1
    }
}

/// The bytes of a GLB with the nodes, meshes, materials and images of a record. The same record gives the
/// same bytes everywhere.
///
/// # Errors
/// When the record has skins or animations, an index is out of range, or the file would exceed 4 GiB.
pub fn to_glb(g: &Gltf) -> Result<Vec<u8>> {
    if !g.skins.is_empty() || !g.animations.is_empty() {
        return Err(Error::input("GLB").expected("a static scene").got("skins or animations"));
    }
    let mut bin = Bin::default();
    let mut root = Map::new();
    root.insert(
        "asset".into(),
        json!({ "version": "2.0", "generator": concat!("lastlight ", env!("CARGO_PKG_VERSION")) }),
    );
    root.insert("scene".into(), json!(0));
    let top: Vec<usize> = g.scene.iter().copied().filter(|&i| g.nodes[i].parent.is_none()).collect();
    root.insert("scenes".into(), json!([{ "nodes": top }]));
    root.insert("nodes".into(), g.nodes.iter().map(node).collect());
    let mut meshes = Vec::new();
    for m in &g.meshes {
        let mut primitives = Vec::new();
        for p in &m.primitives {
            let mut attributes = json!({ "POSITION": bin.floats(&p.positions, "VEC3", true) });
            if let Some(n) = &p.normals {
                attributes["NORMAL"] = json!(bin.floats(n, "VEC3", false));
            }
            for (set, uvs) in p.uvs.iter().enumerate() {
                if let Some(uvs) = uvs {
                    attributes[format!("TEXCOORD_{set}")] = json!(bin.floats(uvs, "VEC2", false));
                }
            }
            let mut primitive =
                json!({ "attributes": attributes, "indices": bin.indices(&p.triangles), "mode": 4 });
            if let Some(material) = p.material {
                primitive["material"] = json!(material);
            }
            primitives.push(primitive);
        }
        meshes.push(json!({ "name": m.name, "primitives": primitives }));
    }
    root.insert("meshes".into(), meshes.into());
    let mut textures = Textures::default();
    let mut used: Vec<&str> = Vec::new();
    let materials: Vec<Value> = g.materials.iter().map(|m| material(m, &mut textures, &mut used)).collect();
    root.insert("materials".into(), materials.into());
    let mut images = Vec::new();
    for image in &g.images {
        let Some(image) = image else {
            return Err(Error::input("GLB")
                .at(format!("images[{}]", images.len()))
                .expected("an image")
                .got("none"));
        };
        let raw = image.texels.as_flattened();
        let png = image_file::png_bytes(image.width, image.height, 4, raw)?;
        let view = bin.view(&png, 0);
        images.push(json!({ "name": image.name, "mimeType": "image/png", "bufferView": view }));
    }
    if !images.is_empty() {
        root.insert("images".into(), images.into());
        root.insert("samplers".into(), textures.samplers.iter().map(|&w| sampler(w)).collect());
        let list = textures.list.iter().map(|&(image, s)| json!({ "source": image, "sampler": s }));
        root.insert("textures".into(), list.collect());
    }
    if !used.is_empty() {
        root.insert("extensionsUsed".into(), json!(used));
    }
    root.insert("accessors".into(), bin.accessors.clone().into());
    root.insert("bufferViews".into(), bin.views.clone().into());
    root.insert("buffers".into(), json!([{ "byteLength": bin.bytes.len() }]));
    let mut text = Value::Object(root).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.bytes.resize(bin.bytes.len().next_multiple_of(4), 0);
    let total = 12 + 8 + text.len() + 8 + bin.bytes.len();
    let word = |n: usize| {
        u32::try_from(n).map(u32::to_le_bytes).map_err(|_| {
            Error::input("GLB").at("size").expected("less than 4 GiB").got(format!("{total} bytes"))
        })
    };
    let mut out = Vec::with_capacity(total);
    out.extend_from_slice(b"glTF\x02\0\0\0");
    out.extend_from_slice(&word(total)?);
    out.extend_from_slice(&word(text.len())?);
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&text);
    out.extend_from_slice(&word(bin.bytes.len())?);
    out.extend_from_slice(b"BIN\0");
    out.extend_from_slice(&bin.bytes);
    Ok(out)
}

fn node(n: &super::Node) -> Value {
    let mut out = json!({ "name": n.name });
    match n.local {
        Local::Matrix(m) => out["matrix"] = json!(columns(&m)),
        Local::Trs { translation, rotation, scale } => {
            if translation != [0.0; 3] {
                out["translation"] = json!(translation);
            }
            if rotation != [0.0, 0.0, 0.0, 1.0] {
                out["rotation"] = json!(rotation);
            }
            if scale != [1.0; 3] {
                out["scale"] = json!(scale);
            }
        }
    }
    if !n.children.is_empty() {
        out["children"] = json!(n.children);
    }
    if let Some(mesh) = n.mesh {
        out["mesh"] = json!(mesh);
    }
    out
}

fn columns(m: &Matrix) -> Vec<f32> {
    (0..16).map(|i| m[i % 4][i / 4]).collect()
}

/// Pairs of image and sampler in order of first use.
#[derive(Default)]
struct Textures {
    list: Vec<(usize, usize)>,
    samplers: Vec<[Wrap; 2]>,
}

impl Textures {
    fn index(&mut self, t: &TextureRef) -> usize {
        let s = place(&mut self.samplers, t.wrap);
        place(&mut self.list, (t.image, s))
    }

    fn info(&mut self, t: &TextureRef, used: &mut Vec<&str>) -> Value {
        let mut out = json!({ "index": self.index(t) });
        if t.uv_set != 0 {
            out["texCoord"] = json!(t.uv_set);
        }
        if t.transform != UvTransform::IDENTITY {
            place(used, "KHR_texture_transform");
            let UvTransform { offset, rotation, scale } = t.transform;
            out["extensions"] = json!({ "KHR_texture_transform": { "offset": offset, "rotation": rotation, "scale": scale } });
        }
        out
    }
}

/// Index of an entry, added if it is new.
fn place<T: PartialEq>(list: &mut Vec<T>, entry: T) -> usize {
    list.iter().position(|e| *e == entry).unwrap_or_else(|| {
        list.push(entry);
        list.len() - 1
    })
}

fn sampler(wrap: [Wrap; 2]) -> Value {
    let code = |w| match w {
        Wrap::Repeat => 10497,
        Wrap::Mirror => 33648,
        Wrap::Clamp => 33071,
    };
    json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": code(wrap[0]), "wrapT": code(wrap[1]) })
}

fn material(m: &super::Material, textures: &mut Textures, used: &mut Vec<&str>) -> Value {
    let mut pbr = json!({ "baseColorFactor": m.base_color, "metallicFactor": m.metallic, "roughnessFactor": m.roughness });
    if let Some(t) = &m.base_color_texture {
        pbr["baseColorTexture"] = textures.info(t, used);
    }
    if let Some(t) = &m.metallic_roughness_texture {
        pbr["metallicRoughnessTexture"] = textures.info(t, used);
    }
    let mut out = json!({ "name": m.name, "pbrMetallicRoughness": pbr });
    if let Some((t, scale)) = &m.normal_texture {
        out["normalTexture"] = textures.info(t, used);
        out["normalTexture"]["scale"] = json!(scale);
    }
    if let Some(t) = &m.emission_texture {
        out["emissiveTexture"] = textures.info(t, used);
    }
    // Factors above one need the extension: a power of two as strength keeps the product exact.
    let strongest = m.emission.iter().fold(0.0f32, |a, &b| order::max(a, b));
    if strongest > 0.0 {
        let mut strength = 1.0f32;
        while strongest > strength {
            strength *= 2.0;
        }
        out["emissiveFactor"] = json!(m.emission.map(|x| x / strength));
        if strength > 1.0 {
            place(used, "KHR_materials_emissive_strength");
            out["extensions"] =
                json!({ "KHR_materials_emissive_strength": { "emissiveStrength": strength } });
        }
    }
    match m.alpha {
        Alpha::Opaque => {}
        Alpha::Mask(cutoff) => {
            out["alphaMode"] = json!("MASK");
            out["alphaCutoff"] = json!(cutoff);
        }
        Alpha::Blend => out["alphaMode"] = json!("BLEND"),
    }
    if m.double_sided {
        out["doubleSided"] = json!(true);
    }
    out
}
