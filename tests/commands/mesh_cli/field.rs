//! `field mesh` and `field relight` on a small field.

use super::{done, refused};
use lastlight::scene::field::{Field, Heads, Network, Placement, Planes, Settings};
use serde_json::Value;
use std::path::Path;

/// A sphere of a tenth of the half size, twice as large in the world.
fn write_field(path: &Path) {
    let linear = |outputs: usize| Network { widths: vec![3, outputs], weights: vec![vec![0.5; 3 * outputs]] };
    let field = Field {
        planes: Planes { values: vec![0.25; 6 * 4 * 4], count: 6, side: 4, channels: 1 },
        panoramas: None,
        heads: Heads {
            sdf: Network { widths: vec![3, 1, 1, 1], weights: vec![vec![1.0; 3], vec![1.0], vec![0.0]] },
            color: Some(linear(3)),
            albedo: Some(linear(3)),
            material: Some(linear(2)),
            normal: None,
            rho: None,
        },
        settings: Settings { half_size: 1.0, ..Settings::default() },
        placement: Placement::new([1.0, 2.0, 3.0], 0.5),
    };
    std::fs::write(path, field.to_bytes().expect("a valid field")).expect("written");
}

#[test]
fn a_field_becomes_a_mesh_and_images_and_both_ways_to_images_agree() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    write_field(&dir.join("field.safetensors"));
    let form = ["--side", "128", "--texture", "256"];
    let mesh = [&["field", "mesh", "field.safetensors", "--quiet"][..], &form].concat();
    let record: Value =
        serde_json::from_str(&done(&[&mesh[..], &["--out", "a.glb", "--json"]].concat(), dir)).expect("JSON");
    assert_eq!((&record["parts"], &record["settings"]["base"]), (&1.into(), &"albedo".into()), "{record:#}");
    refused(&[&mesh[..], &["--out", "a.glb"]].concat(), dir, &["a.glb", "--force"]);
    refused(&[&mesh[..], &["--out", "a.ply"]].concat(), dir, &["--out", ".glb or .obj"]);
    refused(&[&mesh[..], &["--out", "a.glb", "--force", "--base", "gold"]].concat(), dir, &["gold"]);
    done(&[&mesh[..], &["--out", "b.obj"]].concat(), dir);
    for file in ["b.obj", "b.mtl"] {
        assert!(dir.join(file).is_file(), "{file}");
    }
    std::fs::remove_file(dir.join("b.obj")).expect("there");
    refused(&[&mesh[..], &["--out", "b.obj"]].concat(), dir, &["b.mtl", "--force"]);

    // A sphere of radius 0.1 in the field is one of 0.2 about the centre of the placement.
    let view =
        ["mesh", "view", "a.glb", "--out", "page", "--size", "8", "--samples", "1", "--quiet", "--json"];
    let facts = serde_json::from_str::<Value>(&done(&view, dir)).expect("JSON")["facts"].clone();
    assert_eq!((&facts["closed"], &facts["euler"]), (&true.into(), &2.into()), "{facts:#}");
    let volume = facts["volume"].as_f64().expect("closed");
    let ball = 4.0 / 3.0 * std::f64::consts::PI * (0.2 * 0.2 * 0.2);
    assert!((volume / ball - 1.0).abs() < 0.05, "{volume} of {ball}");

    let images = ["--env", "sky", "--cameras", "orbit:2", "--size", "16", "--samples", "4", "--quiet"];
    let of = |out: &str, first: &[&str]| {
        done(&[first, &images, &["--out", out]].concat(), dir);
        std::fs::read(dir.join(out).join("radiance/001.exr")).expect("radiance")
    };
    let relit = of("relit", &[&["field", "relight", "field.safetensors"][..], &form].concat());
    assert_eq!(relit, of("again", &["field", "relight", "a.glb"]), "the mesh of a field, and the field");
    assert_eq!(relit, of("other", &["mesh", "render", "a.glb"]), "field relight is mesh render on it");
    // The header of a run is that of its command.
    let images = [&["field", "relight", "a.glb"][..], &images, &["--out", "other", "--force"]].concat();
    refused(&images, dir, &["another record"]);
}
