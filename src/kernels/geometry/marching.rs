//! The surface where a volume of samples changes its sign, as a closed mesh (marching cubes at 0).
//!
//! A sample v is inside if v < 0; both zeros are outside, and so is everything beyond the box.
//!
//! | symbol | field | shape | unit, range |
//! |---|---|---|---|
//! | v | `values` | (nx, ny, nz) | finite, negative inside; last axis fastest |
//! | o | `origin` | (3) | scene units, position of sample (0, 0, 0) |
//! | h | `spacing` | (3) | scene units, positive |
//!
//! # Vertices
//! One per crossed edge between neighbouring samples: t = v₀/(v₀ − v₁) with v₀ the sample of the smaller index,
//! position = o + h·(index + t). On an edge that leaves the box the vertex is the sample inside, so the surface
//! lies in the box and is closed at its border. Order: by (x, y) index of the smaller sample, then axis, then z;
//! behind them the centres of loops that have one (see *Triangles*), by cell.
//!
//! # Ambiguous faces
//! A face with corners a, c inside and b, d outside (a opposite c) joins a and c if its bilinear saddle value is
//! negative, that is if a·c > b·d (asymptotic decider; Nielson and Hamann 1991); a tie separates them, because a saddle value of
//! 0 is outside. The products of two f32 are exact in f64. The decision depends on the four values only, so both
//! cells of a face take the same one.
//!
//! # Triangles
//! Of the cells in order, counter-clockwise seen from outside; the triangles of a cell are derived from its
//! faces in `cells`, which also contains the proof that every edge is in exactly two triangles, with opposite
//! directions. Loops in one cell stay separate: a tunnel that a trilinear function would have inside
//! one cell is not resolved. A sample of exactly 0 gives vertices that coincide and triangles without area; they remain,
//! because removing them would open the surface.
//!
//! # Rounding
//! f64 until the position, which is rounded to f32 once: ((o + h·(i + t))), with t one quotient of one
//! difference. A centre is the left fold of the rounded positions of its loop over their number.

use super::cells::{self, CENTRES, Cell, Table};
use crate::num::{order, par};
use crate::scene::mesh::{MAX_ELEMENTS, Mesh};
use crate::{Error, Result};

/// Samples of a function on a regular grid.
#[derive(Clone, Copy, Debug)]
pub struct Volume<'a> {
    /// (nx, ny, nz), negative inside.
    pub values: &'a [f32],
    /// nx, ny, nz.
    pub size: [usize; 3],
    /// Position of the first sample.
    pub origin: [f32; 3],
    /// Distance of neighbouring samples along each axis.
    pub spacing: [f32; 3],
}

impl Volume<'_> {
    /// Checks sizes and ranges.
    ///
    /// # Errors
    /// Names the field.
    pub fn validate(&self) -> Result<()> {
        let [nx, ny, nz] = self.size;
        let count = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz));
        if count != Some(self.values.len()) {
            let e = Error::input("volume").expected(format!("{nx}×{ny}×{nz} values"));
            return Err(e.got(self.values.len().to_string()));
        }
        if self.size.iter().any(|&n| n > 1 << 20) {
            return Err(Error::input("volume")
                .expected("at most 2²⁰ samples per axis")
                .got(format!("{:?}", self.size)));
        }
        if let Some(i) = self.values.iter().position(|v| !v.is_finite()) {
            let e = Error::input("volume").at(format!("value {i}")).expected("a finite number");
            return Err(e.got(self.values[i].to_string()));
        }
        if !self.origin.iter().all(|x| x.is_finite())
            || !self.spacing.iter().all(|x| *x > 0.0 && x.is_finite())
        {
            let e = Error::input("volume")
                .at("origin and spacing")
                .expected("a finite origin, positive spacings");
            return Err(e.got(format!("{:?}, {:?}", self.origin, self.spacing)));
        }
        Ok(())
    }
}

/// The volume with a border of outside samples on every side, as bits. Indices with this border start at 0.
struct Padded<'a> {
    volume: &'a Volume<'a>,
    size: [usize; 3],
    /// Words per row along z.
    words: usize,
    /// (x, y, word): a bit for each inside sample.
    inside: Vec<u64>,
    /// (x, y, axis, word): index of the first vertex of the edges along that axis.
    starts: Vec<u32>,
    vertices: usize,
}

