//! Traversal of the tree with one ray.

use super::ray::{Hit, MISS};
use super::tree::{
    CHILDREN, INDEX, LANES, LEAF, Leaf, Node, STACK, Tree, corners, expect_soon, leaf, node, references,
};
use super::triangle::{Intersection, Line, wide};
use crate::num::lanes::f32x8;

/// The values of a line for box tests, in all lanes.
#[derive(Clone, Debug)]
pub(super) struct Wide {
    enter: [f32x8; 3],
    leave: [f32x8; 3],
    /// Negative reciprocal of the direction, −1/direction.
    against: [f32x8; 3],
    /// Rows of the planes at which boxes are entered and left.
    first: [usize; 3],
    last: [usize; 3],
}

impl Wide {
    #[inline(always)]
    pub(super) fn new(line: &Line) -> Self {
        let [x, y, z] = line.inverse;
        let backwards = |k: usize| line.octant >> k & 1;
        Self {
            enter: splat(line.enter),
            leave: splat(line.leave),
            against: splat([-x, -y, -z]),
            first: [backwards(0), 2 + backwards(1), 4 + backwards(2)],
            last: [1 - backwards(0), 3 - backwards(1), 5 - backwards(2)],
        }
    }

    /// Returns the starts of the children, and which of them are hit. (enter − plane)·(−1/d) has the bits of
    /// (plane − enter)/d.
    #[inline(always)]
    pub(super) fn test(&self, node: &Node, t_max: f32) -> (f32x8, f32x8) {
        let start = |k: usize| (self.enter[k] - node[self.first[k] & 7]) * self.against[k];
        let end = |k: usize| (self.leave[k] - node[self.last[k] & 7]) * self.against[k];
        let s = start(0).fast_max(start(1)).fast_max(start(2).fast_max(f32x8::splat(0.0)));
        let e = end(0).fast_min(end(1)).fast_min(end(2).fast_min(f32x8::splat(t_max)));
        (s, s.simd_le(e))
    }
}

#[inline(always)]
fn splat([x, y, z]: [f32; 3]) -> [f32x8; 3] {
    [f32x8::splat(x), f32x8::splat(y), f32x8::splat(z)]
}

/// The best hit so far; the weights are divided at the end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Best {
    t: f32,
    u: f32,
    v: f32,
    triangle: u32,
}

impl Best {
    pub(super) const NONE: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, triangle: MISS };

    #[inline(always)]
    pub(super) fn hit(&self, line: &Line) -> Hit {
        Hit { t: line.in_caller_units(self.t), u: self.u, v: self.v, triangle: self.triangle }
    }
}

/// The axes of the test in their order, indexed by the axis along which the direction is largest.
const ORDER: [[usize; 3]; 4] = [[1, 2, 0], [2, 0, 1], [0, 1, 2], [0, 1, 2]];

/// Tests all triangles of a leaf; returns whether the best hit changed.
#[inline(always)]
pub(super) fn meet(leaf: &Leaf, line: &mut Line, best: &mut Best) -> bool {
    // There is no branch on the axis, because it differs between neighbouring rays of a batch.
    let [x, y, z] = ORDER[line.axis & 3];
    let axes = leaf.as_chunks::<3>().0;
    let (px, py, pz) = (&axes[x], &axes[y], &axes[z]);
    let o = splat([line.origin[x], line.origin[y], line.origin[z]]);
    let shear = splat(line.shear);
    let sheared = |i: usize| {
        let along = pz[i] - o[2];
        [(px[i] - o[0]) - shear[0] * along, (py[i] - o[1]) - shear[1] * along, along]
    };
    let [a, b, c] = [sheared(0), sheared(1), sheared(2)];
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let low = u.fast_min(v).fast_min(w);
    let high = u.fast_max(v).fast_max(w);
    let zero = f32x8::splat(0.0);
    let hit = (low.simd_ge(zero) | high.simd_le(zero)).to_bitmask();
    if hit == 0 {
        return false;
    }
    let strict = (low.simd_gt(zero) | high.simd_lt(zero)).to_bitmask();
    let sum = u + v + w;
    let depth = [shear[2] * a[2], shear[2] * b[2], shear[2] * c[2]];
    let t = (u * depth[0] + v * depth[1] + w * depth[2]) / sum;
    let near = (t.simd_ge(zero) & t.simd_le(f32x8::splat(line.t_max))).to_bitmask();
    let mut left = (hit & strict & near) | (hit & !strict);
    let mut changed = false;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        let met = if strict >> lane & 1 != 0 {
            let s = sum.to_array()[lane & 7];
            Intersection {
                t: t.to_array()[lane & 7],
                u: v.to_array()[lane & 7] / s,
                v: w.to_array()[lane & 7] / s,
            }
        } else {
            let at = |p: [f32x8; 3], k: usize| p[k].to_array()[lane & 7];
            let corner = |i: usize| {
                let p = [a, b, c][i];
                [at(p, 0), at(p, 1), depth[i].to_array()[lane & 7]]
            };
            match wide(corner(0), corner(1), corner(2)) {
                Some(met) => met,
                None => continue,
            }
        };
        let Some(met) = line.inside(corners(leaf, lane), met) else { continue };
        let triangle = references(&leaf[INDEX])[lane & 7];
        if met.t < best.t || (met.t == best.t && triangle < best.triangle) {
            *best = Best { t: met.t, u: met.u, v: met.v, triangle };
            line.t_max = met.t;
            changed = true;
        }
    }
    changed
}

