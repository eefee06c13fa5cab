//! Wavefront OBJ with MTL materials.
//!
//! The record keeps the file's frame (usually right-handed, y up) and its texture coordinates, (0, 0) at the
//! **bottom** left. Polygons become fans of triangles; points and lines are left out. Corners with the same
//! position, texture coordinate and normal indices share a vertex within a group; groups (`o`, `g`, a change
//! of material) share none.
//!
//! | MTL | record |
//! |---|---|
//! | `Kd`, `map_Kd` | base colour, its image |
//! | `d`, `Tr` = 1 − d | alpha; 0 is read as 1, with a note |
//! | `Pr`, `map_Pr` | roughness; without them from `Ns`: α² = 2/(Ns + 2), r = √α; without both ½ |
//! | `Pm`, `map_Pm` | metallic |
//! | `norm`, `map_Kn` | normal map; bump maps (heights) are left out with a note |
//! | `Ke`, `map_Ke` | emission |
//!
//! Of the options of a map `-clamp` is read, the others are noted. A material library that is not there is
//! noted, an image that is not there is an error.

use super::gltf::{Image, MAX_TEXELS, rgba};
use super::{MAX_SMALL_FILE_BYTES, atomic, beside, capture, guard, image_file, name_of, read_bytes};
use crate::{Error, Result};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// An image used by a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Map {
    /// Index into the images.
    pub image: usize,
    /// Its border continues; else it repeats.
    pub clamp: bool,
}

/// A material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name.
    pub name: String,
    /// Linear RGB.
    pub base_color: [f32; 3],
    /// sRGB-encoded.
    pub base_color_map: Option<Map>,
    /// 1 is opaque.
    pub alpha: f32,
    /// 0..1
    pub roughness: f32,
    /// Its first channel times `roughness`.
    pub roughness_map: Option<Map>,
    /// 0..1
    pub metallic: f32,
    /// Its first channel times `metallic`.
    pub metallic_map: Option<Map>,
    /// Tangent space.
    pub normal_map: Option<Map>,
    /// Linear RGB.
    pub emission: [f32; 3],
    /// sRGB-encoded.
    pub emission_map: Option<Map>,
}

/// A named run of triangles of one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Of `o` or `g`.
    pub name: String,
    /// Which triangles.
    pub triangles: Range<usize>,
    /// Index, if it has one.
    pub material: Option<usize>,
}

/// A file with its materials and images.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Obj {
    /// (V)
    pub positions: Vec<[f32; 3]>,
    /// (V) as in the file, zeros where a group has none; or empty
    pub normals: Vec<[f32; 3]>,
    /// (V) v upwards, zeros where a group has none; or empty
    pub uvs: Vec<[f32; 2]>,
    /// (T) indices below V
    pub triangles: Vec<[u32; 3]>,
    /// They cover the triangles in order.
    pub groups: Vec<Group>,
    /// Of all libraries.
    pub materials: Vec<Material>,
    /// Decoded images.
    pub images: Vec<Arc<Image>>,
    /// Contents of the file that the record does not represent, one sentence each.
    pub notes: Vec<String>,
}

/// Reads an OBJ file and the material libraries and images in its folder.
///
/// # Errors
/// When a file is malformed, an index is out of range, a number is not finite, an image is missing, or a path
/// leads out of the folder.
pub fn read(path: &Path) -> Result<Obj> {
    let bytes = read_bytes(path, MAX_SMALL_FILE_BYTES)?;
    parse(&bytes, &name_of(path), &beside(path))
}

const OPTIONS: tobj::LoadOptions =
    tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };

