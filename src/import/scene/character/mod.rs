//! Skinned characters: a surface, a skeleton, skinning weights, animations.
//!
//! ```text
//! .gltf, .glb          every mesh of the scene; joints of skins, and nodes that animations move
//! folder of base.obj   the open body of MakeHuman (`io::makehuman`), with movements of our own
//!
//! canonical surface ──(u_W: folds)──► ──(skin::blend of posed-from-canonical transforms)──► posed surface
//!                                                ▲
//! animation, time ──► Pose ──(mix, bend)──► joint transforms
//! ```
//!
//! The **canonical** surface is the one the mesh was bound in: x_c = K x with K = F G_r B_r for a vertex x of
//! a skinned mesh, r the first joint of its skin, G the node's transform in the rest pose, B its inverse bind
//! matrix, and F the map of the file to the world (z up, then [`Character::fit`]). A joint j moves it by A_j
//! = F G_j B_j K⁻¹, so the canonical surface is the posed one wherever the pose is the bind pose. A mesh
//! without skin is attached with weight 1 to the nearest joint at or above its node, or is static.
//!
//! A vertex keeps its four largest weights, divided by their sum.

mod local;
mod makehuman;
mod motion;
mod posed;
mod rig;
mod skinned;
mod template;

pub use motion::Pose;
pub use posed::Factors;
pub use skinned::{Character, INFLUENCES, Joint, Part};
pub use template::{PURPOSE, Point, Template};

use super::mesh::Object;
use crate::io::gltf;
use crate::{Error, Result};
use glam::{DAffine3, DVec3};
use std::path::Path;

impl Character {
    /// Reads a `.gltf` or `.glb`, or the open body: its folder or the OBJ in it.
    ///
    /// # Errors
    /// When a file is malformed, or contains no visible geometry.
    pub fn read(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if extension == "obj" && !path.is_dir() {
            std::fs::metadata(path).map_err(|e| Error::os(path, &e))?;
            if crate::io::makehuman::locate(path).is_err() {
                return Err(Error::input(name)
                    .expected("a .gltf or .glb, or the open body with its rig and weights beside the .obj")
                    .got("an .obj alone, which has no parts, joints or animations"));
            }
        }
        if path.is_dir() || extension == "obj" {
            return Self::from_body(&crate::io::makehuman::read(path)?, &name);
        }
        Self::from_gltf(gltf::read(path)?, &name)
    }

    /// Name of the file it came from.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The canonical surface.
    pub fn object(&self) -> &Object {
        &self.object
    }

    /// Its parts; they cover the triangles of the object in order.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Its joints.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// (V) joints and weights of the canonical vertices.
    pub fn influences(&self) -> &[([u16; INFLUENCES], [f64; INFLUENCES])] {
        &self.influences
    }

    /// Contents of the file that the character does not represent, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Index of the joint of a name.
    ///
    /// # Errors
    /// When there is none; the error lists the names.
    pub fn joint(&self, name: &str) -> Result<usize> {
        self.joints.iter().position(|j| j.name == name && j.node.is_some()).ok_or_else(|| {
            let all: Vec<&str> = self.joints.iter().map(|j| j.name.as_str()).collect();
            Error::input(self.name.clone())
                .at("joint")
                .expected(format!("one of {}", all.join(", ")))
                .got(name)
        })
    }

    /// A joint that is named like an elbow: the first whose name holds `lowerarm`, `forearm`, `lower_arm` or
    /// `elbow`, right sides first.
    pub fn elbow(&self) -> Option<usize> {
        let like = |n: &str| {
            ["lowerarm", "forearm", "lower_arm", "elbow"].iter().any(|w| n.contains(w)) && !n.contains("ik")
        };
        let right = |n: &str| n.contains("right") || n.ends_with(".r") || n.ends_with("_r");
        let name = |j: &Joint| j.name.to_ascii_lowercase();
        let find = |side: bool| {
            self.joints.iter().position(|j| j.node.is_some() && like(&name(j)) && (!side || right(&name(j))))
        };
        find(true).or_else(|| find(false))
    }

    /// Removes the parts of the given nodes or meshes.
    ///
    /// # Errors
    /// When a name does not exist, or no part would remain.
    pub fn hide(&mut self, names: &[&str]) -> Result<()> {
        let fits = |p: &Part, n: &str| p.name == n || p.mesh == n;
        if let Some(unknown) = names.iter().find(|n| !self.parts.iter().any(|p| fits(p, n))) {
            let mut all: Vec<&str> = self.parts.iter().map(|p| p.name.as_str()).collect();
            all.dedup();
            let e = Error::input(self.name.clone()).at("part to hide");
            return Err(e.expected(format!("one of {}", all.join(", "))).got(*unknown));
        }
        let mut kept = self.clone();
        kept.parts.clear();
        kept.influences.clear();
        kept.folds.clear();
        kept.object = Object { materials: self.object.materials.clone(), ..Object::default() };
        let (from, to) = (&self.object, &mut kept.object);
        for p in self.parts.iter().filter(|p| !names.iter().any(|n| fits(p, n))) {
            let (v, t) = (to.mesh.positions.len(), to.mesh.triangles.len());
            to.mesh.positions.extend_from_slice(&from.mesh.positions[p.vertices.clone()]);
            if !from.mesh.normals.is_empty() {
                to.mesh.normals.extend_from_slice(&from.mesh.normals[p.vertices.clone()]);
            }
            if !from.mesh.uvs.is_empty() {
                to.mesh.uvs.extend_from_slice(&from.mesh.uvs[p.vertices.clone()]);
            }
            // Parts share no vertices.
            let moved = |i: u32| (i as usize - p.vertices.start + v) as u32;
            to.mesh.triangles.extend(from.mesh.triangles[p.triangles.clone()].iter().map(|c| c.map(moved)));
            to.material_of.extend_from_slice(&from.material_of[p.triangles.clone()]);
            kept.influences.extend_from_slice(&self.influences[p.vertices.clone()]);
            let (vertices, triangles) = (v..to.mesh.positions.len(), t..to.mesh.triangles.len());
            kept.parts.push(Part { vertices, triangles, ..p.clone() });
        }
        if kept.parts.is_empty() {
            return Err(Error::input(self.name.clone())
                .at("parts to hide")
                .expected("something left")
                .got("all of them"));
        }
        kept.folds = posed::welded_normals(&kept.object.mesh);
        *self = kept;
        Ok(())
    }

    /// Scales and shifts the character so that the canonical surface is `height` high and the middle of its
    /// bounds is the origin. The built-in figure is 2 high (1.7 m divided by 0.85 m).
    ///
    /// # Errors
    /// When it is flat.
    pub fn fit(&mut self, height: f64) -> Result<()> {
        let [low, high] = self.object.mesh.bounds().map(|b| DVec3::from_array(b.map(f64::from)));
        let extent = high.z - low.z;
        if !(extent > 0.0 && height > 0.0) {
            let e = Error::input(self.name.clone()).at("height");
            return Err(e.expected("a positive extent in z").got(extent.to_string()));
        }
        let scale = height / extent;
        let middle = (low + high) * 0.5;
        let map = DAffine3::from_scale(DVec3::splat(scale)) * DAffine3::from_translation(-middle);
        let back = DAffine3::from_translation(middle) * DAffine3::from_scale(DVec3::splat(1.0 / scale));
        self.frame = map * self.frame;
        for j in &mut self.joints {
            j.bind = j.bind * back;
        }
        for p in &mut self.object.mesh.positions {
            *p = map.transform_point3(DVec3::from_array(p.map(f64::from))).to_array().map(|x| x as f32);
        }
        Ok(())
    }
}
