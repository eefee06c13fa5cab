//! Connected parts of a mesh, and cavities of a volume.
//!
//! Two triangles are connected if they share a vertex index. Parts are numbered by their first triangle.
//!
//! # Rounding
//! The area of a part is the left fold of ½‖(b − a) × (c − a)‖ over its triangles in index order, in f64.

use super::marching::Volume;
use crate::num::order;
use crate::scene::mesh::Mesh;
use crate::{Error, Result};

/// The part of every triangle.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Components {
    /// (T) part of each triangle.
    pub of: Vec<u32>,
    /// Number of parts.
    pub count: usize,
}

/// Which parts of a mesh are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Keep {
    /// The part with the largest area; of equal ones the first.
    Largest,
    /// Parts whose area is at least this fraction of the largest, from 0 to 1.
    Fraction(f64),
}

/// Disjoint sets whose representative is their smallest member.
pub(super) struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    /// One set per member.
    pub(super) fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    /// Smallest member of a set.
    pub(super) fn find(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let above = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = above;
            i = above;
        }
        i
    }

    /// Joins two sets and returns the representative.
    pub(super) fn join(&mut self, a: u32, b: u32) -> u32 {
        let (a, b) = (self.find(a), self.find(b));
        let (low, high) = (order::min(a, b), order::max(a, b));
        self.parent[high as usize] = low;
        low
    }
}

/// ½‖(b − a) × (c − a)‖ of a triangle.
pub(super) fn area([a, b, c]: [[f32; 3]; 3]) -> f64 {
    let n = cross(a, b, c);
    0.5 * ((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2]).sqrt()
}

