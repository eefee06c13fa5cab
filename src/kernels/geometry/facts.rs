//! Numbers about a mesh: edges, parts, area, volume, normals; charts, use and density of its texture coordinates.
//!
//! Vertices with equal positions (−0 and +0 are equal) are one, so that the doubled vertices at borders of charts do not
//! open the surface. An edge is *regular* if it is in exactly two triangles, in opposite directions; a surface is closed if
//! all of its edges are. A chart is a set of triangles that are connected by vertices with equal positions and equal
//! texture coordinates.
//!
//! # Rounding
//! f64. Areas and the volume V = Σ (p₀ − c)·((p₁ − c) × (p₂ − c))/6, with c the middle of the box, are left folds over the
//! triangles.

use super::components::{area, components, cross};
use crate::math::vector::unit;
use crate::num::order;
use crate::scene::mesh::Mesh;

/// Edges by the triangles that they are in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// In two triangles, in opposite directions.
    pub regular: usize,
    /// In one triangle.
    pub open: usize,
    /// In more than two triangles, or twice in one direction.
    pub irregular: usize,
}

/// Numbers about a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Facts {
    /// Vertices with different positions.
    pub points: usize,
    /// Triangles without area.
    pub degenerate: usize,
    /// Edges.
    pub edges: Edges,
    /// Connected parts.
    pub parts: usize,
    /// Area.
    pub area: f64,
    /// Volume; a meaning only where the surface is closed.
    pub volume: f64,
    /// Part of the area whose vertex normals, added, point to the back of the face; 0 without normals.
    pub turned: f64,
}

impl Facts {
    /// Whether every edge is regular.
    pub fn is_closed(&self) -> bool {
        self.edges.open == 0 && self.edges.irregular == 0 && self.edges.regular > 0
    }

    /// The Euler characteristic: points − edges + faces; 2 for each part without holes.
    pub fn euler(&self, triangles: usize) -> i64 {
        let edges = self.edges.regular + self.edges.open + self.edges.irregular;
        (self.points + triangles) as i64 - edges as i64
    }
}

/// Numbers about texture coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Layout {
    /// Charts.
    pub charts: usize,
    /// Part of the texels whose centre is in a triangle.
    pub used: f64,
    /// Part of the texels whose centre is inside of more than one triangle.
    pub overlapping: f64,
    /// Texels per unit of area: the densities below which 2.5, 50 and 97.5 % of the area lie.
    pub density: [f64; 3],
}

/// A number for each row; equal rows have the same one. Numbers count from 0 in the order of first use.
fn equal(rows: impl Iterator<Item = [f32; 5]>) -> (Vec<u32>, usize) {
    // + 0 makes −0 the other zero.
    let keys: Vec<[u32; 5]> = rows.map(|row| row.map(|x| (x + 0.0).to_bits())).collect();
    let mut by_key: Vec<u32> = (0..keys.len() as u32).collect();
    by_key.sort_by_key(|&i| (keys[i as usize], i));
    let mut first = vec![0_u32; keys.len()];
    for (k, &i) in by_key.iter().enumerate() {
        let before = k.checked_sub(1).map(|k| by_key[k]);
        let same = before.filter(|&j| keys[j as usize] == keys[i as usize]);
        first[i as usize] = same.map_or(i, |j| first[j as usize]);
    }
    let (mut number, mut count) = (vec![0_u32; keys.len()], 0);
    for i in 0..keys.len() {
        let leader = first[i] as usize;
        if leader == i {
            number[i] = count;
            count += 1;
        } else {
            number[i] = number[leader];
        }
    }
    (number, count as usize)
}

/// Counts edges of triangles.
///
/// # Example
/// A tetrahedron is closed; without a face, three of its edges are open.
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::facts::{Edges, edges};
/// let all = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
/// assert_eq!(edges(&all), Edges { regular: 6, open: 0, irregular: 0 });
/// assert_eq!(edges(&all[1..]), Edges { regular: 3, open: 3, irregular: 0 });
/// ```
pub fn edges(triangles: &[[u32; 3]]) -> Edges {
    let directed = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let mut all: Vec<(u32, u32, bool)> =
        directed.filter(|(a, b)| a != b).map(|(a, b)| (order::min(a, b), order::max(a, b), a < b)).collect();
    all.sort_unstable();
    let mut out = Edges::default();
    for same in all.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        match same {
            [_] => out.open += 1,
            [a, b] if a.2 != b.2 => out.regular += 1,
            _ => out.irregular += 1,
        }
    }
    out
}

/// Returns numbers about a valid mesh.
pub fn facts(mesh: &Mesh) -> Facts {
    let (number, points) = equal(mesh.positions.iter().map(|p| [p[0], p[1], p[2], 0.0, 0.0]));
    let welded: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| number[v as usize])).collect();
    let [low, high] = mesh.bounds();
    let c: [f64; 3] = std::array::from_fn(|k| 0.5 * f64::from(low[k]) + 0.5 * f64::from(high[k]));
    let mut out =
        Facts { points, edges: edges(&welded), parts: components(&welded, points).count, ..Facts::default() };
    let mut turned = 0.0;
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let p = mesh.corners(t);
        let (size, face) = (area(p), cross(p[0], p[1], p[2]));
        out.degenerate += usize::from(!(size > 0.0));
        out.area = out.area + size;
        let [a, b, d] = p.map(|p| std::array::from_fn::<f64, 3, _>(|k| f64::from(p[k]) - c[k]));
        let n = [b[1] * d[2] - b[2] * d[1], b[2] * d[0] - b[0] * d[2], b[0] * d[1] - b[1] * d[0]];
        out.volume = out.volume + ((a[0] * n[0] + a[1] * n[1]) + a[2] * n[2]) / 6.0;
        if !mesh.normals.is_empty() {
            let [u, v, w] = corners.map(|i| mesh.normals[i as usize].map(f64::from));
            let sum: [f64; 3] = std::array::from_fn(|k| (u[k] + v[k]) + w[k]);
            let face = unit(face);
            if (face[0] * sum[0] + face[1] * sum[1]) + face[2] * sum[2] < 0.0 {
                turned = turned + size;
            }
        }
    }
    out.turned = if out.area > 0.0 { turned / out.area } else { 0.0 };
    out
}

