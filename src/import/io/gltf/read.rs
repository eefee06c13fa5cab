//! Bytes to [`Gltf`].

use super::accessor::{Buffers, Cache};
use super::container::{buffers, container, document};
use super::{Gltf, Local, MAX_JSON_BYTES, MAX_JSON_OBJECTS, Matrix, Mesh, Node, Primitive};
use crate::io::{MAX_FILE_BYTES, beside, guard, name_of, read_bytes};
use crate::{Error, Result};
use gltf::Document;
use gltf::mesh::Mode;
use std::path::Path;

/// Reads a `.gltf` or `.glb` and what it refers to in its folder.
///
/// # Errors
/// When a file is missing, malformed, too large, or requires something that is not supported.
pub fn read(path: &Path) -> Result<Gltf> {
    let bytes = read_bytes(path, MAX_FILE_BYTES)?;
    parse(&bytes, &name_of(path), &beside(path))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors, `fetch` gets what a relative path
/// inside its folder names.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str, fetch: &dyn Fn(&str) -> Result<Vec<u8>>) -> Result<Gltf> {
    let (text, blob) = if bytes.starts_with(b"glTF") { container(bytes, name)? } else { (bytes, None) };
    if text.len() > MAX_JSON_BYTES {
        let e = Error::input(name).at("JSON size");
        return Err(e.expected(format!("at most {MAX_JSON_BYTES} bytes")).got(text.len().to_string()));
    }
    let objects = text.iter().filter(|b| matches!(b, b'{' | b'[')).count();
    if objects > MAX_JSON_OBJECTS {
        let e = Error::input(name).at("JSON");
        return Err(e
            .expected(format!("at most {MAX_JSON_OBJECTS} objects and lists"))
            .got(objects.to_string()));
    }
    guard(name, || {
        let document = document(text, name)?;
        let buffers = Buffers::new(name, buffers(&document, blob, name, fetch)?);
        let mut reader =
            Reader { name, document: &document, buffers, fetch, texels: 0, out: Gltf::default() };
        reader.all()?;
        Ok(reader.out)
    })
}

/// The name in the file, shortened, or `kind N`.
pub(super) fn named(name: Option<&str>, kind: &str, index: usize) -> String {
    match name {
        Some(n) if !n.is_empty() => n.chars().take(200).collect(),
        _ => format!("{kind} {index}"),
    }
}

/// Row-major from column-major.
fn rows(columns: &[[f32; 4]; 4]) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]))
}

/// State of the reader.
pub(super) struct Reader<'a> {
    pub(super) name: &'a str,
    pub(super) document: &'a Document,
    pub(super) buffers: Buffers<'a>,
    pub(super) fetch: &'a dyn Fn(&str) -> Result<Vec<u8>>,
    /// decoded so far
    pub(super) texels: u64,
    pub(super) out: Gltf,
}

