//! Signed distances in closed form.

use lastlight::field::occupancy::{Bounded, Box3};

/// A surface of known distance. Directions have unit length.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    /// The points within half of `thickness` of a plane: its normal and a point.
    Plate { normal: [f64; 3], point: [f64; 3], thickness: f64 },
    /// The points within `radius` of a line: its direction and a point.
    Rod { along: [f64; 3], point: [f64; 3], radius: f64 },
    /// A ball.
    Ball { centre: [f64; 3], radius: f64 },
    /// Nothing anywhere near.
    Nothing,
    /// No number anywhere.
    NotANumber,
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

pub(super) fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

impl Shape {
    pub(super) fn distance(&self, x: [f64; 3]) -> f64 {
        match *self {
            Self::Plate { normal, point, thickness } => dot(minus(x, point), normal).abs() - 0.5 * thickness,
            Self::Rod { along, point, radius } => {
                let off = minus(x, point);
                let along = along.map(|a| a * dot(off, along));
                let across = minus(off, along);
                dot(across, across).sqrt() - radius
            }
            Self::Ball { centre, radius } => dot(minus(x, centre), minus(x, centre)).sqrt() - radius,
            Self::Nothing => 1e3,
            Self::NotANumber => f64::NAN,
        }
    }
}

/// A distance changes by at most the length of a way; 1e-6 covers the rounding of s.
impl Bounded for Shape {
    fn values(&self, points: &[[f32; 3]], sdf: &mut Vec<f32>) {
        sdf.clear();
        sdf.extend(points.iter().map(|x| self.distance(x.map(f64::from)) as f32));
    }

    fn bounds(&self, boxes: &[Box3], bounds: &mut Vec<[f32; 2]>) {
        bounds.clear();
        for [low, high] in boxes {
            let (low, high) = (low.map(f64::from), high.map(f64::from));
            let half = minus(high, low).map(|x| 0.5 * x);
            let s = self.distance([0, 1, 2].map(|k| low[k] + half[k]));
            let reach = dot(half, half).sqrt() + 1e-6;
            bounds.push([(s - reach) as f32, (s + reach) as f32]);
        }
    }
}
