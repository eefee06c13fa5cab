//! Points around an object with their signed distances, for the recipe that compares them.
//!
//! Half of the points are drawn uniformly in the box of the field, half are at most 0.06 in each coordinate
//! from a point of the surface, drawn uniformly by area. A fourth of an object's points is compared in each
//! of its batches. The loss is the mean of (s − d − κβ)² over all points, with d + κβ cut off at ±0.1; a
//! point whose s and d + κβ are both beyond the same end does not count (as the truncated distances of Park
//! et al. 2019), nor does one that a turn has moved out of the box.
//!
//! κ = 1.1 takes back half of what the density of distances adds to silhouettes: a ray that passes a ball of
//! radius r at a distance δ has the optical depth ½·√(2πr/β)·exp(−δ/β), so the ball's image is larger by δ =
//! β·ln(√(2πr/β) / (2 ln 2)), about 2.2 to 2.5 β, while a ray towards the middle ends 0.3 β behind its
//! surface. Images and true distances therefore contradict each other, for every κ; with this one by 1.1 to
//! 1.4 β at outlines and by 1.4 β in the middle, which is at most 0.7 texel at 1/β = 120. (κ was not
//! searched.)

use crate::Result;
use crate::field::render::InBar;
use crate::fit::field::HALF_SIZE;
use crate::fit::field::surface;
use crate::geometry::bvh::Bvh;
use crate::geometry::compare::sample;
use crate::geometry::signed::Signed;
use crate::loss::{self, mse};
use crate::num::elem::f64 as elem;
use crate::num::order;
use crate::num::rng::Rng;
use crate::scene::field::{Field, Placement};
use crate::scene::mesh::Mesh;

