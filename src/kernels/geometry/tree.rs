//! The tree: eight children per node, up to eight triangles per leaf, both in a layout for vector lanes.
//!
//! obvhs proposes a binary tree. Its inner nodes are merged until a node has eight children; a subtree of at
//! most eight triangles becomes a leaf. Boxes are recomputed from the triangles. Nodes and leaves are stored
//! in depth-first order. A primitive of the proposed tree is a triangle, or many triangles with one centre.

use super::pages::Pages;
use super::primitives::{Box3, NOTHING, Triangles, union};
use super::triangle::bounds;
use crate::num::lanes::f32x8;
use crate::num::order::min;
use crate::num::par;
use obvhs::BvhBuildParams;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use prefetch_index::prefetch_index;
use wide::bytemuck;

/// Number of lanes: children per node, triangles per leaf.
pub(super) const LANES: usize = 8;
/// Depth below which the proposed tree is replaced by a balanced one, so that the stack of a traversal is
/// bounded.
const DEEPEST: usize = 24;
/// Stack size of a traversal: up to seven entries are pending at each of at most DEEPEST + log₂(2²⁸) levels.
pub(super) const STACK: usize = 64;
/// Bit that marks a child as a leaf.
pub(super) const LEAF: u32 = 1 << 31;
const CHUNK: usize = 16_384;

/// A node: rows 2k and 2k+1 are the lower and upper planes of its children along axis k, row 6 contains the
/// child references (as bits). The planes of an absent child intersect no ray. A node occupies four cache
/// lines.
pub(super) type Node = [f32x8; 8];

/// A leaf: row 3·axis + corner contains coordinates, one triangle per lane; row 9 contains the indices of the
/// triangles in the mesh (as bits). Lanes after the last triangle repeat the first. A leaf occupies five
/// cache lines.
pub(super) type Leaf = [f32x8; 10];

/// Index of the row that contains references.
pub(super) const CHILDREN: usize = 6;
pub(super) const INDEX: usize = 9;

/// Returns the corners of the triangle in one lane of a leaf.
#[inline(always)]
pub(super) fn corners(leaf: &Leaf, lane: usize) -> [[f32; 3]; 3] {
    let at = |row: usize| leaf[row].to_array()[lane & (LANES - 1)];
    [[at(0), at(3), at(6)], [at(1), at(4), at(7)], [at(2), at(5), at(8)]]
}

/// Returns a row of references.
#[inline(always)]
pub(super) fn references(row: &f32x8) -> &[u32; LANES] {
    bytemuck::cast_ref(row)
}

fn area([lo, hi]: Box3) -> f32 {
    let [x, y, z] = [0, 1, 2].map(|k| hi[k] - lo[k]);
    x * y + y * z + z * x
}

fn fill_node(children: &[(u32, Box3); LANES]) -> Node {
    let mut rows = [[0.0; LANES]; 8];
    let mut ids = [0_u32; LANES];
    for lane in 0..LANES {
        let (id, b) = children[lane];
        ids[lane] = id;
        for k in 0..3 {
            rows[2 * k][lane] = b[0][k];
            rows[2 * k + 1][lane] = b[1][k];
        }
    }
    let mut rows = rows.map(f32x8::new);
    rows[CHILDREN] = bytemuck::cast(ids);
    rows
}

/// The tree of a mesh: nodes and leaves in one array, depth first. A reference is the index of the first of
/// its cache lines, each of which consists of two rows; an empty tree has none.
#[derive(Clone)]
pub(super) struct Tree {
    lines: Pages<[f32x8; 2]>,
    /// Reference of the root.
    pub(super) root: u32,
    pub(super) bounds: Box3,
}

/// Cache lines of a node and of a leaf.
const NODE_LINES: u32 = 4;
const LEAF_LINES: u32 = 5;

/// Returns the node with a reference.
#[inline(always)]
pub(super) fn node(rows: &[f32x8], at: u32) -> &Node {
    rows[2 * at as usize..].first_chunk().expect("a reference is the index of a node")
}

/// Returns the leaf with a reference.
#[inline(always)]
pub(super) fn leaf(rows: &[f32x8], reference: u32) -> &Leaf {
    rows[2 * (reference & !LEAF) as usize..].first_chunk().expect("a reference is the index of a leaf")
}

/// Prefetches a node or leaf that will be visited later.
#[inline(always)]
pub(super) fn expect_soon(rows: &[f32x8], reference: u32) {
    let at = 2 * (reference & !LEAF) as usize;
    for line in 0..LEAF_LINES as usize {
        prefetch_index(rows, at + 2 * line);
    }
}

impl Tree {
    /// Returns all rows; there are none if no triangle has an area.
    #[inline(always)]
    pub(super) fn rows(&self) -> &[f32x8] {
        self.lines.all().as_flattened()
    }

