//! What a generator of shapes returns: a triangle mesh with its material, as plain numbers.

/// How the bytes of a picture hold their quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// sRGB-encoded colour
    Srgb,
    /// the quantity itself
    Linear,
}

/// A texture of RGBA bytes, (H, W, 4) row-major; texture coordinate (0, 0) is its top left corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Texels.
    pub width: usize,
    /// Texels.
    pub height: usize,
    /// (H, W)
    pub texels: Vec<[u8; 4]>,
    /// Meaning of the first three values.
    pub transfer: Transfer,
}

/// A metallic-roughness material (α_GGX = roughness²).
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// For messages.
    pub name: String,
    /// Linear RGB, multiplies the map.
    pub base_color: [f64; 3],
    /// sRGB-encoded.
    pub base_color_map: Option<Picture>,
    /// 0..1, multiplies G of the map.
    pub roughness: f64,
    /// 0..1, multiplies B of the map.
    pub metallic: f64,
    /// Linear: G roughness, B metallic.
    pub metallic_roughness_map: Option<Picture>,
}

/// A triangle mesh, counter-clockwise seen from outside, z up.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// (V)
    pub positions: Vec<[f64; 3]>,
    /// (V) unit, or empty: flat triangles
    pub normals: Vec<[f64; 3]>,
    /// (V), or empty
    pub uvs: Vec<[f64; 2]>,
    /// (T)
    pub triangles: Vec<[u32; 3]>,
    /// Its look.
    pub material: Material,
}
