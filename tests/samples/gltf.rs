//! Hand-written glTF files: JSON and bytes, without the writer of the library.
#![allow(dead_code, reason = "each test program uses its part")]

use base64::Engine;
use serde_json::{Value, json};

/// A file while it grows: one buffer, its views and accessors, and everything else.
pub(crate) struct Builder {
    pub(crate) root: Value,
    pub(crate) bin: Vec<u8>,
}

impl Builder {
    pub(crate) fn new() -> Self {
        let root = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
            "nodes": [], "meshes": [], "bufferViews": [], "accessors": []
        });
        Self { root, bin: Vec::new() }
    }

    /// Appends to a list of the file and returns the index.
    pub(crate) fn push(&mut self, list: &str, value: Value) -> usize {
        if self.root.get(list).is_none() {
            self.root[list] = json!([]);
        }
        let list = self.root[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        let at = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", json!({ "buffer": 0, "byteOffset": at, "byteLength": bytes.len() }))
    }

    /// An accessor over bytes of a component type (5126 f32, 5125 u32, 5123 u16, 5121 u8, 5120 i8, 5122 i16).
    pub(crate) fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        // Viewers want bounds of positions; a reader that trusts them would be wrong here.
        self.push(
            "accessors",
            json!({
                "bufferView": view, "componentType": component, "count": count, "type": kind,
                "min": [0.0, 0.0, 0.0], "max": [0.0, 0.0, 0.0]
            }),
        )
    }

    pub(crate) fn floats<const N: usize>(&mut self, rows: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"].get(N).copied().unwrap_or("MAT4");
        self.accessor(&bytes, 5126, kind, rows.len())
    }

    pub(crate) fn indices(&mut self, list: &[u16]) -> usize {
        let bytes: Vec<u8> = list.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, 5123, "SCALAR", list.len())
    }

    /// Node 0 with one mesh of one primitive.
    pub(crate) fn mesh(&mut self, attributes: Value, indices: Option<usize>) -> usize {
        let mut primitive = json!({ "attributes": attributes });
        if let Some(i) = indices {
            primitive["indices"] = json!(i);
        }
        self.push("meshes", json!({ "primitives": [primitive] }))
    }

    /// With the buffer in a data URI.
    pub(crate) fn gltf(&self) -> Vec<u8> {
        let mut root = self.root.clone();
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bin);
        root["buffers"] = json!([{ "byteLength": self.bin.len(), "uri": format!("data:application/octet-stream;base64,{data}") }]);
        root.to_string().into_bytes()
    }

    /// With the buffer in a chunk.
    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut root = self.root.clone();
        root["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let mut text = root.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend(((28 + text.len() + bin.len()) as u32).to_le_bytes());
        out.extend((text.len() as u32).to_le_bytes());
        out.extend(b"JSON");
        out.extend(text);
        out.extend((bin.len() as u32).to_le_bytes());
        out.extend(b"BIN\0");
        out.extend(bin);
        out
    }
}

/// One triangle in the plane z = 0 of the file, with node 0.
pub(crate) fn triangle() -> Builder {
    let mut b = Builder::new();
    let p = b.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let i = b.indices(&[0, 1, 2]);
    let mesh = b.mesh(json!({ "POSITION": p }), Some(i));
    b.push("nodes", json!({ "mesh": mesh }));
    b
}

/// An arm of two joints along x, bound at x = 0 and x = 1: a strip of vertices at x = 0, 1, 2, and an
/// animation of the second one about z: linear from 0 to 90° in 2 s.
pub(crate) fn arm() -> Builder {
    let mut b = Builder::new();
    let p = b.floats(&[[0.0, 0.1, 0.0], [1.0, 0.1, 0.0], [2.0, 0.1, 0.0], [2.0, -0.1, 0.0]]);
    let n = b.floats(&[[0.0, 0.0, 1.0]; 4]);
    let joints = b.accessor(&[0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0], 5121, "VEC4", 4);
    let w =
        b.floats(&[[1.0, 0.0, 0.0, 0.0], [0.25, 0.75, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]);
    let i = b.indices(&[0, 1, 2, 1, 3, 2]);
    let mesh = b.mesh(json!({ "POSITION": p, "NORMAL": n, "JOINTS_0": joints, "WEIGHTS_0": w }), Some(i));
    b.push("nodes", json!({ "name": "arm", "mesh": mesh, "skin": 0 }));
    b.push("nodes", json!({ "name": "upper", "children": [2] }));
    b.push("nodes", json!({ "name": "lowerarm", "translation": [1.0, 0.0, 0.0], "children": [3] }));
    b.push("nodes", json!({ "name": "hand", "translation": [1.0, 0.0, 0.0] }));
    b.root["scenes"] = json!([{ "nodes": [0, 1] }]);
    let one = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut two = one;
    two[12] = -1.0;
    let bind = b.floats(&[one, two]);
    b.push("skins", json!({ "joints": [1, 2], "inverseBindMatrices": bind }));
    let h = 0.5f32.sqrt();
    let (times, turns) = (b.floats(&[[0.0], [2.0]]), b.floats(&[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, h, h]]));
    b.push(
        "animations",
        json!({
            "name": "bend",
            "samplers": [{ "input": times, "output": turns }],
            "channels": [{ "sampler": 0, "target": { "node": 2, "path": "rotation" } }]
        }),
    );
    b
}
