//! What readers take from files, and what writers give back.

use super::{apart, object, parse};
use crate::samples::gltf::{Builder, triangle};
use lastlight::io::{gltf, obj};
use lastlight::scene::material::{Alpha, Material, Texture, Transfer, Wrap};
use lastlight::scene::mesh::{Mesh, Object};
use lastlight::scene::model;
use serde_json::json;
use std::sync::Arc;

#[test]
fn y_up_becomes_z_up() {
    let mut b = triangle();
    b.root["nodes"][0]["translation"] = json!([1.0, 2.0, 3.0]);
    let o = object(&b);
    assert_eq!(
        o.mesh.positions,
        [[1.0, -3.0, 2.0], [2.0, -3.0, 2.0], [1.0, -3.0, 3.0]],
        "(x, y, z) is (x, −z, y)"
    );
    for p in [[1.0f32, 2.0, 3.0], [0.0, -0.0, 1e-30]] {
        assert_eq!(
            model::y_up(model::z_up(p)).map(f32::to_bits),
            p.map(f32::to_bits),
            "there and back, in bits"
        );
    }
}

#[test]
fn transforms_of_nodes_are_chained() {
    // Parent: 90° about y, then 10 along x. Child: scale (2, 3, 1). A point (1, 1, 0) is (2, 3, 0), turned
    // (0, 3, −2), moved (10, 3, −2).
    let h = 0.5f64.sqrt();
    let mut b = triangle();
    b.root["nodes"] = json!([
        { "rotation": [0.0, h, 0.0, h], "translation": [10.0, 0.0, 0.0], "children": [1] },
        { "mesh": 0, "scale": [2.0, 3.0, 1.0] }
    ]);
    let want = [[10.0, 0.0, 0.0], [10.0, 2.0, 0.0], [10.0, 0.0, 3.0]];
    assert!(apart(&object(&b).mesh.positions, &want) < 1e-6, "T·R·S: {:?}", object(&b).mesh.positions);
    // The same as a matrix, column-major.
    b.root["nodes"] = json!([{
        "mesh": 0,
        "matrix": [0.0, 0.0, -2.0, 0.0, 0.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 1.0]
    }]);
    assert!(apart(&object(&b).mesh.positions, &want) < 1e-6, "columns: {:?}", object(&b).mesh.positions);
    // A mirror keeps the outside outside.
    b.root["nodes"] = json!([{ "mesh": 0, "scale": [-1.0, 1.0, 1.0] }]);
    assert_eq!(object(&b).mesh.triangles, [[0, 2, 1]], "corners turned over");
}

