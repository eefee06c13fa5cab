//! From y up to z up and back, and the size to which a scene may grow.

/// Most vertices or triangles of a scene whose nodes repeat meshes.
pub const MAX_FLAT: usize = 1 << 26;

/// y up to z up.
pub fn z_up([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, -z, y]
}

/// z up to y up.
pub fn y_up([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, z, -y]
}
