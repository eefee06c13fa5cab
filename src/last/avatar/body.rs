//! The body that Gaussians are attached to: the template in its canonical pose, its skinning weights and its
//! pose-dependent offsets.

use super::skin::Bones;
use crate::geometry::nearest::Cloud;
use crate::num::par;
use crate::scene::person::{Affine, Template};

/// Number of points per parallel task.
const BATCH: usize = 256;

/// A template prepared for attaching Gaussians.
#[derive(Clone, Debug)]
pub struct Body {
    /// The template as stored in the capture.
    pub template: Template,
    /// Template points in the canonical pose, shape (P).
    pub points: Vec<[f32; 3]>,
    /// Skinning weights of the template points, shape (P, K).
    weights: Vec<f32>,
    /// Transforms from the rest pose to the canonical pose, shape (K); `None` if the rest pose is the
    /// canonical pose.
    canonical: Option<Vec<Affine>>,
    /// Offsets that the canonical pose adds to points at rest, shape (P).
    offsets: Option<Vec<[f32; 3]>>,
}

const IDENTITY: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

impl Body {
    /// Prepares a validated template.
    pub fn new(template: &Template) -> Self {
        let is_rest = template.canonical.iter().all(|a| *a == IDENTITY);
        Self {
            points: template.canonical_points(),
            weights: template.dense_weights(),
            canonical: (!is_rest).then(|| template.canonical.clone()),
            offsets: template.offsets(&template.axis_angles(&template.canonical)),
            template: template.clone(),
        }
    }

    /// Number of joints K.
    pub fn joints(&self) -> usize {
        self.template.joints.len()
    }

    /// Returns, for each position (G, 3) in the canonical pose, the nearest point of the template (ties go to
    /// the lower index) and the distance to it.
    pub fn nearest(&self, places: &[[f32; 3]]) -> (Vec<u32>, Vec<f64>) {
        let points: Vec<[f64; 3]> = self.points.iter().map(|p| p.map(f64::from)).collect();
        let cloud = Cloud::new(&points);
        let found = par::map_batched(places.len(), BATCH, |g| cloud.nearest(places[g].map(f64::from)));
        found.into_iter().map(|(d, i)| (i, d.sqrt())).unzip()
    }

    /// Skinning weights of the nearest points, shape (G, K).
    pub fn weights(&self, nearest: &[u32]) -> Vec<f32> {
        let k = self.joints();
        nearest.iter().flat_map(|&p| &self.weights[p as usize * k..][..k]).copied().collect()
    }

    /// Offsets, shape (G), that a pose adds to points at rest, minus those that the canonical pose adds.
    pub fn offsets(&self, nearest: &[u32], axis_angles: &[[f32; 3]]) -> Option<Vec<[f32; 3]>> {
        let (canonical, posed) = (self.offsets.as_ref()?, self.template.offsets(axis_angles)?);
        Some(
            nearest
                .iter()
                .map(|&p| {
                    let (a, b) = (posed[p as usize], canonical[p as usize]);
                    std::array::from_fn(|c| a[c] - b[c])
                })
                .collect(),
        )
    }

    /// The joints with the given posed transforms.
    pub fn bones(&self, posed: Vec<Affine>) -> Bones {
        Bones { posed, canonical: self.canonical.clone() }
    }
}
