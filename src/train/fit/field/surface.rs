//! Terms at points instead of pixels: unit gradients and normals of the signed distance near the surface, and its jumps
//! across the centre planes, where six planes have different texels on both sides.
//!
//! The numerical gradient g at a point is that of `field.normal` with central differences one texel apart: forward
//! differences would read the inside of the object, which no image determines. Points are constants: no gradient
//! flows into the positions at which they were found. LIRM composites the normals of all samples of a ray; here there is one
//! stencil per ray, at its surface point x̂, which decodes six points per ray instead of six per sample.

use super::adding::add;
use super::scene::{self, Weights};
use crate::Result;
use crate::field::network::NetworkBar;
use crate::field::{fetch, normal, sdf_head};
use crate::loss::{self, eikonal, mse};
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
/// Largest distance of a point at the surface from a centre plane on which the jump is measured, in texels.
const NEAR: f32 = 4.0;

/// Signed distances at points, with what their adjoint needs.
#[derive(Debug)]
pub struct Distances<'a> {
    field: &'a Field,
    points: Vec<[f32; 3]>,
    features: Vec<f32>,
    /// (N) the distances.
    pub sdf: Vec<f32>,
    saved: sdf_head::Saved,
}

/// Signed distances at the stencils of points.
#[derive(Debug)]
pub struct Stencils<'a> {
    distances: Distances<'a>,
    /// (N, 3) gradients.
    pub gradients: Vec<[f32; 3]>,
    /// (N, 3) unit normals.
    pub normals: Vec<[f32; 3]>,
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

impl<'a> Distances<'a> {
    /// Decodes points, which are constants.
    pub fn at(field: &'a Field, points: Vec<[f32; 3]>) -> Self {
        let (planes, combine) = (scene::planes(field), scene::combine(field));
        let mut features = vec![0.0; points.len() * combine.width(planes.channels)];
        fetch::forward(&planes, combine, &points, &mut features);
        let weights = Weights::of(field);
        let layers = layers(&weights);
        let half_size = field.settings.half_size;
        let x = sdf_head::In { features: &features, points: &points, weights: &layers, half_size };
        let (sdf, saved) = sdf_head::forward(&x);
        Self { field, points, features, sdf, saved }
    }

    /// Adds the gradients for the cotangents of the distances to those of planes and of the network.
    pub fn pull(&self, sdf_bar: &[f32], planes_bar: &mut [f32], network_bar: &mut [Vec<f32>]) {
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
        sdf_head::adjoint(&x, &self.saved, sdf_bar, &mut [], &mut bar);
        for (into, part) in network_bar.iter_mut().zip(&bar.weights) {
            add(into, part);
        }
        let planes = scene::planes(self.field);
        fetch::adjoint(&planes, scene::combine(self.field), &self.points, &bar.x, &mut [], planes_bar);
    }
}

impl<'a> Stencils<'a> {
    /// Decodes the stencils of points.
    pub fn at(field: &'a Field, points: &[[f32; 3]]) -> Self {
        let (stencil, epsilon) = (scene::stencil(field), field.settings.epsilon);
        let width = stencil.width();
        let all = points.iter().flat_map(|x| (0..width).map(move |i| stencil.point(i, epsilon, *x)));
        let distances = Distances::at(field, all.collect());
        let (gradients, normals) = normal::forward(&distances.sdf, stencil, epsilon);
        Self { distances, gradients, normals }
    }

    /// Adds the gradients for the cotangents of gradients and normals to those of planes and of the network.
    pub fn pull(
        &self,
        gradients_bar: &[[f32; 3]],
        normals_bar: &[[f32; 3]],
        planes_bar: &mut [f32],
        network_bar: &mut [Vec<f32>],
    ) {
        let Distances { field, sdf, .. } = &self.distances;
        let (stencil, epsilon) = (scene::stencil(field), field.settings.epsilon);
        let mut sdf_bar = vec![0.0; sdf.len()];
        normal::adjoint(sdf, stencil, epsilon, gradients_bar, normals_bar, &mut sdf_bar);
        self.distances.pull(&sdf_bar, planes_bar, network_bar);
    }
}

/// Returns the points on both sides of the centre planes below the points at the surface that are close to one: first those
/// on the positive sides, then those on the other sides, in the same order.
fn beside_seams(field: &Field, surface: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let near = NEAR * field.settings.epsilon;
    let moved = |side: f32| {
        surface.iter().flat_map(move |x| {
            (0..3).filter(move |k| x[*k].abs() <= near).map(move |k| {
                let mut moved = *x;
                moved[k] = side;
                moved
            })
        })
    };
    // Both zeros belong to the minus side.
    moved(f32::MIN_POSITIVE).chain(moved(0.0)).collect()
}

