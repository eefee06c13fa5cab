//! Poses: transforms of joints, the rotations they imply, and the points they move.
//!
//! A joint's transform A_k maps rest to the world. Relative to its parent p it is A_p⁻¹ A_k: a rotation R_k
//! about the joint's place at rest, if the skeleton is rigid. What corrects such rotations is
//! `last::avatar::pose`.

use super::records::{Affine, INFLUENCES, PersonCapture, Template};
use crate::math::affine::{self, Linear, compose, determinant, inverse, linear, newton_to_rotation, wide};
pub use crate::math::rodrigues::{matrix as rotation_matrix, vector as rotation_vector};
use reference::body::skin;

/// The rotation nearest to a matrix of positive determinant: a fixed number of Newton's steps after division
/// by the cube root of the determinant.
fn polar(m: Linear) -> Linear {
    let scale = libm::cbrt(determinant(&m));
    let mut r = m.map(|row| row.map(|x| x / scale));
    for _ in 0..12 {
        r = newton_to_rotation(&r).0;
    }
    r
}

impl Template {
    /// Number of points P.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// (K) transforms relative to the parent's: A_p⁻¹ A_k.
    pub fn relative(&self, transforms: &[Affine]) -> Vec<affine::Affine> {
        (0..self.joints.len())
            .map(|k| match self.parents[k] {
                Some(p) => compose(&inverse(&wide(&transforms[p])), &wide(&transforms[k])),
                None => wide(&transforms[k]),
            })
            .collect()
    }

    /// (K) axis-angle of the rotation in every relative transform.
    pub fn axis_angles(&self, transforms: &[Affine]) -> Vec<[f32; 3]> {
        let of = |a: &affine::Affine| rotation_vector(&polar(linear(a))).map(|x| x as f32);
        self.relative(transforms).iter().map(of).collect()
    }

    /// (P) how points move before skinning with the rotations of a pose: pose_shapes · vec(R_1 − I, …).
    /// `None` where the body has no such shapes.
    pub fn offsets(&self, axis_angles: &[[f32; 3]]) -> Option<Vec<[f32; 3]>> {
        let shapes = self.pose_shapes.as_ref()?;
        let features = pose_features(axis_angles);
        let n = features.len();
        Some(
            (0..self.len())
                .map(|p| {
                    std::array::from_fn(|c| {
                        let row = &shapes[(p * 3 + c) * n..][..n];
                        let sum = row.iter().zip(&features).fold(0.0f64, |s, (&a, &f)| s + f64::from(a) * f);
                        sum as f32
                    })
                })
                .collect(),
        )
    }

    /// (P) points under transforms, after the pose's own offsets. Left fold over the four joints in f64,
    /// rounded once.
    pub fn posed(&self, transforms: &[Affine], axis_angles: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let offsets = self.offsets(axis_angles);
        (0..self.len())
            .map(|p| {
                let t = self.blended(p, transforms);
                let x: [f64; 3] = std::array::from_fn(|c| {
                    let o = offsets.as_ref().map_or(0.0, |o| f64::from(o[p][c]));
                    f64::from(self.points[p][c]) + o
                });
                skin::point(&t, x).map(|v| v as f32)
            })
            .collect()
    }

    /// Σ w A of a point.
    fn blended(&self, p: usize, transforms: &[Affine]) -> affine::Affine {
        let weights = self.weight_of[p].map(f64::from);
        let of: [affine::Affine; INFLUENCES] = self.joint_of[p].map(|k| wide(&transforms[usize::from(k)]));
        skin::blend(&weights, &of)
    }

    /// (P) points in the canonical pose, where nearest points are searched: in SMPL's rest pose the thighs
    /// nearly touch.
    pub fn canonical_points(&self) -> Vec<[f32; 3]> {
        self.posed(&self.canonical, &self.axis_angles(&self.canonical))
    }

    /// (P, K) all weights, zeros included.
    pub fn dense_weights(&self) -> Vec<f32> {
        let k = self.joints.len();
        let mut out = vec![0.0; self.len() * k];
        for (p, (joints, weights)) in self.joint_of.iter().zip(&self.weight_of).enumerate() {
            for (&j, &w) in joints.iter().zip(weights) {
                if w > 0.0 {
                    out[p * k + usize::from(j)] = w;
                }
            }
        }
        out
    }
}

/// vec(R_1 − I, …, R_{K−1} − I), row-major; the root is left out.
pub(super) fn pose_features(axis_angles: &[[f32; 3]]) -> Vec<f64> {
    let mut out = Vec::with_capacity(9 * axis_angles.len());
    for v in axis_angles.iter().skip(1) {
        let r = rotation_matrix(v.map(f64::from));
        for (i, row) in r.iter().enumerate() {
            for (j, x) in row.iter().enumerate() {
                out.push(x - if i == j { 1.0 } else { 0.0 });
            }
        }
    }
    out
}

impl PersonCapture {
    /// (P) the template's points at a moment, in the world.
    pub fn posed_points(&self, time: usize) -> Vec<[f32; 3]> {
        let pose = &self.poses[time];
        self.template.posed(&pose.transforms, &pose.axis_angles)
    }

    /// (K) the joints at a moment, in the world.
    pub fn posed_joints(&self, time: usize) -> Vec<[f32; 3]> {
        let t = &self.template;
        let of = |(a, j): (&Affine, &[f32; 3])| skin::point(&wide(a), j.map(f64::from)).map(|x| x as f32);
        self.poses[time].transforms.iter().zip(&t.joints).map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scaled_and_sheared_matrix_has_a_rotation() {
        let r = rotation_matrix([0.4, 0.2, -0.9]);
        let scaled = r.map(|row| row.map(|x| 3.0 * x));
        let off = rotation_vector(&polar(scaled));
        for (a, b) in off.iter().zip([0.4, 0.2, -0.9]) {
            assert!((a - b).abs() < 1e-12, "{off:?}");
        }
    }
}