    pub(super) fn build(triangles: &Triangles) -> Self {
        let n = triangles.corners.len();
        if n == 0 {
            return Self { lines: Pages::zeroed(0), root: 0, bounds: [[0.0; 3]; 2] };
        }
        let proposed =
            build_bvh2(&triangles.boxes(), BvhBuildParams::medium_build(), &mut Default::default());
        let mut outline = Outline::new(triangles, &proposed);
        let root = outline.place(Part::Proposed(0), 0);
        if root & LEAF != 0 {
            outline.nodes.push([root, NONE, NONE, NONE, NONE, NONE, NONE, NONE]);
            outline.node_place.push(outline.lines);
            outline.lines += NODE_LINES;
        }
        outline.fill(triangles)
    }
}

/// Marks an absent child.
const NONE: u32 = u32::MAX;

/// A part of the mesh: a node of the proposed tree, or a run of `items` that is split in halves.
#[derive(Clone, Copy)]
enum Part {
    Proposed(u32),
    Run(u32, u32),
}

/// The parent–child structure, before coordinates are filled in.
struct Outline<'a> {
    tree: &'a Bvh2,
    /// First item and number of items below every proposed node.
    spans: Vec<(u32, u32)>,
    /// Triangles in depth-first order of the proposed tree.
    items: Vec<u32>,
    /// Costs per proposed node: `costs[k]` is the smallest surface of nodes if k + 1 children represent it.
    costs: Vec<[f32; LANES]>,
    nodes: Vec<[u32; LANES]>,
    /// First item and number of items of each leaf.
    leaves: Vec<(u32, u32)>,
    node_place: Vec<u32>,
    leaf_place: Vec<u32>,
    /// Number of cache lines allocated so far.
    lines: u32,
}

impl<'a> Outline<'a> {
    fn new(triangles: &Triangles, tree: &'a Bvh2) -> Self {
        let n = triangles.corners.len();
        let mut made = Self {
            tree,
            spans: vec![(0, 0); tree.nodes.len()],
            items: Vec::with_capacity(n),
            costs: vec![[0.0; LANES]; tree.nodes.len()],
            nodes: Vec::with_capacity(n / 16),
            leaves: Vec::with_capacity(n / 5),
            node_place: Vec::with_capacity(n / 16),
            leaf_place: Vec::with_capacity(n / 5),
            lines: 0,
        };
        // The order is depth first; a node is visited a second time, marked, after everything below it.
        let mut stack = vec![(0_u32, false)];
        while let Some((at, seen)) = stack.pop() {
            let node = &tree.nodes[at as usize];
            if seen {
                made.spans[at as usize].1 = made.items.len() as u32 - made.spans[at as usize].0;
                made.costs[at as usize] = made.cost(at);
                continue;
            }
            made.spans[at as usize].0 = made.items.len() as u32;
            let first = node.first_index;
            if node.is_leaf() {
                let run = first as usize..(first + node.prim_count) as usize;
                made.items.extend(tree.primitive_indices[run].iter().flat_map(|&p| triangles.members(p)));
                made.spans[at as usize].1 = made.items.len() as u32 - made.spans[at as usize].0;
            } else {
                stack.extend([(at, true), (first + 1, false), (first, false)]);
            }
        }
        made
    }

    /// Returns the costs of a proposed inner node from those of its halves. Leaves cost the same under any
    /// parent, so they count 0.
    fn cost(&self, at: u32) -> [f32; LANES] {
        let node = &self.tree.nodes[at as usize];
        if self.spans[at as usize].1 as usize <= LANES {
            return [0.0; LANES];
        }
        let mut costs = [0.0; LANES];
        for k in 1..LANES {
            costs[k] = self.split(node.first_index, k).0;
        }
        let own = area([node.aabb.min.into(), node.aabb.max.into()]) + costs[LANES - 1];
        costs[0] = own;
        for k in 1..LANES {
            costs[k] = min(costs[k], costs[k - 1]);
        }
        costs
    }

    /// Returns the smallest cost of a pair of siblings represented by k + 1 children, and the number of
    /// children that represent the first, minus one.
    fn split(&self, first: u32, k: usize) -> (f32, usize) {
        let (a, b) = (&self.costs[first as usize], &self.costs[first as usize + 1]);
        let mut best = (a[0] + b[k - 1], 0);
        for i in 1..k {
            let c = a[i] + b[k - 1 - i];
            if c < best.0 {
                best = (c, i);
            }
        }
        best
    }

    /// Splits a part into those represented by at most `slots` children, and appends them to `into`.
    fn open(&self, part: Part, slots: usize, into: &mut Vec<Part>) {
        let Part::Proposed(at) = part else {
            into.push(part);
            return;
        };
        let (node, costs) = (&self.tree.nodes[at as usize], &self.costs[at as usize]);
        let small = self.spans[at as usize].1 as usize <= LANES;
        if small || slots == 1 || node.is_leaf() || !(costs[slots - 1] < costs[0]) {
            into.push(part);
            return;
        }
        // Selects the fewest slots that reach the smallest cost.
        let mut k = slots - 1;
        while k > 1 && costs[k - 1] == costs[k] {
            k -= 1;
        }
        let (_, i) = self.split(node.first_index, k);
        self.open(Part::Proposed(node.first_index), i + 1, into);
        self.open(Part::Proposed(node.first_index + 1), k - i, into);
    }