impl<'a> Padded<'a> {
    fn new(volume: &'a Volume<'a>) -> Result<Self> {
        let size = volume.size.map(|n| n + 2);
        let words = size[2].div_ceil(64);
        let [_, ny, nz] = volume.size;
        let mut inside = vec![0_u64; size[0] * size[1] * words];
        par::chunks_mut(&mut inside, size[1] * words, |x, slab| {
            for y in 0..if x == 0 || x + 1 == size[0] { 0 } else { ny } {
                let from = ((x - 1) * ny + y) * nz;
                let row = &mut slab[(y + 1) * words..(y + 2) * words];
                for (z, v) in volume.values[from..from + nz].iter().enumerate() {
                    row[(z + 1) / 64] |= u64::from(*v < 0.0) << ((z + 1) % 64);
                }
            }
        });
        let mut padded = Self { volume, size, words, inside, starts: Vec::new(), vertices: 0 };
        let counts = par::map(size[0], |x| {
            let rows = (0..size[1]).flat_map(|y| (0..3 * words).map(move |k| (y, k / words, k % words)));
            rows.map(|(y, axis, w)| padded.crossed(x, y, axis, w).count_ones()).collect::<Vec<_>>()
        });
        let mut total = 0_usize;
        for count in counts.iter().flatten() {
            padded.starts.push(total as u32);
            total += *count as usize;
            if total > MAX_ELEMENTS {
                return Err(too_many());
            }
        }
        padded.vertices = total;
        Ok(padded)
    }

    /// Bits of the samples 64·w.. of a row; none beyond the border.
    #[inline]
    fn row(&self, x: usize, y: usize, w: usize) -> u64 {
        if x < self.size[0] && y < self.size[1] && w < self.words {
            self.inside[(x * self.size[1] + y) * self.words + w]
        } else {
            0
        }
    }

    /// A bit for each sample whose edge along the axis is crossed.
    #[inline]
    fn crossed(&self, x: usize, y: usize, axis: usize, w: usize) -> u64 {
        let own = self.row(x, y, w);
        own ^ match axis {
            0 => self.row(x + 1, y, w),
            1 => self.row(x, y + 1, w),
            _ => own >> 1 | self.row(x, y, w + 1) << 63,
        }
    }

    /// Index of the vertex on the edge from a sample along an axis.
    #[inline]
    fn vertex(&self, at: [usize; 3], axis: usize) -> u32 {
        let (w, bit) = (at[2] / 64, at[2] % 64);
        let start = self.starts[((at[0] * self.size[1] + at[1]) * 3 + axis) * self.words + w];
        start + (self.crossed(at[0], at[1], axis, w) & ((1 << bit) - 1)).count_ones()
    }

    /// The value of a sample; `None` in the border.
    #[inline]
    fn value(&self, at: [usize; 3]) -> Option<f32> {
        let n = self.volume.size;
        let is_real = (0..3).all(|k| (1..=n[k]).contains(&at[k]));
        is_real.then(|| self.volume.values[((at[0] - 1) * n[1] + (at[1] - 1)) * n[2] + (at[2] - 1)])
    }

    /// The vertex on a crossed edge.
    fn position(&self, at: [usize; 3], axis: usize) -> [f32; 3] {
        let mut end = at;
        end[axis] += 1;
        let t = match (self.value(at), self.value(end)) {
            (Some(a), Some(b)) => f64::from(a) / (f64::from(a) - f64::from(b)),
            // The end that is not in the border is the one inside.
            (Some(_), None) => 0.0,
            (None, _) => 1.0,
        };
        std::array::from_fn(|k| {
            let index = at[k] as f64 - 1.0 + if k == axis { t } else { 0.0 };
            (f64::from(self.volume.origin[k]) + f64::from(self.volume.spacing[k]) * index) as f32
        })
    }

    /// The vertices of a row in order.
    fn positions(&self, x: usize, y: usize) -> Vec<[f32; 3]> {
        let mut out = Vec::new();
        for axis in 0..3 {
            for w in 0..self.words {
                for bit in bits(self.crossed(x, y, axis, w)) {
                    out.push(self.position([x, y, 64 * w + bit], axis));
                }
            }
        }
        out
    }