#[test]
fn strips_fans_and_missing_indices() {
    let points = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 2.0, 0.0]];
    for (mode, want) in [
        (5, vec![[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        (6, vec![[1, 2, 0], [2, 3, 0], [3, 4, 0]]),
        (4, vec![[0, 1, 2]]),
    ] {
        let mut b = Builder::new();
        let p = b.floats(if mode == 4 { &points[..3] } else { &points[..] });
        b.mesh(json!({ "POSITION": p }), None);
        b.root["meshes"][0]["primitives"][0]["mode"] = json!(mode);
        b.push("nodes", json!({ "mesh": 0 }));
        assert_eq!(parse(&b).meshes[0].primitives[0].triangles, want, "mode {mode}");
    }
}

#[test]
fn integers_sparse_values_and_strides() {
    // Normalised i8: max(c/127, −1); interleaved with 4 bytes per row.
    let mut b = Builder::new();
    let bytes: Vec<u8> = [[-128i8, 127, 0, 9], [64, -127, 1, 9], [0, 0, 0, 9]]
        .concat()
        .iter()
        .map(|x| x.cast_unsigned())
        .collect();
    let p = b.accessor(&bytes, 5120, "VEC3", 3);
    b.root["accessors"][p]["normalized"] = json!(true);
    b.root["bufferViews"][0]["byteStride"] = json!(4);
    b.root["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    b.root["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    b.mesh(json!({ "POSITION": p }), None);
    b.push("nodes", json!({ "mesh": 0 }));
    let want = vec![[-1.0, 1.0, 0.0], [64.0 / 127.0, -1.0, 1.0 / 127.0], [0.0; 3]];
    assert_eq!(*parse(&b).meshes[0].primitives[0].positions, want, "normalised");
    b.root["accessors"][p]["normalized"] = json!(false);
    assert_eq!(parse(&b).meshes[0].primitives[0].positions[1], [64.0, -127.0, 1.0], "quantised");

    // Sparse over zeros: rows 1 and 2 are given.
    let mut b = Builder::new();
    let at = b.view(&[1, 2]);
    let new: Vec<u8> = [1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let values = b.view(&new);
    let p = b.push("accessors", json!({
        "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0],
        "sparse": { "count": 2, "indices": { "bufferView": at, "componentType": 5121 }, "values": { "bufferView": values } }
    }));
    b.mesh(json!({ "POSITION": p }), None);
    b.push("nodes", json!({ "mesh": 0 }));
    assert_eq!(
        *parse(&b).meshes[0].primitives[0].positions,
        vec![[0.0; 3], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
        "sparse"
    );
}

/// A 2×1 PNG in a buffer view, as texture 0.
fn with_picture(b: &mut Builder) {
    let png = lastlight::io::image_file::png_bytes(2, 1, 3, &[255, 0, 0, 0, 0, 255]).expect("a small image");
    let view = b.view(&png);
    b.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
    b.push("samplers", json!({ "wrapS": 33071, "wrapT": 33648 }));
    b.push("textures", json!({ "source": 0, "sampler": 0 }));
}

#[test]
fn materials_and_texture_transforms() {
    let mut b = triangle();
    let uv = b.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    with_picture(&mut b);
    b.root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(uv);
    b.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    b.root["extensionsUsed"] = json!(["KHR_texture_transform", "KHR_materials_emissive_strength"]);
    b.root["materials"] = json!([{
        "name": "paint", "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true, "emissiveFactor": [0.5, 0.0, 1.0],
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 } },
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1.0, 0.75], "metallicFactor": 0.125, "roughnessFactor": 0.375,
            "baseColorTexture": { "index": 0, "texCoord": 1, "extensions": { "KHR_texture_transform": {
                "offset": [0.5, 0.25], "rotation": std::f64::consts::FRAC_PI_2, "scale": [2.0, 3.0] } } }
        }
    }]);
    let o = object(&b);
    let m = &o.materials[0];
    assert_eq!((m.base_color, m.metallic, m.roughness), ([0.5, 0.25, 1.0, 0.75], 0.125, 0.375), "factors");
    assert_eq!((m.emission, m.alpha), ([2.0, 0.0, 4.0], Alpha::Mask(0.25)), "strength and cut-off");
    let t = m.base_color_map.as_ref().expect("a map");
    assert_eq!(
        (t.width, t.height, t.transfer, t.wrap),
        (2, 1, Transfer::Srgb, [Wrap::Clamp, Wrap::Mirror]),
        "map"
    );
    assert_eq!(t.texels, [[255, 0, 0, 255], [0, 0, 255, 255]], "texels");
    // u' = offset + R(90°)·(scale ∘ u): (u, v) → (3v + 0.5, −2u + 0.25).
    let want = [[0.5, 0.25], [0.5, -1.75], [3.5, 0.25]];
    for (got, want) in o.mesh.uvs.iter().zip(want) {
        assert!((got[0] - want[0]).abs() < 1e-6 && (got[1] - want[1]).abs() < 1e-6, "{got:?} and {want:?}");
    }
}

#[test]
fn normals_are_made_whole() {
    // Flat parts beside smooth ones get zeros; zero normals among others become the mean of their faces; long
    // ones become unit.
    let mut b = triangle();
    let n = b.floats(&[[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 1.0]]);
    b.root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(n);
    let flat = b.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"].clone();
    b.push("meshes", json!({ "primitives": [{ "attributes": { "POSITION": flat } }] }));
    b.push("nodes", json!({ "mesh": 1 }));
    b.root["scenes"][0]["nodes"] = json!([0, 1]);
    let up = [0.0, -1.0, 0.0];
    assert_eq!(object(&b).mesh.normals, [up, up, up, [0.0; 3], [0.0; 3], [0.0; 3]], "as described");
    // Degenerate triangles stay.
    let mut b = triangle();
    let i = b.indices(&[0, 1, 2, 1, 1, 2]);
    b.root["meshes"][0]["primitives"][0]["indices"] = json!(i);
    assert_eq!(object(&b).mesh.triangles, [[0, 1, 2], [1, 1, 2]], "degenerate");
    // Unused vertices are removed.
    let mut b = triangle();
    let i = b.indices(&[2, 1, 2]);
    b.root["meshes"][0]["primitives"][0]["indices"] = json!(i);
    assert_eq!(
        (object(&b).mesh.positions.len(), object(&b).mesh.triangles),
        (2, vec![[1, 0, 1]]),
        "unused vertices"
    );
}

/// Two materials with maps; each vertex is used by one of them, in order, so that a round trip changes
/// nothing.
fn sample() -> Object {
    let texture = |transfer, wrap, seed: u8| {
        let texels = (0..6).map(|i| [seed.wrapping_mul(37) ^ (i * 40), i * 7, 255 - seed, 255 - i]).collect();
        Some(Arc::new(Texture { width: 3, height: 2, texels, transfer, wrap }))
    };
    let first = Material {
        name: "first".into(),
        base_color: [0.1, 0.2, 0.3, 0.4],
        base_color_map: texture(Transfer::Srgb, [Wrap::Repeat; 2], 1),
        roughness: 0.3,
        metallic: 0.7,
        metallic_roughness_map: texture(Transfer::Linear, [Wrap::Mirror, Wrap::Clamp], 2),
        normal_map: texture(Transfer::Linear, [Wrap::Repeat; 2], 3).map(|t| (t, 0.6)),
        emission: [0.1, 3.7, 0.0],
        emission_map: texture(Transfer::Srgb, [Wrap::Clamp; 2], 4),
        alpha: Alpha::Mask(0.3),
    };
    let second = Material { name: "second".into(), alpha: Alpha::Blend, ..Material::default() };
    let turn = |i: usize| (i * 7919 % 97) as f32 / 48.5 - 1.0;
    Object {
        mesh: Mesh {
            positions: (0..8).map(|i| [turn(i), turn(3 * i + 1), turn(5 * i + 2)]).collect(),
            normals: (0..8).map(|i| if i % 2 == 0 { [0.0, 0.6, -0.8] } else { [1.0, 0.0, 0.0] }).collect(),
            uvs: (0..8).map(|i| [turn(i) * 3.0, turn(i + 1)]).collect(),
            triangles: vec![[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7], [4, 7, 7]],
        },
        material_of: vec![0, 0, 1, 1, 1],
        materials: vec![first, second],
    }
}

#[test]
fn a_glb_gives_back_every_bit() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.glb");
    model::write(&path, &sample()).unwrap_or_else(|e| panic!("{e}"));
    let bytes = std::fs::read(&path).expect("written");
    assert_eq!(bytes.len() % 4, 0, "chunks are padded");
    assert_eq!(
        u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize,
        bytes.len(),
        "length"
    );
    let back = model::read(&path).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(back, sample(), "an object is what it was");
    model::write(&path, &back).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(std::fs::read(&path).expect("written"), bytes, "and its bytes");
}

