//! Traversal of the tree with a group of up to sixteen neighbouring rays.
//!
//! A node is visited if the hull of the rays intersects its box. Let E be the origins and A = −1/d, all of
//! one sign per axis. The start of a slab is bounded from below by the smaller of (E* − plane)·A₋ and (E* −
//! plane)·A₊, where E* is the end of E's interval that minimises the product, and its end is bounded from
//! above analogously. Every operation is monotonic in floating point, so the hull intersects every box that
//! one of its rays intersects. At a leaf each ray tests the box of the leaf and then its triangles
//! individually, so a hit is bit-identical to that of the single ray.

use super::ray::Hit;
use super::tree::{CHILDREN, LANES, LEAF, Leaf, Node, Tree, leaf, node, references};
use super::triangle::Line;
use super::walk::{Best, meet};
use crate::num::lanes::f32x8;
use crate::num::order::{max, min};

/// Largest number of rays in a group.
pub(super) const RAYS: usize = 16;
const HALVES: usize = RAYS / LANES;
/// Smallest number of rays for which a group saves time.
pub(super) const FEW: usize = 4;
/// Largest difference of a group's rays from its first ray: directions relative to their magnitude, origins
/// relative to the size of the mesh.
const SPREAD: f32 = 0.06;

/// Whether a ray may join a group that begins with `first`; `size` is the mesh's extent. The result affects
/// only speed.
pub(super) fn beside(first: &Line, line: &Line, size: f32) -> bool {
    let by = SPREAD * first.shear[2].abs();
    line.octant == first.octant
        && line.axis == first.axis
        && (0..2).all(|k| (line.shear[k] - first.shear[k]).abs() <= SPREAD)
        && (line.shear[2] - first.shear[2]).abs() <= by
        && (0..3).all(|k| (line.origin[k] - first.origin[k]).abs() <= SPREAD * size)
}

/// One axis of the hull, in all lanes.
#[derive(Clone, Copy)]
struct Hull {
    enter: f32x8,
    leave: f32x8,
    low: f32x8,
    high: f32x8,
    first: usize,
    last: usize,
}

impl Hull {
    /// Returns a lower bound of where the rays enter the slabs of the children.
    #[inline(always)]
    fn start(&self, node: &Node) -> f32x8 {
        let x = self.enter - node[self.first & 7];
        (x * self.low).fast_min(x * self.high)
    }

    /// Returns an upper bound of where the rays leave them.
    #[inline(always)]
    fn end(&self, node: &Node) -> f32x8 {
        let x = self.leave - node[self.last & 7];
        (x * self.low).fast_max(x * self.high)
    }
}

/// Rays by lane; lanes after the last ray have t_max = −1, so that they intersect no box.
pub(super) struct Group {
    count: usize,
    id: [usize; RAYS],
    line: [Line; RAYS],
    best: [Best; RAYS],
    enter: [[f32; RAYS]; 3],
    leave: [[f32; RAYS]; 3],
    against: [[f32; RAYS]; 3],
    t_max: [f32; RAYS],
    waiting: Vec<(u64, u32)>,
}

fn half(x: &[f32; RAYS], h: usize) -> f32x8 {
    let x: &[f32; LANES] = &x.as_chunks().0[h];
    f32x8::new(*x)
}

impl Group {
    /// Returns a group without rays; `line` may be any line.
    pub(super) fn new(line: Line) -> Self {
        Self {
            count: 0,
            id: [0; RAYS],
            line: [line; RAYS],
            best: [Best::NONE; RAYS],
            enter: [[0.0; RAYS]; 3],
            leave: [[0.0; RAYS]; 3],
            against: [[0.0; RAYS]; 3],
            t_max: [-1.0; RAYS],
            waiting: Vec::with_capacity(128),
        }
    }

    /// Sets the rays of the group; lanes after the last ray repeat the first.
    fn fill(&mut self, rays: &[(usize, Line)]) {
        self.count = rays.len();
        self.t_max = [-1.0; RAYS];
        for i in 0..RAYS {
            let (id, line) = &rays[if i < rays.len() { i } else { 0 }];
            self.id[i] = *id;
            self.line[i] = *line;
            self.best[i] = Best::NONE;
            if i < rays.len() {
                self.t_max[i] = line.t_max;
            }
            for k in 0..3 {
                self.enter[k][i] = line.enter[k];
                self.leave[k][i] = line.leave[k];
                self.against[k][i] = -line.inverse[k];
            }
        }
    }

    fn hull(&self, k: usize, backwards: usize) -> Hull {
        let ends = |x: &[f32; RAYS]| x[1..].iter().fold((x[0], x[0]), |(l, h), &x| (min(l, x), max(h, x)));
        let (enter, leave, against) = (ends(&self.enter[k]), ends(&self.leave[k]), ends(&self.against[k]));
        let (worst_enter, worst_leave) = if backwards == 0 { (enter.1, leave.0) } else { (enter.0, leave.1) };
        Hull {
            enter: f32x8::splat(worst_enter),
            leave: f32x8::splat(worst_leave),
            low: f32x8::splat(against.0),
            high: f32x8::splat(against.1),
            first: 2 * k + backwards,
            last: 2 * k + 1 - backwards,
        }
    }

