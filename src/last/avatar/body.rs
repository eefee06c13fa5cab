//! What Gaussians hang on: the template in its canonical pose, its weights, and what a pose does to it.

use super::skin::Bones;
use crate::geometry::nearest::Cloud;
use crate::num::par;
use crate::scene::person::{Affine, Template};

/// Points of one task.
const BATCH: usize = 256;

/// A template made ready.
#[derive(Clone, Debug)]
pub struct Body {
    /// As the capture has it.
    pub template: Template,
    /// (P) in the canonical pose
    pub points: Vec<[f32; 3]>,
    /// (P, K)
    weights: Vec<f32>,
    /// `None` where rest is canonical
    canonical: Option<Vec<Affine>>,
    /// (P) what the canonical pose adds to points at rest
    offsets: Option<Vec<[f32; 3]>>,
}

const IDENTITY: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

impl Body {
    /// Of a validated template.
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

    /// K.
    pub fn joints(&self) -> usize {
        self.template.joints.len()
    }

    /// For each place (G, 3) in the canonical pose the nearest point of the template, ties to the lower index, and the distance.
    pub fn nearest(&self, places: &[[f32; 3]]) -> (Vec<u32>, Vec<f64>) {
        let points: Vec<[f64; 3]> = self.points.iter().map(|p| p.map(f64::from)).collect();
        let cloud = Cloud::new(&points);
        let found = par::map_batched(places.len(), BATCH, |g| cloud.nearest(places[g].map(f64::from)));
        found.into_iter().map(|(d, i)| (i, d.sqrt())).unzip()
    }

    /// (G, K) weights of the nearest points.
    pub fn weights(&self, nearest: &[u32]) -> Vec<f32> {
        let k = self.joints();
        nearest.iter().flat_map(|&p| &self.weights[p as usize * k..][..k]).copied().collect()
    }

    /// (G) what a pose adds to points at rest beyond what the canonical pose adds.
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

    /// The joints under these transforms.
    pub fn bones(&self, posed: Vec<Affine>) -> Bones {
        Bones { posed, canonical: self.canonical.clone() }
    }
}
