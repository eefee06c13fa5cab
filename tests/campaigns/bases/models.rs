//! Meshes, materials, characters and bodies.

use super::{Base, files};
use crate::samples;
use crate::samples::gltf::{Builder, arm};
use lastlight::io::image_file;
use serde_json::json;

/// A tetrahedron without materials.
pub(super) const OBJ_ALONE: &[u8] =
    b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";

const MTL: &[u8] = b"newmtl m\nKd 0.5 0.5 0.5\nmap_Kd a.png\nPr 0.25\nPm 0.5\nKe 0.1 0 0\nd 1.0\nNs 20\n";
const OBJ: &[u8] = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvn 0 0 1\ng first\nusemtl m\nf 1/1/1 2/2/1 3/1/1\nf 1 2 3 4\n";
const BASE: &[u8] =
    b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nvt 0 0\ng body\nf 1/1 2/1 3/1\ng joint\nf 4/1 4/1 4/1\n";
const RIG: &[u8] = br#"{"scale_factor":0.1,"bones":{"hip":{"parent":"","head":{"strategy":"MEAN","vertex_indices":[0,1]},"tail":{"strategy":"VERTEX","vertex_indices":[2]}},"arm":{"parent":"hip","head":{"strategy":"CUBE","cube_name":"joint"},"tail":{"strategy":"MEAN","vertex_indices":[1]}}}}"#;
const WEIGHTS: &[u8] = br#"{"weights":{"hip":[[0,1],[1,0.5],[2,0.25]],"arm":[[2,0.5]]}}"#;

/// A character with a texture, everything in one buffer.
pub(crate) fn character() -> Builder {
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

const RENDER: &str =
    "mesh render {file} --cameras orbit:1 --size 8x8 --samples 1 --bounces 1 --out out --threads 1 --quiet";
const POSED: &str = "mesh render {file} --animation bend --time 0.7 --cameras orbit:1 --size 8x8 --samples 1 --out out --threads 1 --quiet";
const OBJECT: &str = "lirm gen --mesh {file} --views 1 --size 8 --samples 1 --bounces 0 --texture 32 --passes photo --out out --threads 1 --quiet";

pub(super) fn bases() -> Vec<Base> {
    let b = character();
    let obj = files(&[("a.obj", OBJ), ("a.mtl", MTL), ("a.png", &samples::png(2, 2, 3))]);
    let body = files(&[
        ("body/base.obj", BASE),
        ("body/rig.default.json", RIG),
        ("body/weights.default.json", WEIGHTS),
    ]);
    let beside = "mesh render a.obj --cameras orbit:1 --size 8x8 --samples 1 --out out --threads 1 --quiet";
    let makehuman = "mesh render body --cameras orbit:1 --size 8x8 --samples 1 --out out --threads 1 --quiet";
    let compare = "mesh compare {file} {file} --samples 50 --threads 1";
    vec![
        Base::new("glTF", files(&[("a.gltf", &b.gltf())]), &["a.gltf"], &[RENDER, POSED, OBJECT]).share(20),
        Base::new("GLB", files(&[("a.glb", &b.glb())]), &["a.glb"], &[RENDER, POSED, OBJECT]).share(20),
        Base::new("OBJ", obj.clone(), &["a.obj"], &[RENDER, compare]).share(20),
        Base::new("MTL and texture", obj, &["a.mtl", "a.mtl", "a.png"], &[beside]),
        Base::new(
            "MakeHuman",
            body,
            &["body/base.obj", "body/rig.default.json", "body/weights.default.json"],
            &[makehuman],
        )
        .share(20),
    ]
}
