//! Volumes and meshes with known properties, and checks of meshes.

use lastlight::geometry::marching::{Volume, surface};
use lastlight::num::rng::Rng;
use lastlight::scene::mesh::Mesh;
use std::collections::BTreeMap;

/// Samples of a function of (x, y, z) in −1..1 on n³ points.
pub(crate) fn samples(n: usize, f: impl Fn([f64; 3]) -> f64) -> Vec<f32> {
    let at = |i: usize| -1.0 + 2.0 * i as f64 / (n - 1) as f64;
    (0..n * n * n).map(|i| f([at(i / (n * n)), at(i / n % n), at(i % n)]) as f32).collect()
}

/// The surface of such samples.
pub(crate) fn marched(n: usize, f: impl Fn([f64; 3]) -> f64) -> Mesh {
    let values = samples(n, f);
    let spacing = [2.0 / (n - 1) as f32; 3];
    surface(&Volume { values: &values, size: [n; 3], origin: [-1.0; 3], spacing }).expect("a volume")
}

pub(crate) fn length(p: [f64; 3]) -> f64 {
    (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt()
}

/// Distance to a sphere around the origin.
pub(crate) fn sphere(r: f64) -> impl Fn([f64; 3]) -> f64 {
    move |p| length(p) - r
}

/// Distance to a torus around z.
pub(crate) fn torus(large: f64, small: f64) -> impl Fn([f64; 3]) -> f64 {
    move |p| {
        let q = (p[0] * p[0] + p[1] * p[1]).sqrt() - large;
        (q * q + p[2] * p[2]).sqrt() - small
    }
}

/// A sphere with bumps in every direction and a handle-free but folded surface.
pub(crate) fn bumpy(p: [f64; 3]) -> f64 {
    let s = |x: f64| libm::sin(9.0 * x);
    length(p) - 0.62 - 0.09 * s(p[0]) * s(p[1] + 0.3) * s(p[2] + 0.7) - 0.05 * libm::sin(4.0 * p[2])
}

/// A cube of half-size ½ whose faces have n × n squares, not aligned with the axes if `turned`.
pub(crate) fn cube(n: usize, turned: bool) -> Mesh {
    let mut mesh = Mesh::default();
    let mut known = BTreeMap::new();
    for face in 0..6 {
        let (axis, side) = (face / 2, face % 2);
        let mut vertex = |i: usize, j: usize| {
            let (i, j) = if side == 1 { (i, j) } else { (j, i) };
            let mut at = [0; 3];
            (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side * n, i, j);
            *known.entry(at).or_insert_with(|| {
                let p = at.map(|k| k as f64 / n as f64 - 0.5);
                let (x, y) = if turned {
                    ((p[0] - p[1]) * 0.5f64.sqrt(), (p[0] + p[1]) * 0.5f64.sqrt())
                } else {
                    (p[0], p[1])
                };
                mesh.positions.push([x as f32, y as f32, p[2] as f32]);
                mesh.positions.len() as u32 - 1
            })
        };
        for i in 0..n {
            for j in 0..n {
                let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    mesh
}

/// Numbers in −1..1.
pub(crate) fn draws(n: usize, item: u64) -> Vec<f64> {
    let rng = Rng::new(17);
    (0..n).map(|i| 2.0 * rng.uniform_f64(i as u64, item as u32, 0x6720, 0) - 1.0).collect()
}

/// Checks that every edge is in exactly two triangles with opposite directions and the triangles around every
/// vertex form one cycle; returns vertices − edges + faces.
pub(crate) fn euler(mesh: &Mesh) -> Result<i64, String> {
    let mut next = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        if a == b || b == c || c == a {
            return Err(format!("triangle {:?} repeats a vertex", [a, b, c]));
        }
        for (p, q, r) in [(a, b, c), (b, c, a), (c, a, b)] {
            if next.insert((p, q), r).is_some() {
                return Err(format!("the edge {p} → {q} is in two triangles"));
            }
        }
    }
    if let Some((p, q)) = next.keys().find(|(p, q)| !next.contains_key(&(*q, *p))) {
        return Err(format!("the edge {p} → {q} has no other side"));
    }
    let mut around = vec![0; mesh.positions.len()];
    next.keys().for_each(|&(p, _)| around[p as usize] += 1);
    for (v, &n) in around.iter().enumerate() {
        let Some((&(_, first), _)) = next.range((v as u32, 0)..=(v as u32, u32::MAX)).next() else {
            return Err(format!("vertex {v} has no triangle"));
        };
        let (mut q, mut steps) = (first, 0);
        loop {
            q = next[&(v as u32, q)];
            steps += 1;
            if q == first {
                break;
            }
        }
        if steps != n {
            return Err(format!("the triangles around vertex {v} form several cycles"));
        }
    }
    Ok(mesh.positions.len() as i64 - next.len() as i64 / 2 + mesh.triangles.len() as i64)
}

fn wide(mesh: &Mesh, t: usize) -> [[f64; 3]; 3] {
    mesh.corners(t).map(|p| p.map(f64::from))
}

pub(crate) fn cross(u: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

pub(crate) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// Area, and the signed volume that is enclosed.
pub(crate) fn area_and_volume(mesh: &Mesh) -> [f64; 2] {
    (0..mesh.triangles.len()).fold([0.0; 2], |[area, volume], t| {
        let [a, b, c] = wide(mesh, t);
        let (n, m) = (cross(minus(b, a), minus(c, a)), cross(b, c));
        [area + 0.5 * length(n), volume + (a[0] * m[0] + a[1] * m[1] + a[2] * m[2]) / 6.0]
    })
}