    fn span(&self, part: Part) -> (u32, u32) {
        match part {
            Part::Proposed(i) => self.spans[i as usize],
            Part::Run(first, n) => (first, n),
        }
    }

    /// Lays out a part depth first and returns its reference.
    fn place(&mut self, part: Part, depth: usize) -> u32 {
        let (first, n) = self.span(part);
        if n as usize <= LANES {
            self.leaves.push((first, n));
            self.leaf_place.push(self.lines);
            self.lines += LEAF_LINES;
            return LEAF | (self.leaves.len() - 1) as u32;
        }
        let mut open = Vec::with_capacity(LANES);
        match part {
            Part::Proposed(i) if depth < DEEPEST && !self.tree.nodes[i as usize].is_leaf() => {
                let first = self.tree.nodes[i as usize].first_index;
                let (_, k) = self.split(first, LANES - 1);
                self.open(Part::Proposed(first), k + 1, &mut open);
                self.open(Part::Proposed(first + 1), LANES - 1 - k, &mut open);
            }
            _ => {
                // A balanced tree: eight runs whose lengths differ by at most one.
                for i in 0..LANES as u32 {
                    let at = |i: u32| (u64::from(n) * u64::from(i) / LANES as u64) as u32;
                    open.push(Part::Run(first + at(i), at(i + 1) - at(i)));
                }
            }
        }
        let at = self.nodes.len();
        self.nodes.push([NONE; LANES]);
        self.node_place.push(self.lines);
        self.lines += NODE_LINES;
        for (i, part) in open.into_iter().enumerate() {
            self.nodes[at][i] = self.place(part, depth + 1);
        }
        at as u32
    }

    /// Fills the tree with coordinates: leaves first, then nodes from the last, whose children come after it.
    fn fill(self, triangles: &Triangles) -> Tree {
        let mut lines: Pages<[f32x8; 2]> = Pages::zeroed(self.lines as usize);
        let mut leaf_boxes = vec![NOTHING; self.leaves.len()];
        let (mut rest, mut done) = (lines.all_mut().as_flattened_mut(), 0);
        let mut tasks = Vec::new();
        for (c, boxes) in leaf_boxes.chunks_mut(CHUNK).enumerate() {
            // The gap between the end of one chunk of leaves and the start of the next.
            let end = self.leaf_place.get((c + 1) * CHUNK).copied().unwrap_or(self.lines);
            let (here, after) = rest.split_at_mut(2 * (end - done) as usize);
            tasks.push((done, here, boxes));
            (rest, done) = (after, end);
        }
        par::each(tasks, |c, (start, rows, boxes)| {
            for (i, bounds) in boxes.iter_mut().enumerate() {
                let (first, n) = self.leaves[c * CHUNK + i];
                let (leaf, b) = fill_leaf(triangles, &self.items[first as usize..(first + n) as usize]);
                let at = 2 * (self.leaf_place[c * CHUNK + i] - start) as usize;
                rows[at..at + leaf.len()].copy_from_slice(&leaf);
                *bounds = b;
            }
        });
        let rows = lines.all_mut().as_flattened_mut();
        let mut node_boxes = vec![NOTHING; self.nodes.len()];
        for at in (0..self.nodes.len()).rev() {
            let mut children = [(0, NOTHING); LANES];
            for (child, &id) in children.iter_mut().zip(&self.nodes[at]) {
                if id == NONE {
                    break;
                }
                let i = (id & !LEAF) as usize;
                *child = if id & LEAF != 0 {
                    (LEAF | self.leaf_place[i], leaf_boxes[i])
                } else {
                    (self.node_place[i], node_boxes[i])
                };
                node_boxes[at] = union(node_boxes[at], child.1);
            }
            let place = 2 * self.node_place[at] as usize;
            rows[place..place + LANES].copy_from_slice(&fill_node(&children));
        }
        // The root is the first node; in a tree of a single leaf it comes after the leaf.
        Tree { root: self.node_place[0], bounds: node_boxes[0], lines }
    }
}

fn fill_leaf(triangles: &Triangles, items: &[u32]) -> (Leaf, Box3) {
    let mut rows = [[0.0; LANES]; 10];
    let mut index = [0; LANES];
    let mut all = NOTHING;
    for lane in 0..LANES {
        let i = items[if lane < items.len() { lane } else { 0 }] as usize;
        let t = triangles.corners[i];
        index[lane] = triangles.index[i];
        all = union(all, bounds(t));
        for c in 0..3 {
            for k in 0..3 {
                rows[3 * k + c][lane] = t[c][k];
            }
        }
    }
    let mut rows = rows.map(f32x8::new);
    rows[INDEX] = bytemuck::cast(index);
    (rows, all)
}
