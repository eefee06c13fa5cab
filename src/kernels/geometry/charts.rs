//! Regions of a surface that one projection maps without overlap.
//!
//! 1. Every triangle belongs to the axis direction (±x, ±y, ±z; of equal ones the first) that its normal is
//!    closest to; connected triangles of one direction are a region.
//! 2. Regions grow: as long as there is a region smaller than 1/[`SMALL`] of the area that can be
//!    joined, the smallest is joined to the neighbour with the longest common border. Two regions can be joined if one of 26
//!    directions (to faces, edges and corners of a cube) has a cosine of at least [`MIN_COSINE`] with all normals
//!    of both.
//! 3. A region is projected along its mean normal, or along the direction of step 2 whose smallest cosine is the
//!    largest, whichever has the larger smallest cosine.
//! 4. A region in which two projected triangles overlap is split at the median of its longer extent, and its
//!    connected parts are examined again.
//!
//! So a chart is one to one by examination: every two of its triangles are separated by a line through an edge of
//! one of them. Charts may have holes. Triangles without area belong to any region.

use super::components::{Sets, area, cross};
use super::smooth::Lists;
use crate::math::vector::unit;
use crate::num::{order, par};
use crate::scene::mesh::Mesh;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Smallest cosine between the normal of a triangle and the direction of its projection: the smallest ratio of
/// projected area to area.
pub(super) const MIN_COSINE: f64 = 0.55;

/// Regions below this fraction of the area are joined to neighbours where possible.
const SMALL: f64 = 20.0;

/// Distance that counts as none, in units of the largest coordinate: a multiple of the rounding error of f64.
const OVERLAP: f64 = 1e-12;

/// Normals and neighbours of triangles.
struct Faces<'a> {
    mesh: &'a Mesh,
    /// (T) unit normals, zero for triangles without area.
    normals: Vec<[f64; 3]>,
    /// (T)
    areas: Vec<f64>,
    /// (T, 3) triangle on the other side of the edge from corner k to k + 1; `NONE` if there is none, or several.
    across: Vec<[u32; 3]>,
}

const NONE: u32 = u32::MAX;

/// A chart: triangles, and the projection to the plane.
#[derive(Clone)]
pub(super) struct Chart {
    /// Ascending.
    pub(super) triangles: Vec<u32>,
    /// Two unit vectors; their cross product points to the viewer, the second one down.
    pub(super) axes: [[f64; 3]; 2],
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// The 26 directions, axes first.
fn directions() -> Vec<[f64; 3]> {
    let mut all: Vec<[f64; 3]> = (0..27)
        .map(|i: i32| [(i / 9 - 1), (i / 3 % 3 - 1), (i % 3 - 1)].map(f64::from))
        .filter(|d| *d != [0.0; 3])
        .collect();
    // A stable sort: directions of equal length keep their order.
    all.sort_by_key(|d| d.iter().filter(|x| **x != 0.0).count());
    all.into_iter().map(unit).collect()
}

impl<'a> Faces<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let n = mesh.triangles.len();
        let normals = par::map_batched(n, 4096, |t| {
            let [a, b, c] = mesh.corners(t);
            unit(cross(a, b, c))
        });
        let areas = par::map_batched(n, 4096, |t| area(mesh.corners(t)));
        let mut edges: Vec<(u32, u32, u32)> = (0..3 * n as u32)
            .map(|i| {
                let t = mesh.triangles[i as usize / 3];
                let (a, b) = (t[i as usize % 3], t[(i as usize + 1) % 3]);
                (order::min(a, b), order::max(a, b), i)
            })
            .collect();
        edges.sort_unstable();
        let mut across = vec![[NONE; 3]; n];
        for same in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            if let [(.., i), (.., j)] = *same {
                across[i as usize / 3][i as usize % 3] = j / 3;
                across[j as usize / 3][j as usize % 3] = i / 3;
            }
        }
        Self { mesh, normals, areas, across }
    }

    fn point(&self, vertex: u32) -> [f64; 3] {
        self.mesh.positions[vertex as usize].map(f64::from)
    }

    /// Connected parts of a set of triangles; `of` is scratch space, (T) of zeros.
    fn parts(&self, triangles: &[u32], of: &mut [u32]) -> Vec<Vec<u32>> {
        triangles.iter().for_each(|&t| of[t as usize] = NONE);
        let (mut out, mut open): (Vec<Vec<u32>>, Vec<u32>) = (Vec::new(), Vec::new());
        for &first in triangles {
            if of[first as usize] != NONE {
                continue;
            }
            let mut part = Vec::new();
            of[first as usize] = 1;
            open.push(first);
            while let Some(t) = open.pop() {
                part.push(t);
                for u in self.across[t as usize] {
                    if u != NONE && of[u as usize] == NONE {
                        of[u as usize] = 1;
                        open.push(u);
                    }
                }
            }
            part.sort_unstable();
            out.push(part);
        }
        triangles.iter().for_each(|&t| of[t as usize] = 0);
        out
    }
}

