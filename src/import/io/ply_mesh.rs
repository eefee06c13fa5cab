//! Meshes in PLY files: vertices, normals, colours, texture coordinates, faces.
//!
//! | in the file | record |
//! |---|---|
//! | vertex `x y z`, `nx ny nz` | positions, normals |
//! | vertex `red green blue` (uchar, or float from 0 to 1), or `diffuse_red …` | sRGB-encoded colours |
//! | vertex `s t`, `u v` or `texture_u texture_v` | texture coordinates, (0, 0) at the **bottom** left |
//! | face `vertex_indices` or `vertex_index` | triangles; polygons become fans |
//! | face `texcoord` (six numbers of a triangle), `texnumber`; comments `TextureFile NAME` | coordinates per corner, images (as MeshLab writes them) |
//!
//! Corners of one vertex with different texture coordinates become vertices of their own. Triangle strips are refused; colours of faces and
//! alpha are left out with a note.

use super::gltf::{Image, MAX_TEXELS, rgba};
use super::ply::{Column, Element, Ply};
use super::{MAX_FILE_BYTES, beside, capture, name_of, ply, read_bytes};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A mesh with its images.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyMesh {
    /// (V)
    pub positions: Vec<[f32; 3]>,
    /// (V) as in the file, or empty
    pub normals: Vec<[f32; 3]>,
    /// (V) sRGB-encoded, or empty
    pub colors: Vec<[u8; 3]>,
    /// (V) v upwards, or empty
    pub uvs: Vec<[f32; 2]>,
    /// (T) indices below V
    pub triangles: Vec<[u32; 3]>,
    /// (T) indices into `images`, or empty
    pub image_of: Vec<u32>,
    /// Decoded images.
    pub images: Vec<Arc<Image>>,
    /// Contents of the file that the record does not represent, one sentence each.
    pub notes: Vec<String>,
}

/// Reads a PLY file and the images in its folder.
///
/// # Errors
/// When a file is malformed, has no faces, an index is out of range, a number is not finite, an image is missing, or a path leads out of
/// the folder.
pub fn read(path: &Path) -> Result<PlyMesh> {
    parse(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path), &beside(path))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors, `fetch` gets what a relative path inside its folder names.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str, fetch: &dyn Fn(&str) -> Result<Vec<u8>>) -> Result<PlyMesh> {
    let file = ply::parse_with_lists(bytes, name)?;
    let faces = faces_of(&file, name)?;
    let vertices = file.element("vertex").ok_or_else(|| {
        Error::input(name).expected("an element 'vertex'").got(format!("only {}", names(&file)))
    })?;
    let mut out = PlyMesh {
        positions: rows(vertices, ["x", "y", "z"], name)?.ok_or_else(|| {
            Error::input(name).at("element vertex").expected("properties x, y and z").got("others")
        })?,
        normals: rows(vertices, ["nx", "ny", "nz"], name)?.unwrap_or_default(),
        colors: colors(vertices, name)?,
        ..PlyMesh::default()
    };
    for pair in [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]] {
        if out.uvs.is_empty() {
            out.uvs = rows(vertices, pair, name)?.unwrap_or_default();
        }
    }
    if vertices.column("alpha").is_some() {
        out.notes.push("the alpha of vertices is not read: the mesh is opaque".into());
    }
    if faces.element.column("red").is_some() {
        out.notes.push("colours of faces are not read".into());
    }
    let corners = triangles(&faces, &mut out, name)?;
    if let Some(uvs) = corner_uvs(&faces, &corners, name)? {
        split_corners(&mut out, uvs.as_chunks::<3>().0);
    }
    images(&file, &faces, &corners, name, fetch, &mut out)?;
    Ok(out)
}

/// The element of faces and its list of vertex indices.
struct Faces<'a> {
    element: &'a Element,
    indices: &'a ply::List,
}

fn names(file: &Ply) -> String {
    file.elements.iter().map(|e| e.name.as_str()).collect::<Vec<_>>().join(", ")
}