/// Like [`read`] for bytes in memory; `name` is the file name in errors, `fetch` gets what a relative path
/// inside its folder names.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str, fetch: &dyn Fn(&str) -> Result<Vec<u8>>) -> Result<Obj> {
    guard(name, || {
        let failed: RefCell<Option<Error>> = RefCell::new(None);
        let notes: RefCell<Vec<String>> = RefCell::new(Vec::new());
        let library = |path: &Path| {
            let text = path.to_string_lossy();
            let none = || tobj::load_mtl_buf(&mut &b""[..]);
            match capture::clean(&text) {
                Err(why) => {
                    let e = Error::input(name).at("mtllib").expected("a path inside the folder of the file");
                    failed.borrow_mut().get_or_insert(e.got(format!("'{}', {why}", short(&text))));
                    none()
                }
                Ok(clean) => match fetch(&clean) {
                    Ok(bytes) => {
                        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
                        let loaded = tobj::load_mtl_buf(&mut &bytes[..]);
                        if let Err(e) = &loaded {
                            let wrong = Error::input(name).at(format!("material library '{}'", short(&text)));
                            failed.borrow_mut().get_or_insert(
                                wrong.expected("a statement of an MTL file").got(e.to_string()),
                            );
                        }
                        loaded.or_else(|_| none())
                    }
                    Err(_) => {
                        notes
                            .borrow_mut()
                            .push(format!("the material library '{}' is not there", short(&text)));
                        none()
                    }
                },
            }
        };
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let (models, materials) = tobj::load_obj_buf(&mut &bytes[..], &OPTIONS, library)
            .map_err(|e| locate_error(bytes, name, e))?;
        if let Some(e) = failed.into_inner() {
            return Err(e);
        }
        let materials = materials.unwrap_or_default();
        let mut out = Obj { notes: notes.into_inner(), ..Obj::default() };
        for model in &models {
            group(model, name, &mut out)?;
        }
        let mut pictures = Pictures { name, fetch, known: BTreeMap::new(), texels: 0 };
        for m in &materials {
            let m = material(m, &mut pictures, &mut out)?;
            out.materials.push(m);
        }
        out.notes.dedup();
        Ok(out)
    })
}

fn short(text: &str) -> String {
    text.chars().take(80).collect()
}

/// The crate does not report which line is malformed: it is the last line of the shortest prefix that fails.
fn locate_error(bytes: &[u8], name: &str, e: tobj::LoadError) -> Error {
    const LONGEST: usize = 16 << 20;
    let error = |place: String| Error::input(name).at(place).expected(statement(e));
    if bytes.len() > LONGEST {
        return error("vertices and faces".into()).got("another one");
    }
    let ends: Vec<usize> =
        (0..bytes.len()).filter(|&i| bytes[i] == b'\n').map(|i| i + 1).chain([bytes.len()]).collect();
    let fails = |end: usize| {
        let none = |_: &Path| tobj::load_mtl_buf(&mut &b""[..]);
        tobj::load_obj_buf(&mut &bytes[..end], &OPTIONS, none).is_err()
    };
    let line = ends.partition_point(|&end| !fails(end));
    let start = line.checked_sub(1).and_then(|i| ends.get(i)).copied().unwrap_or(0);
    let text = bytes.get(start..).unwrap_or_default().split(|&b| b == b'\n').next().unwrap_or_default();
    error(format!("line {}", line + 1)).got(format!("'{}'", short(String::from_utf8_lossy(text).trim())))
}

/// The statement that the crate could not read.
fn statement(e: tobj::LoadError) -> &'static str {
    use tobj::LoadError as E;
    match e {
        E::PositionParseError | E::ScalingByZeroError => "a vertex 'v X Y Z' of three numbers",
        E::ColorParseError => "a vertex 'v X Y Z', or one with a colour 'v X Y Z R G B'",
        E::NormalParseError => "a normal 'vn X Y Z' of three numbers",
        E::TexcoordParseError => "a texture coordinate 'vt U V' of two numbers",
        E::FaceParseError | E::InvalidPolygon => "a face 'f V/T/N ...' of indices other than 0",
        E::FaceVertexOutOfBounds | E::FaceColorOutOfBounds => {
            "a face of vertices that the file defines above it"
        }
        E::FaceTexCoordOutOfBounds => "a face of texture coordinates that the file defines above it",
        E::FaceNormalOutOfBounds => "a face of normals that the file defines above it",
        E::InvalidObjectName => "an object 'o NAME' in UTF-8",
        E::MaterialParseError => "a material 'usemtl NAME' or library 'mtllib NAME'",
        _ => "a statement of an OBJ file in UTF-8",
    }
}

