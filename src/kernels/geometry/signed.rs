//! Signed distances of points to the surface of a union of closed parts: negative inside.
//!
//! |d| is the distance to the nearest triangle of the outer surface ([`super::nearest`]). A point is inside when the sum over the crossings of a ray
//! from it, +1 where the ray leaves a part and −1 where it enters one, is positive: the winding number, which parts that overlap
//! do not disturb, unlike the parity of crossings. Three rays vote, since a ray through an edge can be counted twice.
//!
//! A triangle belongs to the outer surface when the point above its centre, at 10⁻⁴ times the longest side of the bounds, is not inside. Triangles that are partly inside
//! another part are decided by their centre: near such a seam |d| is wrong by up to the size of a triangle.
//!
//! # Rounding
//! Distances are f64; rays have f32 origins. An open mesh has no inside, and the sign of a point near its rim depends on the rays.

use super::bvh::{Bvh, MISS, Ray};
use super::nearest::Surface;
use crate::num::par;
use crate::scene::mesh::Mesh;

/// Directions of the rays; none lies in a coordinate plane, where built shapes have faces and edges.
const RAYS: [[f32; 3]; 3] = [[0.531, 0.297, 0.793], [-0.713, 0.604, -0.356], [0.197, -0.883, 0.425]];
/// Height above the centre of a triangle at which it is decided whether it is outside, in longest sides of the bounds.
const ABOVE: f32 = 1e-4;
/// Crossings after which a ray ends.
const MOST: usize = 256;
/// Points per task.
const BATCH: usize = 64;

/// A mesh prepared for signed distances.
pub struct Signed<'a> {
    mesh: &'a Mesh,
    bvh: &'a Bvh,
    outer: Vec<[u32; 3]>,
    surface: Surface,
}

impl<'a> Signed<'a> {
    /// Prepares a valid mesh; `bvh` is its hierarchy.
    pub fn new(mesh: &'a Mesh, bvh: &'a Bvh) -> Self {
        let [low, high] = mesh.bounds();
        let longest = (0..3).fold(0.0, |m: f32, k| crate::num::order::max(m, high[k] - low[k]));
        let is_outer = par::map_batched(mesh.triangles.len(), BATCH, |t| {
            let [a, b, c] = mesh.corners(t);
            let n = normal([a, b, c]);
            let length = ((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2]).sqrt();
            let above = |k: usize| ((a[k] + b[k]) + c[k]) / 3.0 + ABOVE * longest * n[k] / length;
            length > 0.0 && !is_inside(mesh, bvh, std::array::from_fn(above))
        });
        let outer: Vec<[u32; 3]> =
            mesh.triangles.iter().zip(is_outer).filter(|(_, o)| *o).map(|(t, _)| *t).collect();
        let surface = Surface::new(&mesh.positions, &outer);
        Self { mesh, bvh, outer, surface }
    }

    /// The triangles of the outer surface.
    pub fn outer(&self) -> &[[u32; 3]] {
        &self.outer
    }

    /// The signed distances of points, in units of the mesh; infinite if it has no triangles.
    pub fn at(&self, points: &[[f32; 3]]) -> Vec<f32> {
        par::map_batched(points.len(), BATCH, |i| {
            let distance = self.surface.nearest(points[i].map(f64::from)).0.sqrt() as f32;
            if is_inside(self.mesh, self.bvh, points[i]) { -distance } else { distance }
        })
    }
}

/// The normal of a triangle, as long as twice its area.
fn normal([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    let u: [f32; 3] = std::array::from_fn(|k| b[k] - a[k]);
    let v: [f32; 3] = std::array::from_fn(|k| c[k] - a[k]);
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// The winding number of a point, counted along one ray.
fn winding(mesh: &Mesh, bvh: &Bvh, from: [f32; 3], direction: [f32; 3]) -> i32 {
    let (mut origin, mut sum) = (from, 0);
    for _ in 0..MOST {
        let hit = bvh.closest(&Ray { origin, direction, t_max: f32::INFINITY });
        if hit.triangle == MISS {
            break;
        }
        let n = normal(mesh.corners(hit.triangle as usize));
        sum += if (n[0] * direction[0] + n[1] * direction[1]) + n[2] * direction[2] > 0.0 { 1 } else { -1 };
        // On, by 10⁻⁶ of the direction or by one unit in the last place of the largest coordinate.
        let largest = origin.iter().fold(0.0, |m: f32, x| crate::num::order::max(m, x.abs()));
        let step = hit.t + crate::num::order::max(1e-6, (largest + hit.t) * 2.0 * f32::EPSILON);
        origin = std::array::from_fn(|k| origin[k] + step * direction[k]);
    }
    sum
}

/// Whether most rays count a positive winding number.
fn is_inside(mesh: &Mesh, bvh: &Bvh, p: [f32; 3]) -> bool {
    RAYS.iter().filter(|d| winding(mesh, bvh, p, **d) > 0).count() >= 2
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A closed box.
    fn cuboid(low: [f32; 3], high: [f32; 3], into: &mut Mesh) {
        let first = into.positions.len() as u32;
        let pick = |i: usize, k: usize| if i >> k & 1 == 1 { high[k] } else { low[k] };
        into.positions.extend((0..8).map(|i| -> [f32; 3] { std::array::from_fn(|k| pick(i, k)) }));
        for [a, b, c, d] in
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        {
            into.triangles.extend([[a, b, c], [a, c, d]].map(|t| t.map(|i: u32| first + i)));
        }
    }

    fn distances(mesh: &Mesh, points: &[[f32; 3]]) -> Vec<f32> {
        let bvh = Bvh::build(&mesh.positions, &mesh.triangles);
        Signed::new(mesh, &bvh).at(points)
    }

    #[test]
    fn of_a_box_it_is_the_closed_form() {
        let mut mesh = Mesh::default();
        cuboid([-0.5, -0.25, -0.125], [0.5, 0.25, 0.125], &mut mesh);
        let points = [[0.0; 3], [0.75, 0.0, 0.0], [0.0, 0.5, 0.375], [0.45, 0.1, 0.05], [0.0, 0.0, 0.125]];
        let truth = [-0.125, 0.25, 0.5f32.sqrt() * 0.5, -0.05, 0.0];
        for (found, truth) in distances(&mesh, &points).iter().zip(truth) {
            assert!((found - truth).abs() < 1e-6, "{found} {truth}");
        }
    }

    #[test]
    fn parts_that_overlap_are_one_inside() {
        let mut mesh = Mesh::default();
        cuboid([-0.5, -0.2, -0.2], [0.1, 0.2, 0.2], &mut mesh);
        cuboid([-0.1, -0.1, -0.1], [0.5, 0.1, 0.1], &mut mesh);
        // Inside both, beside a face of the second within the first, in the second alone, and outside.
        let found = distances(&mesh, &[[0.0; 3], [-0.12, 0.0, 0.0], [0.4, 0.0, 0.0], [0.3, 0.15, 0.0]]);
        assert!(found[0] < 0.0 && found[2] < 0.0 && found[3] > 0.0, "{found:?}");
        assert!(found[1] < -0.09, "a face that is inside the other part does not count: {found:?}");
        assert!((found[3] - 0.05).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn without_triangles_all_is_outside() {
        assert_eq!(distances(&Mesh::default(), &[[0.0; 3]]), [f32::INFINITY]);
    }
}