/// Returns the chart of every triangle, and the number of charts.
pub fn charts(mesh: &Mesh) -> (Vec<u32>, usize) {
    let rows = mesh.positions.iter().zip(&mesh.uvs).map(|(p, uv)| [p[0], p[1], p[2], uv[0], uv[1]]);
    let (number, count) = equal(rows);
    let welded: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| number[v as usize])).collect();
    let parts = components(&welded, count);
    (parts.of, parts.count)
}

/// Returns the edges at borders of charts: texture coordinates of both ends.
pub fn borders(mesh: &Mesh) -> Vec<[[f32; 2]; 2]> {
    let rows = mesh.positions.iter().zip(&mesh.uvs).map(|(p, uv)| [p[0], p[1], p[2], uv[0], uv[1]]);
    let (number, _) = equal(rows);
    let mut all = Vec::with_capacity(3 * mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        for (i, j) in [(a, b), (b, c), (c, a)] {
            let (m, n) = (number[i as usize], number[j as usize]);
            all.push((order::min(m, n), order::max(m, n), i, j));
        }
    }
    all.sort_unstable();
    let alone = all.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|same| same.len() == 1);
    alone.map(|same| [mesh.uvs[same[0].2 as usize], mesh.uvs[same[0].3 as usize]]).collect()
}

/// Returns numbers about the texture coordinates of a mesh in an image of `size` texels; `None` without coordinates.
/// Coordinates repeat with period 1.
///
/// # Example
/// A unit square in a quarter of an image of 4×4 texels.
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::facts::layout;
/// use lastlight::scene::mesh::Mesh;
/// let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let uvs = vec![[0.0, 0.5], [0.5, 0.5], [0.5, 0.0], [0.0, 0.0]];
/// let mesh = Mesh { positions, uvs, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
/// let found = layout(&mesh, [4, 4]).expect("coordinates");
/// assert_eq!((found.charts, found.used, found.overlapping), (1, 0.25, 0.0));
/// assert_eq!(found.density, [4.0; 3]);
/// ```
pub fn layout(mesh: &Mesh, [w, h]: [usize; 2]) -> Option<Layout> {
    if mesh.uvs.is_empty() || mesh.triangles.is_empty() {
        return None;
    }
    // 0: free, 1: at a border or inside of one triangle, 2: inside of two.
    let (mut state, mut rows) = (vec![0_u8; w * h], Vec::new());
    let mut inside = vec![false; w * h];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let p = corners.map(|v| {
            let [u, v] = mesh.uvs[v as usize].map(f64::from);
            [u * w as f64, v * h as f64]
        });
        let twice = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
        let surface = area(mesh.corners(t));
        if surface > 0.0 {
            rows.push([0.5 * twice.abs() / surface, surface]);
        }
        let range = |k: usize, n: usize| {
            let low = order::min(order::min(p[0][k], p[1][k]), p[2][k]);
            let high = order::max(order::max(p[0][k], p[1][k]), p[2][k]);
            // A triangle wider than the image covers it once.
            let first = (low - 0.5).ceil();
            (first, order::min((high - 0.5).floor() - first + 1.0, n as f64))
        };
        let ((x0, nx), (y0, ny)) = (range(0, w), range(1, h));
        for j in 0..order::max(ny, 0.0) as usize {
            for i in 0..order::max(nx, 0.0) as usize {
                let q = [x0 + i as f64 + 0.5, y0 + j as f64 + 0.5];
                let e = [0, 1, 2].map(|k| {
                    let (a, b) = (p[k], p[(k + 1) % 3]);
                    (b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0])
                });
                let has = |f: &dyn Fn(f64) -> bool| e.iter().all(|x| f(*x));
                if !(has(&|x| x >= 0.0) || has(&|x| x <= 0.0)) || twice == 0.0 {
                    continue;
                }
                let at = (q[1] - 0.5).rem_euclid(h as f64) as usize * w
                    + (q[0] - 0.5).rem_euclid(w as f64) as usize;
                let is_inside = has(&|x| x > 0.0) || has(&|x| x < 0.0);
                state[at] = if is_inside && inside[at] { 2 } else { order::max(state[at], 1) };
                inside[at] |= is_inside;
            }
        }
    }
    let count = |least: u8| state.iter().filter(|s| **s >= least).count() as f64 / (w * h) as f64;
    Some(Layout {
        charts: charts(mesh).1,
        used: count(1),
        overlapping: count(2),
        density: [0.025, 0.5, 0.975].map(|share| quantile(&mut rows, share)),
    })
}

/// The first value of (value, weight) up to which the share of the weight lies; 0 without rows.
fn quantile(rows: &mut [[f64; 2]], share: f64) -> f64 {
    rows.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let total = rows.iter().fold(0.0, |sum, row| sum + row[1]);
    let mut sum = 0.0;
    let found = rows.iter().find(|row| {
        sum = sum + row[1];
        sum >= share * total
    });
    found.or(rows.last()).map_or(0.0, |row| row[0])
}