/// Regions while they are joined.
struct Regions {
    sets: Sets,
    /// By representative: smallest cosine with each direction.
    cosines: Vec<[f64; 26]>,
    areas: Vec<f64>,
    /// By representative: neighbours (as of when the entry was made) and the length of the common border.
    borders: Vec<BTreeMap<u32, f64>>,
}

impl Regions {
    /// Step 1.
    fn new(faces: &Faces<'_>) -> Self {
        let directions = directions();
        let n = faces.normals.len();
        let cosines: Vec<[f64; 26]> = par::map_batched(n, 4096, |t| {
            let normal = faces.normals[t];
            if normal == [0.0; 3] { [1.0; 26] } else { std::array::from_fn(|d| dot(normal, directions[d])) }
        });
        let label = |t: usize| {
            let own = &cosines[t];
            (1..6).fold(0, |best, d| if own[d] > own[best] { d } else { best })
        };
        let labels: Vec<usize> = (0..n).map(label).collect();
        let is_flat = |t: usize| faces.normals[t] == [0.0; 3];
        let mut out =
            Self { sets: Sets::new(n), cosines, areas: vec![0.0; n], borders: vec![BTreeMap::new(); n] };
        for t in 0..n {
            for u in faces.across[t] {
                if u != NONE && labels[t] == labels[u as usize] && !is_flat(t) && !is_flat(u as usize) {
                    out.sets.join(t as u32, u);
                }
            }
        }
        for t in 0..n {
            let r = out.sets.find(t as u32);
            out.areas[r as usize] = out.areas[r as usize] + faces.areas[t];
            let own = out.cosines[t];
            lower(&mut out.cosines[r as usize], &own);
            for k in 0..3 {
                let u = faces.across[t][k];
                if u == NONE {
                    continue;
                }
                let s = out.sets.find(u);
                if r != s {
                    let corners = faces.mesh.triangles[t];
                    let (a, b) = (faces.point(corners[k]), faces.point(corners[(k + 1) % 3]));
                    let d: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
                    *out.borders[r as usize].entry(s).or_insert(0.0) += dot(d, d).sqrt();
                }
            }
        }
        out
    }

    /// The neighbour that a region is joined to.
    fn partner(&mut self, r: u32) -> Option<u32> {
        let mut lengths: BTreeMap<u32, f64> = BTreeMap::new();
        for (s, length) in std::mem::take(&mut self.borders[r as usize]) {
            let s = self.sets.find(s);
            if s != r {
                *lengths.entry(s).or_insert(0.0) += length;
            }
        }
        let mut best: Option<(u32, f64)> = None;
        for (&s, &length) in &lengths {
            let (a, b) = (&self.cosines[r as usize], &self.cosines[s as usize]);
            let is_flat_enough = (0..26).any(|d| a[d] >= MIN_COSINE && b[d] >= MIN_COSINE);
            if is_flat_enough && best.is_none_or(|(_, longest)| length > longest) {
                best = Some((s, length));
            }
        }
        self.borders[r as usize] = lengths;
        best.map(|(s, _)| s)
    }

    fn join(&mut self, a: u32, b: u32) -> u32 {
        let low = self.sets.join(a, b);
        let high = if low == a { b } else { a };
        self.areas[low as usize] = self.areas[low as usize] + self.areas[high as usize];
        let other = self.cosines[high as usize];
        lower(&mut self.cosines[low as usize], &other);
        for (s, length) in std::mem::take(&mut self.borders[high as usize]) {
            *self.borders[low as usize].entry(s).or_insert(0.0) += length;
        }
        low
    }