    /// Returns the bits of the rays that intersect a box before their t_max.
    #[inline(always)]
    fn pass(&self, node: &Node, lane: usize, hull: &[Hull; 3]) -> u32 {
        let plane = |row: usize| f32x8::splat(node[row & 7].to_array()[lane & 7]);
        let planes = [0, 1, 2].map(|k| (plane(hull[k].first), plane(hull[k].last)));
        let mut bits = 0;
        for h in 0..HALVES {
            let against = [half(&self.against[0], h), half(&self.against[1], h), half(&self.against[2], h)];
            let s = |k: usize| (half(&self.enter[k], h) - planes[k].0) * against[k];
            let e = |k: usize| (half(&self.leave[k], h) - planes[k].1) * against[k];
            let start = s(0).fast_max(s(1)).fast_max(s(2).fast_max(f32x8::splat(0.0)));
            let end = e(0).fast_min(e(1)).fast_min(e(2).fast_min(half(&self.t_max, h)));
            bits |= start.simd_le(end).to_bitmask() << (LANES * h);
        }
        bits
    }

    /// Returns the largest t_max of the rays.
    #[inline(always)]
    fn furthest(&self) -> f32 {
        let m = half(&self.t_max, 0).fast_max(half(&self.t_max, 1)).to_array();
        m[1..].iter().fold(m[0], |a, &b| if b > a { b } else { a })
    }

    /// Pushes the children of node `at` whose boxes the hull intersects before `t_max` onto the stack, the
    /// nearest last.
    #[inline(always)]
    fn open(&mut self, node: &Node, at: u32, hull: &[Hull; 3], t_max: f32) {
        let s = hull[0]
            .start(node)
            .fast_max(hull[1].start(node))
            .fast_max(hull[2].start(node).fast_max(f32x8::splat(0.0)));
        let e = hull[0]
            .end(node)
            .fast_min(hull[1].end(node))
            .fast_min(hull[2].end(node).fast_min(f32x8::splat(t_max)));
        let mut hit = s.simd_le(e).to_bitmask();
        let s = s.to_array();
        let children = references(&node[CHILDREN]);
        let base = self.waiting.len();
        while hit != 0 {
            let lane = hit.trailing_zeros() as usize & 7;
            hit &= hit - 1;
            let entry =
                (u64::from(s[lane].to_bits()) << 32 | u64::from(children[lane]), 8 * at + lane as u32);
            let mut i = self.waiting.len();
            self.waiting.push(entry);
            while i > base && self.waiting[i - 1].0 < entry.0 {
                self.waiting[i] = self.waiting[i - 1];
                i -= 1;
            }
            self.waiting[i] = entry;
        }
    }

    /// Tests the triangles of a leaf with each `active` ray individually; returns the number of rays that hit
    /// one.
    #[inline(always)]
    fn test<const ANY: bool>(&mut self, leaf: &Leaf, mut active: u32) -> usize {
        let mut met = 0;
        while active != 0 {
            let i = active.trailing_zeros() as usize & (RAYS - 1);
            active &= active - 1;
            if meet(leaf, &mut self.line[i], &mut self.best[i]) {
                met += 1;
                self.t_max[i] = if ANY { -1.0 } else { self.line[i].t_max };
            }
        }
        met
    }

    /// Returns the next reference that starts before `t_max`, and its index among all children.
    #[inline(always)]
    fn next(&mut self, t_max: f32) -> Option<(u32, u32)> {
        loop {
            match self.waiting.pop()? {
                (e, _) if f32::from_bits((e >> 32) as u32) > t_max => {}
                (e, place) => return Some((e as u32, place)),
            }
        }
    }

    /// Traverses the tree and finds the best hit of each ray, or any hit if `ANY`.
    // On its own, the loop keeps its vectors in registers; inlined into its caller it spills them (1.1 times as slow).
    #[inline(never)]
    pub(super) fn walk<const ANY: bool>(
        &mut self,
        tree: &Tree,
        rays: &[(usize, Line)],
        mut done: impl FnMut(usize, Hit),
    ) {
        self.fill(rays);
        let rows = tree.rows();
        let octant = self.line[0].octant;
        let hull = [0, 1, 2].map(|k| self.hull(k, octant >> k & 1));
        let mut t_max = self.furthest();
        let mut left = self.count;
        self.waiting.clear();
        // Each entry contains the start in the upper bits, the reference in the lower bits, and the index
        // among all children.
        let (mut at, mut place) = (tree.root, 0_u32);
        loop {
            if at & LEAF == 0 {
                self.open(node(rows, at), at, &hull, t_max);
            } else {
                let active = self.pass(node(rows, place >> 3), place as usize & 7, &hull);
                let met = self.test::<ANY>(leaf(rows, at), active);
                if met > 0 {
                    if ANY {
                        left -= met;
                        if left == 0 {
                            break;
                        }
                    }
                    t_max = self.furthest();
                }
            }
            let Some(next) = self.next(t_max) else { break };
            (at, place) = next;
        }
        for i in 0..self.count {
            done(self.id[i], self.best[i].hit(&self.line[i]));
        }
    }
}
