//! The surface point of every texel of an atlas, and the nearest one for the texels of gutters.
//!
//! Texel (x, y) has its centre at ((x + ½)/W, (y + ½)/H). It is covered by the triangle of the smallest index that
//! contains the centre, border included. A chart without a covered texel covers the one that contains the
//! centroid of its first triangle, so every chart has a value.
//!
//! ```text
//! mesh with texture coordinates ── cover ──► texels: index, triangle, barycentric, position, normal
//! values of texels              ── fill  ──► for each texel the covered texel whose value it takes
//! ```
//!
//! # Rounding
//! Edge functions in f64, each computed from the corner of the smaller vertex index to the other one, so that both triangles at
//! an edge get the same value with opposite signs, and no texel between them is missed. Barycentric
//! coordinates are edge functions over their left-fold sum; positions and normals are left folds over the
//! corners; each is rounded to f32 once. A normal is unit; where the interpolated one is zero, or the mesh has
//! none, it is the face normal.

use super::components::cross;
use crate::math::vector::unit;
use crate::num::{order, par};
use crate::scene::mesh::Mesh;
use crate::{Error, Result};

/// Largest number of texels per side.
pub const MAX_SIZE: usize = 1 << 14;

/// Rows of texels per task.
const ROWS: usize = 16;

/// No texel.
pub const NONE: u32 = u32::MAX;

/// A covered texel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Texel {
    /// y·W + x.
    pub index: u32,
    /// Triangle of the mesh.
    pub triangle: u32,
    /// Weights of its corners.
    pub barycentric: [f32; 3],
    /// Point of the surface.
    pub position: [f32; 3],
    /// Unit normal.
    pub normal: [f32; 3],
}

/// Texel coordinates of a triangle, with its vertex indices.
struct Flat {
    corners: [u32; 3],
    p: [[f64; 2]; 3],
}

impl Flat {
    fn of(mesh: &Mesh, t: usize, size: [usize; 2]) -> Self {
        let corners = mesh.triangles[t];
        let p = corners.map(|v| {
            let uv = mesh.uvs[v as usize];
            [0, 1].map(|k| f64::from(uv[k]) * size[k] as f64)
        });
        Self { corners, p }
    }

    /// Twice the area between the edge opposite to corner k and a point.
    fn edge(&self, k: usize, q: [f64; 2]) -> f64 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let swapped = self.corners[j] < self.corners[i];
        let (a, b) = if swapped { (self.p[j], self.p[i]) } else { (self.p[i], self.p[j]) };
        let e = (b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0]);
        if swapped { -e } else { e }
    }

    /// Weights of the corners, if the triangle contains the point.
    fn weights(&self, q: [f64; 2]) -> Option<[f64; 3]> {
        let e = [0, 1, 2].map(|k| self.edge(k, q));
        let sum = (e[0] + e[1]) + e[2];
        let is_inside = (e.iter().all(|x| *x >= 0.0) || e.iter().all(|x| *x <= 0.0)) && sum != 0.0;
        is_inside.then(|| e.map(|x| x / sum))
    }

    /// Smallest and largest row, or column, whose centre the triangle may contain, limited to 0..n.
    fn range(&self, k: usize, n: usize) -> std::ops::Range<usize> {
        let low = self.p.iter().fold(f64::INFINITY, |a, p| order::min(a, p[k]));
        let high = self.p.iter().fold(f64::NEG_INFINITY, |a, p| order::max(a, p[k]));
        let first = order::clamp((low - 0.5).ceil(), 0.0, n as f64) as usize;
        first..order::max(first, order::clamp((high - 0.5).floor() + 1.0, 0.0, n as f64) as usize)
    }
}

/// A point of a triangle.
fn texel(mesh: &Mesh, index: u32, triangle: u32, weights: [f64; 3]) -> Texel {
    let fold = |rows: [[f32; 3]; 3]| -> [f64; 3] {
        std::array::from_fn(|k| {
            (weights[0] * f64::from(rows[0][k]) + weights[1] * f64::from(rows[1][k]))
                + weights[2] * f64::from(rows[2][k])
        })
    };
    let corners = mesh.corners(triangle as usize);
    let smooth = if mesh.normals.is_empty() {
        [0.0; 3]
    } else {
        unit(fold(mesh.triangles[triangle as usize].map(|v| mesh.normals[v as usize])))
    };
    let normal = if smooth == [0.0; 3] { unit(cross(corners[0], corners[1], corners[2])) } else { smooth };
    Texel {
        index,
        triangle,
        barycentric: weights.map(|w| w as f32),
        position: fold(corners).map(|x| x as f32),
        normal: normal.map(|x| x as f32),
    }
}

