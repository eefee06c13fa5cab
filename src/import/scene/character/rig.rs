//! From glTF: joints, canonical positions, weights.

use super::local::Local;
use super::posed;
use super::skinned::{Character, INFLUENCES, Joint, Part};
use crate::io::gltf::{Gltf, Skin};
use crate::scene::model::{self, Part as FlatPart, affine, flatten, normal, normals};
use crate::{Error, Result};
use glam::{DAffine3, DVec3};

/// Joints in the order of discovery, each node once per bind.
struct Joints<'a> {
    g: &'a Gltf,
    /// World transforms at rest.
    rest: &'a [DAffine3],
    /// Whether an animation moves the node.
    moved: Vec<bool>,
    list: Vec<Joint>,
}

/// Two binds of one node are one joint if they differ by less than this, relative to their size.
const SAME: f64 = 1e-5;

fn same(a: &DAffine3, b: &DAffine3) -> bool {
    let (a, b) = (a.to_cols_array(), b.to_cols_array());
    let largest = a.iter().fold(1.0f64, |m, x| crate::num::order::max(m, x.abs()));
    a.iter().zip(&b).all(|(x, y)| (x - y).abs() <= SAME * largest)
}

impl Joints<'_> {
    fn add(&mut self, node: Option<usize>, bind: DAffine3) -> Result<u16> {
        let name = node.map_or_else(|| "world".to_owned(), |n| self.g.nodes[n].name.clone());
        let k = match self.list.iter().position(|j| j.node == node && same(&j.bind, &bind)) {
            Some(k) => k,
            None => {
                self.list.push(Joint { name: name.clone(), parent: None, node, bind });
                self.list.len() - 1
            }
        };
        u16::try_from(k).map_err(|_| Error::input(name).at("joints").expected("at most 65536").got("more"))
    }

    /// Joints of a skin, and canonical from mesh.
    fn skin(&mut self, s: &Skin) -> Result<(Vec<u16>, DAffine3)> {
        let canonical = self.rest[s.joints[0]] * affine(&s.inverse_bind[0]);
        let back = invert(&canonical, &s.name)?;
        let joints = s.joints.iter().zip(&s.inverse_bind).map(|(&j, m)| self.add(Some(j), affine(m) * back));
        Ok((joints.collect::<Result<_>>()?, canonical))
    }

    /// The joint to which a rigid mesh of a node is attached, and canonical from mesh.
    fn rigid(&mut self, node: usize, skins: &[Option<(Vec<u16>, DAffine3)>]) -> Result<(u16, DAffine3)> {
        let in_skin = |n: usize| {
            self.g.skins.iter().zip(skins).find_map(|(s, found)| {
                let (joints, _) = found.as_ref()?;
                Some(joints[s.joints.iter().position(|&j| j == n)?])
            })
        };
        let mut at = Some(node);
        while let Some(n) = at {
            if let Some(k) = in_skin(n) {
                // As the joint carries it at rest, but in canonical space.
                let joint = self.list[usize::from(k)].bind.inverse();
                let offset = invert(&self.rest[n], &self.g.nodes[n].name)? * self.rest[node];
                return Ok((k, joint * offset));
            }
            if self.moved[n] {
                let bind = invert(&self.rest[n], &self.g.nodes[n].name)?;
                return Ok((self.add(Some(n), bind)?, self.rest[node]));
            }
            at = self.g.nodes[n].parent;
        }
        Ok((self.add(None, DAffine3::IDENTITY)?, self.rest[node]))
    }
}

fn invert(a: &DAffine3, name: &str) -> Result<DAffine3> {
    let inverse = a.inverse();
    if inverse.to_cols_array().iter().all(|x| x.is_finite()) {
        Ok(inverse)
    } else {
        Err(Error::input(format!("node or skin '{name}'"))
            .expected("an invertible transform")
            .got("a singular one"))
    }
}