fn group(model: &tobj::Model, name: &str, out: &mut Obj) -> Result<()> {
    let m = &model.mesh;
    let place =
        |what: &str, i: usize| Error::input(name).at(format!("group '{}', {what} {i}", short(&model.name)));
    let base = out.positions.len();
    let count = m.positions.len() / 3;
    if base + count > u32::MAX as usize {
        return Err(place("vertex", count).expected("at most 2³² vertices").got("more"));
    }
    for (what, values) in
        [("position", &m.positions), ("normal", &m.normals), ("texture coordinate", &m.texcoords)]
    {
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            let width = if what == "texture coordinate" { 2 } else { 3 };
            return Err(place(what, i / width).expected("finite numbers").got(values[i].to_string()));
        }
    }
    let rows = |v: &[f32]| v.as_chunks::<3>().0.to_vec();
    out.positions.extend(rows(&m.positions));
    if !m.normals.is_empty() || !out.normals.is_empty() {
        out.normals.resize(base, [0.0; 3]);
        out.normals.extend(rows(&m.normals));
        out.normals.resize(base + count, [0.0; 3]);
    }
    if !m.texcoords.is_empty() || !out.uvs.is_empty() {
        out.uvs.resize(base, [0.0; 2]);
        out.uvs.extend(m.texcoords.as_chunks::<2>().0);
        out.uvs.resize(base + count, [0.0; 2]);
    }
    let first = out.triangles.len();
    for corners in m.indices.as_chunks::<3>().0 {
        if let Some(i) = corners.iter().find(|&&i| i as usize >= count) {
            return Err(place("vertex index", *i as usize)
                .expected(format!("below {count}"))
                .got(i.to_string()));
        }
        out.triangles.push(corners.map(|i| i + base as u32));
    }
    let triangles = first..out.triangles.len();
    if !triangles.is_empty() {
        out.groups.push(Group { name: model.name.clone(), triangles, material: m.material_id });
    }
    Ok(())
}

/// Images by path, each decoded once.
struct Pictures<'a> {
    name: &'a str,
    fetch: &'a dyn Fn(&str) -> Result<Vec<u8>>,
    known: BTreeMap<String, usize>,
    texels: u64,
}

impl Pictures<'_> {
    /// The image of a statement `[options] path`.
    fn map(&mut self, statement: &str, place: &str, out: &mut Obj) -> Result<Map> {
        let (path, clamp) = options(statement, &mut out.notes);
        let error = |e: Error| e.within(self.name).at(place.to_owned());
        let clean = capture::clean(&path).map_err(|why| {
            let e =
                Error::input(self.name).at(place.to_owned()).expected("a path inside the folder of the file");
            e.got(format!("'{}', {why}", short(&path)))
        })?;
        if let Some(&image) = self.known.get(&clean) {
            return Ok(Map { image, clamp });
        }
        let bytes = (self.fetch)(&clean).map_err(error)?;
        let ([width, height], texels) = rgba(&bytes, MAX_TEXELS - self.texels).map_err(error)?;
        self.texels += texels.len() as u64;
        let image = out.images.len();
        out.images.push(Arc::new(Image { name: clean.clone(), width, height, texels }));
        self.known.insert(clean, image);
        Ok(Map { image, clamp })
    }
}

/// Path and `-clamp` of a map statement.
fn options(statement: &str, notes: &mut Vec<String>) -> (String, bool) {
    let (mut rest, mut clamp) = (statement.trim(), false);
    while rest.starts_with('-') {
        let mut words = rest.split_whitespace();
        let option = words.next().unwrap_or_default();
        let most = match option {
            "-o" | "-s" | "-t" => 3,
            "-mm" => 2,
            "-blendu" | "-blendv" | "-boost" | "-texres" | "-clamp" | "-bm" | "-imfchan" | "-type" => 1,
            // A path may begin with a dash.
            _ => break,
        };
        let numbers = matches!(option, "-o" | "-s" | "-t");
        let values: Vec<&str> =
            words.take(most).take_while(|w| !numbers || w.parse::<f32>().is_ok()).collect();
        match (option, values.first()) {
            ("-clamp", Some(&"on")) => clamp = true,
            ("-clamp", _) => {}
            _ => notes.push(format!("the option {option} of a map is not read")),
        }
        // Behind the last word that was taken.
        let mut used = rest;
        for word in std::iter::once(option).chain(values) {
            used = used.trim_start().strip_prefix(word).unwrap_or(used);
        }
        rest = used.trim_start();
    }
    (rest.to_owned(), clamp)
}

