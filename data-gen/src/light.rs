//! What a generator of environments returns: a latitude–longitude map, as plain numbers.

use reference::num::elem::{cos, sin};
use std::f64::consts::{PI, TAU};

/// A latitude–longitude map of linear radiance with z up.
///
/// ```text
/// u = atan2(x, y)/2π + ½        v = acos(z)/π        at column centre u and row centre v
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Columns of azimuth.
    pub width: usize,
    /// Rows of inclination, top is +z.
    pub height: usize,
    /// (H, W) linear RGB radiance, finite, ≥ 0
    pub radiance: Vec<[f32; 3]>,
    /// What it shows.
    pub kind: &'static str,
    /// Unit vector towards the brightest source; none: nothing stands out.
    pub brightest: Option<[f64; 3]>,
}

/// The direction of a place in the map, u and v in 0..1.
pub fn direction(u: f64, v: f64) -> [f64; 3] {
    let (azimuth, inclination) = (TAU * (u - 0.5), PI * v);
    let s = sin(inclination);
    [s * sin(azimuth), s * cos(azimuth), cos(inclination)]
}

impl Map {
    /// The same radiance from everywhere.
    pub fn constant(radiance: [f32; 3]) -> Self {
        Self { width: 2, height: 1, radiance: vec![radiance; 2], kind: "constant", brightest: None }
    }
}
