//! The tree: eight children a node, up to eight triangles a leaf, both laid out for lanes.
//!
//! obvhs proposes a binary tree. Its inner nodes are drawn together until a node has eight children; what has at most eight triangles
//! becomes a leaf. Boxes are taken from the triangles again. Nodes and leaves stand in depth-first order.

use super::pages::Pages;
use super::triangle::{bounds, is_degenerate};
use crate::num::lanes::f32x8;
use crate::num::order::{max, min};
use crate::num::par;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::{BvhBuildParams, aabb::Aabb};
use wide::bytemuck;

/// Lanes: children of a node, triangles of a leaf.
pub(super) const LANES: usize = 8;
/// Below this depth the proposed tree is replaced by an even one, so that the stack of a walk is bounded.
const DEEPEST: usize = 24;
/// Entries that the stack of a walk can have: seven wait at each of at most DEEPEST + log₂(2²⁸) levels.
pub(super) const STACK: usize = 64;
/// Marks a child that is a leaf.
pub(super) const LEAF: u32 = 1 << 31;
const CHUNK: usize = 16_384;

/// A node: rows 2k and 2k+1 are the lower and upper planes of its children along axis k, row 6 the children (as bits). A
/// child that is not there has planes that no ray passes. Four cache lines.
pub(super) type Node = [f32x8; 8];

/// A leaf: row 3·corner + axis, lane by lane; row 9 the indices of the triangles in the mesh (as bits). Lanes past the last
/// triangle repeat the first. Five cache lines.
pub(super) type Leaf = [f32x8; 10];

/// Rows that hold references.
pub(super) const CHILDREN: usize = 6;
pub(super) const INDEX: usize = 9;

/// A row of references.
#[inline(always)]
pub(super) fn references(row: &f32x8) -> &[u32; LANES] {
    bytemuck::cast_ref(row)
}

type Box3 = [[f32; 3]; 2];
const NOTHING: Box3 = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

fn union(a: Box3, b: Box3) -> Box3 {
    [[0, 1, 2].map(|k| min(a[0][k], b[0][k])), [0, 1, 2].map(|k| max(a[1][k], b[1][k]))]
}

fn area([lo, hi]: Box3) -> f32 {
    let [x, y, z] = [0, 1, 2].map(|k| hi[k] - lo[k]);
    x * y + y * z + z * x
}

fn node(children: &[(u32, Box3)]) -> Node {
    let mut rows = [[0.0; LANES]; 8];
    let mut ids = [0_u32; LANES];
    for lane in 0..LANES {
        let (id, b) = children.get(lane).copied().unwrap_or((0, NOTHING));
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

/// Triangles that have an area, in scaled coordinates.
pub(super) struct Triangles {
    pub(super) corners: Vec<[[f32; 3]; 3]>,
    pub(super) index: Vec<u32>,
}

impl Triangles {
    pub(super) fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]], scale: f32) -> Self {
        let parts = par::map(triangles.len().div_ceil(CHUNK), |c| {
            let mut kept = Vec::with_capacity(CHUNK);
            for i in c * CHUNK..Ord::min((c + 1) * CHUNK, triangles.len()) {
                let corners = triangles[i].map(|v| positions[v as usize].map(|x| x * scale));
                if !is_degenerate(corners) {
                    kept.push((corners, i as u32));
                }
            }
            kept
        });
        let n = parts.iter().map(Vec::len).sum();
        let (mut corners, mut index) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (c, i) in parts.into_iter().flatten() {
            corners.push(c);
            index.push(i);
        }
        Self { corners, index }
    }
}

/// The tree of a mesh. An empty one has no nodes.
#[derive(Clone)]
pub(super) struct Tree {
    pub(super) nodes: Pages<Node>,
    pub(super) leaves: Pages<Leaf>,
    pub(super) bounds: Box3,
    pub(super) node_count: usize,
}

impl Tree {
    pub(super) fn build(triangles: &Triangles) -> Self {
        let n = triangles.corners.len();
        if n == 0 {
            return Self {
                nodes: Pages::zeroed(0),
                leaves: Pages::zeroed(0),
                bounds: [[0.0; 3]; 2],
                node_count: 0,
            };
        }
        let mut boxes = vec![Aabb::default(); n];
        par::chunks_mut(&mut boxes, CHUNK, |c, out| {
            for (b, &t) in out.iter_mut().zip(&triangles.corners[c * CHUNK..]) {
                let [lo, hi] = bounds(t);
                *b = Aabb::new(lo.into(), hi.into());
            }
        });
        let mut params = match std::env::var("PRESET").as_deref() {
            Ok("slow") => BvhBuildParams::slow_build(),
            Ok("fast") => BvhBuildParams::fast_build(),
            Ok("vs") => BvhBuildParams::very_slow_build(),
            _ => BvhBuildParams::medium_build(),
        };
        params.pre_split = false;
        if let Ok(m) = std::env::var("MAXP") {
            params.max_prims_per_leaf = m.parse().unwrap();
        }
        if let Ok(m) = std::env::var("COST") {
            params.collapse_traversal_cost = m.parse().unwrap();
        }
        if let Ok(m) = std::env::var("REIN") {
            params.reinsertion_batch_ratio = m.parse().unwrap();
        }
        if let Ok(m) = std::env::var("POST") {
            params.post_collapse_reinsertion_batch_ratio_multiplier = m.parse().unwrap();
        }
        let proposed = build_bvh2(&boxes, params, &mut Default::default());
        let mut made = Collapse::new(triangles, &proposed);
        let root = made.root();
        let (child, bounds) = made.place(root, 0);
        if child & LEAF != 0 {
            made.nodes.all_mut()[0] = node(&[(child, bounds)]);
            made.node_count = 1;
        }
        Self { nodes: made.nodes, leaves: made.leaves, bounds, node_count: made.node_count }
    }
}

