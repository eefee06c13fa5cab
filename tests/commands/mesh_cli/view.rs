//! `mesh view`: a page of its own with the facts, of a closed textured mesh and of an open one without coordinates.

use super::{done, refused, workplace, write, write_cube};
use crate::report::checked;
use serde_json::Value;

#[test]
fn a_page_shows_a_closed_mesh_from_all_sides_with_its_sheets_and_facts() {
    let dir = workplace();
    let dir = dir.path();
    write_cube(dir, 0.5, 200);
    let view =
        ["mesh", "view", "cube.obj", "--out", "page", "--size", "24", "--samples", "2", "--quiet", "--json"];
    let record: Value = serde_json::from_str(&done(&view, dir)).expect("JSON");
    let facts = &record["facts"];
    assert_eq!(facts["closed"], true, "{facts:#}");
    assert_eq!((&facts["edges"]["regular"], &facts["parts"]), (&18.into(), &1.into()), "{facts:#}");
    assert_eq!((&facts["points"], &facts["triangles"]), (&8.into(), &12.into()), "{facts:#}");
    let [volume, area] = ["volume", "area"].map(|k| facts[k].as_f64().expect("a number"));
    assert!((volume - 1.0).abs() < 1e-12 && (area - 6.0).abs() < 1e-12, "{volume}, {area}");
    assert_eq!((&facts["euler"], &facts["degenerate_triangles"]), (&2.into(), &0.into()), "{facts:#}");
    // Six faces, each with the same square of two triangles: centres of texels off the diagonal are inside of six.
    let texture = &facts["texture"];
    assert_eq!(texture["texels_used"], 1.0, "{texture:#}");
    assert!(texture["texels_overlapping"].as_f64().expect("a number") >= 0.5, "{texture:#}");
    let html = checked(&dir.join("page/report/index.html"));
    for alt in ["the mesh from 0°", "the mesh from 315°", "the mesh from above", "the mesh from below"] {
        assert!(html.contains(&format!("alt=\"{alt}\"")), "{alt}");
    }
    for alt in ["shading normals from 90°", "ambient occlusion from 180°", "base colour, 2 by 2 texels"] {
        assert!(html.contains(&format!("alt=\"{alt}")), "{alt}");
    }
    assert!(html.contains("every edge in two triangles"), "closed");
    let file: Value = serde_json::from_slice(&std::fs::read(dir.join("page/result.json")).expect("a record"))
        .expect("JSON");
    assert_eq!(file["facts"], *facts, "the same facts in the file");
    refused(&view[..view.len() - 1], dir, &["page", "--force"]);
}

#[test]
fn an_open_mesh_without_coordinates_has_a_page_too() {
    let dir = workplace();
    let dir = dir.path();
    write(&dir.join("flat.obj"), "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nf 1 2 3\nf 1 3 4\n");
    let view = ["mesh", "view", "flat.obj", "--out", "page", "--size", "16", "--samples", "1", "--quiet"];
    let text = done(&view, dir);
    assert!(text.contains("4 open edges") && text.contains("none: not closed"), "{text}");
    let html = checked(&dir.join("page/report/index.html"));
    assert!(!html.contains("id=\"textures\""), "no sheets");
}