impl Reader<'_> {
    pub(super) fn error(&self, place: String) -> Error {
        Error::input(self.name).at(place)
    }

    pub(super) fn note(&mut self, text: String) {
        if !self.out.notes.contains(&text) {
            self.out.notes.push(text);
        }
    }

    fn all(&mut self) -> Result<()> {
        self.nodes()?;
        self.scene();
        self.meshes()?;
        self.materials()?;
        self.skins()?;
        self.animations()
    }

    fn nodes(&mut self) -> Result<()> {
        for n in self.document.nodes() {
            let local = match n.transform() {
                gltf::scene::Transform::Matrix { matrix } => Local::Matrix(rows(&matrix)),
                gltf::scene::Transform::Decomposed { translation, rotation, scale } => {
                    Local::Trs { translation, rotation, scale }
                }
            };
            let place = format!("nodes[{}]", n.index());
            let finite = match &local {
                Local::Matrix(m) => m.iter().flatten().all(|x| x.is_finite()) && m[3] == [0.0, 0.0, 0.0, 1.0],
                Local::Trs { translation, rotation, scale } => {
                    translation.iter().chain(rotation).chain(scale).all(|x| x.is_finite())
                        && rotation.iter().any(|x| *x != 0.0)
                }
            };
            if !finite {
                let e = self.error(place);
                return Err(e
                    .expected("a finite affine transform with a rotation")
                    .got(format!("{local:?}")));
            }
            let children = n.children().map(|c| c.index()).collect();
            self.out.nodes.push(Node {
                name: named(n.name(), "node", n.index()),
                parent: None,
                children,
                local,
                mesh: n.mesh().map(|m| m.index()),
                skin: n.skin().map(|s| s.index()),
            });
        }
        for i in 0..self.out.nodes.len() {
            for child in self.out.nodes[i].children.clone() {
                if let Some(other) = self.out.nodes[child].parent.replace(i) {
                    return Err(self
                        .error(format!("nodes[{child}]"))
                        .expected("one parent")
                        .got(format!("nodes {other} and {i}")));
                }
            }
        }
        let roots: Vec<usize> =
            (0..self.out.nodes.len()).filter(|&i| self.out.nodes[i].parent.is_none()).collect();
        self.out.order = self.below(&roots);
        if self.out.order.len() < self.out.nodes.len() {
            let mut reached = vec![false; self.out.nodes.len()];
            self.out.order.iter().for_each(|&i| reached[i] = true);
            let first = reached.iter().position(|r| !r).unwrap_or(0);
            return Err(self.error(format!("nodes[{first}]")).expected("a tree").got("a cycle of children"));
        }
        Ok(())
    }

    /// The nodes from `roots` downwards, parents before children, in the order of the file.
    fn below(&self, roots: &[usize]) -> Vec<usize> {
        let mut stack: Vec<usize> = roots.iter().rev().copied().collect();
        let mut out = Vec::new();
        while let Some(i) = stack.pop() {
            out.push(i);
            stack.extend(self.out.nodes[i].children.iter().rev());
        }
        out
    }

    fn scene(&mut self) {
        let scene = self.document.default_scene().or_else(|| self.document.scenes().next());
        let Some(scene) = scene else {
            self.out.scene = self.out.order.clone();
            return;
        };
        // A scene may name a node twice, or one below another.
        let mut inside = vec![false; self.out.nodes.len()];
        scene.nodes().for_each(|n| inside[n.index()] = true);
        for &i in &self.out.order {
            if self.out.nodes[i].parent.is_some_and(|p| inside[p]) {
                inside[i] = true;
            }
        }
        self.out.scene = self.out.order.iter().copied().filter(|&i| inside[i]).collect();
        if self.document.scenes().len() > 1 {
            self.note("the file has several scenes; one was read".into());
        }
    }

    fn meshes(&mut self) -> Result<()> {
        let mut cache = Cache::default();
        let (document, mut notes) = (self.document, Vec::new());
        for m in document.meshes() {
            let mut primitives = Vec::new();
            for p in m.primitives() {
                let place = format!("meshes[{}].primitives[{}]", m.index(), p.index());
                primitives.extend(self.primitive(&p, &place, &mut cache, &mut notes)?);
            }
            self.out.meshes.push(Mesh { name: named(m.name(), "mesh", m.index()), primitives });
        }
        notes.into_iter().for_each(|n| self.note(n));
        Ok(())
    }

    fn primitive(
        &self,
        p: &gltf::Primitive<'_>,
        place: &str,
        cache: &mut Cache,
        notes: &mut Vec<String>,
    ) -> Result<Option<Primitive>> {
        use gltf::Semantic as S;
        if matches!(p.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            notes.push("points and lines are not shown".into());
            return Ok(None);
        }
        let Some(accessor) = p.get(&S::Positions) else { return Ok(None) };
        let rows = Rows { reader: self, place, vertices: accessor.count() };
        let positions = cache.get3(&self.buffers, &accessor, "positions")?;
        let normals = p.get(&S::Normals).map(|a| {
            rows.check(&a, "normals")?;
            cache.get3(&self.buffers, &a, "normals")
        });
        let (mut uvs, mut joints, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (semantic, a) in p.attributes() {
            match semantic {
                S::TexCoords(set) if set < 8 => {
                    rows.check(&a, "texture coordinates")?;
                    if uvs.len() <= set as usize {
                        uvs.resize(set as usize + 1, None);
                    }
                    uvs[set as usize] = Some(cache.get2(&self.buffers, &a)?);
                }
                S::Colors(_) => notes.push("vertex colours are not read".into()),
                S::Joints(set) | S::Weights(set) if set >= 4 => {
                    return Err(self
                        .error(place.into())
                        .expected("at most 4 sets of joints")
                        .got(format!("set {set}")));
                }
                _ => {}
            }
        }
        for set in 0..4 {
            match (p.get(&S::Joints(set)), p.get(&S::Weights(set))) {
                (Some(j), Some(w)) => {
                    rows.check(&j, "joints")?;
                    rows.check(&w, "weights")?;
                    joints.push(cache.joints(&self.buffers, &j)?);
                    weights.push(cache.get4(&self.buffers, &w, "weights")?);
                }
                (None, None) => {}
                _ => {
                    let e = self.error(format!("{place}, joints and weights of set {set}"));
                    return Err(e.expected("both or neither").got("one"));
                }
            }
        }
        if p.morph_targets().len() > 0 {
            notes.push("morph targets are not read: meshes have their default shape".into());
        }
        let triangles = rows.triangles(p)?;
        let material = p.material().index();
        let normals = normals.transpose()?;
        Ok(Some(Primitive { positions, normals, uvs, joints, weights, triangles, material }))
    }
}

