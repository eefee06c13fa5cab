//! One ray through the tree.

use super::bvh::{Hit, MISS};
use super::tree::{CHILDREN, INDEX, LANES, LEAF, Leaf, Node, STACK, Tree, references};
use super::triangle::{Line, Met, wide};
use crate::num::lanes::f32x8;
use prefetch_index::prefetch_index;

/// A line with its numbers in all lanes.
pub(super) struct Wide {
    enter: [f32x8; 3],
    leave: [f32x8; 3],
    inverse: [f32x8; 3],
    /// rows of the planes at which boxes are entered and left
    first: [usize; 3],
    last: [usize; 3],
}

impl Wide {
    #[inline(always)]
    pub(super) fn new(line: &Line) -> Self {
        let backwards = |k: usize| line.octant >> k & 1;
        Self {
            enter: splat(line.enter),
            leave: splat(line.leave),
            inverse: splat(line.inverse),
            first: [backwards(0), 2 + backwards(1), 4 + backwards(2)],
            last: [1 - backwards(0), 3 - backwards(1), 5 - backwards(2)],
        }
    }

    /// Starts and hit bits of the children.
    #[inline(always)]
    fn children(&self, rows: &[f32x8; 8], t_max: f32) -> (f32x8, u32) {
        let start = |k: usize| (rows[self.first[k] & 7] - self.enter[k]) * self.inverse[k];
        let end = |k: usize| (rows[self.last[k] & 7] - self.leave[k]) * self.inverse[k];
        let s = start(0).fast_max(start(1)).fast_max(start(2).fast_max(f32x8::splat(0.0)));
        let e = end(0).fast_min(end(1)).fast_min(end(2).fast_min(f32x8::splat(t_max)));
        (s, s.simd_le(e).to_bitmask())
    }
}

#[inline(always)]
fn splat([x, y, z]: [f32; 3]) -> [f32x8; 3] {
    [f32x8::splat(x), f32x8::splat(y), f32x8::splat(z)]
}

/// The best hit so far; weights are divided at the end.
struct Best {
    t: f32,
    u: f32,
    v: f32,
    triangle: u32,
}

#[inline(always)]
fn corners(leaf: &Leaf, lane: usize) -> [[f32; 3]; 3] {
    let at = |row: usize| leaf[row].to_array()[lane & 7];
    [[at(0), at(1), at(2)], [at(3), at(4), at(5)], [at(6), at(7), at(8)]]
}

/// Tests all triangles of a leaf; whether the best hit changed.
#[inline(always)]
fn meet(leaf: &Leaf, line: &mut Line, best: &mut Best) -> bool {
    let (x, y, z) = match line.axis {
        0 => (1, 2, 0),
        1 => (2, 0, 1),
        _ => (0, 1, 2),
    };
    let o = splat([line.origin[x], line.origin[y], line.origin[z]]);
    let shear = splat(line.shear);
    let sheared = |p: &[f32x8]| {
        let along = p[z] - o[2];
        [(p[x] - o[0]) - shear[0] * along, (p[y] - o[1]) - shear[1] * along, along]
    };
    let [a, b, c] = [sheared(&leaf[..3]), sheared(&leaf[3..6]), sheared(&leaf[6..9])];
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
            Met { t: t.to_array()[lane & 7], u: v.to_array()[lane & 7] / s, v: w.to_array()[lane & 7] / s }
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

/// Asks for the memory of a child that will be visited later.
#[inline(always)]
fn expect_soon(nodes: &[Node], leaves: &[Leaf], child: u32) {
    if child & LEAF == 0 {
        let rows = nodes.as_flattened();
        let at = 8 * child as usize;
        prefetch_index(rows, at);
        prefetch_index(rows, at + 2);
        prefetch_index(rows, at + 4);
        prefetch_index(rows, at + 6);
    } else {
        let rows = leaves.as_flattened();
        let at = 10 * (child ^ LEAF) as usize;
        prefetch_index(rows, at);
        prefetch_index(rows, at + 2);
        prefetch_index(rows, at + 4);
        prefetch_index(rows, at + 6);
        prefetch_index(rows, at + 8);
    }
}

impl Tree {
    /// The best hit, or any if `ANY`; t in the line's own unit.
    #[inline]
    pub(super) fn walk<const ANY: bool>(&self, mut line: Line) -> Hit {
        let (nodes, leaves) = (self.nodes.all(), self.leaves.all());
        let wide = Wide::new(&line);
        let mut best = Best { t: f32::INFINITY, u: 0.0, v: 0.0, triangle: MISS };
        // Entries: bits of the start above the reference.
        let mut stack = [0_u64; STACK];
        let mut top = 0;
        let mut at = 0_u32;
        'walk: loop {
            while at & LEAF == 0 {
                let node = &nodes[at as usize];
                let (start, mut hit) = wide.children(node, line.t_max);
                let start = start.to_array();
                let children = references(&node[CHILDREN]);
                if hit == 0 {
                    break;
                }
                let lane = hit.trailing_zeros() as usize;
                hit &= hit - 1;
                if hit == 0 {
                    at = children[lane & 7];
                    continue;
                }
                let entry =
                    |lane: usize| u64::from(start[lane & 7].to_bits()) << 32 | u64::from(children[lane & 7]);
                let mut nearest = entry(lane);
                let base = top;
                while hit != 0 {
                    let lane = hit.trailing_zeros() as usize;
                    hit &= hit - 1;
                    expect_soon(nodes, leaves, children[lane & 7]);
                    let mut e = entry(lane);
                    if e < nearest {
                        std::mem::swap(&mut e, &mut nearest);
                    }
                    // Far ones stay below.
                    let mut i = top;
                    while i > base && stack[(i - 1) & (STACK - 1)] < e {
                        stack[i & (STACK - 1)] = stack[(i - 1) & (STACK - 1)];
                        i -= 1;
                    }
                    stack[i & (STACK - 1)] = e;
                    top += 1;
                }
                at = nearest as u32;
            }
            if at & LEAF != 0 {
                let leaf = &leaves[(at ^ LEAF) as usize];
                if meet(leaf, &mut line, &mut best) && ANY {
                    break 'walk;
                }
            }
            loop {
                if top == 0 {
                    break 'walk;
                }
                top -= 1;
                let e = stack[top & (STACK - 1)];
                if f32::from_bits((e >> 32) as u32) <= line.t_max {
                    at = e as u32;
                    break;
                }
            }
        }
        Hit { t: best.t * line.unit, u: best.u, v: best.v, triangle: best.triangle }
    }
}

const _: () = assert!(LANES == 8, "bit masks and `& 7` are written for eight lanes");