fn material(m: &tobj::Material, pictures: &mut Pictures<'_>, out: &mut Obj) -> Result<Material> {
    let name = pictures.name;
    let label = short(&m.name);
    let place = |key: &str| format!("material '{label}', {key}");
    let wrong = |key: &str, got: String| {
        Error::input(name).at(place(key)).expected("finite numbers in range").got(got)
    };
    let text = |key: &str| m.unknown_param.get(key).map(String::as_str);
    let number = |key: &str| -> Result<Option<f32>> {
        let Some(word) = text(key).and_then(|t| t.split_whitespace().next()) else { return Ok(None) };
        match word.parse::<f32>() {
            Ok(x) if x.is_finite() => Ok(Some(x)),
            _ => Err(wrong(key, word.chars().take(40).collect())),
        }
    };
    let unit =
        |key: &str, x: f32| if (0.0..=1.0).contains(&x) { Ok(x) } else { Err(wrong(key, x.to_string())) };
    let color = |key: &str, c: Option<[f32; 3]>, default: f32| -> Result<[f32; 3]> {
        let c = c.unwrap_or([default; 3]);
        if c.iter().all(|x| x.is_finite() && *x >= 0.0) { Ok(c) } else { Err(wrong(key, format!("{c:?}"))) }
    };
    let base_color = color("Kd", m.diffuse, 1.0)?;
    if base_color.iter().any(|x| *x > 1.0) {
        return Err(wrong("Kd", format!("{base_color:?}")));
    }
    let alpha = match (m.dissolve, number("Tr")?) {
        (Some(d), _) => unit("d", d)?,
        (None, Some(t)) => unit("Tr", 1.0 - t)?,
        (None, None) => 1.0,
    };
    let alpha = if alpha > 0.0 {
        alpha
    } else {
        out.notes.push(format!(
            "material '{label}' is invisible (d 0 or Tr 1) and read as opaque, as most importers do"
        ));
        1.0
    };
    let mut find = |keys: &[(&str, Option<&str>)], out: &mut Obj| -> Result<Option<Map>> {
        let found = keys.iter().find_map(|(key, statement)| Some((key, (*statement)?)));
        found.map(|(key, statement)| pictures.map(statement, &place(key), out)).transpose()
    };
    let base_color_map = find(&[("map_Kd", m.diffuse_texture.as_deref())], out)?;
    let roughness_map = find(&[("map_Pr", text("map_Pr"))], out)?;
    let metallic_map = find(&[("map_Pm", text("map_Pm"))], out)?;
    let normal_map = find(&[("norm", text("norm")), ("map_Kn", text("map_Kn"))], out)?;
    let emission_map = find(&[("map_Ke", text("map_Ke"))], out)?;
    if m.normal_texture.is_some() {
        out.notes.push("bump maps are not read".into());
    }
    if m.dissolve_texture.is_some() {
        out.notes.push("map_d is not read".into());
    }
    let shiny = match m.shininess {
        Some(ns) if ns.is_finite() && ns >= 0.0 => Some((2.0 / (ns + 2.0)).sqrt().sqrt()),
        Some(ns) => return Err(wrong("Ns", ns.to_string())),
        None => None,
    };
    // The factor of a map is 1.
    let factor = |key: &str, value: Option<f32>, map: Option<Map>, otherwise: f32| match (value, map) {
        (Some(x), _) => unit(key, x),
        (None, Some(_)) => Ok(1.0),
        (None, None) => Ok(otherwise),
    };
    let roughness = factor("Pr", number("Pr")?, roughness_map, shiny.unwrap_or(0.5))?;
    let metallic = factor("Pm", number("Pm")?, metallic_map, 0.0)?;
    let emission = color("Ke", m.emissive, if emission_map.is_some() { 1.0 } else { 0.0 })?;
    Ok(Material {
        name: label.clone(),
        base_color,
        base_color_map,
        alpha,
        roughness,
        roughness_map,
        metallic,
        metallic_map,
        normal_map,
        emission,
        emission_map,
    })
}

/// Writes `STEM.obj`, `STEM.mtl` and a PNG per image that a material names, each atomically, the OBJ last.
///
/// # Errors
/// When an index is out of range or a file cannot be written.
pub fn write(path: &Path, obj: &Obj) -> Result<()> {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let folder = path.parent().unwrap_or(Path::new(""));
    let picture = |i: usize| format!("{stem}_{i}.png");
    let is_named = |i: usize| obj.materials.iter().any(|m| m.maps().iter().any(|(_, map)| map.image == i));
    for (i, image) in obj.images.iter().enumerate().filter(|(i, _)| is_named(*i)) {
        let texels = image.texels.as_flattened();
        image_file::write_png(&folder.join(picture(i)), image.width, image.height, 4, texels)?;
    }
    let library = format!("{stem}.mtl");
    if !obj.materials.is_empty() {
        atomic::write_bytes(&folder.join(&library), mtl_text(&obj.materials, &picture).as_bytes())?;
    }
    atomic::write_bytes(path, obj_text(obj, &library)?.as_bytes())
}

