//! Traversal of the tree with many rays, a few of which are interleaved.
//!
//! While one ray waits for memory, others proceed: every visit ends with a prefetch of the next node or leaf,
//! and then the next ray continues. Rays at nodes and rays at leaves are kept in two lists, so that no branch
//! prediction between the two is necessary, and a visit of a node has no branch that depends on the number of
//! children that are hit.

use super::ray::Hit;
use super::tree::{CHILDREN, LANES, LEAF, Tree, expect_soon, leaf, node, references};
use super::triangle::Line;
use super::walk::{Best, Wide, meet};
use crate::num::lanes::{f32x8, i32x8};
use wide::bytemuck;

/// Number of interleaved rays.
const TURNS: usize = 12;
/// Number of levels of the tree, a power of two; `tree::DEEPEST` plus the logarithm of the number of
/// triangles stays below it.
const LEVELS: usize = 64;
/// Marks a child that is not hit or was already visited.
const GONE: i32 = i32::MAX;

/// Source of rays and receiver of hits.
pub(super) trait Feed {
    /// Returns the next ray and its index.
    fn next(&mut self) -> Option<(usize, Line)>;
    /// Receives the hit of a ray.
    fn done(&mut self, ray: usize, hit: Hit);
}

/// State of one ray. Per level of the tree it stores the node with pending children, which children are
/// pending, and their keys: the bits of each start with the lane in the lowest three bits.
#[derive(Clone)]
struct Turn {
    ray: usize,
    line: Line,
    wide: Wide,
    best: Best,
    at: u32,
    top: usize,
    keys: [i32x8; LEVELS],
    node: [u32; LEVELS],
    left: [u32; LEVELS],
}

impl Turn {
    fn new(ray: usize, line: Line, root: u32) -> Self {
        Self {
            ray,
            wide: Wide::new(&line),
            line,
            best: Best::NONE,
            at: root,
            top: 0,
            keys: [i32x8::splat(GONE); LEVELS],
            node: [0; LEVELS],
            left: [0; LEVELS],
        }
    }

    fn restart(&mut self, ray: usize, line: Line, root: u32) {
        (self.ray, self.wide, self.line, self.best) = (ray, Wide::new(&line), line, Best::NONE);
        (self.at, self.top) = (root, 0);
    }

    /// Moves from the node `at` to the nearest child that is hit, and stores the others as pending on a new
    /// level; if no child is hit, continues with a pending one. Returns whether there is a next node or leaf.
    #[inline(always)]
    fn visit_node(&mut self, rows: &[f32x8]) -> bool {
        let node = node(rows, self.at);
        let (start, hit) = self.wide.test(node, self.line.t_max);
        let bits = hit.to_bitmask();
        if bits == 0 {
            return self.next(rows);
        }
        let lanes = i32x8::new([0, 1, 2, 3, 4, 5, 6, 7]);
        let start: i32x8 = bytemuck::cast(start);
        let mask: i32x8 = bytemuck::cast(hit);
        let keys = (start & i32x8::splat(!7)) | lanes;
        let keys = (keys & mask) | (!mask & i32x8::splat(GONE));
        let nearest = keys.reduce_min();
        let lane = (nearest & 7) as usize;
        let rest = bits & !(1 << lane);
        let level = self.top & (LEVELS - 1);
        self.keys[level] = keys | (keys.simd_eq(i32x8::splat(nearest)) & i32x8::splat(GONE));
        self.node[level] = self.at;
        self.left[level] = rest;
        self.top += usize::from(rest != 0);
        self.at = references(&node[CHILDREN])[lane];
        true
    }

    /// Moves to the nearest pending child on the highest level; returns whether there is one.
    #[inline(always)]
    fn next(&mut self, rows: &[f32x8]) -> bool {
        loop {
            if self.top == 0 {
                return false;
            }
            let level = (self.top - 1) & (LEVELS - 1);
            let keys = self.keys[level];
            let key = keys.reduce_min();
            if key & !7 > self.line.t_max.to_bits() as i32 {
                self.top -= 1;
                continue;
            }
            let lane = (key & 7) as usize;
            self.keys[level] = keys | (keys.simd_eq(i32x8::splat(key)) & i32x8::splat(GONE));
            self.left[level] &= !(1 << lane);
            self.at = references(&node(rows, self.node[level])[CHILDREN])[lane];
            self.top -= usize::from(self.left[level] == 0);
            return true;
        }
    }
}

impl Turn {
    /// Prefetches the next node or leaf, or reports the hit and starts another ray.
    #[inline(always)]
    fn go_on(
        &mut self,
        more: bool,
        i: u8,
        rows: &[f32x8],
        root: u32,
        rays: &mut impl Feed,
        then: &mut Lists,
    ) {
        if more {
            expect_soon(rows, self.at);
            then.add(i, self.at);
            return;
        }
        rays.done(self.ray, self.best.hit(&self.line));
        if let Some((ray, line)) = rays.next() {
            self.restart(ray, line, root);
            then.add(i, root);
        }
    }
}

/// Active rays by location.
#[derive(Default)]
struct Lists {
    /// Index 0: rays at nodes; index 1: rays at leaves.
    of: [[u8; 16]; 2],
    len: [usize; 2],
}

impl Lists {
    #[inline(always)]
    fn add(&mut self, turn: u8, at: u32) {
        let kind = (at >> 31) as usize & 1;
        self.of[kind][self.len[kind] & 15] = turn;
        self.len[kind] += 1;
    }
}

const _: () = assert!(
    TURNS <= 16 && LANES == 8 && LEAF == 1 << 31,
    "lists have 16 entries, lanes three bits, and the highest bit marks leaves"
);

impl Tree {
    /// Finds the best hits of many rays, or any hits if `ANY`, in any order.
    pub(super) fn walk_many<const ANY: bool>(&self, rays: &mut impl Feed) {
        let (rows, root) = (self.rows(), self.root);
        let mut turns: Vec<Turn> = Vec::with_capacity(TURNS);
        let mut lists = [Lists::default(), Lists::default()];
        let mut now = 0;
        while turns.len() < TURNS
            && let Some((ray, line)) = rays.next()
        {
            lists[0].add(turns.len() as u8, root);
            turns.push(Turn::new(ray, line, root));
        }
        while lists[now & 1].len != [0, 0] {
            let [even, odd] = &mut lists;
            let (here, then) = if now == 0 { (&*even, odd) } else { (&*odd, even) };
            then.len = [0, 0];
            for &i in &here.of[0][..here.len[0]] {
                let turn = &mut turns[i as usize];
                let more = turn.visit_node(rows);
                turn.go_on(more, i, rows, root, rays, then);
            }
            for &i in &here.of[1][..here.len[1]] {
                let turn = &mut turns[i as usize];
                let found = meet(leaf(rows, turn.at), &mut turn.line, &mut turn.best);
                let more = !(found && ANY) && turn.next(rows);
                turn.go_on(more, i, rows, root, rays, then);
            }
            now ^= 1;
        }
    }
}