/// A part of the mesh: a node of the proposed tree, or a run of `items` that is halved.
#[derive(Clone, Copy)]
enum Part {
    Proposed(u32),
    Run(u32, u32),
}

struct Collapse<'a> {
    triangles: &'a Triangles,
    tree: &'a Bvh2,
    /// first item and number of items below every proposed node
    spans: Vec<(u32, u32)>,
    /// triangles in depth-first order of the proposed tree
    items: Vec<u32>,
    nodes: Pages<Node>,
    leaves: Pages<Leaf>,
    node_count: usize,
    leaf_count: usize,
}

impl<'a> Collapse<'a> {
    fn new(triangles: &'a Triangles, tree: &'a Bvh2) -> Self {
        let n = triangles.corners.len();
        let mut made = Self {
            triangles,
            tree,
            spans: vec![(0, 0); tree.nodes.len()],
            items: Vec::with_capacity(n),
            nodes: Pages::zeroed(0),
            leaves: Pages::zeroed(0),
            node_count: 0,
            leaf_count: 0,
        };
        // Depth first; a node is met again, marked, when all below it has been seen.
        let mut stack = vec![(0_u32, false)];
        while let Some((at, seen)) = stack.pop() {
            let node = &tree.nodes[at as usize];
            if seen {
                made.spans[at as usize].1 = made.items.len() as u32 - made.spans[at as usize].0;
                continue;
            }
            made.spans[at as usize].0 = made.items.len() as u32;
            let first = node.first_index;
            if node.is_leaf() {
                let run = first as usize..(first + node.prim_count) as usize;
                made.items.extend(&tree.primitive_indices[run]);
                made.spans[at as usize].1 = node.prim_count;
            } else {
                stack.extend([(at, true), (first + 1, false), (first, false)]);
            }
        }
        // A leaf has more than four triangles unless its sibling is larger than it.
        let leaves = made.count_leaves();
        made.leaves = Pages::zeroed(leaves);
        made.nodes = Pages::zeroed(leaves);
        made
    }

    /// Upper bound of the number of leaves.
    fn count_leaves(&self) -> usize {
        self.triangles.corners.len().div_ceil(2) + 1
    }

    fn root(&self) -> Part {
        Part::Proposed(0)
    }

    fn span(&self, part: Part) -> (u32, u32) {
        match part {
            Part::Proposed(i) => self.spans[i as usize],
            Part::Run(first, n) => (first, n),
        }
    }

    /// Both halves of a part with more than eight triangles.
    fn halves(&self, part: Part, depth: usize) -> [Part; 2] {
        if let Part::Proposed(i) = part {
            let node = &self.tree.nodes[i as usize];
            if !node.is_leaf() && depth < DEEPEST {
                return [Part::Proposed(node.first_index), Part::Proposed(node.first_index + 1)];
            }
        }
        let (first, n) = self.span(part);
        [Part::Run(first, n / 2), Part::Run(first + n / 2, n - n / 2)]
    }

    /// The surface that decides which part is opened next; runs are opened by their size.
    fn surface(&self, part: Part) -> f32 {
        match part {
            Part::Proposed(i) => {
                let b = self.tree.nodes[i as usize].aabb;
                area([b.min.into(), b.max.into()])
            }
            Part::Run(_, n) => n as f32,
        }
    }

    /// Writes a part; gives its reference and box.
    fn place(&mut self, part: Part, depth: usize) -> (u32, Box3) {
        let (first, n) = self.span(part);
        if n as usize <= LANES {
            return self.leaf(first as usize, n as usize);
        }
        let mut open = self.halves(part, depth).to_vec();
        while open.len() < LANES {
            let widest = (0..open.len())
                .filter(|&i| self.span(open[i]).1 as usize > LANES)
                .max_by(|&a, &b| self.surface(open[a]).total_cmp(&self.surface(open[b])));
            let Some(i) = widest else { break };
            let [a, b] = self.halves(open[i], depth);
            open[i] = a;
            open.push(b);
        }
        let at = self.node_count;
        self.node_count += 1;
        let children: Vec<(u32, Box3)> = open.into_iter().map(|p| self.place(p, depth + 1)).collect();
        let all = children.iter().fold(NOTHING, |all, c| union(all, c.1));
        self.nodes.all_mut()[at] = node(&children);
        (at as u32, all)
    }

    fn leaf(&mut self, first: usize, n: usize) -> (u32, Box3) {
        let mut corners = [[0.0; LANES]; 10];
        let mut index = [0; LANES];
        let mut all = NOTHING;
        for lane in 0..LANES {
            let i = self.items[first + if lane < n { lane } else { 0 }] as usize;
            let t = self.triangles.corners[i];
            index[lane] = self.triangles.index[i];
            all = union(all, bounds(t));
            for c in 0..3 {
                for k in 0..3 {
                    corners[3 * c + k][lane] = t[c][k];
                }
            }
        }
        let mut rows = corners.map(f32x8::new);
        rows[INDEX] = bytemuck::cast(index);
        self.leaves.all_mut()[self.leaf_count] = rows;
        self.leaf_count += 1;
        (LEAF | (self.leaf_count - 1) as u32, all)
    }
}