/// A primitive whose vertices are counted.
struct Rows<'a> {
    reader: &'a Reader<'a>,
    /// how errors name it
    place: &'a str,
    vertices: usize,
}

impl Rows<'_> {
    /// Checks that an attribute has a row per vertex.
    fn check(&self, a: &gltf::Accessor<'_>, what: &str) -> Result<()> {
        match a.count() {
            n if n == self.vertices => Ok(()),
            n => Err(self
                .reader
                .error(format!("{}, {what}", self.place))
                .expected(format!("{} rows, as positions", self.vertices))
                .got(n.to_string())),
        }
    }

    /// Corners of the triangles, from lists, strips and fans.
    fn triangles(&self, p: &gltf::Primitive<'_>) -> Result<Vec<[u32; 3]>> {
        let list = self.indices(p)?;
        let count = list.len().saturating_sub(2);
        Ok(match p.mode() {
            Mode::TriangleStrip => (0..count)
                .map(|i| {
                    if i % 2 == 0 {
                        [list[i], list[i + 1], list[i + 2]]
                    } else {
                        [list[i], list[i + 2], list[i + 1]]
                    }
                })
                .collect(),
            Mode::TriangleFan => (0..count).map(|i| [list[i + 1], list[i + 2], list[0]]).collect(),
            _ => {
                let (whole, rest) = list.as_chunks::<3>();
                if !rest.is_empty() {
                    let e = self.reader.error(format!("{}, indices", self.place));
                    return Err(e.expected("a multiple of 3").got(list.len().to_string()));
                }
                whole.to_vec()
            }
        })
    }

    /// Indices of vertices; without any, all vertices in turn.
    fn indices(&self, p: &gltf::Primitive<'_>) -> Result<Vec<u32>> {
        let Self { reader, place, vertices } = *self;
        let list: Vec<u32> = match p.indices() {
            Some(a) => reader.buffers.indices(&a)?.into_iter().map(|[i]| i).collect(),
            None => {
                let count = u32::try_from(vertices).map_err(|_| {
                    reader.error(place.into()).expected("at most 2³² vertices").got(vertices.to_string())
                })?;
                (0..count).collect()
            }
        };
        if let Some(i) = list.iter().position(|&i| i as usize >= vertices) {
            return Err(reader
                .error(format!("{place}, index {i}"))
                .expected(format!("below {vertices}"))
                .got(list[i].to_string()));
        }
        Ok(list)
    }
}