/// The text of an OBJ file; `library` names its materials.
///
/// # Errors
/// When an index is out of range or groups do not cover the triangles in order.
pub fn obj_text(obj: &Obj, library: &str) -> Result<String> {
    let mut s = String::new();
    // Writing to a String cannot fail.
    let mut line = |args: std::fmt::Arguments<'_>| {
        let _ = s.write_fmt(args);
        s.push('\n');
    };
    if !obj.materials.is_empty() {
        line(format_args!("mtllib {library}"));
    }
    obj.positions.iter().for_each(|[x, y, z]| line(format_args!("v {x} {y} {z}")));
    obj.uvs.iter().for_each(|[u, v]| line(format_args!("vt {u} {v}")));
    obj.normals.iter().for_each(|[x, y, z]| line(format_args!("vn {x} {y} {z}")));
    let corner = |i: u32| {
        let i = u64::from(i) + 1;
        match (obj.uvs.is_empty(), obj.normals.is_empty()) {
            (true, true) => i.to_string(),
            (false, true) => format!("{i}/{i}"),
            (true, false) => format!("{i}//{i}"),
            (false, false) => format!("{i}/{i}/{i}"),
        }
    };
    let mut next = 0;
    for g in &obj.groups {
        let covered = g.triangles.start == next && g.triangles.end <= obj.triangles.len();
        let known = g.material.is_none_or(|m| m < obj.materials.len());
        if !(covered && known) {
            let e = Error::input("OBJ").at(format!("group '{}'", g.name));
            return Err(e
                .expected("the next triangles and a known material")
                .got(format!("{:?}, {:?}", g.triangles, g.material)));
        }
        line(format_args!("g {}", one_word(&g.name)));
        if let Some(m) = g.material {
            line(format_args!("usemtl {}_{m}", one_word(&obj.materials[m].name)));
        }
        for t in &obj.triangles[g.triangles.clone()] {
            if t.iter().any(|&i| i as usize >= obj.positions.len()) {
                let e = Error::input("OBJ").at("triangle");
                return Err(e
                    .expected(format!("indices below {}", obj.positions.len()))
                    .got(format!("{t:?}")));
            }
            line(format_args!("f {} {} {}", corner(t[0]), corner(t[1]), corner(t[2])));
        }
        next = g.triangles.end;
    }
    if next != obj.triangles.len() {
        let e = Error::input("OBJ").at("groups");
        return Err(e.expected(format!("{} triangles", obj.triangles.len())).got(next.to_string()));
    }
    Ok(s)
}

impl Material {
    /// Its maps, with their names in a material library.
    fn maps(&self) -> Vec<(&'static str, Map)> {
        let maps = [
            ("map_Kd", self.base_color_map),
            ("map_Pr", self.roughness_map),
            ("map_Pm", self.metallic_map),
            ("norm", self.normal_map),
            ("map_Ke", self.emission_map),
        ];
        maps.into_iter().filter_map(|(name, map)| Some((name, map?))).collect()
    }
}

/// A name without white space, since names are fields of a line.
fn one_word(name: &str) -> String {
    let word: String =
        name.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect();
    if word.is_empty() { "default".into() } else { word }
}

/// The text of a material library; `picture` gives the file name of an image.
pub fn mtl_text(materials: &[Material], picture: &dyn Fn(usize) -> String) -> String {
    let mut s = String::new();
    for (i, m) in materials.iter().enumerate() {
        let [r, g, b] = m.base_color;
        let _ = writeln!(
            s,
            "newmtl {}_{i}\nKd {r} {g} {b}\nd {}\nPr {}\nPm {}",
            one_word(&m.name),
            m.alpha,
            m.roughness,
            m.metallic
        );
        if m.emission.iter().any(|x| *x > 0.0) {
            let [r, g, b] = m.emission;
            let _ = writeln!(s, "Ke {r} {g} {b}");
        }
        for (key, map) in m.maps() {
            let clamp = if map.clamp { "-clamp on " } else { "" };
            let _ = writeln!(s, "{key} {clamp}{}", picture(map.image));
        }
    }
    s
}