#[test]
fn a_flat_part_has_no_normals_and_the_file_only_unit_ones() {
    let mut object = sample();
    object.mesh.normals[4..].fill([0.0; 3]);
    let g = model::to_gltf(&object, "a");
    let p = &g.meshes[0].primitives;
    assert!(p[1].normals.is_none(), "zero normals mean none");
    let rows = p[0].normals.as_ref().expect("the other part has some");
    let unit = |n: &[f32; 3]| ((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2] - 1.0).abs() < 1e-6;
    assert!(rows.iter().all(unit), "viewers refuse others: {rows:?}");
    assert_eq!(
        model::from_gltf(&g, "a.glb").unwrap_or_else(|e| panic!("{e}")),
        object,
        "and it is read back"
    );
}

#[test]
fn the_bounds_of_positions_are_stated() {
    let g = gltf::to_glb(&model::to_gltf(&sample(), "a")).unwrap_or_else(|e| panic!("{e}"));
    let length = u32::from_le_bytes([g[12], g[13], g[14], g[15]]) as usize;
    let root: serde_json::Value = serde_json::from_slice(&g[20..20 + length]).expect("JSON");
    let position = root["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64().expect("an index");
    let a = &root["accessors"][position as usize];
    let [low, high] = sample().mesh.bounds();
    // y up: (x, z, −y)
    let want = [[low[0], low[2], -high[1]], [high[0], high[2], -low[1]]];
    assert_eq!([&a["min"], &a["max"]], [&json!(want[0]), &json!(want[1])], "min and max");
    for view in root["bufferViews"].as_array().expect("views") {
        assert_eq!(view["byteOffset"].as_u64().expect("an offset") % 4, 0, "aligned");
    }
}

#[test]
fn an_obj_gives_back_what_it_can_hold() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.obj");
    let object = sample();
    model::write(&path, &object).unwrap_or_else(|e| panic!("{e}"));
    let back = model::read(&path).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(back.mesh.triangles.len(), object.mesh.triangles.len(), "triangles");
    assert_eq!(back.material_of, object.material_of, "materials of triangles");
    for (t, u) in back.mesh.triangles.iter().flatten().zip(object.mesh.triangles.iter().flatten()) {
        let (t, u) = (*t as usize, *u as usize);
        assert_eq!(back.mesh.positions[t], object.mesh.positions[u], "positions in bits");
        assert_eq!(back.mesh.normals[t], object.mesh.normals[u], "normals in bits");
        for k in 0..2 {
            assert!((back.mesh.uvs[t][k] - object.mesh.uvs[u][k]).abs() < 2e-7, "v is turned over twice");
        }
    }
    let (a, b) = (&back.materials[0], &object.materials[0]);
    assert_eq!(
        (a.base_color, a.roughness, a.metallic, a.emission),
        (b.base_color, b.roughness, b.metallic, b.emission),
        "factors"
    );
    let texels = |t: &Option<Arc<Texture>>| t.as_ref().map(|t| t.texels.clone());
    assert_eq!(texels(&a.base_color_map), texels(&b.base_color_map), "base colour");
    assert_eq!(texels(&a.emission_map), texels(&b.emission_map), "emission");
    let packed =
        |t: &Option<Arc<Texture>>| texels(t).map(|t| t.iter().map(|x| [x[1], x[2]]).collect::<Vec<_>>());
    assert_eq!(
        packed(&a.metallic_roughness_map),
        packed(&b.metallic_roughness_map),
        "roughness and metallic"
    );
    assert_eq!(
        a.normal_map.as_ref().map(|(t, _)| t.texels.clone()),
        b.normal_map.as_ref().map(|(t, _)| t.texels.clone()),
        "normals"
    );
}