    /// Step 2.
    fn grow(&mut self, total: f64) {
        let n = self.areas.len();
        // Areas are not negative, so their bits have their order.
        let key = |area: f64, r: u32| Reverse((area.to_bits(), r));
        let mut open: BinaryHeap<_> = BinaryHeap::new();
        for r in 0..n as u32 {
            if self.sets.find(r) == r {
                open.push(key(self.areas[r as usize], r));
            }
        }
        while let Some(Reverse((bits, r))) = open.pop() {
            let area = f64::from_bits(bits);
            if !(area * SMALL < total) {
                break;
            }
            let is_current = self.sets.find(r) == r && self.areas[r as usize].to_bits() == bits;
            if let (true, Some(s)) = (is_current, self.partner(r)) {
                let joined = self.join(r, s);
                open.push(key(self.areas[joined as usize], joined));
            }
        }
    }
}

fn lower(a: &mut [f64; 26], b: &[f64; 26]) {
    for d in 0..26 {
        a[d] = order::min(a[d], b[d]);
    }
}

/// The charts of a mesh, by their first triangle; every triangle is in one.
pub(super) fn charts(mesh: &Mesh) -> Vec<Chart> {
    let faces = Faces::new(mesh);
    let mut regions = Regions::new(&faces);
    let total = faces.areas.iter().fold(0.0, |sum, a| sum + a);
    regions.grow(total);
    let mut members: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for t in 0..faces.areas.len() as u32 {
        members.entry(regions.sets.find(t)).or_default().push(t);
    }
    examine(&faces, members.into_values().collect())
}

/// Charts without overlap of the connected parts of sets of triangles.
fn examine(faces: &Faces<'_>, mut open: Vec<Vec<u32>>) -> Vec<Chart> {
    let (mut out, mut scratch) = (Vec::new(), vec![0; faces.areas.len()]);
    while !open.is_empty() {
        let projected = par::map(open.len(), |i| {
            let chart = project(faces, open[i].clone());
            let halves = overlaps(faces, &chart).then(|| halve(faces, &chart));
            (chart, halves)
        });
        open.clear();
        for (chart, halves) in projected {
            match halves {
                None => out.push(chart),
                Some(halves) => open.extend(halves.iter().flat_map(|half| faces.parts(half, &mut scratch))),
            }
        }
    }
    out.sort_by_key(|chart| chart.triangles[0]);
    out
}

/// The charts with those for which `is_split` holds split as in step 4, except single triangles.
pub(super) fn split(mesh: &Mesh, charts: Vec<Chart>, is_split: impl Fn(usize) -> bool) -> Vec<Chart> {
    let (faces, mut scratch) = (Faces::new(mesh), vec![0; mesh.triangles.len()]);
    let (mut out, mut open) = (Vec::new(), Vec::new());
    for (i, chart) in charts.into_iter().enumerate() {
        if is_split(i) && chart.triangles.len() > 1 {
            let halves = halve(&faces, &chart);
            open.extend(halves.iter().flat_map(|half| faces.parts(half, &mut scratch)));
        } else {
            out.push(chart);
        }
    }
    out.extend(examine(&faces, open));
    out.sort_by_key(|chart| chart.triangles[0]);
    out
}

/// Step 3.
fn project(faces: &Faces<'_>, triangles: Vec<u32>) -> Chart {
    let smallest = |d: [f64; 3]| {
        triangles.iter().fold(1.0_f64, |least, &t| {
            let n = faces.normals[t as usize];
            if n == [0.0; 3] { least } else { order::min(least, dot(n, d)) }
        })
    };
    let sum = triangles.iter().fold([0.0; 3], |sum: [f64; 3], &t| {
        std::array::from_fn(|k| sum[k] + faces.areas[t as usize] * faces.normals[t as usize][k])
    });
    let mut best = (unit(sum), smallest(unit(sum)));
    for d in directions() {
        let cosine = smallest(d);
        if cosine > best.1 || best.0 == [0.0; 3] {
            best = (d, cosine);
        }
    }
    let n = best.0;
    // The axis that is most perpendicular to n, made perpendicular.
    let axis = (1..3).fold(0, |k, j| if n[j].abs() < n[k].abs() { j } else { k });
    let u = unit(std::array::from_fn(|k| f64::from(u8::from(k == axis)) - n[axis] * n[k]));
    let v = [u[1] * n[2] - u[2] * n[1], u[2] * n[0] - u[0] * n[2], u[0] * n[1] - u[1] * n[0]];
    Chart { triangles, axes: [u, v] }
}