/// Pending references: the bits of the start above the reference, the nearest on top. Entries that do not fit
/// are moved to a vector, which does not happen for ordinary meshes.
#[derive(Clone, Debug)]
struct Waiting {
    near: [u64; STACK],
    top: usize,
    far: Vec<u64>,
}

impl Waiting {
    #[inline(always)]
    fn new() -> Self {
        Self { near: [0; STACK], top: 0, far: Vec::new() }
    }

    #[cold]
    fn make_room(&mut self) {
        self.far.extend_from_slice(&self.near[..self.top]);
        self.top = 0;
    }

    #[cold]
    fn refill(&mut self) {
        let from = self.far.len().saturating_sub(STACK / 2);
        self.top = self.far.len() - from;
        self.near[..self.top].copy_from_slice(&self.far[from..]);
        self.far.truncate(from);
    }

    /// Returns the next reference whose box starts at or before t_max.
    #[inline(always)]
    fn pop(&mut self, t_max: f32) -> Option<u32> {
        loop {
            if self.top == 0 {
                if self.far.is_empty() {
                    return None;
                }
                self.refill();
            }
            self.top -= 1;
            let e = self.near[self.top & (STACK - 1)];
            if f32::from_bits((e >> 32) as u32) <= t_max {
                return Some(e as u32);
            }
        }
    }

    #[inline(always)]
    fn push(&mut self, e: u64) {
        self.near[self.top & (STACK - 1)] = e;
        self.top += 1;
    }

    /// Inserts above `base`, with larger entries below.
    #[inline(always)]
    fn insert(&mut self, base: usize, e: u64) {
        let mut i = self.top;
        while i > base && self.near[(i - 1) & (STACK - 1)] < e {
            self.near[i & (STACK - 1)] = self.near[(i - 1) & (STACK - 1)];
            i -= 1;
        }
        self.near[i & (STACK - 1)] = e;
        self.top += 1;
    }
}

/// State of the traversal with one ray.
#[derive(Clone, Debug)]
struct Walk {
    line: Line,
    best: Best,
    waiting: Waiting,
    at: u32,
}

impl Walk {
    #[inline(always)]
    fn new(line: Line, root: u32) -> Self {
        Self { line, best: Best::NONE, waiting: Waiting::new(), at: root }
    }

    /// Visits the node or leaf `at` and selects the next one; returns whether there is one.
    #[inline(always)]
    fn step<const ANY: bool>(&mut self, rows: &[f32x8], wide: &Wide) -> bool {
        if self.at & LEAF == 0 {
            let node = node(rows, self.at);
            let (start, hit) = wide.test(node, self.line.t_max);
            let mut hit = hit.to_bitmask();
            if hit != 0 {
                let children = references(&node[CHILDREN]);
                let lane = hit.trailing_zeros() as usize;
                hit &= hit - 1;
                if hit == 0 {
                    self.at = children[lane & 7];
                    return true;
                }
                let start = start.to_array();
                let entry =
                    |lane: usize| u64::from(start[lane & 7].to_bits()) << 32 | u64::from(children[lane & 7]);
                if self.waiting.top + LANES > STACK {
                    self.waiting.make_room();
                }
                if ANY {
                    // The order does not matter, because the first hit ends the traversal. A start of 0 is
                    // always within range.
                    while hit != 0 {
                        let next = hit.trailing_zeros() as usize;
                        hit &= hit - 1;
                        expect_soon(rows, children[next & 7]);
                        self.waiting.push(u64::from(children[next & 7]));
                    }
                    self.at = children[lane & 7];
                    return true;
                }
                let mut nearest = entry(lane);
                let base = self.waiting.top;
                while hit != 0 {
                    let lane = hit.trailing_zeros() as usize;
                    hit &= hit - 1;
                    expect_soon(rows, children[lane & 7]);
                    let mut e = entry(lane);
                    if e < nearest {
                        std::mem::swap(&mut e, &mut nearest);
                    }
                    self.waiting.insert(base, e);
                }
                self.at = nearest as u32;
                return true;
            }
        } else if meet(leaf(rows, self.at), &mut self.line, &mut self.best) && ANY {
            return false;
        }
        match self.waiting.pop(self.line.t_max) {
            Some(at) => {
                self.at = at;
                true
            }
            None => false,
        }
    }
}

impl Tree {
    /// Returns the best hit, or any hit if `ANY`.
    #[inline]
    pub(super) fn walk<const ANY: bool>(&self, line: Line) -> Hit {
        let rows = self.rows();
        let wide = Wide::new(&line);
        let mut walk = Walk::new(line, self.root);
        while walk.step::<ANY>(rows, &wide) {}
        walk.best.hit(&walk.line)
    }
}

const _: () = assert!(LANES == 8, "bit masks and `& 7` assume eight lanes");
