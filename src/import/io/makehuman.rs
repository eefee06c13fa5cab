//! The open body of MakeHuman: a mesh in OBJ, a rig and skinning weights in JSON (all CC0).
//!
//! ```text
//! base.obj          v, vt, f in decimetres, y up, facing +z; group `body` is the skin, others are helpers: clothes proxies, joint cubes
//! rig.NAME.json     { scale_factor, bones: { BONE: { parent, head: { strategy, … }, tail: { … } } } }
//! weights.NAME.json { weights: { BONE: [[vertex, weight], …] } }
//! ```
//!
//! A bone end is the mean of vertices: of `vertex_indices` for the strategy MEAN, of the group `cube_name`
//! for CUBE, the vertex `vertex_indices[0]` for VERTEX. Weights index the `v` lines of the complete file, so
//! its vertices are kept in order here; those of a vertex need not sum to 1 and are divided by their sum.

use super::{MAX_SMALL_FILE_BYTES, name_of, read_bytes};
use crate::{Error, Result};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest number of vertices.
const MAX_VERTICES: usize = 1 << 22;

/// A bone.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// Its name.
    pub name: String,
    /// Its parent bone, an index below its own.
    pub parent: Option<usize>,
    /// Where it begins, in the units of the mesh.
    pub head: [f64; 3],
    /// Where it ends.
    pub tail: [f64; 3],
}

/// Mesh, rig and weights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Body {
    /// (V) of group `body`, in the units and axes of the file
    pub positions: Vec<[f32; 3]>,
    /// (U) texture coordinates, v upwards
    pub uvs: Vec<[f32; 2]>,
    /// (T) corners: vertex and texture coordinate
    pub triangles: Vec<[[u32; 2]; 3]>,
    /// Parents before children.
    pub bones: Vec<Bone>,
    /// (V) bone and weight, the largest first, summing to 1
    pub weights: Vec<Vec<(u16, f64)>>,
    /// Metres per unit.
    pub scale: f64,
}

/// Finds the three files: `path` is a folder or the OBJ in it; the rig and the weights are the only ones of
/// their kind beside it.
///
/// # Errors
/// When one is missing or there are several.
pub fn locate(path: &Path) -> Result<[PathBuf; 3]> {
    let folder =
        if path.is_dir() { path.to_path_buf() } else { path.parent().unwrap_or(Path::new("")).to_path_buf() };
    let folder = if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder };
    let mesh = if path.is_dir() { folder.join("base.obj") } else { path.to_path_buf() };
    let entries = std::fs::read_dir(&folder).map_err(|e| Error::os(&folder, &e))?;
    let mut names: Vec<String> = entries.filter_map(|e| e.ok()?.file_name().into_string().ok()).collect();
    names.sort();
    let one = |prefix: &str| {
        let found: Vec<&String> =
            names.iter().filter(|n| n.starts_with(prefix) && n.ends_with(".json")).collect();
        match found.as_slice() {
            [name] => Ok(folder.join(name)),
            other => Err(Error::input(name_of(&folder))
                .expected(format!("one file {prefix}*.json"))
                .got(other.len().to_string())),
        }
    };
    Ok([mesh, one("rig.")?, one("weights.")?])
}

/// Reads the body of a folder, or of the OBJ in it.
///
/// # Errors
/// When a file is missing or malformed, or they do not belong together.
pub fn read(path: &Path) -> Result<Body> {
    let [mesh, rig, weights] = locate(path)?;
    let bytes = [&mesh, &rig, &weights].map(|p| read_bytes(p, MAX_SMALL_FILE_BYTES));
    let [m, r, w] = bytes;
    parse([&m?, &r?, &w?], [&name_of(&mesh), &name_of(&rig), &name_of(&weights)])
}

#[derive(Deserialize)]
struct Rig {
    #[serde(default = "decimetre")]
    scale_factor: f64,
    bones: BTreeMap<String, RigBone>,
}

fn decimetre() -> f64 {
    0.1
}

#[derive(Deserialize)]
struct RigBone {
    parent: String,
    head: End,
    tail: End,
}

#[derive(Deserialize)]
struct End {
    strategy: String,
    #[serde(default)]
    vertex_indices: Vec<usize>,
    #[serde(default)]
    cube_name: String,
}

#[derive(Deserialize)]
struct Weights {
    weights: BTreeMap<String, Vec<(usize, f64)>>,
}

