//! Nearest hits and occlusion over a bounding volume hierarchy.

use super::triangle::{Frame, Line, bounds, is_degenerate};
use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::builder::build_bvh2};

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

/// A mesh, ready for queries. Its shape changes no result.
#[derive(Clone)]
pub struct Bvh {
    frame: Frame,
    tree: obvhs::bvh2::Bvh2,
    corners: Vec<[[f32; 3]; 3]>,
    /// index in the mesh
    index: Vec<u32>,
}

impl std::fmt::Debug for Bvh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Bvh({} triangles)", self.index.len())
    }
}

impl Bvh {
    /// The hierarchy of a mesh; triangles without area are left out.
    ///
    /// # Panics
    /// If an index is out of range or a coordinate is not finite: see [`crate::scene::mesh::Mesh::validate`].
    pub fn build(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let largest = triangles.iter().flatten().flat_map(|&i| positions[i as usize]).fold(0.0, |m, x| {
            assert!(x.is_finite(), "coordinates are finite");
            if x.abs() > m { x.abs() } else { m }
        });
        let scale = Frame::scale_for(largest);
        let (mut corners, mut index) = (Vec::new(), Vec::new());
        for (i, t) in triangles.iter().enumerate() {
            let c = t.map(|i| positions[i as usize].map(|x| x * scale));
            if !is_degenerate(c) {
                corners.push(c);
                index.push(i as u32);
            }
        }
        let boxes: Vec<Aabb> = corners
            .iter()
            .map(|&c| {
                let [lo, hi] = bounds(c);
                Aabb::new(lo.into(), hi.into())
            })
            .collect();
        let tree = if boxes.is_empty() {
            obvhs::bvh2::Bvh2::default()
        } else {
            build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Default::default())
        };
        let bounds = match tree.nodes.first() {
            Some(n) => [n.aabb.min.into(), n.aabb.max.into()],
            None => [[0.0; 3]; 2],
        };
        Self { frame: Frame { scale, bounds }, tree, corners, index }
    }

    fn walk(&self, ray: &Ray, any: bool) -> Hit {
        let mut best = Hit::NONE;
        let Some(mut line) = Line::new(ray, &self.frame) else { return best };
        if self.tree.nodes.is_empty() {
            return best;
        }
        let mut stack = vec![0usize];
        while let Some(n) = stack.pop() {
            let node = &self.tree.nodes[n];
            let (start, end) = line.slab(node.aabb.min.into(), node.aabb.max.into());
            if !(start <= end && end >= 0.0 && start <= line.t_max) {
                continue;
            }
            let first = node.first_index as usize;
            if !node.is_leaf() {
                stack.extend([first, first + 1]);
                continue;
            }
            for i in first..first + node.prim_count as usize {
                let i = self.tree.primitive_indices[i] as usize;
                if let Some(met) = line.meet(self.corners[i]) {
                    if met.t < best.t || (met.t == best.t && self.index[i] < best.triangle) {
                        best = Hit { t: met.t, u: met.u, v: met.v, triangle: self.index[i] };
                        line.t_max = met.t;
                        if any {
                            return best;
                        }
                    }
                }
            }
        }
        best.t *= line.unit;
        best
    }

    /// The hit with the smallest (t, triangle), or [`Hit::NONE`].
    pub fn closest(&self, ray: &Ray) -> Hit {
        self.walk(ray, false)
    }

    /// Whether anything is hit.
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.walk(ray, true).triangle != MISS
    }

    /// [`Bvh::closest`] of many rays, same bits.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn closest_batch(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest(ray);
        }
    }

    /// [`Bvh::occluded`] of many rays, same answers.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn occluded_batch(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        for (ray, hit) in rays.iter().zip(occluded) {
            *hit = self.occluded(ray);
        }
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
