//! Terms at points instead of pixels: unit gradients and normals of the signed distance near the surface.
//!
//! The numerical gradient g at a point is that of `field.normal` with central differences one texel apart: forward
//! differences would read the inside of the object, which no image determines. Points are constants: no gradient
//! flows into the positions at which they were found. LIRM composites the normals of all samples of a ray; here there is one
//! stencil per ray, at its surface point x̂, which decodes six points per ray instead of six per sample.

use super::adding::add;
use super::scene::{self, Weights};
use crate::field::network::NetworkBar;
use crate::field::{fetch, normal, sdf_head};
use crate::loss::eikonal;
use crate::num::rng::Rng;
use crate::scene::field::Field;

/// Purpose of the drawn points; the item is the point, draws 0 to 2 its coordinates.
const PURPOSE: u16 = 0x0534;
/// Points of the eikonal term in the whole box.
const ANYWHERE: usize = 512;
/// Of the points at the surface, one in this many is used for the eikonal term.
const ONE_IN: usize = 4;
/// Largest distance of these points from the surface, in texels.
const AROUND: f32 = 3.0;

/// Signed distances at the stencils of points, with what their adjoint needs.
pub(super) struct Stencils<'a> {
    field: &'a Field,
    points: Vec<[f32; 3]>,
    features: Vec<f32>,
    sdf: Vec<f32>,
    saved: sdf_head::Saved,
    /// (N, 3) gradients.
    pub(super) gradients: Vec<[f32; 3]>,
    /// (N, 3) unit normals.
    pub(super) normals: Vec<[f32; 3]>,
}

/// The layers of the signed distance: of a trunk, the first row of its last layer.
fn layers<'a>(weights: &Weights<'a>) -> Vec<&'a [f32]> {
    let mut layers = weights.sdf_layers();
    if let Some(last) = layers.pop() {
        let outputs = if weights.is_trunk() { 4 } else { 1 };
        layers.push(&last[..last.len() / outputs]);
    }
    layers
}

impl<'a> Stencils<'a> {
    /// Decodes the stencils of points.
    pub(super) fn at(field: &'a Field, points: &[[f32; 3]]) -> Self {
        let (stencil, epsilon) = (scene::stencil(field), field.settings.epsilon);
        let width = stencil.width();
        let all = points.iter().flat_map(|x| (0..width).map(move |i| stencil.point(i, epsilon, *x)));
        let points: Vec<[f32; 3]> = all.collect();
        let (planes, combine) = (scene::planes(field), scene::combine(field));
        let mut features = vec![0.0; points.len() * combine.width(planes.channels)];
        fetch::forward(&planes, combine, &points, &mut features);
        let weights = Weights::of(field);
        let layers = layers(&weights);
        let half_size = field.settings.half_size;
        let x = sdf_head::In { features: &features, points: &points, weights: &layers, half_size };
        let (sdf, saved) = sdf_head::forward(&x);
        let (gradients, normals) = normal::forward(&sdf, stencil, epsilon);
        Self { field, points, features, sdf, saved, gradients, normals }
    }

    /// Adds the gradients for the cotangents of gradients and normals to those of planes and of the network.
    pub(super) fn pull(
        &self,
        gradients_bar: &[[f32; 3]],
        normals_bar: &[[f32; 3]],
        planes_bar: &mut [f32],
        network_bar: &mut [Vec<f32>],
    ) {
        let (stencil, epsilon) = (scene::stencil(self.field), self.field.settings.epsilon);
        let mut sdf_bar = vec![0.0; self.sdf.len()];
        normal::adjoint(&self.sdf, stencil, epsilon, gradients_bar, normals_bar, &mut sdf_bar);
        let weights = Weights::of(self.field);
        let layers = layers(&weights);
        let x = sdf_head::In {
            features: &self.features,
            points: &self.points,
            weights: &layers,
            half_size: self.field.settings.half_size,
        };
        let mut bar = NetworkBar {
            x: vec![0.0; self.features.len()],
            weights: layers.iter().map(|w| vec![0.0; w.len()]).collect(),
        };
        sdf_head::adjoint(&x, &self.saved, &sdf_bar, &mut [], &mut bar);
        for (into, part) in network_bar.iter_mut().zip(&bar.weights) {
            add(into, part);
        }
        let planes = scene::planes(self.field);
        fetch::adjoint(&planes, scene::combine(self.field), &self.points, &bar.x, &mut [], planes_bar);
    }
}

/// Returns the points of the eikonal term: around some of the points at the surface, and anywhere in the box.
pub(super) fn scattered(field: &Field, surface: &[[f32; 3]], seed: u64, iteration: usize) -> Vec<[f32; 3]> {
    let rng = Rng::new(seed);
    let step = u32::try_from(iteration).expect("validated");
    let signed = |item: usize, k: usize| 2.0 * rng.uniform_f32(item as u64, step, PURPOSE, k as u16) - 1.0;
    let near = surface.iter().step_by(ONE_IN).enumerate().map(|(i, x)| {
        std::array::from_fn(|k| x[k] + AROUND * field.settings.epsilon * signed(ANYWHERE + i, k))
    });
    let anywhere = (0..ANYWHERE).map(|i| std::array::from_fn(|k| field.settings.half_size * signed(i, k)));
    anywhere.chain(near).collect()
}

/// Adds the gradients of the eikonal term with the given weight; returns the weighted value.
pub(super) fn unit_length(
    stencils: &Stencils<'_>,
    weight: f32,
    planes_bar: &mut [f32],
    network_bar: &mut [Vec<f32>],
) -> f32 {
    let value = eikonal::forward(&stencils.gradients);
    let n = stencils.gradients.len();
    let mut gradients_bar = vec![[0.0; 3]; n];
    eikonal::adjoint(&stencils.gradients, weight, &mut gradients_bar);
    stencils.pull(&gradients_bar, &vec![[0.0; 3]; n], planes_bar, network_bar);
    weight * value
}