    /// The cell whose smallest corner is `at`, if the surface passes through it.
    fn cell(&self, table: &'static Table, at: [usize; 3], inside: u8) -> &'static Cell {
        let mut joined = 0;
        for face in bits(u64::from(table.ambiguous(inside))) {
            let v = cells::corners(face as u8).map(|c| {
                let corner = std::array::from_fn(|k| at[k] + usize::from(c >> k & 1));
                f64::from(self.value(corner).expect("an ambiguous face has no corner in the border"))
            });
            // The products of the inside pair and of the outside pair, whichever is which.
            let (even, odd) = (v[0] * v[2], v[1] * v[3]);
            let is_joined = if v[0] < 0.0 { even > odd } else { odd > even };
            joined |= u8::from(is_joined) << face;
        }
        table.cell(inside, joined)
    }

    /// Triangles of the cells from slab x to x + 1, and the loops that have a centre; their vertices are
    /// numbered from `self.vertices` on.
    fn slab(&self, x: usize) -> Slab {
        let (table, mut out) = (cells::table(), Slab::default());
        for y in 0..self.size[1] - 1 {
            for w in 0..self.words {
                let rows = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| {
                    let own = self.row(x + i, y + j, w);
                    [own, own >> 1 | self.row(x + i, y + j, w + 1) << 63]
                });
                let any = rows.iter().fold(0, |a, [p, q]| a | p | q);
                let all = rows.iter().fold(u64::MAX, |a, [p, q]| a & p & q);
                for bit in bits(any & !all) {
                    let at = [x, y, 64 * w + bit];
                    let inside =
                        (0..8_usize).fold(0, |s, c| s | ((rows[c & 3][c >> 2] >> bit & 1) as u8) << c);
                    self.emit(self.cell(table, at, inside), at, &mut out);
                }
            }
        }
        out
    }

    fn emit(&self, cell: &Cell, at: [usize; 3], out: &mut Slab) {
        let vertex = |e: u8| {
            let (axis, low) = cells::edge(e);
            self.vertex(std::array::from_fn(|k| at[k] + usize::from(low >> k & 1)), usize::from(axis))
        };
        let first = self.vertices + out.fans.len();
        for t in &cell.triangles {
            let id =
                |&e: &u8| if e < CENTRES { vertex(e) } else { (first + usize::from(e - CENTRES)) as u32 };
            out.triangles.push([id(&t[0]), id(&t[1]), id(&t[2])]);
        }
        out.fans.extend(cell.fans.iter().map(|f| f.iter().map(|&e| vertex(e)).collect()));
    }
}

/// The surface in one layer of cells.
#[derive(Default)]
struct Slab {
    triangles: Vec<[u32; 3]>,
    /// Vertices of the loops that have a centre.
    fans: Vec<Vec<u32>>,
}

fn too_many() -> Error {
    Error::input("volume")
        .at("surface")
        .expected(format!("at most {MAX_ELEMENTS} vertices and triangles"))
        .got("more")
}

/// The set bits of a word, ascending.
fn bits(word: u64) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(word), |w| Some(w & w.wrapping_sub(1)))
        .take_while(|w| *w != 0)
        .map(|w| w.trailing_zeros() as usize)
}

/// The mean of vertices, as the module documentation defines it.
fn mean(positions: &[[f32; 3]], of: &[u32]) -> [f32; 3] {
    let sum = of.iter().fold([0.0_f64; 3], |sum, &i| {
        let p = positions[i as usize];
        std::array::from_fn(|k| sum[k] + f64::from(p[k]))
    });
    sum.map(|x| (x / of.len() as f64) as f32)
}

/// Returns the surface of a volume, without normals and texture coordinates.
///
/// # Errors
/// Returns an error if a value is not finite, a size is wrong, or there are more than [`MAX_ELEMENTS`]
/// vertices or triangles.
///
/// # Example
/// One inside sample gives an octahedron; its vertices are halfway to its neighbours where those are +1, and at
/// the sample itself where the box ends.
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::marching::{Volume, surface};
/// let values = [1.0, -1.0, 1.0];
/// let size = [1, 1, 3];
/// let mesh = surface(&Volume { values: &values, size, origin: [0.0; 3], spacing: [1.0; 3] })?;
/// assert_eq!((mesh.positions.len(), mesh.triangles.len()), (6, 8));
/// assert_eq!(mesh.bounds(), [[0.0, 0.0, 0.5], [0.0, 0.0, 1.5]]);
/// # Ok::<(), lastlight::Error>(())
/// ```
pub fn surface(volume: &Volume<'_>) -> Result<Mesh> {
    volume.validate()?;
    let padded = Padded::new(volume)?;
    let [nx, ny, _] = padded.size;
    let rows = par::map_batched(nx * ny, 16, |i| padded.positions(i / ny, i % ny));
    let mut mesh = Mesh { positions: rows.concat(), ..Mesh::default() };
    drop(rows);
    let slabs = par::map(nx - 1, |x| padded.slab(x));
    let (mut centres, edges) = (0, padded.vertices as u32);
    if slabs.iter().fold(0, |n, s| order::max(n + s.triangles.len(), n + s.fans.len())) > MAX_ELEMENTS {
        return Err(too_many());
    }
    for slab in slabs {
        let shift = |i: u32| if i < edges { i } else { i + centres };
        mesh.triangles.extend(slab.triangles.iter().map(|t| t.map(shift)));
        centres += slab.fans.len() as u32;
        for f in &slab.fans {
            let centre = mean(&mesh.positions, f);
            mesh.positions.push(centre);
        }
    }
    Ok(mesh)
}
