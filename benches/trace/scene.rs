//! The mesh and the rays of the record: a torus with bumps, rays from a camera, at random, and bounced.

use lastlight::geometry::bvh::{Bvh, Hit, MISS, Ray};
use lastlight::num::rng::Rng;

pub(crate) struct Mesh {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// The closed torus of 2·u·v triangles.
#[expect(clippy::disallowed_methods, reason = "a bench's scene need not be the same on every machine")]
pub(crate) fn mesh(u: u32, v: u32) -> Mesh {
    let tau = std::f64::consts::TAU;
    let (mut positions, mut triangles) = (vec![], vec![]);
    for i in 0..u {
        for j in 0..v {
            let (a, b) = (tau * f64::from(i) / f64::from(u), tau * f64::from(j) / f64::from(v));
            let d = 0.05 * (9.0 * a).sin() * (7.0 * b).cos()
                + 0.02 * (31.0 * a + 17.0 * b).sin()
                + 0.008 * (97.0 * a - 61.0 * b).sin();
            let r = 0.45 + d;
            let ring = 1.0 + r * b.cos();
            positions.push([(ring * a.cos()) as f32, (ring * a.sin()) as f32, (r * b.sin()) as f32]);
            let at = |i: u32, j: u32| (i % u) * v + j % v;
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    Mesh { positions, triangles }
}

fn unit(d: [f64; 3]) -> [f64; 3] {
    let n = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    d.map(|x| x / n)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
    Ray { origin: origin.map(|x| x as f32), direction: direction.map(|x| x as f32), t_max: f32::INFINITY }
}

/// Camera rays row by row, random rays, and cosine-distributed rays from the camera's hits.
#[expect(clippy::disallowed_methods, reason = "a bench's scene need not be the same on every machine")]
pub(crate) fn rays(bvh: &Bvh, mesh: &Mesh, side: usize) -> Vec<(&'static str, Vec<Ray>)> {
    let r = Rng::new(0);
    let eye = [0.0, -2.8, 1.9];
    let forward = unit(eye.map(|x: f64| -x));
    let right = unit(cross(forward, [0.0, 0.0, 1.0]));
    let up = cross(right, forward);
    let half = (22.5_f64).to_radians().tan();
    let primary: Vec<Ray> = (0..side * side)
        .map(|i| {
            let at = |p: usize| 2.0 * (p as f64 + 0.5) / side as f64 - 1.0;
            let (x, y) = (half * at(i % side), -half * at(i / side));
            ray(eye, unit([0, 1, 2].map(|k| forward[k] + x * right[k] + y * up[k])))
        })
        .collect();
    let random = (0..side * side)
        .map(|i| {
            let n = |d: u16| r.uniform_f64(i as u64, 0, 0, d);
            let (z, a) = (2.0 * n(3) - 1.0, std::f64::consts::TAU * n(4));
            let s = (1.0 - z * z).sqrt();
            ray([0, 1, 2].map(|k| 3.0 * n(k) - 1.5), [s * a.cos(), s * a.sin(), z])
        })
        .collect();
    let mut hits = vec![Hit::NONE; primary.len()];
    bvh.closest_batch(&primary, &mut hits);
    let bounce = hits
        .iter()
        .zip(&primary)
        .enumerate()
        .filter(|(_, (h, _))| h.triangle != MISS)
        .map(|(i, (h, p))| {
            let [a, b, c] =
                mesh.triangles[h.triangle as usize].map(|i| mesh.positions[i as usize].map(f64::from));
            let edge = |q: [f64; 3]| [0, 1, 2].map(|k| q[k] - a[k]);
            let mut n = unit(cross(edge(b), edge(c)));
            let d = p.direction.map(f64::from);
            if d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0 {
                n = n.map(|x| -x);
            }
            let tangent = unit(cross(n, if n[0].abs() < 0.5 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] }));
            let other = cross(n, tangent);
            let (e, f) =
                (r.uniform_f64(i as u64, 1, 0, 0), std::f64::consts::TAU * r.uniform_f64(i as u64, 1, 0, 1));
            let (x, y, z) = (e.sqrt() * f.cos(), e.sqrt() * f.sin(), (1.0 - e).sqrt());
            let at = |k: usize| f64::from(p.origin[k]) + f64::from(h.t) * d[k] + 1e-3 * n[k];
            ray([at(0), at(1), at(2)], [0, 1, 2].map(|k| x * tangent[k] + y * other[k] + z * n[k]))
        })
        .collect();
    vec![("primary", primary), ("random", random), ("bounce", bounce)]
}