/// `d 0` hides a model, which is seldom meant: exporters write it for materials that they do not understand.
#[test]
fn an_invisible_material_of_obj_is_read_as_opaque_with_a_note() {
    for line in ["d 0.0", "Tr 1"] {
        let mtl = format!("newmtl ghost\nKd 1 0 0\n{line}\n").into_bytes();
        let fetch = move |_: &str| Ok(mtl.clone());
        let text = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl ghost\nf 1 2 3\n";
        let o = obj::parse(text, "a.obj", &fetch).expect("an OBJ");
        assert!(
            o.notes.iter().any(|n| n.contains("'ghost'") && n.contains("opaque")),
            "{line}: {:?}",
            o.notes
        );
        let object = model::from_obj(&o, "a.obj").expect("an object");
        assert_eq!(
            (object.materials[0].alpha, object.materials[0].base_color[3]),
            (Alpha::Opaque, 1.0),
            "{line}"
        );
    }
}

#[test]
fn polygons_groups_and_materials_of_obj() {
    let text = b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 1.5 0\nusemtl red\ng square\nf 1 2 3 4\nusemtl none_such\ng house\nf -5 -4 -3 -1 -2\nl 1 2\n";
    let mtl = b"newmtl red\nKd 1 0.5 0\nNs 98\nd 0.5\nmap_Kd -s 1 1 1 -clamp on a b.png\nnewmtl other\nPr 0.2\nPm 1\n";
    let png = lastlight::io::image_file::png_bytes(1, 1, 1, &[7]).expect("an image");
    let fetch = |p: &str| match p {
        "m.mtl" => Ok(mtl.to_vec()),
        "a b.png" => Ok(png.clone()),
        other => Err(lastlight::Error::input(other).got("not there")),
    };
    let o = obj::parse(text, "a.obj", &fetch).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(o.triangles.len(), 2 + 3, "fans");
    let names: Vec<(&str, usize, Option<usize>)> =
        o.groups.iter().map(|g| (g.name.as_str(), g.triangles.len(), g.material)).collect();
    assert_eq!(names, [("square", 2, Some(0)), ("house", 3, None)], "groups");
    let red = &o.materials[0];
    // α² = 2/100, r = √α
    assert!((red.roughness - 0.02f32.sqrt().sqrt()).abs() < 1e-6, "roughness of Ns 98: {}", red.roughness);
    assert_eq!(
        (red.base_color, red.alpha, red.base_color_map),
        ([1.0, 0.5, 0.0], 0.5, Some(obj::Map { image: 0, clamp: true })),
        "red"
    );
    assert_eq!((o.materials[1].roughness, o.materials[1].metallic), (0.2, 1.0), "the PBR extension");
    assert_eq!(o.images[0].texels, [[7, 7, 7, 255]], "grey is spread");
    assert!(o.notes.iter().any(|n| n.contains("-s")), "an option that is not read is noted: {:?}", o.notes);
    let object = model::from_obj(&o, "a.obj").unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(object.materials.len(), 2, "the default material and red");
    assert_eq!(object.materials[0].alpha, Alpha::Blend, "half transparent");
}