fn faces_of<'a>(file: &'a Ply, name: &str) -> Result<Faces<'a>> {
    let found = file.element("face").and_then(|element| {
        let indices = element.list("vertex_indices").or_else(|| element.list("vertex_index"))?;
        Some(Faces { element, indices })
    });
    if let Some(faces) = found.filter(|faces| faces.element.rows > 0) {
        return Ok(faces);
    }
    let e = Error::input(name).expected("an element 'face' with lists 'vertex_indices'");
    let vertex = |property: &str| file.element("vertex").is_some_and(|v| v.column(property).is_some());
    Err(if file.element("tristrips").is_some() {
        e.got("triangle strips")
            .hint("save the mesh with separate faces, for example with MeshLab or Blender")
    } else if vertex("f_dc_0") || vertex("packed_position") {
        e.got("a scene of Gaussians").hint("`lastlight splat render` renders scenes")
    } else {
        e.got(format!("{}: points without faces", names(file)))
    })
}

/// Columns of numbers that must be finite; `None` unless all are there.
fn rows<const K: usize>(e: &Element, properties: [&str; K], name: &str) -> Result<Option<Vec<[f32; K]>>> {
    let columns: Vec<&Column> = properties.iter().filter_map(|p| e.column(p)).collect();
    if columns.len() < K {
        return Ok(None);
    }
    let mut out = Vec::with_capacity(e.rows);
    for row in 0..e.rows {
        let mut values = [0.0; K];
        for (x, column) in values.iter_mut().zip(&columns) {
            *x = column.f32(row);
            if !x.is_finite() {
                return Err(Error::input(name)
                    .at(format!("element {}, row {row}, property {}", e.name, column.name))
                    .expected("a finite number")
                    .got(column.f64(row).to_string()));
            }
        }
        out.push(values);
    }
    Ok(Some(out))
}

/// sRGB-encoded colours of the vertices, or none.
fn colors(e: &Element, name: &str) -> Result<Vec<[u8; 3]>> {
    for properties in [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"]] {
        let Some(values) = rows(e, properties, name)? else { continue };
        let kinds = properties.map(|p| e.column(p).map(|c| c.kind));
        let byte: fn(f32) -> u8 = match kinds {
            [Some(a), Some(b), Some(c)] if [a, b, c] == [ply::Type::U8; 3] => |x: f32| x as u8,
            [Some(a), Some(b), Some(c)] if [a, b, c].into_iter().all(ply::Type::is_float) => {
                |x: f32| (crate::num::order::clamp(x, 0.0, 1.0) * 255.0 + 0.5) as u8
            }
            other => {
                return Err(Error::input(name)
                    .at(format!("element vertex, property {}", properties[0]))
                    .expected("colours of type uchar or float")
                    .got(format!("{other:?}")));
            }
        };
        return Ok(values.into_iter().map(|c| c.map(byte)).collect());
    }
    Ok(Vec::new())
}

/// A triangle's corner in the file: which face, and which of its corners.
type Corner = (u32, u32);

/// Fans of the polygons. Returns the corners of each triangle if faces have texture coordinates or images of their own.
fn triangles(faces: &Faces<'_>, out: &mut PlyMesh, name: &str) -> Result<Vec<[Corner; 3]>> {
    let count = out.positions.len();
    let wanted = faces.element.list("texcoord").is_some() || faces.element.column("texnumber").is_some();
    let mut corners = Vec::new();
    let mut small = 0_usize;
    let mut polygon: Vec<u32> = Vec::new();
    for face in 0..faces.element.rows {
        polygon.clear();
        for index in faces.indices.row(face) {
            if !(0.0..count as f64).contains(&index) || index.fract() != 0.0 {
                return Err(Error::input(name)
                    .at(format!("element face, row {face}"))
                    .expected(format!("vertex indices below {count}"))
                    .got(index.to_string()));
            }
            polygon.push(index as u32);
        }
        if polygon.len() < 3 {
            small += 1;
            continue;
        }
        for k in 1..polygon.len() - 1 {
            out.triangles.push([polygon[0], polygon[k], polygon[k + 1]]);
            if wanted {
                corners.push([0, k as u32, k as u32 + 1].map(|corner| (face as u32, corner)));
            }
        }
    }
    if out.triangles.is_empty() {
        return Err(Error::input(name)
            .at("element face")
            .expected("faces of three corners or more")
            .got("none"));
    }
    if small > 0 {
        out.notes.push(format!("{small} faces with fewer than three corners are left out"));
    }
    Ok(corners)
}

