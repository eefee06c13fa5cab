//! Triangle meshes, and objects made of them.
//!
//! Corners of a triangle are counter-clockwise seen from outside; an index is shared by position, normal and
//! texture coordinate, so a seam doubles a vertex. Texture coordinates follow glTF: (0, 0) is the top left
//! corner of the image, v grows downwards.

use super::material::Material;
use crate::{Error, Result};

/// Most vertices or triangles of one mesh.
pub const MAX_ELEMENTS: usize = 1 << 28;

/// Largest coordinate of a mesh that is rendered, 2¹²⁰: differences and sums of a few stay within f32.
pub const MAX_COORDINATE: f32 = f32::from_bits((127 + 120) << 23);
/// Largest texture coordinate, 2³⁰; f32 has no fraction from 2²³ on.
pub const MAX_UV: f32 = f32::from_bits((127 + 30) << 23);

/// A triangle mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// (V), scene units
    pub positions: Vec<[f32; 3]>,
    /// (V) unit shading normals, or empty: triangles are flat
    pub normals: Vec<[f32; 3]>,
    /// (V) texture coordinates, or empty
    pub uvs: Vec<[f32; 2]>,
    /// (T) vertex indices
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh whose triangles have materials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// Its surface.
    pub mesh: Mesh,
    /// (T) index into `materials`
    pub material_of: Vec<u16>,
    /// At least one if there are triangles.
    pub materials: Vec<Material>,
}

impl Mesh {
    /// Checks indices, sizes and finiteness. Degenerate triangles and zero normals are allowed: rays pass
    /// through the former, shading falls back to the face normal for the latter.
    ///
    /// # Errors
    /// Names the array and the index; `name` is the name of the mesh in errors.
    pub fn validate(&self, name: &str) -> Result<()> {
        let (v, t) = (self.positions.len(), self.triangles.len());
        if v > MAX_ELEMENTS || t > MAX_ELEMENTS {
            let e = Error::input(name).at("mesh size");
            return Err(e
                .expected(format!("at most {MAX_ELEMENTS} vertices and triangles"))
                .got(format!("{v}, {t}")));
        }
        for (array, len) in [("normals", self.normals.len()), ("uvs", self.uvs.len())] {
            if len != 0 && len != v {
                let e = Error::input(name).at(format!("array '{array}'"));
                return Err(e.expected(format!("none or {v} rows")).got(len.to_string()));
            }
        }
        finite(name, "positions", &self.positions)?;
        finite(name, "normals", &self.normals)?;
        finite(name, "uvs", &self.uvs)?;
        within(name, "uvs", &self.uvs, MAX_UV)?;
        for (i, corner) in self.triangles.iter().enumerate() {
            if let Some(index) = corner.iter().find(|&&c| c as usize >= v) {
                let e = Error::input(name).at(format!("triangle {i}"));
                return Err(e.expected(format!("vertex indices below {v}")).got(index.to_string()));
            }
        }
        Ok(())
    }

    /// Corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [[f32; 3]; 3] {
        self.triangles[triangle].map(|i| self.positions[i as usize])
    }

    /// Smallest and largest coordinates of the vertices; zeros if there are none.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        let Some(&first) = self.positions.first() else { return [[0.0; 3]; 2] };
        let mut b = [first, first];
        for p in &self.positions {
            for k in 0..3 {
                b[0][k] = crate::num::order::min(b[0][k], p[k]);
                b[1][k] = crate::num::order::max(b[1][k], p[k]);
            }
        }
        b
    }
}

impl Object {
    /// Checks the mesh and its range, the materials, and that every triangle has one.
    ///
    /// # Errors
    /// Names what is wrong; `name` is the name of the object in errors.
    pub fn validate(&self, name: &str) -> Result<()> {
        self.mesh.validate(name)?;
        within(name, "positions", &self.mesh.positions, MAX_COORDINATE)?;
        within(name, "normals", &self.mesh.normals, MAX_COORDINATE)?;
        if self.material_of.len() != self.mesh.triangles.len() {
            let e = Error::input(name).at("array 'material_of'");
            return Err(e
                .expected(format!("{} entries", self.mesh.triangles.len()))
                .got(self.material_of.len().to_string()));
        }
        if let Some(i) = self.material_of.iter().position(|&m| usize::from(m) >= self.materials.len()) {
            let e = Error::input(name).at(format!("triangle {i}"));
            return Err(e
                .expected(format!("a material below {}", self.materials.len()))
                .got(self.material_of[i].to_string()));
        }
        self.materials.iter().try_for_each(|m| m.validate().map_err(|e| e.within(name)))
    }
}

fn within<const N: usize>(name: &str, array: &str, rows: &[[f32; N]], most: f32) -> Result<()> {
    match rows.iter().position(|r| !r.iter().all(|x| x.abs() <= most)) {
        None => Ok(()),
        Some(i) => Err(Error::input(name)
            .at(format!("array '{array}', row {i}"))
            .expected(format!("numbers of at most {most:e}"))
            .got(format!("{:?}", rows[i]))),
    }
}

fn finite<const N: usize>(name: &str, array: &str, rows: &[[f32; N]]) -> Result<()> {
    match rows.iter().position(|r| !r.iter().all(|x| x.is_finite())) {
        None => Ok(()),
        Some(i) => Err(Error::input(name)
            .at(format!("array '{array}', row {i}"))
            .expected("finite numbers")
            .got(format!("{:?}", rows[i]))),
    }
}
