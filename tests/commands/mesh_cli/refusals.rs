//! Options that are refused, of `mesh render` and of the light of `lirm gen`.

use super::{refused, workplace, write};
use crate::program::{json, lastlight, stderr};
use serde_json::Value;

#[test]
fn what_makes_no_sense_is_refused_and_makes_no_folder() {
    let work = workplace();
    let dir = work.path();
    let with = |more: &[&'static str]| {
        let base = ["mesh", "render", "cube.obj", "--out", "new", "--quiet"];
        base.iter().chain(more).copied().collect::<Vec<_>>()
    };
    let cases: [(&[&'static str], &[&str]); 22] = [
        (&["--env", "none.hdr"], &["none.hdr", "studio", "axes"]),
        (&["--env-axes", "mitsuba"], &["--env-axes", "uniform"]),
        (&["--env", "sky", "--env-axes", "blender"], &["--env-axes", "'sky'"]),
        (&["--env", "studio", "--env-mirror"], &["--env-mirror", "studio"]),
        (&["--env", "axes", "--env-linear"], &["--env-linear", "axes"]),
        (&["--env-scale", "nan"], &["scale", "NaN"]),
        (&["--env-scale", "-1"], &["scale", "-1"]),
        (&["--env-scale", "1e30"], &["environment", "--env-scale"]),
        (&["--env", "sky", "--env-rotate", "1e30"], &["rotation"]),
        (&["--env", "cube.obj"], &["cube.obj"]),
        (&["--cameras", "orbit:0"], &["orbit"]),
        (&["--cameras", "orbit:x"], &["--cameras"]),
        (&["--cameras", "orbit"], &["orbit:N", "orbit:36"]),
        (&["--passes", "photo,depht"], &["--passes", "depth"]),
        (&["--cameras", "nowhere"], &["nowhere"]),
        (&["--size", "0x4"], &["--size"]),
        (&["--elevation", "95"], &["elevation", "88 degrees", "got 95"]),
        (&["--fov", "0"], &["field of view", "got 0"]),
        (&["--exposure=-1"], &["--exposure"]),
        (&["--hide", "lid"], &["--hide", "no parts"]),
        (&["--animation", "walk"], &["--animation", "no parts, joints or animations"]),
        (&["--exposure", "nan"], &["--exposure"]),
    ];
    for (more, parts) in cases {
        refused(&with(more), dir, parts);
    }
    for name in ["orb", "unity"] {
        let o = lastlight(&with(&["--env", "sky.exr", "--env-axes", name]), dir);
        let text = stderr(&o);
        assert!(
            o.status.code() == Some(2) && text.contains("mitsuba") && text.contains(name),
            "{name}: {text}"
        );
    }
    assert_eq!(lastlight(&with(&["--time", "1"]), dir).status.code(), Some(2), "a time of what");
    refused(&["mesh", "render", "none.obj", "--out", "new"], dir, &["none.obj"]);
    write(&dir.join("broken.glb"), "glTF");
    refused(&["mesh", "render", "broken.glb", "--out", "new"], dir, &["broken.glb"]);
    // A body whose rig is broken: the error is of that file, not of an option that nobody gave.
    std::fs::create_dir(dir.join("body")).expect("made");
    let parts = [("base.obj", "v 0 0 0\n"), ("rig.default.json", "{"), ("weights.default.json", "{}")];
    parts.into_iter().for_each(|(name, text)| write(&dir.join("body").join(name), text));
    refused(&["mesh", "render", "body", "--out", "new"], dir, &["error: body/"]);
    // Far apart, and yet a place to look from: the square of a coordinate need not fit.
    write(&dir.join("far.obj"), "v 0 0 0\nv 1e30 0 0\nv 0 1e30 0\nf 1 2 3\n");
    let far =
        ["mesh", "render", "far.obj", "--out", "far", "--size", "8x8", "--samples", "1", "--json", "--quiet"];
    assert_eq!(json(&far, dir)["images"], 1, "one image");
}

#[test]
fn lirm_gen_refuses_light_that_would_not_be_used() {
    let work = workplace();
    let dir = work.path();
    let with = |more: &[&'static str]| {
        let base = [
            "lirm",
            "gen",
            "--out",
            "new",
            "--views",
            "2",
            "--size",
            "16",
            "--samples",
            "1",
            "--texture",
            "32",
            "--quiet",
        ];
        base.iter().chain(more).copied().collect::<Vec<_>>()
    };
    refused(&with(&["--env", "none.hdr"]), dir, &["env", "--lighting environment or both"]);
    refused(&with(&["--env", "axes"]), dir, &["--lighting environment or both"]);
    refused(&with(&["--env-width", "64"]), dir, &["--env-width"]);
    for alone in [&["--env-axes", "mitsuba"][..], &["--env", "sky.exr", "--env-width", "64"]] {
        assert_eq!(lastlight(&with(alone), dir).status.code(), Some(2), "{alone:?}: prints nothing");
    }
    refused(&with(&["--lighting", "environment", "--env", "axes,sky.exr"]), dir, &["axes"]);
    assert!(!dir.join("new").exists(), "no folder");
    let lit = ["--lighting", "environment", "--env", "axes", "--env-axes", "mitsuba", "--json"];
    let record = json(&with(&lit), dir);
    assert_eq!(record["settings"]["axes"], true, "recorded: {record}");
    let object = std::fs::read_to_string(dir.join("new/object_00000/object.json")).expect("a record");
    let object: Value = serde_json::from_str(&object).expect("JSON");
    assert_eq!(object["environment"]["kind"], "axes", "described: {object}");
}
