//! Hand-made malformed models, by subject.

use super::{BASE, Builder, MTL, OBJ, RIG, WEIGHTS, character, triangle};
use crate::spoiled::{rows, splice, text};
use crate::{Case, find};
use lastlight::io::image_file;
use serde_json::{Value, json};

/// All of them.
pub(crate) fn all() -> Vec<Case> {
    let groups =
        [glb, containers, buffers, views, accessors, primitives, nodes, materials, skins, animations];
    let others = [wavefront, bodies, maps];
    groups.into_iter().chain(others).flat_map(|group| group()).collect()
}

/// The triangle with its JSON changed.
fn changed(change: impl FnOnce(&mut Builder)) -> Vec<u8> {
    let mut b = triangle();
    change(&mut b);
    b.gltf()
}

/// The character with its JSON changed.
fn miscast(change: impl FnOnce(&mut Builder)) -> Vec<u8> {
    let mut b = character();
    change(&mut b);
    b.gltf()
}

/// The only primitive of the triangle and of the character.
fn primitive(b: &mut Builder) -> &mut Value {
    &mut b.root["meshes"][0]["primitives"][0]
}

/// Makes an accessor an attribute of the only primitive.
fn attribute(b: &mut Builder, name: &str, accessor: usize) {
    primitive(b)["attributes"][name] = json!(accessor);
}

/// The container.
fn glb() -> Vec<Case> {
    let glb = character().glb();
    let json_length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    assert!(find(&glb, b"BIN\0") > 20, "the sample has a buffer");
    rows(
        "a.glb",
        [
            (splice(&glb, 4, &[3]), "version"),
            (splice(&glb, 8, &[0xff; 4]), "byte 8: length"),
            (splice(&glb, 12, &[0xff, 0xff, 0xff, 0x7f]), "chunk 'JSON'"),
            (splice(&glb, 16, b"BIN\0"), "one JSON chunk"),
            (splice(&glb, 20 + json_length + 4, b"JSON"), "one JSON chunk"),
        ],
    )
}

