//! Exact nearest neighbours of every point of a point cloud.
//!
//! d²(i, j) = ((x_i−x_j)² + (y_i−y_j)²) + (z_i−z_j)²; the neighbours of a point are sorted by (d², index) and
//! exclude the point itself.
//!
//! # Rounding
//! Coordinates are converted exactly to f64; differences and squares are rounded in the order written. The
//! k-d tree only skips boxes that contain no nearer point. The distance to a box is computed by the same
//! operations on nearer coordinates, and rounding is monotone, so the result is bit-identical to a comparison
//! of all pairs.
//!
//! # Kinks and domain
//! Points must be finite. In a cloud of n points, a point has at most n − 1 neighbours.
//!
//! # Example
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::math::knn;
//! let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0], [9.0, 9.0, 9.0]];
//! let near = knn::neighbours::<3>(&points)?;
//! assert_eq!(near[0], [(1.0, 1), (4.0, 2), (4.0, 3)]); // a tie goes to the lower index
//! assert_eq!(knn::mean_squared_distance(&points)?[0], 3.0);
//! # Ok::<(), lastlight::Error>(())
//! ```

use crate::num::par;
use crate::{Error, Result};

/// Largest number of points in a leaf.
const LEAF: usize = 12;
/// Number of points per task.
const BATCH: usize = 256;

/// Placeholder for a missing neighbour, used if the cloud has too few points.
pub const NONE: (f64, u32) = (f64::INFINITY, u32::MAX);

/// A box of the tree, which contains the points `order[start..end]`.
struct Node {
    low: [f64; 3],
    high: [f64; 3],
    start: u32,
    end: u32,
    /// Lowest index inside the box; it decides whether a tie can still change the result.
    least: u32,
    /// Index of the second child; the first child follows its parent. The value 0 marks a leaf.
    second: u32,
}

struct Tree<'a> {
    points: &'a [[f32; 3]],
    order: Vec<u32>,
    nodes: Vec<Node>,
}

impl<'a> Tree<'a> {
    fn new(points: &'a [[f32; 3]]) -> Self {
        let mut tree = Self { points, order: (0..points.len() as u32).collect(), nodes: Vec::new() };
        if !points.is_empty() {
            tree.build(0, points.len());
        }
        tree
    }

    /// Splits the widest side at the median of (coordinate, index). These keys are unique, so the tree
    /// depends on the points alone.
    fn build(&mut self, start: usize, end: usize) -> u32 {
        let part = &self.order[start..end];
        let (mut low, mut high, mut least) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], u32::MAX);
        for &i in part {
            least = least.min(i);
            for c in 0..3 {
                let x = f64::from(self.points[i as usize][c]);
                low[c] = if x < low[c] { x } else { low[c] };
                high[c] = if x > high[c] { x } else { high[c] };
            }
        }
        let node = self.nodes.len();
        self.nodes.push(Node { low, high, start: start as u32, end: end as u32, least, second: 0 });
        if end - start > LEAF {
            let side = |c: usize| high[c] - low[c];
            let mut axis = 0;
            for c in 1..3 {
                axis = if side(c) > side(axis) { c } else { axis };
            }
            let middle = (end - start) / 2;
            let points = self.points;
            self.order[start..end].select_nth_unstable_by(middle, |&a, &b| {
                points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b))
            });
            self.build(start, start + middle);
            self.nodes[node].second = self.build(start + middle, end);
        }
        node as u32
    }

    /// Returns the squared distance from `p` to a box, which is 0 inside the box.
    fn distance(&self, node: u32, p: [f64; 3]) -> f64 {
        let n = &self.nodes[node as usize];
        let d: [f64; 3] = std::array::from_fn(|c| {
            if p[c] < n.low[c] {
                n.low[c] - p[c]
            } else if p[c] > n.high[c] {
                p[c] - n.high[c]
            } else {
                0.0
            }
        });
        (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
    }

    fn search<const K: usize>(
        &self,
        node: u32,
        distance: f64,
        me: u32,
        p: [f64; 3],
        best: &mut [(f64, u32); K],
    ) {
        let n = &self.nodes[node as usize];
        let worst = best[K - 1];
        if !(distance < worst.0 || (distance == worst.0 && n.least < worst.1)) {
            return;
        }
        if n.second == 0 {
            for &i in self.order[n.start as usize..n.end as usize].iter().filter(|i| **i != me) {
                let q = self.points[i as usize].map(f64::from);
                let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
                insert(best, ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2], i));
            }
            return;
        }
        let children = [node + 1, n.second].map(|c| (self.distance(c, p), self.nodes[c as usize].least, c));
        let [a, b] = children;
        // The nearer box is visited first; of equally near boxes, the one with the lower index, which
        // resolves ties earliest.
        let swap = b.0 < a.0 || (b.0 == a.0 && b.1 < a.1);
        for (d, _, child) in if swap { [b, a] } else { [a, b] } {
            self.search(child, d, me, p, best);
        }
    }
}

/// Inserts a candidate into the list sorted by (distance, index).
#[inline(always)]
fn insert<const K: usize>(best: &mut [(f64, u32); K], new: (f64, u32)) {
    let before = |a: (f64, u32), b: (f64, u32)| a.0 < b.0 || (a.0 == b.0 && a.1 < b.1);
    if !before(new, best[K - 1]) {
        return;
    }
    let mut at = K - 1;
    while at > 0 && before(new, best[at - 1]) {
        best[at] = best[at - 1];
        at -= 1;
    }
    best[at] = new;
}

/// Returns the K nearest neighbours of every point as (squared distance, index), nearest first; missing
/// neighbours are [`NONE`].
///
/// # Errors
/// Returns an error if a coordinate is not finite.
pub fn neighbours<const K: usize>(points: &[[f32; 3]]) -> Result<Vec<[(f64, u32); K]>> {
    assert!(K > 0 && points.len() < u32::MAX as usize, "K is at least 1, and point indices fit into 32 bits");
    if let Some(i) = points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        return Err(Error::input("points")
            .at(format!("row {i}"))
            .expected("finite coordinates")
            .got(format!("{:?}", points[i])));
    }
    let tree = Tree::new(points);
    Ok(par::map_batched(points.len(), BATCH, |i| {
        let (p, mut best) = (points[i].map(f64::from), [NONE; K]);
        tree.search(0, tree.distance(0, p), i as u32, p, &mut best);
        best
    }))
}

/// Returns the mean squared distance of every point to its three nearest neighbours, which is used for
/// initial scales. In a cloud of two or three points, the mean is over the existing neighbours; for a single
/// point it is 0.
///
/// # Rounding
/// The sum is a left fold from the nearest neighbour, followed by one division; the result is rounded once to
/// f32.
///
/// # Errors
/// Returns an error if a coordinate is not finite.
pub fn mean_squared_distance(points: &[[f32; 3]]) -> Result<Vec<f32>> {
    let count = points.len().saturating_sub(1).min(3);
    let near = neighbours::<3>(points)?;
    Ok(near
        .into_iter()
        .map(|n| {
            if count == 0 { 0.0 } else { (n[..count].iter().fold(0.0, |a, b| a + b.0) / count as f64) as f32 }
        })
        .collect())
}
