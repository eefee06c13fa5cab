//! Texture coordinates: charts of a mesh in a square, without overlap and with one texel density.
//!
//! | property | how |
//! |---|---|
//! | no overlap | `charts`: every chart is one to one; `packing`: no two charts touch a common texel |
//! | limited stretch | the projected area of a triangle is at least 0.55 of its area, and all charts have one scale: texel densities differ by at most a factor of 1.82 |
//! | gutter | at least `gutter` texels between the texels that two charts touch, so that bilinear lookups and the first mip levels stay in a chart |
//! | half of the texels or more, by search and not guaranteed | if the charts cover less than 0.55 of the square, those longer than half of the longest are split, up to 8 times; the best layout is used |
//! | no mirroring | seen from outside, the image is not mirrored |
//!
//! A vertex of a chart is a vertex of the result; vertices are in the order in which the triangles use them, and
//! triangles keep their order. Coordinates are (0, 0) at the top left, v down, and multiples of 2⁻²⁴, so that 1 − v is exact (OBJ
//! counts v from the bottom).
//!
//! # Rounding
//! f64 from the positions on: projection by two left-fold dot products, rotation to the smallest
//! bounding rectangle, then scale and place; one division by the size, rounded to the nearest multiple of 2⁻²⁴.

use super::charts::{self, Chart, bounds};
use super::packing::{self, Flat, Place};
use crate::num::{order, par};
use crate::scene::mesh::Mesh;
use crate::{Error, Result};

/// Steps of a texture coordinate from 0 to 1.
const STEPS: f64 = (1 << 24) as f64;

/// Fraction of the square from which on charts are not split.
const ENOUGH: f64 = 0.55;

/// Most rounds of splitting.
const SPLITS: usize = 8;

/// Largest number of texels per side.
pub const MAX_SIZE: usize = 1 << 14;

/// Size and gutter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Texels per side, 16 to [`MAX_SIZE`].
    pub size: usize,
    /// Texels between charts.
    pub gutter: usize,
}

impl Default for Settings {
    /// 1024² texels, 4 between charts.
    fn default() -> Self {
        Self { size: 1024, gutter: 4 }
    }
}

/// A mesh with texture coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atlas {
    /// With `uvs`; vertices are doubled at borders of charts.
    pub mesh: Mesh,
    /// (V) vertex of the original mesh.
    pub source: Vec<u32>,
    /// (T) chart of each triangle.
    pub chart_of: Vec<u32>,
    /// Number of charts.
    pub charts: usize,
    /// Texels per unit of length in the planes of the charts.
    pub texels_per_unit: f64,
}

/// Makes texture coordinates for a mesh; existing ones are replaced.
///
/// # Errors
/// Returns an error if the mesh is not valid or has no area, the size is out of range, or the charts do not fit.
///
/// # Example
/// The two triangles of a square are one chart and keep their four vertices.
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::atlas::{Settings, unwrap};
/// use lastlight::scene::mesh::Mesh;
/// let positions = vec![[0.0; 3], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]];
/// let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
/// let atlas = unwrap(&mesh, &Settings { size: 256, gutter: 4 })?;
/// assert_eq!((atlas.charts, atlas.mesh.positions.len()), (1, 4));
/// # Ok::<(), lastlight::Error>(())
/// ```
pub fn unwrap(mesh: &Mesh, settings: &Settings) -> Result<Atlas> {
    mesh.validate("mesh")?;
    let Settings { size, gutter } = *settings;
    if !(16..=MAX_SIZE).contains(&size) || gutter > size {
        let e =
            Error::input("atlas").expected(format!("16 to {MAX_SIZE} texels per side and a smaller gutter"));
        return Err(e.got(format!("{size}, {gutter}")));
    }
    let mut best = layout(mesh, charts::charts(mesh), settings)?;
    let mut last = best.clone();
    for _ in 0..SPLITS {
        if best.used(size) >= ENOUGH {
            break;
        }
        let longest = last.extents.iter().fold(0.0, |a, b| order::max(a, *b));
        let extents = last.extents;
        let next = charts::split(mesh, last.charts, |i| 2.0 * extents[i] > longest);
        last = layout(mesh, next, settings)?;
        if last.places.is_empty() {
            break;
        }
        if best.places.is_empty() || last.used(size) > best.used(size) {
            best = last.clone();
        }
    }
    if best.places.is_empty() {
        let e = Error::input("atlas").at("size").expected(format!("room for {} charts", best.charts.len()));
        return Err(e.got(format!("{size}×{size} texels")).hint("smooth the mesh, or use a larger texture"));
    }
    let uv = |i: usize, v: u32| coordinate(&best.places[i], best.plane(mesh, i, v), size);
    Ok(assemble(mesh, &best.charts, best.texels_per_unit, uv))
}

/// Charts with their places.
#[derive(Clone)]
struct Layout {
    charts: Vec<Chart>,
    /// Cosine and sine of the rotation of each chart.
    turns: Vec<[f64; 2]>,
    /// The longer side of the bounding rectangle of each chart.
    extents: Vec<f64>,
    /// Projected area of all charts.
    area: f64,
    /// None if the charts do not fit.
    places: Vec<Place>,
    texels_per_unit: f64,
}

