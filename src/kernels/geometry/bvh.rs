//! Nearest hits and occlusion queries with a bounding volume hierarchy.

use super::group::{self, Group};
use super::primitives::Triangles;
pub use super::ray::{Hit, MISS, Ray};
use super::tree::Tree;
use super::triangle::{Frame, Line};
use super::turns::Feed;

/// A mesh prepared for queries. The shape of its tree affects no result.
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
    /// Builds the hierarchy of a mesh; triangles without area are omitted.
    ///
    /// # Panics
    /// Panics if an index is out of range or a coordinate is not finite: see
    /// [`crate::scene::mesh::Mesh::validate`].
    pub fn build(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let mut largest = 0.0;
        for x in triangles.iter().flatten().flat_map(|&i| positions[i as usize]).map(f32::abs) {
            assert!(x.is_finite(), "the coordinates are finite");
            largest = if x > largest { x } else { largest };
        }
        let scale = Frame::scale_for(largest);
        let kept = Triangles::new(positions, triangles, scale);
        let tree = Tree::build(&kept);
        Self { frame: Frame { scale, bounds: tree.bounds }, tree, triangles: triangles.len() }
    }

    /// Number of triangles of the mesh.
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

    /// Converts the ray to the scaled coordinates of the tree, or returns `None` if it cannot hit anything.
    // This and the traversals below are compiled here once, and never as a part of the caller in another crate.
    #[inline(never)]
    fn line(&self, ray: &Ray) -> Option<Line> {
        Line::new(ray, &self.frame).filter(|_| !self.tree.rows().is_empty())
    }

    /// Traces neighbouring rays in groups and the others interleaved.
    fn walk_many<const ANY: bool>(&self, rays: &[Ray], done: impl FnMut(usize, Hit)) {
        let [lo, hi] = self.frame.bounds;
        let mut queue = Queue::<ANY, _> {
            bvh: self,
            size: (0..3).fold(0.0, |m, k| crate::num::order::max(m, hi[k] - lo[k])),
            rays,
            read: 0,
            run: Vec::with_capacity(group::RAYS),
            others: Vec::with_capacity(group::FEW),
            group: None,
            done,
        };
        self.tree.walk_many::<ANY>(&mut queue);
    }

    /// Returns the hit with the smallest (t, triangle), or [`Hit::NONE`].
    #[inline(never)]
    pub fn closest(&self, ray: &Ray) -> Hit {
        self.walk::<false>(ray)
    }

    /// Whether the ray hits anything.
    #[inline(never)]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.walk::<true>(ray).triangle != MISS
    }

    /// [`Bvh::closest`] of many rays, with the same bits.
    ///
    /// # Panics
    /// Panics if the lengths differ.
    #[inline(never)]
    pub fn closest_batch(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "there is one hit per ray");
        self.walk_many::<false>(rays, |i, hit| hits[i] = hit);
    }

    /// [`Bvh::occluded`] of many rays, with the same results.
    ///
    /// # Panics
    /// Panics if the lengths differ.
    #[inline(never)]
    pub fn occluded_batch(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "there is one result per ray");
        self.walk_many::<true>(rays, |i, hit| occluded[i] = hit.triangle != MISS);
    }
}

/// The rays of a batch in their order. Runs of neighbouring rays are traced as a group before the next ray is
/// returned; the remaining rays are returned one by one.
struct Queue<'a, const ANY: bool, D> {
    bvh: &'a Bvh,
    /// Largest extent of the mesh.
    size: f32,
    rays: &'a [Ray],
    /// Number of rays that have been read.
    read: usize,
    /// The last rays read, as long as they are neighbours.
    run: Vec<(usize, Line)>,
    /// Rays to be returned, the last one first.
    others: Vec<(usize, Line)>,
    group: Option<Group>,
    done: D,
}

impl<const ANY: bool, D: FnMut(usize, Hit)> Queue<'_, ANY, D> {
    /// Traces the run as a group, or moves its rays to `others`.
    #[inline(never)]
    fn flush(&mut self) {
        if self.run.len() < group::FEW {
            std::mem::swap(&mut self.run, &mut self.others);
            self.others.reverse();
        } else {
            let group = self.group.get_or_insert_with(|| Group::new(self.run[0].1));
            group.walk::<ANY>(&self.bvh.tree, &self.run, &mut self.done);
        }
        self.run.clear();
    }
}

impl<const ANY: bool, D: FnMut(usize, Hit)> Feed for Queue<'_, ANY, D> {
    #[inline]
    fn next(&mut self) -> Option<(usize, Line)> {
        loop {
            if let Some(ray) = self.others.pop() {
                return Some(ray);
            }
            let Some(ray) = self.rays.get(self.read) else {
                if self.run.is_empty() {
                    return None;
                }
                self.flush();
                continue;
            };
            let i = self.read;
            self.read += 1;
            let Some(line) = self.bvh.line(ray) else {
                (self.done)(i, Hit::NONE);
                continue;
            };
            let full = self.run.len() == group::RAYS;
            if full || self.run.first().is_some_and(|first| !group::beside(&first.1, &line, self.size)) {
                self.flush();
            }
            self.run.push((i, line));
        }
    }

    #[inline]
    fn done(&mut self, ray: usize, hit: Hit) {
        (self.done)(ray, hit);
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
