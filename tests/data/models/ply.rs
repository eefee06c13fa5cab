//! PLY meshes as objects.

use lastlight::io::image_file;
use lastlight::io::ply_mesh;
use lastlight::scene::material::Transfer;
use lastlight::scene::mesh::Object;
use lastlight::scene::model;
use lastlight::{Error, Result};

fn fetch(path: &str) -> Result<Vec<u8>> {
    match path {
        "red.png" => Ok(image_file::png_bytes(1, 1, 3, &[255, 0, 0]).expect("a texture")),
        "blue.png" => Ok(image_file::png_bytes(1, 1, 3, &[0, 0, 255]).expect("a texture")),
        other => Err(Error::input(other).expected("a file").got("none")),
    }
}

fn read(bytes: &[u8]) -> Result<(Object, Vec<String>)> {
    let p = ply_mesh::parse(bytes, "a.ply", &fetch)?;
    Ok((model::from_ply(&p, "a.ply")?, p.notes))
}

fn refused(text: &str, parts: &[&str]) {
    let e = read(text.as_bytes()).expect_err("refused").to_string();
    assert!(e.starts_with("a.ply: ") && parts.iter().all(|p| e.contains(p)), "{parts:?} in {e}");
}

const HEAD: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n";
const ROWS: [[f32; 8]; 4] = [
    [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    [1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 1.0, 0.0],
    [1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0],
];
const FACES: [&[i32]; 2] = [&[0, 1, 2, 3], &[0, 2, 1]];

fn ascii() -> Vec<u8> {
    let mut text = format!("ply\nformat ascii 1.0\n{HEAD}");
    for row in ROWS {
        text += &format!("{}\n", row.map(|x| x.to_string()).join(" "));
    }
    for face in FACES {
        let corners: Vec<String> = face.iter().map(ToString::to_string).collect();
        text += &format!("{} {}\n", face.len(), corners.join(" "));
    }
    text.into_bytes()
}

fn binary(big: bool) -> Vec<u8> {
    let mut out =
        format!("ply\nformat binary_{}_endian 1.0\n{HEAD}", if big { "big" } else { "little" }).into_bytes();
    ROWS.as_flattened().iter().for_each(|x| out.extend(if big { x.to_be_bytes() } else { x.to_le_bytes() }));
    for face in FACES {
        out.push(face.len() as u8);
        face.iter().for_each(|i| out.extend(if big { i.to_be_bytes() } else { i.to_le_bytes() }));
    }
    out
}

#[test]
fn a_mesh_is_the_same_in_text_and_in_both_byte_orders() {
    let (object, notes) = read(&ascii()).expect("text");
    assert_eq!(object.mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 1]], "a fan, and a triangle");
    assert_eq!(object.mesh.positions[2], [1.0, -0.0, 1.0], "y up becomes z up");
    assert_eq!(object.mesh.normals[1], [0.0, -1.0, 0.0], "made unit");
    assert_eq!(object.mesh.uvs[0], [0.0, 1.0], "v turned over");
    assert!(notes.is_empty(), "{notes:?}");
    for big in [false, true] {
        assert_eq!(read(&binary(big)).expect("binary").0, object, "big endian: {big}");
    }
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("mesh.PLY");
    std::fs::write(&path, binary(false)).expect("written");
    let (again, notes) = model::read_with_notes(&path).expect("by extension");
    assert_eq!(again, object, "from a file");
    assert!(notes.iter().any(|n| n.contains("y is taken to be up")), "{notes:?}");
}

/// The texture of vertex colours interpolates as a triangle does.
#[test]
fn colours_of_vertices_become_a_texture() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\nproperty list uchar uint vertex_index\nend_header\n0 0 0 255 0 0\n1 0 0 0 255 0\n1 1 0 0 0 255\n0 1 0 188 188 188\n3 0 1 2\n3 0 2 3\n";
    let (object, _) = read(text.as_bytes()).expect("colours");
    let map = object.materials[0].base_color_map.clone().expect("a texture");
    assert_eq!(map.transfer, Transfer::Srgb, "encoded");
    let colors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.503, 0.503, 0.503]];
    for (t, corners) in [[0, 1, 2], [0, 2, 3]].into_iter().enumerate() {
        let uv = object.mesh.triangles[t].map(|i| object.mesh.uvs[i as usize]);
        for weights in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5]] {
            let mix = |k: usize, of: &dyn Fn(usize, usize) -> f32| {
                (0..3).fold(0.0, |s, c| s + weights[c] * of(c, k))
            };
            let at = [0, 1].map(|k| mix(k, &|c, k| uv[c][k]));
            let got = map.sample(at);
            for k in 0..3 {
                let want = mix(k, &|c, k| colors[corners[c]][k]);
                assert!((got[k] - want).abs() < 4e-3, "triangle {t}, {weights:?}: {got:?}, want {want}");
            }
        }
    }
    let float = text
        .replace("uchar red", "float red")
        .replace("uchar green", "float green")
        .replace("uchar blue", "float blue");
    let float = float.replace("255", "1").replace("188 188 188", "0.7372549 0.7372549 0.7372549");
    assert_eq!(read(float.as_bytes()).expect("floats").0, object, "floats from 0 to 1");
    refused(&text.replace("uchar red", "short red"), &["uchar or float"]);
}