impl Layout {
    /// A vertex in the plane of a chart, rotated.
    fn plane(&self, mesh: &Mesh, chart: usize, v: u32) -> [f64; 2] {
        let [x, y] = self.charts[chart].map(mesh.positions[v as usize].map(f64::from));
        let [c, s] = self.turns[chart];
        [c * x + s * y, c * y - s * x]
    }

    /// The fraction of the square that the charts cover.
    fn used(&self, size: usize) -> f64 {
        self.area * (self.texels_per_unit / size as f64) * (self.texels_per_unit / size as f64)
    }
}

/// Rotates and packs charts.
fn layout(mesh: &Mesh, charts: Vec<Chart>, settings: &Settings) -> Result<Layout> {
    let turns = par::map(charts.len(), |i| upright(mesh, &charts[i]));
    let (extents, places) = (Vec::new(), Vec::new());
    let mut out = Layout { charts, turns, extents, area: 0.0, places, texels_per_unit: 0.0 };
    let flat: Vec<Flat> = par::map(out.charts.len(), |i| {
        out.charts[i]
            .triangles
            .iter()
            .map(|&t| mesh.triangles[t as usize].map(|v| out.plane(mesh, i, v)))
            .collect()
    });
    out.area = flat.iter().flatten().fold(0.0, |sum, [a, b, c]| {
        sum + 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
    });
    if !(out.area > 0.0 && out.area.is_finite()) {
        return Err(Error::input("mesh").at("surface").expected("a positive area").got(out.area.to_string()));
    }
    let extent = |chart: &Flat| {
        let [low, high] = bounds(chart.iter().flatten().copied()).unwrap_or_default();
        order::max(high[0] - low[0], high[1] - low[1])
    };
    out.extents = flat.iter().map(extent).collect();
    if let Some((places, scale)) = packing::pack(&flat, out.area, settings.size, settings.gutter) {
        (out.places, out.texels_per_unit) = (places, scale);
    }
    Ok(out)
}

/// A texture coordinate.
fn coordinate(place: &Place, p: [f64; 2], size: usize) -> [f32; 2] {
    place.map(p).map(|x| ((x / size as f64 * STEPS).round() / STEPS) as f32)
}

/// Cosine and sine of the rotation to the bounding rectangle with the smallest area, along an edge of the
/// convex hull; of equal rectangles, the first edge.
fn upright(mesh: &Mesh, chart: &Chart) -> [f64; 2] {
    let vertices = chart.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]);
    let hull = hull(vertices.map(|v| chart.map(mesh.positions[v as usize].map(f64::from))).collect());
    let (mut best, mut least) = ([1.0, 0.0], f64::INFINITY);
    for (i, a) in hull.iter().enumerate() {
        let b = hull[(i + 1) % hull.len()];
        let d = [b[0] - a[0], b[1] - a[1]];
        let length = (d[0] * d[0] + d[1] * d[1]).sqrt();
        if !(length > 0.0) {
            continue;
        }
        let [c, s] = d.map(|x| x / length);
        let turned = hull.iter().map(|p| [c * p[0] + s * p[1], c * p[1] - s * p[0]]);
        let [low, high] = bounds(turned).unwrap_or_default();
        let area = (high[0] - low[0]) * (high[1] - low[1]);
        if area < least {
            (best, least) = ([c, s], area);
        }
    }
    best
}

/// The convex hull of points, counter-clockwise (monotone chain).
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut out: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while let [.., a, b] = out[..] {
                if (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0.0 {
                    break;
                }
                out.pop();
            }
            out.push(p);
        }
        out.pop();
        out
    };
    let mut lower = chain(&mut points.iter().copied());
    lower.extend(chain(&mut points.iter().rev().copied()));
    lower
}

/// The mesh with a vertex for each pair of chart and vertex.
fn assemble(
    mesh: &Mesh,
    charts: &[Chart],
    texels_per_unit: f64,
    uv: impl Fn(usize, u32) -> [f32; 2],
) -> Atlas {
    let mut out = Atlas {
        chart_of: vec![0; mesh.triangles.len()],
        charts: charts.len(),
        texels_per_unit,
        ..Atlas::default()
    };
    for (i, chart) in charts.iter().enumerate() {
        chart.triangles.iter().for_each(|&t| out.chart_of[t as usize] = i as u32);
    }
    // By vertex: charts that contain it, and its number there.
    let mut known: Vec<Vec<(u32, u32)>> = vec![Vec::new(); mesh.positions.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let chart = out.chart_of[t];
        let number = corners.map(|v| {
            if let Some(&(_, n)) = known[v as usize].iter().find(|(c, _)| *c == chart) {
                return n;
            }
            let n = out.source.len() as u32;
            known[v as usize].push((chart, n));
            out.source.push(v);
            out.mesh.uvs.push(uv(chart as usize, v));
            n
        });
        out.mesh.triangles.push(number);
    }
    let rows = |rows: &[[f32; 3]]| -> Vec<[f32; 3]> {
        if rows.is_empty() { Vec::new() } else { out.source.iter().map(|&v| rows[v as usize]).collect() }
    };
    (out.mesh.positions, out.mesh.normals) = (rows(&mesh.positions), rows(&mesh.normals));
    debug_assert!(out.mesh.uvs.iter().flatten().all(|x| order::clamp(*x, 0.0, 1.0) == *x), "in the square");
    out
}