/// Returns the covered texels in order of their index; `chart_of` is the chart of each triangle.
///
/// # Errors
/// Returns an error if the mesh is not valid, has no texture coordinates, or a size is out of range.
///
/// # Example
/// A square over the left half of the image covers two of four texels.
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::texels::{cover, fill};
/// use lastlight::scene::mesh::Mesh;
/// let mesh = Mesh {
///     positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [0.0, 2.0, 0.0]],
///     uvs: vec![[0.0, 1.0], [0.5, 1.0], [0.5, 0.0], [0.0, 0.0]],
///     triangles: vec![[0, 1, 2], [0, 2, 3]],
///     ..Mesh::default()
/// };
/// let texels = cover(&mesh, &[0, 0], [2, 2])?;
/// assert_eq!(texels.len(), 2);
/// assert_eq!((texels[1].index, texels[1].position), (2, [0.5, 0.5, 0.0]));
/// assert_eq!(fill(&texels, [2, 2], 1), [0, 0, 1, 1]);
/// # Ok::<(), lastlight::Error>(())
/// ```
pub fn cover(mesh: &Mesh, chart_of: &[u32], size: [usize; 2]) -> Result<Vec<Texel>> {
    mesh.validate("mesh")?;
    let [w, h] = size;
    if mesh.uvs.len() != mesh.positions.len() || chart_of.len() != mesh.triangles.len() {
        let e = Error::input("mesh").expected("a texture coordinate per vertex and a chart per triangle");
        return Err(e.got(format!("{} and {}", mesh.uvs.len(), chart_of.len())));
    }
    if !(1..=MAX_SIZE).contains(&w) || !(1..=MAX_SIZE).contains(&h) {
        return Err(Error::input("texture")
            .expected(format!("1 to {MAX_SIZE} texels per side"))
            .got(format!("{w}×{h}")));
    }
    let bands = h.div_ceil(ROWS);
    let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
    for t in 0..mesh.triangles.len() {
        let rows = Flat::of(mesh, t, size).range(1, h);
        if !rows.is_empty() {
            (rows.start / ROWS..=(rows.end - 1) / ROWS).for_each(|band| of_band[band].push(t as u32));
        }
    }
    let covered = par::map(bands, |band| {
        let (first, end) = (band * ROWS, order::min((band + 1) * ROWS, h));
        let mut found: Vec<Option<(u32, [f64; 3])>> = vec![None; (end - first) * w];
        for &t in &of_band[band] {
            let flat = Flat::of(mesh, t as usize, size);
            let rows = flat.range(1, h);
            for y in order::max(rows.start, first)..order::min(rows.end, end) {
                for x in flat.range(0, w) {
                    let place = &mut found[(y - first) * w + x];
                    if place.is_none() {
                        *place = flat.weights([x as f64 + 0.5, y as f64 + 0.5]).map(|weights| (t, weights));
                    }
                }
            }
        }
        let texel = |(i, found): (usize, &Option<(u32, [f64; 3])>)| {
            found.map(|(t, weights)| texel(mesh, (first * w + i) as u32, t, weights))
        };
        found.iter().enumerate().filter_map(texel).collect::<Vec<_>>()
    });
    let mut out = covered.concat();
    small_charts(mesh, chart_of, size, &mut out);
    Ok(out)
}

/// Adds a texel for each chart that has none.
fn small_charts(mesh: &Mesh, chart_of: &[u32], size: [usize; 2], texels: &mut Vec<Texel>) {
    let count = chart_of.iter().fold(0, |n, &c| order::max(n, c as usize + 1));
    let mut is_covered = vec![false; count];
    texels.iter().for_each(|t| is_covered[chart_of[t.triangle as usize] as usize] = true);
    for (t, &chart) in chart_of.iter().enumerate() {
        if std::mem::replace(&mut is_covered[chart as usize], true) {
            continue;
        }
        let p = Flat::of(mesh, t, size).p;
        let [x, y] = [0, 1].map(|k| {
            let middle = ((p[0][k] + p[1][k]) + p[2][k]) / 3.0;
            order::clamp(middle, 0.0, (size[k] - 1) as f64) as usize
        });
        let index = (y * size[0] + x) as u32;
        if let Err(place) = texels.binary_search_by_key(&index, |t| t.index) {
            texels.insert(place, texel(mesh, index, t as u32, [1.0 / 3.0; 3]));
        }
    }
}

/// Returns for every texel the position in `texels` of the one whose value it takes: itself if it is covered,
/// else the nearest one, of equally near ones that of the smallest index; [`NONE`] if the distance of the
/// centres is larger than `radius`.
pub fn fill(texels: &[Texel], [w, h]: [usize; 2], radius: usize) -> Vec<u32> {
    let mut source = vec![NONE; w * h];
    for (i, t) in texels.iter().enumerate() {
        source[t.index as usize] = i as u32;
    }
    // By column: the nearest covered row at or above, and at or below, each texel.
    let mut above: Vec<u32> =
        source.iter().zip(0_u32..).map(|(s, i)| if *s == NONE { NONE } else { i / w as u32 }).collect();
    let mut below = above.clone();
    for i in w..w * h {
        if above[i] == NONE {
            above[i] = above[i - w];
        }
        let j = w * h - 1 - i;
        if below[j] == NONE {
            below[j] = below[j + w];
        }
    }
    let nearest = |x: usize, y: usize| {
        let (mut best, mut index) = (radius.saturating_mul(radius), usize::MAX);
        for dx in 0..w {
            if dx * dx > best {
                break;
            }
            let columns = [x.checked_sub(dx), Some(x + dx).filter(|x| *x < w)];
            for column in columns.into_iter().flatten() {
                for row in [above[y * w + column], below[y * w + column]] {
                    if row != NONE {
                        let at = row as usize * w + column;
                        let dy = (row as usize).abs_diff(y);
                        (best, index) = order::min((best, index), (dx * dx + dy * dy, at));
                    }
                }
            }
        }
        index
    };
    let covered = source.clone();
    par::chunks_mut(&mut source, w, |y, row| {
        for (x, s) in row.iter_mut().enumerate().filter(|(_, s)| **s == NONE) {
            *s = covered.get(nearest(x, y)).copied().unwrap_or(NONE);
        }
    });
    source
}
