//! Rays and hits.

/// Index that marks a missing triangle.
pub const MISS: u32 = u32::MAX;

/// A ray with the interval in which it can hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin, scene units.
    pub origin: [f32; 3],
    /// Direction, not zero and not necessarily of length 1; t is in units of its length.
    pub direction: [f32; 3],
    /// Upper end of the interval: hits have 0 ≤ t ≤ t_max.
    pub t_max: f32,
}

/// A hit; if nothing was hit, `triangle` is [`MISS`] and t is infinite.
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
    /// The value that represents no hit.
    pub const NONE: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, triangle: MISS };
}