/// (b − a) × (c − a) in f64.
pub(super) fn cross(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> [f64; 3] {
    let [u, v] = [b, c].map(|p| std::array::from_fn::<f64, 3, _>(|k| f64::from(p[k]) - f64::from(a[k])));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// Returns the connected parts of `vertices` vertices under triangles with smaller indices.
pub fn components(triangles: &[[u32; 3]], vertices: usize) -> Components {
    let mut sets = Sets::new(vertices);
    for &[a, b, c] in triangles {
        let low = sets.join(a, b);
        sets.join(low, c);
    }
    let (mut number, mut count) = (vec![u32::MAX; vertices], 0_usize);
    let of = triangles.iter().map(|t| {
        let n = &mut number[sets.find(t[0]) as usize];
        if *n == u32::MAX {
            *n = count as u32;
            count += 1;
        }
        *n
    });
    let of = of.collect();
    Components { of, count }
}

/// Returns the area of every part.
pub fn areas(mesh: &Mesh, parts: &Components) -> Vec<f64> {
    let mut out = vec![0.0; parts.count];
    for (t, &part) in parts.of.iter().enumerate() {
        out[part as usize] = out[part as usize] + area(mesh.corners(t));
    }
    out
}

/// Returns the mesh without the other parts. Vertices and triangles keep their order.
///
/// # Errors
/// Returns an error if the fraction is not from 0 to 1.
///
/// # Example
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::components::{Keep, keep};
/// use lastlight::scene::mesh::Mesh;
/// let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0; 3], [5.0, 5.0, 8.0], [5.0, 7.0, 5.0]];
/// let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [3, 4, 5]], ..Mesh::default() };
/// let large = keep(&mesh, Keep::Largest)?;
/// assert_eq!((large.positions.len(), large.positions[1]), (3, [5.0, 5.0, 8.0]));
/// assert_eq!(large.triangles, [[0, 1, 2]]);
/// assert_eq!(keep(&mesh, Keep::Fraction(0.1))?, mesh);
/// # Ok::<(), lastlight::Error>(())
/// ```
pub fn keep(mesh: &Mesh, which: Keep) -> Result<Mesh> {
    let parts = components(&mesh.triangles, mesh.positions.len());
    let areas = areas(mesh, &parts);
    let mut largest = 0;
    for (part, area) in areas.iter().enumerate() {
        if *area > areas[largest] {
            largest = part;
        }
    }
    let kept: Vec<bool> = match which {
        Keep::Largest => (0..areas.len()).map(|part| part == largest).collect(),
        Keep::Fraction(f) if (0.0..=1.0).contains(&f) => {
            areas.iter().map(|a| *a >= f * areas[largest]).collect()
        }
        Keep::Fraction(f) => {
            return Err(Error::input("fraction of the largest part").expected("0 to 1").got(f.to_string()));
        }
    };
    let triangles = mesh.triangles.iter().zip(&parts.of).filter(|(_, part)| kept[**part as usize]);
    Ok(select(mesh, triangles.map(|(t, _)| *t).collect()))
}

/// The mesh with other triangles, without the vertices that they do not use.
fn select(mesh: &Mesh, mut triangles: Vec<[u32; 3]>) -> Mesh {
    let mut is_used = vec![false; mesh.positions.len()];
    triangles.iter().flatten().for_each(|&i| is_used[i as usize] = true);
    let mut count = 0;
    let number = |&used: &bool| {
        count += u32::from(used);
        count - u32::from(used)
    };
    let number: Vec<u32> = is_used.iter().map(number).collect();
    triangles.iter_mut().flatten().for_each(|i| *i = number[*i as usize]);
    Mesh {
        positions: used(&mesh.positions, &is_used),
        normals: used(&mesh.normals, &is_used),
        uvs: used(&mesh.uvs, &is_used),
        triangles,
    }
}

fn used<T: Copy>(rows: &[T], is_used: &[bool]) -> Vec<T> {
    rows.iter().zip(is_used).filter(|(_, used)| **used).map(|(row, _)| *row).collect()
}

/// Makes every outside region inside that is not connected to the space beyond the box, and returns the number
/// of changed samples.
///
/// Outside samples are connected along the axes, and at the border of the box to each other, through the corners
/// of the space around it. A changed sample v becomes −v, and a zero the negative number closest to zero.
///
/// # Errors
/// See [`Volume::validate`].
///
/// # Example
/// ```
/// # use lastlight_kernels as lastlight;
/// use lastlight::geometry::components::fill_cavities;
/// use lastlight::geometry::marching::Volume;
/// let mut values = vec![-1.0; 125];
/// values[62] = 3.0; // the centre of 5×5×5
/// values[0] = 2.0; // a corner
/// let volume = Volume { values: &values, size: [5; 3], origin: [0.0; 3], spacing: [1.0; 3] };
/// let (filled, changed) = fill_cavities(&volume)?;
/// assert_eq!((filled[62], filled[0], changed), (-3.0, 2.0, 1));
/// # Ok::<(), lastlight::Error>(())
/// ```
pub fn fill_cavities(volume: &Volume<'_>) -> Result<(Vec<f32>, usize)> {
    volume.validate()?;
    let ([nx, ny, nz], values) = (volume.size, volume.values);
    let mut reached = vec![false; values.len()];
    let mut open = Vec::new();
    let mut visit = |i: usize, open: &mut Vec<usize>| {
        if !reached[i] && !(values[i] < 0.0) {
            reached[i] = true;
            open.push(i);
        }
    };
    for i in 0..values.len() {
        let (x, y, z) = (i / (ny * nz), i / nz % ny, i % nz);
        if x == 0 || y == 0 || z == 0 || x + 1 == nx || y + 1 == ny || z + 1 == nz {
            visit(i, &mut open);
        }
    }
    while let Some(i) = open.pop() {
        let (x, y, z) = (i / (ny * nz), i / nz % ny, i % nz);
        let steps = [(x, nx, ny * nz), (y, ny, nz), (z, nz, 1)];
        for (at, n, stride) in steps {
            if at > 0 {
                visit(i - stride, &mut open);
            }
            if at + 1 < n {
                visit(i + stride, &mut open);
            }
        }
    }
    let mut changed = 0;
    let fill = |(v, reached): (&f32, &bool)| {
        if *v < 0.0 || *reached {
            return *v;
        }
        changed += 1;
        if *v > 0.0 { -*v } else { -f32::from_bits(1) }
    };
    let filled = values.iter().zip(&reached).map(fill).collect();
    Ok((filled, changed))
}