impl Character {
    /// From a record; `name` is the file name in errors.
    ///
    /// # Errors
    /// When there is no visible geometry, or a joint's transform cannot be inverted.
    pub fn from_gltf(mut g: Gltf, name: &str) -> Result<Self> {
        let flat = flatten(&g, name)?;
        let locals: Vec<DAffine3> = g.nodes.iter().map(|n| model::local(&n.local)).collect();
        let frame = model::z_up_map();
        let rest = model::globals(&g, &locals, frame);
        let mut moved = vec![false; g.nodes.len()];
        g.animations.iter().flat_map(|a| &a.channels).for_each(|c| moved[c.node] = true);
        let mut joints = Joints { g: &g, rest: &rest, moved, list: Vec::new() };
        // Skins that the scene uses.
        let mut skins: Vec<Option<(Vec<u16>, DAffine3)>> = vec![None; g.skins.len()];
        for &n in &g.scene {
            if let (Some(s), Some(_)) = (g.nodes[n].skin, g.nodes[n].mesh)
                && skins[s].is_none()
            {
                skins[s] = Some(joints.skin(&g.skins[s]).map_err(|e| e.within(name))?);
            }
        }
        let mut object = flat.object;
        let mut influences = Vec::with_capacity(object.mesh.positions.len());
        let mut parts = Vec::new();
        for part in &flat.parts {
            let p = &g.meshes[part.mesh].primitives[part.primitive];
            let skin = g.nodes[part.node].skin.filter(|_| !p.joints.is_empty());
            let found = skin.and_then(|s| skins[s].as_ref());
            let map = match found {
                Some((of_skin, canonical)) => {
                    for &v in &part.kept {
                        let pairs = p.joints.iter().zip(&p.weights).flat_map(|(j, w)| {
                            j[v as usize].iter().copied().zip(w[v as usize]).collect::<Vec<_>>()
                        });
                        let pairs = pairs.filter(|(_, w)| *w > 0.0);
                        influences.push(largest(
                            pairs.map(|(j, w)| (of_skin[usize::from(j)], f64::from(w))).collect(),
                        ));
                    }
                    *canonical
                }
                None => {
                    let (joint, map) = joints.rigid(part.node, &skins).map_err(|e| e.within(name))?;
                    influences.extend(part.kept.iter().map(|_| largest(vec![(joint, 1.0)])));
                    map
                }
            };
            place(&mut object, part, &map);
            parts.push(Part {
                name: g.nodes[part.node].name.clone(),
                mesh: g.meshes[part.mesh].name.clone(),
                skinned: found.is_some(),
                vertices: part.vertices.clone(),
                triangles: part.triangles.clone(),
            });
        }
        normals(&mut object.mesh);
        object.validate(name)?;
        let mut list = joints.list;
        parents(&mut list, &g);
        let rest = g.nodes.iter().map(|n| Local::of(&n.local)).collect();
        let notes = std::mem::take(&mut g.notes);
        // The surface is in the object; the hierarchy and its animations are kept.
        g.meshes.clear();
        g.images.clear();
        g.materials.clear();
        let folds = posed::welded_normals(&object.mesh);
        let name = name.to_owned();
        Ok(Self { name, object, parts, joints: list, influences, rig: g, rest, frame, folds, notes })
    }
}

/// Positions, normals and winding of a part under canonical-from-mesh.
fn place(object: &mut crate::scene::mesh::Object, part: &FlatPart, map: &DAffine3) {
    let mesh = &mut object.mesh;
    for i in part.vertices.clone() {
        let p = map.transform_point3(DVec3::from_array(mesh.positions[i].map(f64::from)));
        mesh.positions[i] = p.to_array().map(|x| x as f32);
        if let Some(n) = mesh.normals.get_mut(i) {
            *n = normal(&map.matrix3, *n);
        }
    }
    if map.matrix3.determinant() < 0.0 {
        mesh.triangles[part.triangles.clone()].iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// The largest weights of pairs, each joint once, divided by their sum; ties by the smaller joint.
pub(super) fn largest(mut pairs: Vec<(u16, f64)>) -> ([u16; INFLUENCES], [f64; INFLUENCES]) {
    pairs.sort_by_key(|(j, _)| *j);
    pairs.dedup_by(|b, a| {
        let one = a.0 == b.0;
        if one {
            a.1 = a.1 + b.1;
        }
        one
    });
    pairs.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    pairs.truncate(INFLUENCES);
    let sum = pairs.iter().fold(0.0, |s, (_, w)| s + w);
    let mut out = ([0; INFLUENCES], [0.0; INFLUENCES]);
    for (k, (j, w)) in pairs.into_iter().enumerate() {
        out.0[k] = j;
        out.1[k] = w / sum;
    }
    out
}

/// The nearest joint above each joint.
fn parents(list: &mut [Joint], g: &Gltf) {
    let mut of_node: Vec<Option<usize>> = vec![None; g.nodes.len()];
    for (k, j) in list.iter().enumerate() {
        if let Some(n) = j.node
            && of_node[n].is_none()
        {
            of_node[n] = Some(k);
        }
    }
    for j in list {
        let mut at = j.node.and_then(|n| g.nodes[n].parent);
        while let Some(n) = at {
            if of_node[n].is_some() {
                j.parent = of_node[n];
                break;
            }
            at = g.nodes[n].parent;
        }
    }
}
