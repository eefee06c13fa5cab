//! Nearest hits and occlusion over a bounding volume hierarchy.

use super::group::{self, Group};
use super::tree::{Tree, Triangles};
use super::triangle::{Frame, Line};

/// The index of a triangle that was not hit.
pub const MISS: u32 = u32::MAX;

/// A ray with the interval in which it hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, scene units.
    pub origin: [f32; 3],
    /// Not necessarily of length 1, not zero; t counts in it.
    pub direction: [f32; 3],
    /// Hits have 0 ≤ t ≤ t_max.
    pub t_max: f32,
}

/// A hit, or `triangle == MISS` and t infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Parameter along the ray.
    pub t: f32,
    /// Barycentric weight of corner 1.
    pub u: f32,
    /// Barycentric weight of corner 2.
    pub v: f32,
    /// Index of the triangle.
    pub triangle: u32,
}

impl Hit {
    /// No hit.
    pub const NONE: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, triangle: MISS };
}

/// A mesh, ready for queries. The shape of its tree changes no result.
#[derive(Clone)]
pub struct Bvh {
    frame: Frame,
    tree: Tree,
    triangles: usize,
}

impl std::fmt::Debug for Bvh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Bvh({} triangles)", self.triangles)
    }
}

impl Bvh {
    /// The hierarchy of a mesh; triangles without area are left out.
    ///
    /// # Panics
    /// If an index is out of range or a coordinate is not finite: see [`crate::scene::mesh::Mesh::validate`].
    pub fn build(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let mut largest = 0.0;
        for x in triangles.iter().flatten().flat_map(|&i| positions[i as usize]).map(f32::abs) {
            assert!(x.is_finite(), "coordinates are finite");
            largest = if x > largest { x } else { largest };
        }
        let scale = Frame::scale_for(largest);
        let kept = Triangles::new(positions, triangles, scale);
        let tree = Tree::build(&kept);
        Self { frame: Frame { scale, bounds: tree.bounds }, tree, triangles: triangles.len() }
    }

    /// Number of triangles of the mesh it was built from.
    pub fn triangles(&self) -> usize {
        self.triangles
    }

    #[inline]
    fn walk<const ANY: bool>(&self, ray: &Ray) -> Hit {
        match Line::new(ray, &self.frame) {
            Some(line) if !self.tree.rows().is_empty() => self.tree.walk::<ANY>(line),
            _ => Hit::NONE,
        }
    }

    /// Rays side by side in groups, the others in turns.
    fn walk_many<const ANY: bool>(&self, rays: &[Ray], mut done: impl FnMut(usize, Hit)) {
        let [lo, hi] = self.frame.bounds;
        let size = (0..3).fold(0.0, |m, k| crate::num::order::max(m, hi[k] - lo[k]));
        let mut others = Vec::new();
        let mut together: Vec<(usize, Line)> = Vec::with_capacity(group::RAYS);
        let mut group: Option<Group> = None;
        let mut flush = |together: &mut Vec<(usize, Line)>, done: &mut dyn FnMut(usize, Hit)| {
            if together.len() < group::FEW {
                others.append(together);
            } else {
                let group = group.get_or_insert_with(|| Group::new(together[0].1));
                group.walk::<ANY>(&self.tree, together, done);
                together.clear();
            }
        };
        for (i, ray) in rays.iter().enumerate() {
            let Some(line) = Line::new(ray, &self.frame).filter(|_| !self.tree.rows().is_empty()) else {
                done(i, Hit::NONE);
                continue;
            };
            let full = together.len() == group::RAYS;
            if full || together.first().is_some_and(|first| !group::beside(&first.1, &line, size)) {
                flush(&mut together, &mut done);
            }
            together.push((i, line));
        }
        flush(&mut together, &mut done);
        let mut others = others.into_iter();
        self.tree.walk_many::<ANY>(|| others.next(), done);
    }

    /// The hit with the smallest (t, triangle), or [`Hit::NONE`].
    pub fn closest(&self, ray: &Ray) -> Hit {
        self.walk::<false>(ray)
    }

    /// Whether anything is hit.
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.walk::<true>(ray).triangle != MISS
    }

    /// [`Bvh::closest`] of many rays, same bits.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn closest_batch(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        self.walk_many::<false>(rays, |i, hit| hits[i] = hit);
    }

    /// [`Bvh::occluded`] of many rays, same answers.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn occluded_batch(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        self.walk_many::<true>(rays, |i, hit| occluded[i] = hit.triangle != MISS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_of_two_triangles() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let bvh = Bvh::build(&p, &[[0, 1, 2], [0, 2, 3]]);
        let ray =
            |x: f32, y: f32| Ray { origin: [x, y, 2.0], direction: [0.0, 0.0, -1.0], t_max: f32::INFINITY };
        assert_eq!(
            bvh.closest(&ray(0.75, 0.25)),
            Hit { t: 2.0, u: 0.5, v: 0.25, triangle: 0 },
            "below the diagonal"
        );
        assert_eq!(bvh.closest(&ray(0.25, 0.75)).triangle, 1, "above");
        assert_eq!(bvh.closest(&ray(0.5, 0.5)).triangle, 0, "on the diagonal the lower index wins");
        assert_eq!(bvh.closest(&ray(1.5, 0.5)), Hit::NONE, "beside");
        assert!(bvh.occluded(&ray(0.5, 0.5)), "occluded");
        assert_eq!(Bvh::build(&[], &[]).closest(&ray(0.0, 0.0)), Hit::NONE, "an empty mesh");
    }
}