/// The complete JSON.
fn containers() -> Vec<Case> {
    rows(
        "a.gltf",
        [
            (b"{".repeat(4000), "glTF JSON"),
            (b"[".repeat((1 << 20) + 1), "objects and lists"),
            (changed(|b| b.root["asset"]["version"] = json!("1.0")), "asset.version"),
            (changed(|b| b.root["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])), "decompress"),
            (changed(|b| b.root["extensionsRequired"] = json!(["KHR_texture_basisu"])), "PNG or JPEG"),
        ],
    )
}

/// Buffers: missing, outside, too short, not base64.
fn buffers() -> Vec<Case> {
    let buffer = |value: Value| {
        let mut root: Value = serde_json::from_slice(&triangle().gltf()).expect("JSON");
        root["buffers"] = json!([value]);
        root.to_string().into_bytes()
    };
    let at = |uri: &str| buffer(json!({ "byteLength": 44, "uri": uri }));
    rows(
        "a.gltf",
        [
            (at("b.bin"), "buffers[0]"),
            (at("../a.bin"), "leads out of the folder"),
            (at("x/%2e%2E/../a.bin"), "leads out of the folder"),
            (at("/etc/hostname"), "an absolute path"),
            (at("%zz"), "percent-encoded"),
            (at("data:,abc"), "base64"),
            (at("data:;base64,=abc"), "base64"),
            (at("a.bin"), "byteLength"),
            (buffer(json!({ "byteLength": 44 })), "buffers[0]"),
        ],
    )
}

fn views() -> Vec<Case> {
    let view = |key: &str, v: Value| changed(|b| b.root["bufferViews"][0][key] = v);
    rows(
        "a.gltf",
        [
            (view("byteLength", json!(4000)), "bufferViews[0]"),
            (view("byteOffset", json!(u64::MAX)), "bufferViews[0]"),
            (view("buffer", json!(1)), "bufferViews[0].buffer"),
            (view("byteStride", json!(4)), "stride"),
        ],
    )
}

fn accessors() -> Vec<Case> {
    let accessor = |key: &str, v: Value| changed(|b| b.root["accessors"][0][key] = v);
    let sparse = json!({
        "componentType": 5126, "count": 900_000_000, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0],
        "sparse": {
            "count": 1,
            "indices": { "bufferView": 1, "componentType": 5123 },
            "values": { "bufferView": 0 },
        },
    });
    let nan = f32::NAN.to_le_bytes();
    rows(
        "a.gltf",
        [
            (accessor("count", json!(4)), "accessors[0]"),
            (accessor("count", json!(1u64 << 60)), "accessors[0], count"),
            (accessor("byteOffset", json!(u64::MAX)), "accessors[0]"),
            (accessor("type", json!("VEC2")), "positions"),
            (accessor("componentType", json!(5125)), "positions"),
            (accessor("bufferView", json!(9)), "accessors[0].bufferView"),
            (changed(|b| b.root["accessors"][0] = sparse), "accessors[0], count"),
            (changed(|b| b.bin[16..20].copy_from_slice(&nan)), "accessors[0] (positions), element 1"),
            (changed(|b| b.bin[36] = 3), "index 0"),
        ],
    )
}

fn primitives() -> Vec<Case> {
    let two_indices = |b: &mut Builder| {
        let i = b.indices(&[0, 1]);
        primitive(b)["indices"] = json!(i);
    };
    let one_normal = |b: &mut Builder| {
        let n = b.floats(&[[0.0, 0.0, 1.0]]);
        attribute(b, "NORMAL", n);
    };
    rows(
        "a.gltf",
        [
            (changed(|b| primitive(b)["indices"] = json!(7)), "indices"),
            (changed(|b| primitive(b)["attributes"] = json!({})), "meshes[0]"),
            (changed(two_indices), "a multiple of 3"),
            (changed(one_normal), "normals"),
        ],
    )
}

fn nodes() -> Vec<Case> {
    let nodes = |v: Value| changed(|b| b.root["nodes"] = v);
    let sheared = [1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    let (far, large) = ([3e38, 3e38, 3e38], [1e38, 1e38, 1e38]);
    rows(
        "a.gltf",
        [
            (nodes(json!([{ "children": [1] }, { "children": [0], "mesh": 0 }])), "a cycle"),
            (nodes(json!([{ "children": [0], "mesh": 0 }])), "nodes[0]"),
            (nodes(json!([{ "children": [2] }, { "children": [2] }, { "mesh": 0 }])), "one parent"),
            (nodes(json!([{ "children": [5], "mesh": 0 }])), "children"),
            (nodes(json!([{ "mesh": 0, "rotation": [0.0, 0.0, 0.0, 0.0] }])), "nodes[0]"),
            (nodes(json!([{ "mesh": 0, "matrix": sheared }])), "affine"),
            (nodes(json!([{ "name": "empty" }])), "triangles"),
            (nodes(json!([{ "mesh": 0, "translation": far, "scale": large }])), "finite"),
        ],
    )
}

/// Materials and images.
fn materials() -> Vec<Case> {
    let surface = |key: &str, v: Value| miscast(|b| b.root["materials"][0]["pbrMetallicRoughness"][key] = v);
    let image = |v: Value| miscast(|b| b.root["images"][0] = v);
    // An image of one colour, far larger than its file.
    let bomb = image_file::png_bytes(8192, 8192, 1, &vec![0; 8192 * 8192]).expect("an image");
    let bombed = miscast(|b| {
        let v = b.view(&bomb);
        b.root["images"][0]["bufferView"] = json!(v);
    });
    rows(
        "a.gltf",
        [
            (surface("roughnessFactor", json!(2)), "roughness"),
            (miscast(|b| b.root["textures"][0]["source"] = json!(3)), "textures[0].source"),
            (image(json!({ "uri": "../../a.png" })), "images[0]"),
            (image(json!({ "uri": "a.bin" })), "images[0]"),
            (bombed, "64 per byte"),
            (surface("baseColorTexture", json!({ "index": 0, "texCoord": 5 })), "set 5"),
        ],
    )
}

/// Joints, weights, bind matrices.
fn skins() -> Vec<Case> {
    let weights = |row: [f32; 4]| {
        miscast(|b| {
            let w = b.floats(&[row; 4]);
            attribute(b, "WEIGHTS_0", w);
        })
    };
    let unknown_joint = |b: &mut Builder| {
        let j = b.accessor(&[0, 7, 0, 0].repeat(4), 5121, "VEC4", 4);
        attribute(b, "JOINTS_0", j);
    };
    let no_weights = |b: &mut Builder| {
        primitive(b)["attributes"].as_object_mut().expect("a map").remove("WEIGHTS_0");
    };
    let singular = |b: &mut Builder| {
        let m = b.floats(&[[0.0; 16]; 2]);
        b.root["skins"][0]["inverseBindMatrices"] = json!(m);
    };
    let one_matrix = |b: &mut Builder| {
        let m = b.floats(&[[1.0; 16]; 1]);
        b.root["skins"][0]["inverseBindMatrices"] = json!(m);
    };
    rows(
        "a.gltf",
        [
            (miscast(unknown_joint), "joints below 2"),
            (weights([0.5, 0.2, 0.0, 0.0]), "weights that sum to 1"),
            (weights([1.5, -0.5, 0.0, 0.0]), "weights ≥ 0"),
            (weights([0.0; 4]), "weights that sum to 1"),
            (miscast(no_weights), "joints and weights"),
            (miscast(singular), "inverse bind matrix 0"),
            (miscast(one_matrix), "2 matrices"),
            (miscast(|b| b.root["skins"][0]["joints"] = json!([1, 99])), "skins[0].joints"),
            (miscast(|b| b.root["nodes"][1]["scale"] = json!([0, 0, 0])), "invertible"),
        ],
    )
}

fn animations() -> Vec<Case> {
    let times = |of: &[[f32; 1]]| {
        miscast(|b| {
            let t = b.floats(of);
            b.root["animations"][0]["samplers"][0]["input"] = json!(t);
        })
    };
    let zeros = |b: &mut Builder| {
        let q = b.floats(&[[0.0f32; 4]; 2]);
        b.root["animations"][0]["samplers"][0]["output"] = json!(q);
    };
    let channel = |key: &str, v: Value| miscast(|b| b.root["animations"][0]["channels"][0][key] = v);
    let unknown_node = |b: &mut Builder| {
        b.root["animations"][0]["channels"][0]["target"]["node"] = json!(44);
    };
    rows(
        "a.gltf",
        [
            (times(&[[2.0], [1.0]]), "ascending"),
            (times(&[[0.0], [1.0], [2.0]]), "values"),
            (miscast(zeros), "quaternions"),
            (channel("sampler", json!(4)), "sampler"),
            (miscast(unknown_node), "node"),
        ],
    )
}

fn wavefront() -> Vec<Case> {
    let obj = |from: &str, to: &str| text(OBJ, from, to);
    let mtl = |from: &str, to: &str| text(MTL, from, to);
    let models = [
        (
            obj("f 1 2 3 4", "f 1 2 9"),
            "line 12: expected a face of vertices that the file defines above it, got 'f 1 2 9'",
        ),
        (obj("f 1 2 3 4", "f 0 1 2"), "line 12"),
        (obj("f 1 2 3 4", "f 1 2 -9"), "line"),
        (obj("f 1/1/1 2/2/1", "f 1/1/1 2/7/1"), "line"),
        (obj("v 1 0 0", "v nan 0 0"), "position"),
        (obj("vn 0 0 1", "vn 0 0 inf"), "normal"),
        (
            obj("v 1 0 0", "v one 0 0"),
            "line 3: expected a vertex 'v X Y Z' of three numbers, got 'v one 0 0'",
        ),
        (obj("mtllib a.mtl", "mtllib ../a.mtl"), "leads out of the folder"),
        (b"v 0 0 0\n".to_vec(), "faces"),
    ];
    let materials = [
        (mtl("a.png", "../a.png"), "leads out of the folder"),
        (mtl("a.png", "b.png"), "map_Kd"),
        (mtl("Pr 0.25", "Pr 2"), "Pr"),
        (mtl("Pr 0.25", "Pr nan"), "Pr"),
        (mtl("Kd 0.5 0.5 0.5", "Kd 0.5 -1 0.5"), "Kd"),
        (mtl("Kd 0.5 0.5 0.5", "Kd 0.5"), "a.mtl"),
    ];
    [rows("a.obj", models), rows("a.mtl", materials)].concat()
}

/// MakeHuman: mesh, rig, weights.
fn bodies() -> Vec<Case> {
    let base = [
        (text(BASE, "3/1\ng joint", "9/1\ng joint"), "line 7"),
        (text(BASE, "v 1 0 0", "v 1 0 nan"), "line 2"),
        (text(BASE, "g body", "g hair"), "group 'body'"),
    ];
    let rig = [
        (text(RIG, "\"parent\":\"\"", "\"parent\":\"arm\""), "a tree of bones"),
        (text(RIG, "[0,1]", "[0,99]"), "bones.hip.head"),
        (text(RIG, "\"joint\"", "\"cube\""), "no group 'cube'"),
        (text(RIG, "0.1", "-0.1"), "scale_factor"),
    ];
    let weights = [
        (text(WEIGHTS, "[0,1]", "[99,1]"), "a vertex below 4"),
        (text(WEIGHTS, "[0,1]", "[0,-1]"), "a weight ≥ 0"),
        (text(WEIGHTS, "\"arm\"", "\"leg\""), "a bone of the rig"),
        (text(WEIGHTS, "[0,1],", ""), "a positive weight"),
    ];
    [rows("base.obj", base), rows("rig.json", rig), rows("weights.json", weights)].concat()
}

/// Environment maps.
fn maps() -> Vec<Case> {
    let exr = |width, channels: &[&str], data: &[f32]| {
        image_file::exr_bytes(width, 1, channels, data).expect("an image")
    };
    rows(
        "map.exr",
        [
            (exr(2, &["R", "G", "B"], &[0.0, 1.0, 2.0, 0.0, -3.0, 4.0]), "row 0, column 1"),
            (exr(2, &["Z"], &[0.0, 1.0]), "channels"),
        ],
    )
}
