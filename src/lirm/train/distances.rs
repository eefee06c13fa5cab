//! Points around an object with their signed distances, for the recipe that compares them.
//!
//! Half of the points are drawn uniformly in the box of the field, half are at most 0.06 in each coordinate from a point of the surface, drawn
//! uniformly by area. The loss is the mean of (s − d)² over all points, with d cut off at ±0.1; a point whose s and d are both
//! beyond the same end does not count (as the truncated distances of Park et al. 2019).

use crate::Result;
use crate::field::render::InBar;
use crate::fit::field::surface;
use crate::geometry::bvh::Bvh;
use crate::geometry::compare::sample;
use crate::geometry::signed::Signed;
use crate::lirm::model::config::HALF_SIZE;
use crate::loss::{self, mse};
use crate::num::elem::f64 as elem;
use crate::num::order;
use crate::num::rng::Rng;
use crate::scene::field::{Field, Placement};
use crate::scene::mesh::Mesh;

/// Points of an object.
const COUNT: usize = 4096;
/// Largest distance, per coordinate, of points around the surface.
const AROUND: f32 = 0.06;
/// Distances are cut off here.
const FAR: f32 = 0.1;
/// Purpose of the drawn points; the item is the object, and a point of it.
const PURPOSE: u16 = 0x0556;

/// Points with their signed distances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Distances {
    points: Vec<[f32; 3]>,
    truth: Vec<f32>,
}

impl Distances {
    /// Draws the points around a mesh: a function of the seed and of the number of the object.
    ///
    /// # Errors
    /// If the mesh has no surface.
    pub fn of(mesh: &Mesh, seed: u64, k: u64) -> Result<Self> {
        let bvh = Bvh::build(&mesh.positions, &mesh.triangles);
        let signed = Signed::new(mesh, &bvh);
        let outer =
            Mesh { positions: mesh.positions.clone(), triangles: signed.outer().to_vec(), ..Mesh::default() };
        let own = Rng::new(seed).derive(k, 0, PURPOSE);
        let rng = Rng::new(own);
        let signs = |i: usize, by: f32| -> [f32; 3] {
            std::array::from_fn(|c| by * (2.0 * rng.uniform_f32(i as u64, 0, PURPOSE, c as u16) - 1.0))
        };
        let near = sample(&outer, COUNT / 2, own, 0, "surface")?.points;
        let moved = |(i, p): (usize, &[f64; 3])| {
            let by = signs(i, AROUND);
            std::array::from_fn(|c| p[c] as f32 + by[c])
        };
        let anywhere = (near.len()..COUNT).map(|i| signs(i, HALF_SIZE));
        let points: Vec<[f32; 3]> = near.iter().enumerate().map(moved).chain(anywhere).collect();
        let truth = signed.at(&points).into_iter().map(|d| order::clamp(d, -FAR, FAR)).collect();
        Ok(Self { points, truth })
    }

    /// Turns the object about the vertical, as [`crate::lirm::views::Views::turned`] does; then to the field.
    pub(super) fn turned(&self, radians: f64, at: &Placement) -> Self {
        let (sin, cos) = (elem::sin(radians), elem::cos(radians));
        let turn = |p: &[f32; 3]| {
            let [x, y, z] = p.map(f64::from);
            at.to_field([cos * x - sin * y, sin * x + cos * y, z]).map(|v| v as f32)
        };
        Self { points: self.points.iter().map(turn).collect(), truth: self.truth.clone() }
    }

    /// The loss of a field and the cotangents of its distances, for a weight.
    pub(super) fn compare(&self, field: &Field, weight: f32) -> Result<(f32, Vec<f32>)> {
        if self.points.is_empty() {
            return Ok((0.0, Vec::new()));
        }
        let found = surface::Distances::at(field, self.points.clone()).sdf;
        let counts = |(s, d): (&f32, &f32)| {
            let is_beyond = (*d >= FAR && *s >= FAR) || (*d <= -FAR && *s <= -FAR);
            if is_beyond { 0.0 } else { 1.0 }
        };
        let mask: Vec<f32> = found.iter().zip(&self.truth).map(counts).collect();
        let pair = loss::In { x: &found, y: &self.truth, mask: Some(&mask), height: found.len(), width: 1 };
        let (value, saved) = mse::forward_over(&pair, mse::Over::All)?;
        let mut bar = vec![0.0; found.len()];
        mse::adjoint(&pair, &saved, weight, &mut bar, None);
        Ok((weight * value, bar))
    }

    /// Adds the gradients for the cotangents of the distances.
    pub(super) fn pull(&self, field: &Field, distances_bar: &[f32], bar: &mut InBar) {
        if self.points.is_empty() {
            return;
        }
        let found = surface::Distances::at(field, self.points.clone());
        found.pull(distances_bar, &mut bar.planes, &mut bar.heads.sdf);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lirm::subject::Subject;
    use crate::lirm::train::source::Rendered;

    #[test]
    fn half_of_the_points_are_near_the_surface_and_some_are_inside() {
        let rendered = Rendered::new(0);
        let subject = Subject::new(rendered.settings(), 0).expect("built in");
        let found = Distances::of(&subject.object.mesh, 0, 0).expect("it has a surface");
        let near = found.truth.iter().filter(|d| d.abs() < 0.06 * 3f32.sqrt()).count();
        assert!(found.truth.len() == COUNT && near >= COUNT / 2, "{near}");
        assert!(found.truth.iter().any(|d| *d < -0.01), "points inside");
        assert_eq!(found, Distances::of(&subject.object.mesh, 0, 0).expect("again"), "the same points");
        let turned = found.turned(0.5, &Placement::default());
        let radius = |p: &[f32; 3]| (p[0] * p[0] + p[1] * p[1]).sqrt();
        let moved = found.points.iter().zip(&turned.points);
        assert!(moved.clone().all(|(a, b)| (radius(a) - radius(b)).abs() < 1e-6 && a[2] == b[2]));
        assert!(moved.clone().any(|(a, b)| a != b));
    }
}
