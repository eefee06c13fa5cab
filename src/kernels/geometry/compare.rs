//! Distances between two surfaces: between samples, from samples to the other mesh, and between normals.
//!
//! N samples a_i of A and b_j of B are drawn uniformly by area; n are their face normals, and d(x, S) is the
//! distance to the nearest point of a set:
//!
//! | field | formula | also known as |
//! |---|---|---|
//! | `chamfer_mean` | ½ (mean d(a, {b}) + mean d(b, {a})) | L1 Chamfer |
//! | `chamfer_sum` | mean d(a, {b}) + mean d(b, {a}) | L1, as a sum |
//! | `chamfer_squared` | mean d²(a, {b}) + mean d²(b, {a}) | L2 Chamfer; PyTorch3D's default |
//! | `normal_consistency` | ½ (mean \|n_a·n_near\| + mean \|n_b·n_near\|) | 1 for parallel normals; the orientation is ignored |
//! | `a_to_b`, `b_to_a` | mean, root mean square, maximum of d(a, triangles of B), and the reverse | one-sided; `max` is a lower bound of the Hausdorff distance |
//! | `f_score` | harmonic mean of the fractions of samples within τ of the other mesh | τ = 1 % of the diagonal of A by default |
//!
//! The first three contain sampling noise: two sample sets of one surface have a distance of about half the
//! sample spacing, not 0. The distances to triangles contain no such noise.
//!
//! # Rounding
//! All values are f64; means are sums of [`crate::num::sum::sum16_f64`] divided by N.

use super::nearest::{Cloud, Surface};
use crate::num::rng::Rng;
use crate::num::{order, par, sum};
use crate::scene::mesh::Mesh;
use crate::{Error, Result};

/// Purpose of the draws; the item is the sample, the step is 0 for A and 1 for B, draw 0 selects the
/// triangle, and draws 1 and 2 the position on it.
pub const PURPOSE: u16 = 0x0600;

/// Samples per task.
const BATCH: usize = 64;

/// Points of a surface with the normals of their faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Positions, shape (N).
    pub points: Vec<[f64; 3]>,
    /// Unit normals, shape (N).
    pub normals: Vec<[f64; 3]>,
    /// Triangle of each point, shape (N).
    pub triangles: Vec<u32>,
}

/// Distances from samples of one surface to the triangles of the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distances {
    /// Mean over all samples.
    pub mean: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// Maximum over all samples.
    pub max: f64,
    /// Fraction of the samples within τ.
    pub within: f64,
}

/// Result of [`compare`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Chamfer distance as in the table of the module.
    pub chamfer_mean: f64,
    /// Chamfer distance as in the table of the module.
    pub chamfer_sum: f64,
    /// Chamfer distance as in the table of the module.
    pub chamfer_squared: f64,
    /// Normal consistency, in 0..1.
    pub normal_consistency: f64,
    /// From samples of A to B.
    pub a_to_b: Distances,
    /// From samples of B to A.
    pub b_to_a: Distances,
    /// F-score, in 0..1.
    pub f_score: f64,
    /// The threshold of `within` and `f_score`.
    pub tau: f64,
    /// Areas of A and B.
    pub area: [f64; 2],
    /// Diagonals of the bounds of A and B.
    pub diagonal: [f64; 2],
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// Returns the cumulative sums of the areas of the triangles.
fn areas(mesh: &Mesh) -> Vec<f64> {
    let mut total = 0.0;
    (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p.map(f64::from));
            let n = cross(std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
            total = total + 0.5 * dot(n, n).sqrt();
            total
        })
        .collect()
}

