//! Exact search for the triangle nearest to a point, and for the nearest point of a cloud.
//!
//! The search uses a tree of boxes over triangles or points, split at the median of the widest side of the
//! centres. It skips boxes that contain nothing nearer: the distance to a box is computed by the same
//! operations on nearer coordinates, and rounding is monotone. Results are ordered by (d², index), so they
//! equal those of an exhaustive search, for any tree. A box at the best distance is visited only if it contains
//! a lower index, and of equal triangles only the first is kept, so equal entries cost no more than others.
//!
//! # Rounding
//! All values are f64: coordinates are converted exactly; d² = (x² + y²) + z². For triangles, a box is
//! enlarged by 2⁻⁴⁰ of the largest coordinate, because the nearest point of a triangle is rounded.

use crate::num::order;

/// Largest number of entries in a leaf.
const LEAF: usize = 4;

/// A box over `order[start..end]`.
struct Node {
    low: [f64; 3],
    high: [f64; 3],
    start: usize,
    end: usize,
    /// Lowest index in the box; it decides whether a tie can still change the result.
    least: u32,
    /// Index of the second child; the first follows its parent. The value 0 marks a leaf.
    second: usize,
}

/// A tree of boxes.
struct Tree {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Tree {
    /// Builds the tree of the entries in `order`.
    fn new(boxes: &[[[f64; 3]; 2]], order: Vec<u32>) -> Self {
        let mut tree = Self { nodes: Vec::new(), order };
        if !tree.order.is_empty() {
            tree.split(boxes, 0, tree.order.len());
        }
        tree
    }

    fn split(&mut self, boxes: &[[[f64; 3]; 2]], start: usize, end: usize) {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let (mut first, mut last, mut least) = (low, high, u32::MAX);
        for &i in &self.order[start..end] {
            least = least.min(i);
            let [a, b] = boxes[i as usize];
            for k in 0..3 {
                low[k] = order::min(low[k], a[k]);
                high[k] = order::max(high[k], b[k]);
                first[k] = order::min(first[k], a[k] + b[k]);
                last[k] = order::max(last[k], a[k] + b[k]);
            }
        }
        let at = self.nodes.len();
        self.nodes.push(Node { low, high, start, end, least, second: 0 });
        if end - start <= LEAF {
            return;
        }
        let extent = |k: usize| last[k] - first[k];
        let axis = (1..3).fold(0, |best, k| if extent(k) > extent(best) { k } else { best });
        let key = |i: u32| {
            let [a, b] = boxes[i as usize];
            a[axis] + b[axis]
        };
        let middle = usize::midpoint(start, end);
        self.order[start..end]
            .select_nth_unstable_by(middle - start, |&i, &j| key(i).total_cmp(&key(j)).then(i.cmp(&j)));
        self.split(boxes, start, middle);
        self.nodes[at].second = self.nodes.len();
        self.split(boxes, middle, end);
    }

    /// Returns the entry with the smallest (d², index).
    fn nearest(&self, p: [f64; 3], square: impl Fn(u32) -> f64) -> (f64, u32) {
        let mut best = (f64::INFINITY, u32::MAX);
        let mut stack = if self.nodes.is_empty() { Vec::new() } else { vec![(0.0, 0)] };
        while let Some((bound, at)) = stack.pop() {
            let node = &self.nodes[at];
            if bound > best.0 || (bound == best.0 && node.least > best.1) {
                continue;
            }
            if node.second == 0 {
                for &i in &self.order[node.start..node.end] {
                    let d = square(i);
                    if d < best.0 || (d == best.0 && i < best.1) {
                        best = (d, i);
                    }
                }
                continue;
            }
            let [a, b] = [at + 1, node.second].map(|c| (self.outside(c, p), c));
            // The nearer box is visited first.
            if a.0 <= b.0 { stack.extend([b, a]) } else { stack.extend([a, b]) }
        }
        best
    }

    /// Returns d² to a box.
    fn outside(&self, at: usize, p: [f64; 3]) -> f64 {
        let node = &self.nodes[at];
        let d: [f64; 3] = std::array::from_fn(|k| p[k] - order::clamp(p[k], node.low[k], node.high[k]));
        (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
    }
}

/// Triangles prepared for searches.
pub struct Surface {
    corners: Vec<[[f64; 3]; 3]>,
    tree: Tree,
}

impl Surface {
    /// Builds the search tree of a mesh whose indices are valid.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let corners: Vec<[[f64; 3]; 3]> =
            triangles.iter().map(|t| t.map(|i| positions[i as usize].map(f64::from))).collect();
        let largest = corners.iter().flatten().flatten().fold(0.0f64, |m, x| order::max(m, x.abs()));
        let pad = largest / (1u64 << 40) as f64;
        let around = |t: &[[f64; 3]; 3]| {
            let of = |pick: fn(f64, f64) -> f64, by: f64| {
                std::array::from_fn(|k| pick(pick(t[0][k], t[1][k]), t[2][k]) + by)
            };
            [of(order::min, -pad), of(order::max, pad)]
        };
        let boxes: Vec<_> = corners.iter().map(around).collect();
        let bits = |i: u32| corners[i as usize].map(|p| p.map(f64::to_bits));
        let mut order: Vec<u32> = (0..corners.len() as u32).collect();
        order.sort_by_key(|&i| bits(i));
        order.dedup_by(|i, first| bits(*i) == bits(*first));
        Self { tree: Tree::new(&boxes, order), corners }
    }