impl Chart {
    /// A point in the plane of the chart.
    pub(super) fn map(&self, p: [f64; 3]) -> [f64; 2] {
        self.axes.map(|axis| dot(p, axis))
    }
}

/// Whether two triangles have common interior points in the projection: more than [`OVERLAP`] of the largest
/// coordinate from every line through an edge. Triangles without area have none.
fn overlaps(faces: &Faces<'_>, chart: &Chart) -> bool {
    let has_area = |t: &&u32| faces.normals[**t as usize] != [0.0; 3];
    let flat = |t: &u32| faces.mesh.triangles[*t as usize].map(|v| chart.map(faces.point(v)));
    let triangles: Vec<[[f64; 2]; 3]> = chart.triangles.iter().filter(has_area).map(flat).collect();
    let Some([low, high]) = bounds(triangles.iter().flatten().copied()) else { return false };
    let largest = low.iter().chain(&high).fold(0.0, |m, x| order::max(m, x.abs()));
    // About one triangle per cell.
    let n = order::min((triangles.len() as f64).sqrt() as usize + 1, 1024);
    let cell = |x: f64, k: usize| {
        let extent = high[k] - low[k];
        let at = if extent > 0.0 { (x - low[k]) / extent * n as f64 } else { 0.0 };
        order::min(at as usize, n - 1)
    };
    let cells = triangles.iter().zip(0_u32..).flat_map(|(triangle, i)| {
        let [a, b] = bounds(triangle.iter().copied()).unwrap_or_default();
        let (columns, rows) = (cell(a[0], 0)..=cell(b[0], 0), cell(a[1], 1)..=cell(b[1], 1));
        columns.flat_map(move |x| rows.clone().map(move |y| ((x * n + y) as u32, i)))
    });
    let lists = Lists::of(n * n, cells);
    let meets = |i: u32, j: u32| {
        let (p, q) = (&triangles[i as usize], &triangles[j as usize]);
        !is_beside(p, q, OVERLAP * largest) && !is_beside(q, p, OVERLAP * largest)
    };
    (0..n * n).any(|c| {
        let list = lists.list(c);
        (1..list.len()).any(|j| (0..j).any(|i| meets(list[i], list[j])))
    })
}

/// Whether all of q is on the outer side of an edge of p, or within a distance of it.
fn is_beside(p: &[[f64; 2]; 3], q: &[[f64; 2]; 3], distance: f64) -> bool {
    let side =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let sign = if side(p[0], p[1], p[2]) < 0.0 { -1.0 } else { 1.0 };
    (0..3).any(|k| {
        let (a, b) = (p[k], p[(k + 1) % 3]);
        let most = distance * ((b[0] - a[0]).abs() + (b[1] - a[1]).abs());
        q.iter().all(|&c| sign * side(a, b, c) <= most)
    })
}

/// Smallest and largest coordinates.
pub(super) fn bounds(mut points: impl Iterator<Item = [f64; 2]>) -> Option<[[f64; 2]; 2]> {
    let first = points.next()?;
    Some(points.fold([first; 2], |[low, high], p| {
        [[0, 1].map(|k| order::min(low[k], p[k])), [0, 1].map(|k| order::max(high[k], p[k]))]
    }))
}

/// Step 4: two sets of triangles, by the coordinate of their centroids along the longer extent.
fn halve(faces: &Faces<'_>, chart: &Chart) -> [Vec<u32>; 2] {
    let middle = |t: u32| {
        let [a, b, c] = faces.mesh.triangles[t as usize].map(|v| chart.map(faces.point(v)));
        [0, 1].map(|k| (a[k] + b[k]) + c[k])
    };
    let [low, high] = bounds(chart.triangles.iter().map(|&t| middle(t))).unwrap_or_default();
    let axis = usize::from(high[1] - low[1] > high[0] - low[0]);
    let mut sorted = chart.triangles.clone();
    sorted.sort_by(|&a, &b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(&b)));
    let mut upper = sorted.split_off(sorted.len() / 2);
    sorted.sort_unstable();
    upper.sort_unstable();
    [sorted, upper]
}