/// As MeshLab writes a mesh with two textures: coordinates of the corners of faces.
#[test]
fn corners_have_their_own_texture_coordinates() {
    let text = "ply\nformat ascii 1.0\ncomment VCGLIB generated\ncomment TextureFile red.png\ncomment TextureFile blue.png\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 3\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\nproperty uchar red\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 6 0 0 1 0 1 1 0 7\n3 0 2 3 6 0.5 0 1 1 0 1 1 7\n3 1 2 3 0 -1 7\n";
    let (object, notes) = read(text.as_bytes()).expect("corners");
    assert_eq!(object.materials.len(), 2, "two textures");
    assert_eq!(object.material_of, [0, 1, 0], "−1 is the first");
    // Vertex 0 has two coordinates, vertices 1, 2 and 3 those of the face without any, too.
    assert_eq!((object.mesh.positions.len(), object.mesh.uvs.len()), (8, 8), "split where they differ");
    let uv = |t: usize, c: usize| object.mesh.uvs[object.mesh.triangles[t][c] as usize];
    assert_eq!(
        (uv(0, 0), uv(1, 0), uv(1, 1), uv(0, 2)),
        ([0.0, 1.0], [0.5, 1.0], [1.0, 0.0], [1.0, 0.0]),
        "per corner"
    );
    assert!(notes.iter().any(|n| n.contains("colours of faces")), "{notes:?}");
    refused(&text.replace("red.png", "../red.png"), &["TextureFile", "inside the folder"]);
    refused(&text.replace("red.png", "gone.png"), &["TextureFile", "gone.png"]);
    refused(&text.replace("6 0 0 1 0 1 1 0 7", "4 0 0 1 0 0 7"), &["texcoord", "every corner"]);
    refused(&text.replace("1 1 7", "1 2 7"), &["texnumber", "below 2"]);
}

#[test]
fn what_is_no_mesh_is_refused_with_what_it_is() {
    let vertex = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let rows = "0 0 0\n1 0 0\n0 1 0\n";
    let file =
        |more: &str, body: &str| format!("ply\nformat ascii 1.0\n{vertex}{more}end_header\n{rows}{body}");
    let strips = "element tristrips 1\nproperty list int int vertex_indices\n";
    refused(&file(strips, "4 0 1 2 -1\n"), &["triangle strips", "MeshLab"]);
    refused(&file("", ""), &["'face'", "points without faces"]);
    let faces = "element face 1\nproperty list uchar int vertex_indices\n";
    refused(&file(faces, "3 0 1 3\n"), &["row 0", "below 3"]);
    refused(&file(faces, "3 0 -1 2\n"), &["row 0", "-1"]);
    refused(&file(faces, "2 0 1\n"), &["three corners"]);
    refused(&file(faces, "9 0 1 2\n"), &["end of the line"]);
    refused(&file(faces, "3 0 1 2\n").replace("1 0 0\n", "nan 0 0\n"), &["row 1, property x", "finite"]);
    refused(
        &file("property float f_dc_0\n", "").replace("0 0\n", "0 0 0\n").replace("1 0\n", "1 0 0\n"),
        &["splat render"],
    );
    let (object, notes) = read(
        file(faces, "3 0 1 2\n")
            .replace("face 1", "face 2")
            .replace("3 0 1 2\n", "1 0\n3 0 1 2\n")
            .as_bytes(),
    )
    .expect("one is left");
    assert_eq!(object.mesh.triangles.len(), 1, "a triangle");
    assert!(notes.iter().any(|n| n.contains("1 faces with fewer than three corners")), "{notes:?}");
}

/// A file of a few bytes that declares long lists: refused before anything is allocated.
#[test]
fn long_lists_are_refused() {
    let head = "ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uint int vertex_indices\nend_header\n";
    let mut bytes = head.as_bytes().to_vec();
    bytes.extend(u32::MAX.to_le_bytes());
    let e = read(&bytes).expect_err("too long").to_string();
    assert!(e.contains("element face, row 0"), "{e}");
}