    /// Returns the squared distance and the index of the nearest triangle; ∞ and `u32::MAX` if there are no
    /// triangles.
    pub fn nearest(&self, p: [f64; 3]) -> (f64, u32) {
        self.tree.nearest(p, |i| {
            let q = nearest_on(&self.corners[i as usize], p);
            square(p, q)
        })
    }
}

/// Points prepared for searches.
pub struct Cloud<'a> {
    points: &'a [[f64; 3]],
    tree: Tree,
}

impl<'a> Cloud<'a> {
    /// Builds the search tree of finite points.
    pub fn new(points: &'a [[f64; 3]]) -> Self {
        let boxes: Vec<_> = points.iter().map(|p| [*p, *p]).collect();
        Self { points, tree: Tree::new(&boxes, (0..points.len() as u32).collect()) }
    }

    /// Returns the squared distance and the index of the nearest point; ∞ and `u32::MAX` if there are no
    /// points.
    pub fn nearest(&self, p: [f64; 3]) -> (f64, u32) {
        self.tree.nearest(p, |i| square(p, self.points[i as usize]))
    }
}

fn square(p: [f64; 3], q: [f64; 3]) -> f64 {
    let d: [f64; 3] = std::array::from_fn(|k| p[k] - q[k]);
    (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
}

/// Returns the point of a triangle nearest to p, selected by the region of the plane that contains the
/// projection of p (Ericson 2005, §5.1.5). A degenerate triangle is treated as its edges.
pub fn nearest_on(t: &[[f64; 3]; 3], p: [f64; 3]) -> [f64; 3] {
    let sub = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| a[k] - b[k]) };
    let dot = |a: [f64; 3], b: [f64; 3]| (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2];
    let along = |a: [f64; 3], d: [f64; 3], w: f64| -> [f64; 3] { std::array::from_fn(|k| a[k] + w * d[k]) };
    let [a, b, c] = *t;
    let (ab, ac) = (sub(b, a), sub(c, a));
    let n = [ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]];
    if !(dot(n, n) > 0.0) {
        let on_edge = |from: [f64; 3], to: [f64; 3]| {
            let d = sub(to, from);
            let length = dot(d, d);
            let w = if length > 0.0 { order::clamp(dot(sub(p, from), d) / length, 0.0, 1.0) } else { 0.0 };
            along(from, d, w)
        };
        let edges = [on_edge(a, b), on_edge(b, c), on_edge(c, a)];
        return edges
            .into_iter()
            .fold(edges[0], |best, q| if square(p, q) < square(p, best) { q } else { best });
    }
    let ap = sub(p, a);
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return along(a, ab, d1 / (d1 - d3));
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return along(a, ac, d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return along(b, sub(c, b), (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = (va + vb) + vc;
    along(along(a, ab, vb / sum), ac, vc / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    /// Compares with an exhaustive search, and the distance with a fine grid of barycentric points.
    #[test]
    fn the_tree_finds_what_comparing_with_all_finds() {
        let rng = Rng::new(3);
        let u = |i: u64, d: u16| rng.uniform_f32(i, 0, 0x06ff, d) - 0.5;
        let positions: Vec<[f32; 3]> = (0..90).map(|i| [u(i, 0), u(i, 1), u(i, 2)]).collect();
        let mut triangles: Vec<[u32; 3]> =
            (0..200u64).map(|i| [3, 4, 5].map(|d| rng.index(90, i, 0, 0x06ff, d) as u32)).collect();
        triangles.extend([[1, 1, 1], [2, 3, 3]]);
        let surface = Surface::new(&positions, &triangles);
        let flat: Vec<[f64; 3]> = positions.iter().map(|p| p.map(f64::from)).collect();
        let cloud = Cloud::new(&flat);
        for i in 0..300u64 {
            let p = [6, 7, 8].map(|d| 2.0 * f64::from(u(i, d)));
            let all = surface.corners.iter().enumerate().fold((f64::INFINITY, 0), |best, (k, t)| {
                let d = square(p, nearest_on(t, p));
                if d < best.0 { (d, k as u32) } else { best }
            });
            assert_eq!(surface.nearest(p), all, "triangle of point {i}");
            let all = flat.iter().enumerate().fold((f64::INFINITY, 0), |best, (k, q)| {
                let d = square(p, *q);
                if d < best.0 { (d, k as u32) } else { best }
            });
            assert_eq!(cloud.nearest(p), all, "point of point {i}");
        }
        assert_eq!(Surface::new(&[], &[]).nearest([0.0; 3]), (f64::INFINITY, u32::MAX), "nothing there");
    }

    #[test]
    fn the_nearest_point_of_a_triangle_is_the_nearest() {
        let t = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
        let rng = Rng::new(4);
        for i in 0..200u64 {
            let p = [0, 1, 2].map(|d| 4.0 * rng.uniform_f64(i, 0, 0x06ff, d) - 2.0);
            let best = square(p, nearest_on(&t, p));
            let mut grid = f64::INFINITY;
            for a in 0..=60 {
                for b in 0..=60 - a {
                    let (v, w) = (f64::from(a) / 60.0, f64::from(b) / 60.0);
                    let q =
                        std::array::from_fn(|k| t[0][k] + v * (t[1][k] - t[0][k]) + w * (t[2][k] - t[0][k]));
                    grid = order::min(grid, square(p, q));
                }
            }
            assert!(best <= grid + 1e-12 && best.sqrt() > grid.sqrt() - 0.03, "point {i}: {best} and {grid}");
        }
    }
}
