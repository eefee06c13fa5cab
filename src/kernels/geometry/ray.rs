//! Rays and hits.

/// The index of a triangle that was not hit.
pub const MISS: u32 = u32::MAX;

/// A ray with the interval in which it hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, scene units.
    pub origin: [f32; 3],
    /// Not necessarily of length 1, not zero; t counts in it.
    pub direction: [f32; 3],
    /// Hits have 0 ≤ t ≤ t_max.
    pub t_max: f32,
}

/// A hit, or `triangle == MISS` and t infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Parameter along the ray.
    pub t: f32,
    /// Barycentric weight of corner 1.
    pub u: f32,
    /// Barycentric weight of corner 2.
    pub v: f32,
    /// Index of the triangle.
    pub triangle: u32,
}

impl Hit {
    /// No hit.
    pub const NONE: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, triangle: MISS };
}