/// Texture coordinates of the corners, if faces have their own.
fn corner_uvs(faces: &Faces<'_>, corners: &[[Corner; 3]], name: &str) -> Result<Option<Vec<[f32; 2]>>> {
    let Some(list) = faces.element.list("texcoord") else { return Ok(None) };
    let mut uvs = Vec::with_capacity(3 * corners.len());
    for &(face, corner) in corners.iter().flatten() {
        let (face, at) = (face as usize, 2 * corner as usize);
        let uv = match (list.row_len(face), list.get(face, at), list.get(face, at + 1)) {
            // A face without coordinates has an empty list.
            (0, ..) => Some([0.0; 2]),
            (_, Some(u), Some(v)) => Some([u as f32, v as f32]).filter(|uv| uv.iter().all(|x| x.is_finite())),
            _ => None,
        };
        uvs.push(uv.ok_or_else(|| {
            Error::input(name)
                .at(format!("element face, row {face}, property texcoord"))
                .expected("two finite numbers for every corner")
                .got(format!("{} numbers", list.row_len(face)))
        })?);
    }
    Ok(Some(uvs))
}

/// Gives corners with different texture coordinates vertices of their own; `uvs` are those of the corners of each triangle.
fn split_corners(out: &mut PlyMesh, uvs: &[[[f32; 2]; 3]]) {
    let mut known: BTreeMap<(u32, [u32; 2]), u32> = BTreeMap::new();
    let mut source = Vec::new();
    out.uvs.clear();
    for (triangle, uv) in out.triangles.iter_mut().zip(uvs) {
        for (index, uv) in triangle.iter_mut().zip(uv) {
            let vertex = *known.entry((*index, uv.map(f32::to_bits))).or_insert_with(|| {
                source.push(*index as usize);
                out.uvs.push(*uv);
                source.len() as u32 - 1
            });
            *index = vertex;
        }
    }
    let pick = |rows: &[[f32; 3]]| -> Vec<[f32; 3]> {
        if rows.is_empty() { Vec::new() } else { source.iter().map(|&i| rows[i]).collect() }
    };
    (out.positions, out.normals) = (pick(&out.positions), pick(&out.normals));
    if !out.colors.is_empty() {
        out.colors = source.iter().map(|&i| out.colors[i]).collect();
    }
}

/// Reads the images that the comments name, and which face has which.
fn images(
    file: &Ply,
    faces: &Faces<'_>,
    corners: &[[Corner; 3]],
    name: &str,
    fetch: &dyn Fn(&str) -> Result<Vec<u8>>,
    out: &mut PlyMesh,
) -> Result<()> {
    let listed: Vec<&str> = file.comments.iter().filter_map(|c| c.strip_prefix("TextureFile ")).collect();
    if listed.is_empty() {
        return Ok(());
    }
    if out.uvs.is_empty() {
        out.notes.push("the texture is not read: no texture coordinates".into());
        return Ok(());
    }
    let mut texels = 0;
    for path in &listed {
        let place = || "comment TextureFile".to_owned();
        let clean = capture::clean(path.trim()).map_err(|why| {
            let short: String = path.chars().take(80).collect();
            let e = Error::input(name).at(place()).expected("a path inside the folder of the file");
            e.got(format!("'{short}', {why}"))
        })?;
        let within = |e: Error| e.within(name).at(place());
        let bytes = fetch(&clean).map_err(within)?;
        let ([width, height], image) = rgba(&bytes, MAX_TEXELS - texels).map_err(within)?;
        texels += image.len() as u64;
        out.images.push(Arc::new(Image { name: clean, width, height, texels: image }));
    }
    let number = faces.element.column("texnumber");
    for triangle in 0..out.triangles.len() {
        let face = corners.get(triangle).map_or(0, |c| c[0].0 as usize);
        // MeshLab writes −1 for faces without a texture.
        let image = number.map_or(0.0, |column| crate::num::order::max(column.f64(face), 0.0));
        if !(0.0..listed.len() as f64).contains(&image) || image.fract() != 0.0 {
            return Err(Error::input(name)
                .at(format!("element face, row {face}, property texnumber"))
                .expected(format!("numbers below {}", listed.len()))
                .got(image.to_string()));
        }
        out.image_of.push(image as u32);
    }
    if !out.colors.is_empty() {
        out.colors.clear();
        out.notes.push("colours of vertices are not read: the mesh has a texture".into());
    }
    Ok(())
}