/// Vertices, texture coordinates, and faces by group, in the order of the file.
struct Base {
    v: Vec<[f32; 3]>,
    vt: Vec<[f32; 2]>,
    groups: BTreeMap<String, Vec<Vec<[u32; 2]>>>,
}

/// Like [`read`] for the bytes of mesh, rig and weights; `names` are the file names in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: [&[u8]; 3], names: [&str; 3]) -> Result<Body> {
    let base = base(bytes[0], names[0])?;
    let rig: Rig = json(bytes[1], names[1])?;
    let weights: Weights = json(bytes[2], names[2])?;
    if !(rig.scale_factor > 0.0 && rig.scale_factor < 1e6) {
        return Err(Error::input(names[1])
            .at("scale_factor")
            .expected("a positive number")
            .got(rig.scale_factor.to_string()));
    }
    let bones = bones(&rig, &base, names[1])?;
    let faces = base
        .groups
        .get("body")
        .ok_or_else(|| Error::input(names[0]).expected("a group 'body'").got("none"))?;
    let index = |name: &str| bones.iter().position(|b: &Bone| b.name == name);
    let mut all: Vec<Vec<(u16, f64)>> = vec![Vec::new(); base.v.len()];
    for (bone, list) in &weights.weights {
        let at = |i: usize| {
            Error::input(names[2])
                .at(format!("weights, bone '{}', entry {i}", bone.chars().take(80).collect::<String>()))
        };
        let k = index(bone).ok_or_else(|| at(0).expected("a bone of the rig").got("none of that name"))?;
        for (i, &(vertex, w)) in list.iter().enumerate() {
            let Some(slot) = all.get_mut(vertex) else {
                return Err(at(i)
                    .expected(format!("a vertex below {}", base.v.len()))
                    .got(vertex.to_string()));
            };
            if !(w >= 0.0 && w.is_finite()) {
                return Err(at(i).expected("a weight ≥ 0").got(w.to_string()));
            }
            if w > 0.0 {
                slot.push((k as u16, w));
            }
        }
    }
    // Vertices of the body alone, in the order of the file.
    let mut used = vec![false; base.v.len()];
    faces.iter().flatten().for_each(|c| used[c[0] as usize] = true);
    let mut renamed = vec![0; base.v.len()];
    let mut out = Body { uvs: base.vt, scale: rig.scale_factor, ..Body::default() };
    for (i, _) in used.iter().enumerate().filter(|(_, u)| **u) {
        renamed[i] = out.positions.len() as u32;
        out.positions.push(base.v[i]);
        let mut w = std::mem::take(&mut all[i]);
        let sum = w.iter().fold(0.0, |s, (_, x)| s + x);
        if !(sum > 0.0) {
            return Err(Error::input(names[2])
                .at(format!("vertex {i}"))
                .expected("a positive weight")
                .got("none"));
        }
        w.iter_mut().for_each(|(_, x)| *x /= sum);
        // The largest first, ties by bone.
        w.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        out.weights.push(w);
    }
    for face in faces {
        let corner = |k: usize| [renamed[face[k][0] as usize], face[k][1]];
        out.triangles.extend((1..face.len() - 1).map(|k| [corner(0), corner(k), corner(k + 1)]));
    }
    out.bones = bones;
    Ok(out)
}

fn json<T: for<'a> Deserialize<'a>>(bytes: &[u8], name: &str) -> Result<T> {
    serde_json::from_slice(bytes).map_err(|e| super::json::error(bytes, name, &e))
}