/// Adds the gradients of the mean squared jump of the signed distance across the centre planes, in texels; returns the weighted
/// value. Three planes have no jump.
///
/// # Errors
/// When there is a distance that is not finite.
pub(super) fn closed(
    field: &Field,
    surface: &[[f32; 3]],
    weight: f32,
    planes_bar: &mut [f32],
    network_bar: &mut [Vec<f32>],
) -> Result<f32> {
    let points = beside_seams(field, surface);
    if field.planes.count == 3 || points.is_empty() {
        return Ok(0.0);
    }
    let distances = Distances::at(field, points);
    let n = distances.sdf.len() / 2;
    let (plus, minus) = distances.sdf.split_at(n);
    let pair = loss::In { x: plus, y: minus, mask: None, height: n, width: 1 };
    let (value, saved) = mse::forward_over(&pair, mse::Over::All)?;
    let weight = weight / (field.settings.epsilon * field.settings.epsilon);
    let mut sdf_bar = vec![0.0; 2 * n];
    let (plus_bar, minus_bar) = sdf_bar.split_at_mut(n);
    mse::adjoint(&pair, &saved, weight, plus_bar, Some(minus_bar));
    distances.pull(&sdf_bar, planes_bar, network_bar);
    Ok(weight * value)
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

#[cfg(test)]
mod tests {
    use super::super::settings::Settings;
    use super::super::state::State;
    use super::*;
    use crate::scene::field::Placement;

    fn field() -> Field {
        let settings = Settings { side: 32, channels: 4, ..Settings::default() };
        let mut field = State::new(&settings, Placement::default()).expect("valid settings").field;
        field.settings.epsilon = 0.01;
        field
    }

    const POINTS: [[f32; 3]; 3] = [[0.01, 0.1, 0.2], [-0.2, -0.01, 0.02], [0.3, 0.3, 0.3]];

    /// Value and gradients of the planes with weight 1.
    fn closed_at(field: &Field) -> (f32, Vec<f32>) {
        let mut planes = vec![0.0; field.planes.values.len()];
        let mut network: Vec<Vec<f32>> = field.heads.sdf.weights.iter().map(|w| vec![0.0; w.len()]).collect();
        let value = closed(field, &POINTS, 1.0, &mut planes, &mut network).expect("finite");
        (value, planes)
    }

    #[test]
    fn jumps_are_those_between_both_sides() {
        let field = field();
        let points = beside_seams(&field, &POINTS);
        assert_eq!(points.len(), 6, "two sides of x = 0, y = 0 and z = 0");
        assert!(points[..3].iter().zip(&points[3..]).all(|(p, m)| p != m), "{points:?}");
        let s = Distances::at(&field, points).sdf;
        let epsilon = field.settings.epsilon;
        let jumps = s[..3].iter().zip(&s[3..]).map(|(p, m)| (p - m) / epsilon);
        let mean = jumps.fold(0.0, |sum, j| sum + j * j) / 3.0;
        let (value, gradient) = closed_at(&field);
        assert!((value - mean).abs() <= 1e-5 * mean && mean > 0.0, "{value} {mean}");
        // along the gradient, against a difference quotient
        let square = gradient.iter().fold(0.0, |sum, g| sum + f64::from(*g) * f64::from(*g));
        let moved = |h: f64| {
            let mut field = field.clone();
            let texels = field.planes.values.iter_mut().zip(&gradient);
            texels.for_each(|(t, g)| *t += (h * f64::from(*g) / square.sqrt()) as f32);
            f64::from(closed_at(&field).0)
        };
        let slope = (moved(1e-3) - moved(-1e-3)) / 2e-3;
        assert!((slope - square.sqrt()).abs() < 0.02 * square.sqrt(), "{slope} {}", square.sqrt());
    }

    #[test]
    fn equal_sides_have_no_jump() {
        let mut mirrored = field();
        let plane = mirrored.planes.values.len() / 6;
        for pair in mirrored.planes.values.chunks_exact_mut(2 * plane) {
            let (minus, plus) = pair.split_at_mut(plane);
            plus.copy_from_slice(minus);
        }
        let (value, gradient) = closed_at(&mirrored);
        assert!(value == 0.0 && gradient.iter().all(|g| *g == 0.0), "{value}");
    }
}