/// Draws N points of a mesh, uniformly by area; a point is a function of (seed, step, sample index).
///
/// # Errors
/// Returns an error if the mesh has no area.
pub fn sample(mesh: &Mesh, count: usize, seed: u64, step: u32, name: &str) -> Result<Samples> {
    let running = areas(mesh);
    let total = running.last().copied().unwrap_or(0.0);
    if !(total > 0.0 && total.is_finite()) {
        return Err(Error::input(name).at("surface").expected("a positive area").got(total.to_string()));
    }
    let rng = Rng::new(seed);
    let one = |i: usize| {
        let u = |draw| rng.uniform_f64(i as u64, step, PURPOSE, draw);
        let t = order::min(running.partition_point(|&c| c <= u(0) * total), running.len() - 1);
        let [a, b, c] = mesh.corners(t).map(|p| p.map(f64::from));
        let (root, v) = (u(1).sqrt(), u(2));
        let w = [1.0 - root, root * (1.0 - v), root * v];
        let p = std::array::from_fn(|k| (w[0] * a[k] + w[1] * b[k]) + w[2] * c[k]);
        let n = cross(std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
        let length = dot(n, n).sqrt();
        (p, n.map(|x| x / length), t as u32)
    };
    let mut out = Samples::default();
    for (p, n, t) in par::map_batched(count, BATCH, one) {
        out.points.push(p);
        out.normals.push(n);
        out.triangles.push(t);
    }
    Ok(out)
}

fn mean(x: &[f64]) -> f64 {
    sum::sum16_f64(x) / x.len() as f64
}

/// Returns the distances to the nearest sample, and |cos| between the normals there.
fn between(from: &Samples, to: &Samples) -> (Vec<f64>, Vec<f64>) {
    let cloud = Cloud::new(&to.points);
    let near = par::map_batched(from.points.len(), BATCH, |i| cloud.nearest(from.points[i]));
    let cosine = |(i, (_, j)): (usize, &(f64, u32))| dot(from.normals[i], to.normals[*j as usize]).abs();
    let cosines = near.iter().enumerate().map(cosine).collect();
    (near.into_iter().map(|(d, _)| d).collect(), cosines)
}

fn onto(from: &Samples, mesh: &Mesh, tau: f64) -> Distances {
    let surface = Surface::new(&mesh.positions, &mesh.triangles);
    let square = par::map_batched(from.points.len(), BATCH, |i| surface.nearest(from.points[i]).0);
    let d: Vec<f64> = square.iter().map(|x| x.sqrt()).collect();
    Distances {
        mean: mean(&d),
        rms: mean(&square).sqrt(),
        max: d.iter().fold(0.0, |m, x| order::max(m, *x)),
        within: d.iter().filter(|x| **x <= tau).count() as f64 / d.len() as f64,
    }
}

fn diagonal(mesh: &Mesh) -> f64 {
    let [low, high] = mesh.bounds();
    let d: [f64; 3] = std::array::from_fn(|k| f64::from(high[k]) - f64::from(low[k]));
    dot(d, d).sqrt()
}

/// Compares two meshes with `count` samples of each.
///
/// # Errors
/// Returns an error if a mesh has no area, or if `count` is 0.
pub fn compare(a: &Mesh, b: &Mesh, count: usize, seed: u64, tau: Option<f64>) -> Result<Comparison> {
    if count == 0 {
        return Err(Error::input("samples").expected("at least 1").got("0"));
    }
    let tau = tau.unwrap_or(0.01 * diagonal(a));
    let (sa, sb) = (sample(a, count, seed, 0, "A")?, sample(b, count, seed, 1, "B")?);
    let ((ab, cos_ab), (ba, cos_ba)) = (between(&sa, &sb), between(&sb, &sa));
    let root = |x: &[f64]| mean(&x.iter().map(|v| v.sqrt()).collect::<Vec<f64>>());
    let chamfer_sum = root(&ab) + root(&ba);
    let (a_to_b, b_to_a) = (onto(&sa, b, tau), onto(&sb, a, tau));
    let both = a_to_b.within + b_to_a.within;
    Ok(Comparison {
        chamfer_mean: 0.5 * chamfer_sum,
        chamfer_sum,
        chamfer_squared: mean(&ab) + mean(&ba),
        normal_consistency: 0.5 * (mean(&cos_ab) + mean(&cos_ba)),
        a_to_b,
        b_to_a,
        f_score: if both > 0.0 { 2.0 * a_to_b.within * b_to_a.within / both } else { 0.0 },
        tau,
        area: [a, b].map(|m| areas(m).last().copied().unwrap_or(0.0)),
        diagonal: [diagonal(a), diagonal(b)],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of side 1 in the plane z = `z`.
    fn square(z: f32) -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn parallel_squares_are_as_far_apart_as_they_are() {
        let c = compare(&square(0.0), &square(0.5), 4000, 1, Some(0.4)).unwrap_or_else(|e| panic!("{e}"));
        for d in [c.a_to_b, c.b_to_a] {
            assert!(
                (d.mean - 0.5).abs() < 1e-12 && (d.rms - 0.5).abs() < 1e-12 && (d.max - 0.5).abs() < 1e-12,
                "{d:?}"
            );
            assert_eq!(d.within, 0.0, "further than the threshold");
        }
        // Samples add the spacing of samples: √(¼ + r²) with r about ½/√N.
        assert!(c.chamfer_mean > 0.5 && c.chamfer_mean < 0.5005, "{c:?}");
        assert!((c.chamfer_squared - 0.5).abs() < 1e-3 && c.chamfer_sum == 2.0 * c.chamfer_mean, "{c:?}");
        assert!((c.normal_consistency - 1.0).abs() < 1e-12 && c.area == [1.0, 1.0], "{c:?}");
        let same = compare(&square(0.0), &square(0.0), 4000, 1, None).unwrap_or_else(|e| panic!("{e}"));
        assert!(same.a_to_b.max < 1e-15 && same.f_score == 1.0, "a surface is on itself: {same:?}");
        // The mean distance to the nearest of N uniform points is ½/√N.
        let spacing = 0.5 / 4000f64.sqrt();
        assert!((same.chamfer_mean / spacing - 1.0).abs() < 0.1, "{} and {spacing}", same.chamfer_mean);
    }

    #[test]
    fn upright_squares_have_no_normal_in_common() {
        let upright = Mesh {
            positions: square(0.0).positions.iter().map(|p| [p[0], 0.0, p[1]]).collect(),
            ..square(0.0)
        };
        let c = compare(&square(0.0), &upright, 500, 2, None).unwrap_or_else(|e| panic!("{e}"));
        assert!(c.normal_consistency < 1e-12, "{c:?}");
        // The points of one mesh are at heights uniform in 0..1 above the other.
        assert!((c.a_to_b.mean - 0.5).abs() < 0.05 && (c.b_to_a.mean - 0.5).abs() < 0.05, "{c:?}");
        assert!(compare(&Mesh::default(), &upright, 5, 0, None).is_err(), "nothing to sample");
    }
}
