//! The triangles of one cell of a grid, for every combination of signs and face decisions.
//!
//! Nothing here is a list of cases: the triangles are derived from the crossings of the six faces.
//!
//! ```text
//! corner c    bit k of c is the offset along axis k
//! edge e      4·axis + (offset along the next axis) + 2·(offset along the one after)
//! face f      2·axis + side; its corners counter-clockwise seen from outside the cell
//! ```
//!
//! 1. An edge is crossed if its corners have different signs. In a face, seen from outside the cell, a segment
//!    leads from each crossing *outside → inside* to a crossing *inside → outside*. Four crossings have two
//!    such matchings; `joined` selects the one that joins both inside corners.
//! 2. An edge lies in two faces with opposite directions, so every crossed edge ends one segment and starts
//!    one: the segments form loops. The cell on the other side of a face has the same segments, reversed.
//! 3. A loop becomes a triangulation without new vertices whose diagonals lie in no face of the cell; a
//!    diagonal in a face could also be one of the neighbour's, and four triangles would meet there. Among these
//!    triangulations the one with the smallest sum of squared diagonals (between midpoints of edges) is used,
//!    and of equal ones the one with the smaller split. Some loops of 8, 9 and 12 crossings have no such
//!    triangulation: they become a fan around a new vertex, the mean of the loop.
//!
//! Therefore every edge of the mesh is in exactly two triangles, with opposite directions: an edge inside a cell
//! by the triangulation, an edge in a face because both cells contain its segment once.

use std::sync::OnceLock;

/// Triangle vertices below this number are edges of the cell; from it on, centres of loops.
pub(super) const CENTRES: u8 = 12;

/// Crossed edges of a closed curve, in order.
pub(super) type Loop = Vec<u8>;

/// The surface in one cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Cell {
    /// Edges of the cell, or [`CENTRES`] + index into `fans`; counter-clockwise seen from outside the surface.
    pub(super) triangles: Vec<[u8; 3]>,
    /// Loops that have a vertex in their centre.
    pub(super) fans: Vec<Loop>,
}

/// The four corners of a face, counter-clockwise seen from outside the cell.
pub(super) fn corners(face: u8) -> [u8; 4] {
    let (axis, side) = (face / 2, face % 2);
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let at = |p: u8, q: u8| side << axis | p << b | q << c;
    if side == 1 {
        [at(0, 0), at(1, 0), at(1, 1), at(0, 1)]
    } else {
        [at(0, 0), at(0, 1), at(1, 1), at(1, 0)]
    }
}

/// The edge between two corners.
fn edge_of(p: u8, q: u8) -> u8 {
    let (axis, low) = ((p ^ q).trailing_zeros() as u8, p & q);
    4 * axis + (low >> ((axis + 1) % 3) & 1) + 2 * (low >> ((axis + 2) % 3) & 1)
}

/// Axis and lower corner of an edge.
pub(super) fn edge(e: u8) -> (u8, u8) {
    let (axis, place) = (e / 4, e % 4);
    (axis, (place & 1) << ((axis + 1) % 3) | (place >> 1) << ((axis + 2) % 3))
}

/// The four edges of a face: edge i is between corners i and i + 1.
fn edges(face: u8) -> [u8; 4] {
    let c = corners(face);
    std::array::from_fn(|i| edge_of(c[i], c[(i + 1) % 4]))
}

/// Whether two edges lie in a common face.
fn share_face(e: u8, f: u8) -> bool {
    (0..6).any(|face| edges(face).contains(&e) && edges(face).contains(&f))
}

/// Which corners of a face are inside; `inside` has a bit per corner of the cell.
fn signs(inside: u8, face: u8) -> [bool; 4] {
    corners(face).map(|c| inside >> c & 1 == 1)
}

/// A bit for each face whose diagonals have different signs.
pub(super) fn ambiguous(inside: u8) -> u8 {
    (0..6).fold(0, |bits, face| {
        let s = signs(inside, face);
        bits | u8::from(s[0] == s[2] && s[1] == s[3] && s[0] != s[1]) << face
    })
}

