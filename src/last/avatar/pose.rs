//! Corrected poses of a template: [`mod@crate::body::pose`] applied to the transforms of a capture, with
//! joints in any order.
//!
//! The operator requires parents before their children; this module sorts the joints for the operator and
//! restores their order in the results.

use crate::body::pose::{self, In, InBar};
use crate::scene::person::{Affine, Template};

/// The skeleton of a template with pose corrections.
#[derive(Clone, Debug)]
struct Skeleton {
    captured: Vec<Affine>,
    correction: Vec<[f32; 3]>,
    joints: Vec<[f32; 3]>,
    parents: Vec<i32>,
}

impl Skeleton {
    fn new(template: &Template, transforms: &[Affine], corrections: &[[f32; 3]]) -> Self {
        let order = &template.order;
        let mut place = vec![-1; order.len()];
        order.iter().enumerate().for_each(|(i, &k)| place[k] = i as i32);
        Self {
            captured: order.iter().map(|&k| transforms[k]).collect(),
            correction: order.iter().map(|&k| corrections[k]).collect(),
            joints: order.iter().map(|&k| template.joints[k]).collect(),
            parents: order.iter().map(|&k| template.parents[k].map_or(-1, |p| place[p])).collect(),
        }
    }

    fn input(&self) -> In<'_> {
        In {
            pose: &[],
            captured: &self.captured,
            correction: Some(&self.correction),
            joints: &self.joints,
            parents: &self.parents,
        }
    }
}

/// Transforms of a moment with corrections, and the values saved for the adjoint.
#[derive(Clone, Debug)]
pub struct CorrectedPose {
    /// World transforms of the joints relative to rest, shape (K).
    pub transforms: Vec<Affine>,
    sorted: Skeleton,
    saved: pose::Saved,
}

/// Computes B_k for corrections (K) of the transforms of a capture.
///
/// # Panics
/// If the template is invalid, or a transform has no inverse.
pub fn forward(template: &Template, transforms: &[Affine], corrections: &[[f32; 3]]) -> CorrectedPose {
    let sorted = Skeleton::new(template, transforms, corrections);
    let posed = pose::forward(sorted.input());
    let (posed, saved) = posed.expect(
        "a valid template has at least one joint and no cycle; the transforms of a moment are invertible",
    );
    let mut transforms = transforms.to_vec();
    template.order.iter().zip(posed).for_each(|(&k, b)| transforms[k] = b);
    CorrectedPose { transforms, sorted, saved }
}

/// Gradient with respect to the corrections, shape (K), from the cotangents of B.
pub fn adjoint(template: &Template, corrected: &CorrectedPose, bar: &[Affine]) -> Vec<[f32; 3]> {
    let sorted_bar: Vec<Affine> = template.order.iter().map(|&k| bar[k]).collect();
    let zeros = vec![[0.0; 3]; bar.len()];
    let mut x_bar = InBar { correction: zeros.clone(), ..InBar::default() };
    pose::adjoint(corrected.sorted.input(), &corrected.saved, &sorted_bar, &mut x_bar);
    let mut v_bar = zeros;
    template.order.iter().zip(x_bar.correction).for_each(|(&k, v)| v_bar[k] = v);
    v_bar
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::person::Kind;

    #[test]
    fn joints_in_any_order_are_corrected_alike() {
        // A root with a chain of two joints and a second branch; the joints are not stored parents first.
        let template = |joints: Vec<[f32; 3]>, parents: Vec<Option<usize>>, order: Vec<usize>| Template {
            kind: Kind::Figure,
            unit_m: 1.0,
            points: Vec::new(),
            normals: Vec::new(),
            faces: Vec::new(),
            joint_of: Vec::new(),
            weight_of: Vec::new(),
            joints,
            parents,
            order,
            canonical: Vec::new(),
            pose_shapes: None,
        };
        let (joints, turns) = (
            [[0.5, 1.5, 0.25], [0.0, 0.0, 0.0], [0.25, 1.0, -0.5], [-0.75, 0.5, 0.0]],
            [[0.2, -0.4, 0.1], [0.0, 0.7, 0.3], [-0.5, 0.1, 0.9], [0.3, 0.3, -0.2]],
        );
        let still: Affine = [[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, -0.25], [0.0, 0.0, 1.0, 2.0]];
        let order = vec![1, 2, 0, 3];
        let mixed = template(joints.to_vec(), vec![Some(2), None, Some(1), Some(1)], order.clone());
        let sorted = template(
            order.iter().map(|&k| joints[k]).collect(),
            vec![None, Some(0), Some(1), Some(0)],
            vec![0, 1, 2, 3],
        );
        let bar: Vec<Affine> = (0..4).map(|k| still.map(|row| row.map(|x| x + k as f32))).collect();
        let run = |t: &Template, turns: &[[f32; 3]], bar: &[Affine]| {
            let posed = forward(t, &[still; 4], turns);
            let again = forward(t, &posed.transforms, turns);
            let v = adjoint(t, &again, bar);
            (again.transforms, v)
        };
        let (a, a_bar) = run(&mixed, &turns, &bar);
        let there = |k: usize| order[k];
        let (b, b_bar) =
            run(&sorted, &[0, 1, 2, 3].map(|k| turns[there(k)]), &[0, 1, 2, 3].map(|k| bar[there(k)]));
        for k in 0..4 {
            assert_eq!(a[there(k)], b[k], "transform {k}");
            assert_eq!(a_bar[there(k)], b_bar[k], "gradient {k}");
        }
    }
}