fn base(bytes: &[u8], name: &str) -> Result<Base> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        Error::input(name).at(format!("byte {}", e.valid_up_to())).expected("UTF-8").got("other bytes")
    })?;
    let mut out = Base { v: Vec::new(), vt: Vec::new(), groups: BTreeMap::new() };
    let mut group = String::from("body");
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        let wrong = |expected: &str| {
            Error::input(name)
                .at(format!("line {}", i + 1))
                .expected(expected)
                .got(format!("'{}'", line.chars().take(60).collect::<String>()))
        };
        match words.next() {
            Some("v") if out.v.len() < MAX_VERTICES => {
                out.v.push(numbers(words).ok_or_else(|| wrong("three finite numbers"))?)
            }
            Some("vt") if out.vt.len() < MAX_VERTICES => {
                out.vt.push(numbers(words).ok_or_else(|| wrong("two finite numbers"))?)
            }
            Some("v" | "vt") => return Err(wrong(&format!("at most {MAX_VERTICES} vertices"))),
            Some("g" | "o") => group = words.next().unwrap_or("default").to_owned(),
            Some("f") => {
                let corner = |w: &str| {
                    let mut parts = w.split('/');
                    let v = parts.next()?.parse::<u32>().ok()?.checked_sub(1)?;
                    let t = match parts.next() {
                        None | Some("") => 0,
                        Some(t) => t.parse::<u32>().ok()?.checked_sub(1)?,
                    };
                    let inside =
                        (v as usize) < out.v.len() && ((t as usize) < out.vt.len() || out.vt.is_empty());
                    inside.then_some([v, t])
                };
                let face: Option<Vec<[u32; 2]>> = words.map(corner).collect();
                let face = face.filter(|f| f.len() >= 3);
                let face = face.ok_or_else(|| wrong("three or more corners V/T of vertices above"))?;
                match out.groups.get_mut(&group) {
                    Some(list) => list.push(face),
                    None => {
                        out.groups.insert(group.clone(), vec![face]);
                    }
                }
            }
            _ => {}
        }
    }
    Ok(out)
}

/// The next `N` words as finite numbers.
fn numbers<'a, const N: usize>(mut words: impl Iterator<Item = &'a str>) -> Option<[f32; N]> {
    let mut out = [0.0; N];
    for x in &mut out {
        *x = words.next()?.parse().ok().filter(|x: &f32| x.is_finite())?;
    }
    Some(out)
}

/// Bones with their ends, parents before children, otherwise by name.
fn bones(rig: &Rig, base: &Base, name: &str) -> Result<Vec<Bone>> {
    let mut out: Vec<Bone> = Vec::new();
    if rig.bones.len() > usize::from(u16::MAX) {
        return Err(Error::input(name)
            .at("bones")
            .expected("at most 65535")
            .got(rig.bones.len().to_string()));
    }
    let known = |out: &[Bone], n: &str| out.iter().position(|b| b.name == n);
    // A round adds the bones whose parents are there; a bone that is never added has a missing parent or is
    // part of a cycle.
    loop {
        let before = out.len();
        for (n, b) in &rig.bones {
            if known(&out, n).is_some() {
                continue;
            }
            let parent = known(&out, &b.parent);
            if b.parent.is_empty() || parent.is_some() {
                let end = |e: &End, which: &str| {
                    end(e, base).map_err(|got| {
                        Error::input(name)
                            .at(format!("bones.{}.{which}", n.chars().take(80).collect::<String>()))
                            .expected("MEAN or VERTEX with vertices, or CUBE with a group, of the mesh")
                            .got(got)
                    })
                };
                out.push(Bone {
                    name: n.clone(),
                    parent,
                    head: end(&b.head, "head")?,
                    tail: end(&b.tail, "tail")?,
                });
            }
        }
        if out.len() == rig.bones.len() {
            return Ok(out);
        }
        if out.len() == before {
            let stuck = rig.bones.keys().find(|n| known(&out, n).is_none()).cloned().unwrap_or_default();
            return Err(Error::input(name)
                .at(format!("bones.{}.parent", stuck.chars().take(80).collect::<String>()))
                .expected("a tree of bones")
                .got("a cycle or a bone that is not there"));
        }
    }
}

/// Mean of the vertices of a bone end, a left fold in f64.
fn end(e: &End, base: &Base) -> std::result::Result<[f64; 3], String> {
    let vertices: Vec<usize> = match e.strategy.as_str() {
        "MEAN" => e.vertex_indices.clone(),
        "VERTEX" => e.vertex_indices.iter().take(1).copied().collect(),
        "CUBE" => {
            let faces = base.groups.get(&e.cube_name).ok_or_else(|| format!("no group '{}'", e.cube_name))?;
            let set: std::collections::BTreeSet<usize> =
                faces.iter().flatten().map(|c| c[0] as usize).collect();
            set.into_iter().collect()
        }
        other => return Err(format!("strategy '{}'", other.chars().take(40).collect::<String>())),
    };
    if vertices.is_empty() {
        return Err("no vertices".into());
    }
    let mut sum = [0.0; 3];
    for &i in &vertices {
        let v = base.v.get(i).ok_or_else(|| format!("vertex {i} of {}", base.v.len()))?;
        for k in 0..3 {
            sum[k] = sum[k] + f64::from(v[k]);
        }
    }
    Ok(sum.map(|s| s / vertices.len() as f64))
}
