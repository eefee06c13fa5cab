//! The result of a generator of shapes: a triangle mesh with its material as plain data.

/// Encoding of the bytes of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// sRGB-encoded colour.
    Srgb,
    /// Linear encoding.
    Linear,
}

/// A texture of RGBA bytes, (H, W, 4) row-major; texture coordinate (0, 0) is its top left corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// Texels, shape (H, W).
    pub texels: Vec<[u8; 4]>,
    /// Encoding of the first three values.
    pub transfer: Transfer,
}

/// A metallic-roughness material (α_GGX = roughness²).
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name, for messages.
    pub name: String,
    /// Linear RGB, multiplied with the map.
    pub base_color: [f64; 3],
    /// sRGB-encoded texture of the base colour.
    pub base_color_map: Option<Picture>,
    /// Roughness 0..1, multiplied with G of the map.
    pub roughness: f64,
    /// Metallic 0..1, multiplied with B of the map.
    pub metallic: f64,
    /// Linear texture: G roughness, B metallic.
    pub metallic_roughness_map: Option<Picture>,
}

/// A triangle mesh, counter-clockwise seen from outside, z up.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Positions, shape (V).
    pub positions: Vec<[f64; 3]>,
    /// Unit normals, shape (V), or empty for flat triangles.
    pub normals: Vec<[f64; 3]>,
    /// Texture coordinates, shape (V), or empty.
    pub uvs: Vec<[f64; 2]>,
    /// Triangles, shape (T).
    pub triangles: Vec<[u32; 3]>,
    /// The material.
    pub material: Material,
}
