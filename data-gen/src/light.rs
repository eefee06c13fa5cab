//! The result of a generator of environments: a latitude–longitude map as plain data.

use reference::num::elem::{cos, sin};
use std::f64::consts::{PI, TAU};

/// A latitude–longitude map of linear radiance with z up.
///
/// ```text
/// u = atan2(x, y)/2π + ½        v = acos(z)/π        at column centre u and row centre v
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Number of columns (azimuth).
    pub width: usize,
    /// Number of rows (inclination); the top is +z.
    pub height: usize,
    /// Linear RGB radiance, finite, ≥ 0, shape (H, W).
    pub radiance: Vec<[f32; 3]>,
    /// Name of the kind of environment.
    pub kind: &'static str,
    /// Unit vector towards the brightest source; `None` if there is no distinct one.
    pub brightest: Option<[f64; 3]>,
}

/// The direction of a point of the map, with u and v in 0..1.
pub fn direction(u: f64, v: f64) -> [f64; 3] {
    let (azimuth, inclination) = (TAU * (u - 0.5), PI * v);
    let s = sin(inclination);
    [s * sin(azimuth), s * cos(azimuth), cos(inclination)]
}

impl Map {
    /// A map with the same radiance in all directions.
    pub fn constant(radiance: [f32; 3]) -> Self {
        Self { width: 2, height: 1, radiance: vec![radiance; 2], kind: "constant", brightest: None }
    }
}