/// The loops of a cell, each from its smallest edge on.
pub(super) fn loops(inside: u8, joined: u8) -> Vec<Loop> {
    let mut next = [None; 12];
    for face in 0..6 {
        let (s, e) = (signs(inside, face), edges(face));
        let is_ambiguous = ambiguous(inside) >> face & 1 == 1;
        for i in 0..4 {
            // Edge `from` enters the inside corners that end at edge `to`.
            let (before, after) = (s[i], s[(i + 1) % 4]);
            if before || !after {
                continue;
            }
            let to = match (is_ambiguous, joined >> face & 1 == 1) {
                (false, _) => (1..4).map(|n| (i + n) % 4).find(|&k| s[k] && !s[(k + 1) % 4]),
                (true, false) => Some((i + 1) % 4),
                (true, true) => Some((i + 3) % 4),
            };
            next[usize::from(e[i])] = to.map(|k| e[k]);
        }
    }
    let mut out = Vec::new();
    for first in 0..12 {
        let (mut curve, mut at) = (Vec::new(), first);
        while let Some(following) = next[usize::from(at)].take() {
            curve.push(at);
            at = following;
        }
        if !curve.is_empty() {
            out.push(curve);
        }
    }
    out
}

/// Squared distance of the midpoints of two edges, in quarters.
fn distance(e: u8, f: u8) -> u32 {
    let middle = |e: u8| -> [i32; 3] {
        let (axis, low) = edge(e);
        std::array::from_fn(|k| if k == usize::from(axis) { 1 } else { 2 * i32::from(low >> k & 1) })
    };
    let (p, q) = (middle(e), middle(f));
    (0..3).fold(0, |sum, k| sum + (p[k] - q[k]).unsigned_abs().pow(2))
}

/// The triangulation of a loop with the shortest diagonals, none of them in a face; `None` if there is none.
fn triangulate(curve: &[u8]) -> Option<Vec<[u8; 3]>> {
    let n = curve.len();
    // (sum of squared diagonals, split) of the part from i to j; none if a diagonal lies in a face.
    let mut best = vec![vec![None; n]; n];
    for i in 0..n - 1 {
        best[i][i + 1] = Some((0, 0));
    }
    for width in 2..n {
        for i in 0..n - width {
            let j = i + width;
            let is_side = i == 0 && j == n - 1;
            if !is_side && share_face(curve[i], curve[j]) {
                continue;
            }
            let own = if is_side { 0 } else { distance(curve[i], curve[j]) };
            for split in i + 1..j {
                let (Some((left, _)), Some((right, _))) = (best[i][split], best[split][j]) else { continue };
                let sum = left + right + own;
                if best[i][j].is_none_or(|(least, _)| sum < least) {
                    best[i][j] = Some((sum, split));
                }
            }
        }
    }
    best[0][n - 1]?;
    let (mut out, mut open) = (Vec::new(), vec![(0, n - 1)]);
    while let Some((i, j)) = open.pop() {
        if j - i >= 2 {
            let (_, split) = best[i][j].expect("parts of a triangulation are triangulated");
            out.push([curve[i], curve[split], curve[j]]);
            open.extend([(i, split), (split, j)]);
        }
    }
    Some(out)
}

/// The surface of a cell from the signs of its corners and the decisions of its ambiguous faces.
fn surface_of(inside: u8, joined: u8) -> Cell {
    let mut cell = Cell::default();
    for curve in loops(inside, joined) {
        if let Some(triangles) = triangulate(&curve) {
            cell.triangles.extend(triangles);
        } else {
            let centre = CENTRES + cell.fans.len() as u8;
            let n = curve.len();
            cell.triangles.extend((0..n).map(|i| [curve[i], curve[(i + 1) % n], centre]));
            cell.fans.push(curve);
        }
    }
    cell
}

/// All cells.
pub(super) struct Table {
    ambiguous: [u8; 256],
    cells: Vec<Cell>,
}

impl Table {
    /// A bit for each face of the cell that requires a decision.
    pub(super) fn ambiguous(&self, inside: u8) -> u8 {
        self.ambiguous[usize::from(inside)]
    }

    /// The surface of a cell; `joined` has bits of ambiguous faces only.
    pub(super) fn cell(&self, inside: u8, joined: u8) -> &Cell {
        &self.cells[usize::from(inside) << 6 | usize::from(joined)]
    }
}

/// The table, derived at the first call.
pub(super) fn table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| {
        let bits: [u8; 256] = std::array::from_fn(|s| ambiguous(s as u8));
        let cells = (0..256 << 6).map(|i| {
            let (inside, joined) = ((i >> 6) as u8, (i & 63) as u8);
            let is_reached = joined & !bits[usize::from(inside)] == 0;
            if is_reached { surface_of(inside, joined) } else { Cell::default() }
        });
        Table { ambiguous: bits, cells: cells.collect() }
    })
}
