//! Models: valid samples and hand-made malformed files.

pub(super) mod spoiled;

use super::samples::gltf::{Builder, arm, triangle};
use super::{Format, Reader};
use lastlight::io::{gltf, image_file, makehuman, obj, ply_mesh};
use lastlight::scene::character::Character;
use lastlight::scene::{environment_file, model};
use lastlight::{Error, Result};
use serde_json::json;

fn fetch(path: &str) -> Result<Vec<u8>> {
    match path {
        "a.bin" => Ok(vec![0; 36]),
        "a.mtl" => Ok(MTL.to_vec()),
        "a.png" => Ok(image_file::png_bytes(2, 2, 3, &[9; 12]).expect("an image")),
        other => Err(Error::input(other).expected("a.bin, a.mtl or a.png").got("another name")),
    }
}

const MTL: &[u8] = b"newmtl m\nKd 0.5 0.5 0.5\nmap_Kd a.png\nPr 0.25\n";
const OBJ: &[u8] = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvn 0 0 1\ng first\nusemtl m\nf 1/1/1 2/2/1 3/1/1\nf 1 2 3 4\n";
const BASE: &[u8] =
    b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nvt 0 0\ng body\nf 1/1 2/1 3/1\ng joint\nf 4/1 4/1 4/1\n";
const RIG: &[u8] = br#"{"scale_factor":0.1,"bones":{"hip":{"parent":"","head":{"strategy":"MEAN","vertex_indices":[0,1]},"tail":{"strategy":"VERTEX","vertex_indices":[2]}},"arm":{"parent":"hip","head":{"strategy":"CUBE","cube_name":"joint"},"tail":{"strategy":"MEAN","vertex_indices":[1]}}}}"#;
const WEIGHTS: &[u8] = br#"{"weights":{"hip":[[0,1],[1,0.5],[2,0.25]],"arm":[[2,0.5]]}}"#;

/// A character with a texture, everything in one buffer.
fn character() -> Builder {
    let mut b = arm();
    let png = image_file::png_bytes(2, 2, 3, &[9, 200, 3, 9, 9, 9, 8, 8, 8, 1, 2, 3]).expect("an image");
    let view = b.view(&png);
    b.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
    b.push("textures", json!({ "source": 0 }));
    b.push("materials", json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }));
    let uv = b.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
    b.root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uv);
    b.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    b
}

fn read_gltf(bytes: &[u8], name: &str) -> Result<()> {
    let g = gltf::parse(bytes, name, &fetch)?;
    model::from_gltf(&g, name)?;
    let c = Character::from_gltf(g, name)?;
    for k in 0..c.animations().len() {
        // A mutated key may lead far away, but never to a number that is none.
        let posed = c.posed(&c.pose(k, 0.7), &data_gen::figure::factors::Drive::new(&[0.1; 4]));
        assert!(
            posed.is_err() || posed.is_ok_and(|o| o.mesh.positions.iter().flatten().all(|x| x.is_finite())),
            "finite"
        );
    }
    Ok(())
}

fn read_body(parts: [&[u8]; 3], name: &str) -> Result<()> {
    Character::from_body(&makehuman::parse(parts, [name; 3])?, name).map(drop)
}

fn read_map(bytes: &[u8], name: &str) -> Result<()> {
    environment_file::from_picture(
        &image_file::parse(bytes, name)?,
        &environment_file::Options::default(),
        name,
    )
    .map(drop)
}

