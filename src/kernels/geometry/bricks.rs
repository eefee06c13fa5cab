//! A tree over the occupied bricks of a [`BitGrid`]: which bricks a ray meets, and where.
//!
//! obvhs proposes the tree. A brick is found if the ray meets its box, moved outward by a margin that the
//! caller gives, inside the span; the result is ordered by (enter, brick). Boxes of nodes contain those of
//! their bricks and rounding is monotone, so the shape of the tree affects no result.
//!
//! # Rounding
//! The planes of a box are crossed at (plane ∓ margin − o)/d, each operation rounded once; a coordinate with
//! d = 0 is compared with the planes.

use super::bit_grid::{BRICK, BitGrid};
use super::primitives::Box3;
use crate::num::order::{max, min};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};

/// A brick that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance at which the ray enters the brick.
    pub enter: f32,
    /// Distance at which it leaves the brick.
    pub leave: f32,
    /// Number of the brick among the occupied ones.
    pub brick: u32,
}

/// A ray.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    /// Where it starts.
    pub origin: [f32; 3],
    /// Its direction, of unit length.
    pub direction: [f32; 3],
    /// Distances between which bricks are found.
    pub span: [f32; 2],
    /// Distances by which boxes are moved outward along each axis.
    pub margin: [f32; 3],
}

/// The tree.
#[derive(Clone)]
pub struct Bricks {
    tree: Option<Bvh2>,
    boxes: Vec<Box3>,
}

impl std::fmt::Debug for Bricks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bricks").field("bricks", &self.len()).finish_non_exhaustive()
    }
}

impl Path {
    /// Returns the distances at which the ray is inside a box, if there are any in its span.
    #[inline(always)]
    fn inside(&self, low: [f32; 3], high: [f32; 3]) -> Option<[f32; 2]> {
        let [mut enter, mut leave] = self.span;
        for k in 0..3 {
            let (o, d) = (self.origin[k], self.direction[k]);
            let (low, high) = ((low[k] - self.margin[k]) - o, (high[k] + self.margin[k]) - o);
            if d == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (low / d, high / d);
            enter = max(enter, min(a, b));
            leave = min(leave, max(a, b));
        }
        (enter <= leave).then_some([enter, leave])
    }
}

impl Bricks {
    /// Builds the tree over the bricks of a grid that have a bit.
    pub fn new(grid: &BitGrid) -> Self {
        let occupied = grid.occupied_bricks();
        let of = |first: &[usize; 3]| grid.edges(*first, first.map(|i| Ord::min(i + BRICK, grid.side())));
        let boxes: Vec<Box3> = occupied.iter().map(of).collect();
        let corners: Vec<Aabb> =
            boxes.iter().map(|[low, high]| Aabb::new((*low).into(), (*high).into())).collect();
        let tree = (!boxes.is_empty())
            .then(|| build_bvh2(&corners, BvhBuildParams::fast_build(), &mut Default::default()));
        Self { tree, boxes }
    }

    /// Number of bricks.
    pub fn len(&self) -> usize {
        self.boxes.len()
    }

    /// Whether no brick is occupied.
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    /// Writes the bricks that a ray meets in its span, ordered by (enter, brick).
    pub fn along(&self, path: &Path, found: &mut Vec<Crossing>) {
        found.clear();
        let Some(tree) = &self.tree else { return };
        let mut open = vec![0_u32];
        while let Some(at) = open.pop() {
            let node = &tree.nodes[at as usize];
            if path.inside(node.aabb.min.into(), node.aabb.max.into()).is_none() {
                continue;
            }
            let first = node.first_index;
            if !node.is_leaf() {
                open.extend([first, first + 1]);
                continue;
            }
            for &brick in &tree.primitive_indices[first as usize..(first + node.prim_count) as usize] {
                let [low, high] = self.boxes[brick as usize];
                if let Some([enter, leave]) = path.inside(low, high) {
                    found.push(Crossing { enter, leave, brick });
                }
            }
        }
        found.sort_unstable_by(|a, b| a.enter.total_cmp(&b.enter).then(a.brick.cmp(&b.brick)));
    }
}
