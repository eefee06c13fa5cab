//! Meshes with an atlas and baked maps: written and read again with the same bits, and accepted by the Khronos
//! validator.

use crate::common::not_run;
use lastlight::geometry::atlas::{Settings, unwrap};
use lastlight::geometry::marching::{Volume, surface};
use lastlight::geometry::smooth::normals;
use lastlight::geometry::texels::{cover, fill};
use lastlight::scene::material::{Material, Texture, Transfer, Wrap};
use lastlight::scene::mesh::Object;
use lastlight::scene::model;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

/// Texels per side.
const SIZE: usize = 128;

/// A torus with maps of base colour, roughness and metallic that depend on the position.
fn torus() -> Object {
    const N: usize = 24;
    let at = |i: usize| -1.0 + 2.0 * i as f64 / (N - 1) as f64;
    let distance = |i: usize| {
        let [x, y, z] = [at(i / (N * N)), at(i / N % N), at(i % N)];
        let q = (x * x + y * y).sqrt() - 0.6;
        ((q * q + z * z).sqrt() - 0.3) as f32
    };
    let values: Vec<f32> = (0..N * N * N).map(distance).collect();
    let spacing = [2.0 / (N - 1) as f32; 3];
    let mut mesh =
        surface(&Volume { values: &values, size: [N; 3], origin: [-1.0; 3], spacing }).expect("a volume");
    mesh.normals = normals(&mesh);
    let atlas = unwrap(&mesh, &Settings { size: SIZE, gutter: 4 }).expect("an atlas");
    let texels = cover(&atlas.mesh, &atlas.chart_of, [SIZE; 2]).expect("coordinates");
    let sources = fill(&texels, [SIZE; 2], 2 * SIZE);
    let byte = |x: f32| (127.5 + 127.0 * x) as u8;
    let map = |transfer: Transfer, value: &dyn Fn([f32; 3]) -> [u8; 4]| {
        let texels = sources.iter().map(|&s| value(texels[s as usize].position)).collect();
        Some(Arc::new(Texture { width: SIZE, height: SIZE, texels, transfer, wrap: [Wrap::Clamp; 2] }))
    };
    let material = Material {
        name: "baked".into(),
        base_color_map: map(Transfer::Srgb, &|p| [byte(p[0]), byte(p[1]), byte(p[2]), 255]),
        roughness: 1.0,
        metallic: 1.0,
        metallic_roughness_map: map(Transfer::Linear, &|p| [255, byte(p[2]), byte(p[0]), 255]),
        ..Material::default()
    };
    Object { material_of: vec![0; atlas.mesh.triangles.len()], mesh: atlas.mesh, materials: vec![material] }
}

#[test]
fn glb_and_obj_give_back_a_baked_mesh_in_bits() {
    let object = torus();
    let dir = tempfile::tempdir().expect("a temporary folder");
    for file in ["torus.glb", "torus.obj"] {
        let path = dir.path().join(file);
        model::write(&path, &object).unwrap_or_else(|e| panic!("{e}"));
        let (back, notes) = model::read_with_notes(&path).unwrap_or_else(|e| panic!("{e}"));
        assert!(notes.is_empty(), "{file}: {notes:?}");
        assert_eq!(back.mesh.triangles, object.mesh.triangles, "{file}: triangles");
        let bits = |rows: &[[f32; 3]]| rows.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert!(bits(&back.mesh.positions) == bits(&object.mesh.positions), "{file}: positions in bits");
        assert!(bits(&back.mesh.normals) == bits(&object.mesh.normals), "{file}: normals in bits");
        // v of 0 is 1 − 1 = +0 behind OBJ; no coordinate of an atlas is a negative zero
        let bits = |rows: &[[f32; 2]]| rows.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert!(bits(&back.mesh.uvs) == bits(&object.mesh.uvs), "{file}: texture coordinates in bits");
        let (ours, theirs) = (&object.materials[0], &back.materials[0]);
        assert_eq!(theirs.base_color_map, ours.base_color_map, "{file}: base colour");
        assert_eq!(
            theirs.metallic_roughness_map, ours.metallic_roughness_map,
            "{file}: roughness and metallic"
        );
        assert_eq!((theirs.roughness, theirs.metallic), (1.0, 1.0), "{file}: factors");
    }
    let other = dir.path().join("again.glb");
    model::write(&other, &object).unwrap_or_else(|e| panic!("{e}"));
    let size = |path: &Path| std::fs::read(path).expect("a file").len();
    assert_eq!(size(&other), size(&dir.path().join("torus.glb")), "as long; only the names differ");
}

/// Reports as JSON; exits with 3 where the package is missing.
const SCRIPT: &str = "
let validator;
try { validator = require('gltf-validator') } catch { process.exit(3) }
validator.validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[1])))
  .then(report => console.log(JSON.stringify(report.issues)))";

/// Runs the Khronos validator, if it is there, and expects that it reports nothing.
pub(super) fn validated(path: &Path) {
    let Ok(run) = Command::new("node").args(["-e", SCRIPT]).arg(path).output() else {
        return not_run("node with gltf-validator: node is missing");
    };
    if run.status.code() == Some(3) {
        return not_run("node with gltf-validator: the package is not on NODE_PATH");
    }
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{text} {}", String::from_utf8_lossy(&run.stderr));
    let issues: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    for kind in ["numErrors", "numWarnings", "numInfos", "numHints"] {
        assert_eq!(issues[kind], 0, "{}: {issues:#}", path.display());
    }
}

#[test]
fn the_khronos_validator_accepts_a_baked_mesh() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("torus.glb");
    model::write(&path, &torus()).unwrap_or_else(|e| panic!("{e}"));
    validated(&path);
}
