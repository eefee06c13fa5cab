//! The transform of a node in its parent.

use crate::io::gltf;
use crate::scene::model;
use glam::{DAffine3, DVec3};

/// A node's own transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Local {
    /// Never moved.
    Fixed(DAffine3),
    /// T · R · S, rotation xyzw of length 1.
    Trs { t: DVec3, q: [f64; 4], s: DVec3 },
}

impl Local {
    pub(super) fn of(l: &gltf::Local) -> Self {
        match l {
            gltf::Local::Matrix(m) => Self::Fixed(model::affine(m)),
            gltf::Local::Trs { translation, rotation, scale } => Self::Trs {
                t: DVec3::from_array(translation.map(f64::from)),
                q: normalized(rotation.map(f64::from)),
                s: DVec3::from_array(scale.map(f64::from)),
            },
        }
    }

    pub(super) fn map(&self) -> DAffine3 {
        match *self {
            Self::Fixed(m) => m,
            Self::Trs { t, q, s } => model::compose(t, q, s),
        }
    }
}

/// Scalar product, added from the left.
pub(super) fn dot(a: [f64; 4], b: [f64; 4]) -> f64 {
    ((a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]) + a[3] * b[3]
}

/// Length 1. A zero that interpolation may give becomes no rotation.
pub(super) fn normalized(q: [f64; 4]) -> [f64; 4] {
    let n = dot(q, q).sqrt();
    if n > 0.0 { q.map(|x| x / n) } else { [0.0, 0.0, 0.0, 1.0] }
}