/// Points of an object, and the part of them that is compared at once.
const COUNT: usize = 16_384;
const PARTS: usize = 4;
/// Largest distance, per coordinate, of points around the surface.
const AROUND: f32 = 0.06;
/// Distances are cut off here.
const FAR: f32 = 0.1;
/// What is added to a distance, in units of β.
const OFFSET: f32 = 1.1;
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
        let truth = signed.at(&points);
        Ok(Self { points, truth })
    }

    /// Part `n` of the points, counted around. Turns the object about the vertical, as
    /// [`crate::lirm::views::Views::turned`] does; then to the field and its units.
    pub(super) fn turned(&self, n: usize, radians: f64, at: &Placement) -> Self {
        let (sin, cos) = (elem::sin(radians), elem::cos(radians));
        let turn = |p: &[f32; 3]| {
            let [x, y, z] = p.map(f64::from);
            at.to_field([cos * x - sin * y, sin * x + cos * y, z]).map(|v| v as f32)
        };
        let part = || (n % PARTS..self.points.len()).step_by(PARTS);
        Self {
            points: part().map(|i| turn(&self.points[i])).collect(),
            truth: part().map(|i| (f64::from(self.truth[i]) * at.scale) as f32).collect(),
        }
    }

    /// Adds points of the rest of the box, where the object is smaller than that: those that are drawn
    /// uniformly are points of the field this time, and count where they are farther than [`FAR`] from a
    /// ball, around a point of the field, that contains the object.
    pub(super) fn with_room(mut self, of: &Self, n: usize, middle: [f64; 3], radius: f64) -> Self {
        let own = (n % PARTS..of.points.len()).step_by(PARTS).filter(|i| *i >= of.points.len() / 2);
        let is_far = |p: &[f32; 3]| {
            let [x, y, z] = std::array::from_fn(|k| f64::from(p[k]) - middle[k]);
            ((x * x + y * y) + z * z).sqrt() >= radius + f64::from(FAR)
        };
        let far: Vec<[f32; 3]> = own.map(|i| of.points[i]).filter(is_far).collect();
        self.truth.extend(std::iter::repeat_n(FAR, far.len()));
        self.points.extend(far);
        self
    }

    /// The points that are at least that deep in the object.
    #[cfg(test)]
    pub(super) fn inside(&self, depth: f32) -> Vec<[f32; 3]> {
        let all = self.points.iter().zip(&self.truth);
        all.filter(|(_, d)| **d <= -depth).map(|(p, _)| *p).collect()
    }

    /// The loss of a field and the cotangents of its distances, for a weight.
    pub(super) fn compare(&self, field: &Field, weight: f32) -> Result<(f32, Vec<f32>)> {
        if self.points.is_empty() {
            return Ok((0.0, Vec::new()));
        }
        let found = surface::Distances::at(field, self.points.clone()).sdf;
        let offset = OFFSET / field.settings.inverse_beta;
        let truth: Vec<f32> = self.truth.iter().map(|d| order::clamp(d + offset, -FAR, FAR)).collect();
        let half = field.settings.half_size;
        let counts = |((s, d), p): ((&f32, &f32), &[f32; 3])| {
            let is_beyond = (*d >= FAR && *s >= FAR) || (*d <= -FAR && *s <= -FAR);
            let is_outside = p.iter().any(|x| x.abs() > half);
            if is_beyond || is_outside { 0.0 } else { 1.0 }
        };
        let mask: Vec<f32> = found.iter().zip(&truth).zip(&self.points).map(counts).collect();
        let pair = loss::In { x: &found, y: &truth, mask: Some(&mask), height: found.len(), width: 1 };
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
    use crate::lirm::train::source::BuiltInObjects;

    #[test]
    fn half_of_the_points_are_near_the_surface_and_some_are_inside() {
        let rendered = BuiltInObjects::new(0);
        let subject = Subject::new(rendered.settings(), 0).expect("built in");
        let found = Distances::of(&subject.object.mesh, 0, 0).expect("it has a surface");
        let near = found.truth.iter().filter(|d| d.abs() < 0.06 * 3f32.sqrt()).count();
        assert!(found.truth.len() == COUNT && near >= COUNT / 2, "{near}");
        assert!(found.truth.iter().any(|d| *d < -0.01), "points inside");
        assert_eq!(found, Distances::of(&subject.object.mesh, 0, 0).expect("again"), "the same points");
        let radius = |p: &[f32; 3]| (p[0] * p[0] + p[1] * p[1]).sqrt();
        let parts = [0, 1, 2, 3, 6].map(|n| found.turned(n, 0.5, &Placement::default()));
        assert!(parts[4] == parts[2] && parts[3] != parts[2], "counted around");
        assert!(parts.iter().all(|p| p.points.len() == COUNT / PARTS && p.truth.len() == COUNT / PARTS));
        let (middle, around) = ([0.2, -0.1, 0.0], 0.25);
        let roomy = parts[1].clone().with_room(&found, 1, middle, around);
        let added = &roomy.points[parts[1].points.len()..];
        assert!(added.len() > 1000 && roomy.truth.len() == roomy.points.len(), "{}", added.len());
        assert!(roomy.truth[parts[1].truth.len()..].iter().all(|d| *d == FAR));
        let from_middle = |p: &[f32; 3]| {
            let [x, y, z] = std::array::from_fn(|k| f64::from(p[k]) - middle[k]);
            (x * x + y * y + z * z).sqrt()
        };
        assert!(added.iter().all(|p| from_middle(p) >= around + f64::from(FAR)), "outside of the ball");
        let half = Placement::new([0.0; 3], 0.5);
        let small = found.turned(1, 0.5, &half);
        assert!(small.truth.iter().zip(&parts[1].truth).all(|(a, b)| *a == 0.5 * b), "units of the field");
        let turned = &parts[1];
        let moved = found.points.iter().skip(1).step_by(PARTS).zip(&turned.points);
        assert!(moved.clone().all(|(a, b)| (radius(a) - radius(b)).abs() < 1e-6 && a[2] == b[2]));
        assert!(moved.clone().any(|(a, b)| a != b));
    }
}
