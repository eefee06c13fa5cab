//! A skinned character as data: surface, joints, weights.

use super::local::Local;
use crate::io::gltf;
use crate::scene::mesh::Object;
use glam::DAffine3;
use reference::body::skin::Affine;
use std::ops::Range;

/// Weights a vertex keeps.
pub const INFLUENCES: usize = 4;

/// A joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name of its node.
    pub name: String,
    /// Its parent joint.
    pub parent: Option<usize>,
    /// The node that moves it; `None` if it is static.
    pub(super) node: Option<usize>,
    /// Joint from canonical space.
    pub(super) bind: DAffine3,
}

impl Joint {
    /// Where it is in canonical space.
    pub fn position(&self) -> [f64; 3] {
        self.bind.inverse().translation.to_array()
    }

    /// Canonical space from the joint's own.
    pub fn rest(&self) -> Affine<f64> {
        rows(&self.bind.inverse())
    }
}

/// Triangles that one node shows with one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name of the node.
    pub name: String,
    /// Name of the mesh.
    pub mesh: String,
    /// Whether it deforms; else it follows one joint.
    pub skinned: bool,
    pub(super) vertices: Range<usize>,
    pub(super) triangles: Range<usize>,
}

impl Part {
    /// Its vertices in the object.
    pub fn vertices(&self) -> Range<usize> {
        self.vertices.clone()
    }

    /// Its triangles in the object.
    pub fn triangles(&self) -> Range<usize> {
        self.triangles.clone()
    }
}

/// A skinned character.
#[derive(Clone, Debug)]
pub struct Character {
    /// For messages.
    pub(super) name: String,
    /// Canonical.
    pub(super) object: Object,
    pub(super) parts: Vec<Part>,
    pub(super) joints: Vec<Joint>,
    /// (V) joints, with weights that sum to 1
    pub(super) influences: Vec<([u16; INFLUENCES], [f64; INFLUENCES])>,
    /// The hierarchy and its movements.
    pub(super) rig: gltf::Gltf,
    /// Own transforms of the nodes at rest.
    pub(super) rest: Vec<Local>,
    /// World from file.
    pub(super) frame: DAffine3,
    /// (V) welded unit normals along which folds move the surface
    pub(super) folds: Vec<[f32; 3]>,
    /// Contents of the file that the character does not represent.
    pub(super) notes: Vec<String>,
}

/// The upper three rows of a map.
pub(super) fn rows(a: &DAffine3) -> Affine<f64> {
    let m = &a.matrix3;
    std::array::from_fn(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i], a.translation[i]])
}