/// A quad with colours and texture coordinates of its corners.
fn mesh_ply() -> Vec<u8> {
    let mut b = b"ply\nformat binary_little_endian 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n".to_vec();
    for [x, y] in [[0.0_f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
        [x, y, 0.5].iter().for_each(|v| b.extend(v.to_le_bytes()));
        b.extend([9, 200, 30]);
    }
    b.push(4);
    (0..4_i32).for_each(|i| b.extend(i.to_le_bytes()));
    b.push(8);
    (0..8).for_each(|i| b.extend((i as f32 / 8.0).to_le_bytes()));
    b
}

pub(super) fn formats() -> Vec<Format> {
    let f = |name, read: Reader, valid, sealed| Format { name, read, valid, sealed };
    let (glb, json) = (character().glb(), character().gltf());
    vec![
        f("a.glb", read_gltf, glb, true),
        f("a.gltf", read_gltf, json, true),
        f("a.obj", |b, n| model::from_obj(&obj::parse(b, n, &fetch)?, n).map(drop), OBJ.to_vec(), false),
        f(
            "a.mtl",
            |b, n| {
                let of = |p: &str| if p == "a.mtl" { Ok(b.to_vec()) } else { fetch(p) };
                model::from_obj(&obj::parse(OBJ, n, &of)?, n).map(drop)
            },
            MTL.to_vec(),
            false,
        ),
        f("mesh.ply", |b, n| model::from_ply(&ply_mesh::parse(b, n, &fetch)?, n).map(drop), mesh_ply(), true),
        f("base.obj", |b, n| read_body([b, RIG, WEIGHTS], n), BASE.to_vec(), false),
        f("rig.json", |b, n| read_body([BASE, b, WEIGHTS], n), RIG.to_vec(), true),
        f("weights.json", |b, n| read_body([BASE, RIG, b], n), WEIGHTS.to_vec(), true),
        f(
            "map.exr",
            read_map,
            image_file::exr_bytes(2, 1, &["R", "G", "B"], &[0.0, 1.0, 2.0, 0.0, 3.0, 4.0]).expect("a map"),
            true,
        ),
    ]
}

#[test]
fn quantised_weights_are_normalised() {
    // 85 + 85 + 85 of 255 is 1; 84 + 84 + 84 is off by 1.2 %, as exporters that round leave it.
    let mut b = arm();
    let w = b.accessor(&[84, 171, 0, 0].repeat(4), 5121, "VEC4", 4);
    b.root["accessors"][w]["normalized"] = json!(true);
    b.root["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(w);
    let off = b.accessor(&[84, 168, 0, 0].repeat(4), 5121, "VEC4", 4);
    b.root["accessors"][off]["normalized"] = json!(true);
    let j = b.accessor(&[0, 1, 0, 0].repeat(4), 5121, "VEC4", 4);
    b.root["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(j);
    for set in [w, off] {
        b.root["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(set);
        let g = gltf::parse(&b.glb(), "a.glb", &fetch).unwrap_or_else(|e| panic!("{e}"));
        let c = Character::from_gltf(g, "a.glb").unwrap_or_else(|e| panic!("{e}"));
        let (_, w) = c.influences()[0];
        assert!((w[0] + w[1] - 1.0).abs() < 1e-12, "sums to 1: {w:?}");
    }
}

#[test]
fn files_beside_are_found_inside_the_folder_only() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let inner = dir.path().join("inner");
    std::fs::create_dir(&inner).expect("a folder");
    let b = triangle();
    std::fs::write(inner.join("my data.bin"), &b.bin).expect("written");
    std::fs::write(dir.path().join("secret.bin"), &b.bin).expect("written");
    let mut root = b.root.clone();
    let mut read = |uri: &str| {
        root["buffers"] = json!([{ "byteLength": b.bin.len(), "uri": uri }]);
        std::fs::write(inner.join("a.gltf"), root.to_string()).expect("written");
        model::read(&inner.join("a.gltf"))
    };
    assert!(read("my%20data.bin").is_ok(), "percent-encoded");
    assert!(read("./my data.bin").is_ok(), "as it is");
    for outside in ["../secret.bin", "..%2Fsecret.bin", "..\\secret.bin", "x/../../secret.bin"] {
        let e = read(outside).expect_err("refused");
        assert!(e.to_string().contains("inside the folder"), "{outside}: {e}");
    }
    let e = read("none.bin").expect_err("missing").to_string();
    assert!(e.contains("a.gltf") && e.contains("none.bin"), "{e}");
    // The extension decides which reader; another one is named.
    std::fs::write(inner.join("a.fbx"), b"").expect("written");
    assert!(model::read(&inner.join("a.fbx")).expect_err("unknown").to_string().contains(".fbx"), "named");
}
