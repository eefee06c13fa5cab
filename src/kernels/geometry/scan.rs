//! The shape error of Stanford-ORB: between samples of a reconstruction and the **vertices** of a scan.
//!
//! With N points p_i drawn uniformly by area from the reconstruction, and the vertices v_j of the scan at distinct places:
//!
//! value = ½ (mean_i min_j ‖p_i − v_j‖² + mean_j min_i ‖v_j − p_i‖²)
//!
//! in squared units of the benchmark's scenes. The published code returns this mean; the published table has the sum of both means
//! times 10³, that is 2·10³ of it ([`Scan::table`]). The scan is not sampled: where its vertices are sparse, a perfect
//! reconstruction has an error of about the squared spacing of the vertices, and in the other direction of about that of
//! the samples. [`crate::geometry::compare`] has distances to triangles, which vanish for equal surfaces.
//!
//! # Rounding
//! All values are f64; means are sums of [`crate::num::sum::sum16_f64`] divided by their number.

use super::compare::sample;
use super::nearest::Cloud;
use crate::num::{par, sum};
use crate::scene::mesh::Mesh;
use crate::{Error, Result};

/// Number of samples in the published code.
pub const SAMPLES: usize = 30_000;

/// Points per task.
const BATCH: usize = 64;

/// Squared distances between a reconstruction and a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan {
    /// Mean squared distance from the samples of the reconstruction to the nearest vertex.
    pub samples_to_vertices: f64,
    /// Mean squared distance from the vertices to the nearest sample.
    pub vertices_to_samples: f64,
    /// Number of vertices at distinct places.
    pub vertices: usize,
}

impl Scan {
    /// Returns the value of the published code: the mean of both.
    pub fn value(&self) -> f64 {
        0.5 * (self.samples_to_vertices + self.vertices_to_samples)
    }

    /// Returns the value of the published table: 10³ times the sum of both.
    pub fn table(&self) -> f64 {
        2e3 * self.value()
    }
}

/// Returns the places of a mesh's vertices, each once, in the order of their bits.
fn places(mesh: &Mesh) -> Vec<[f64; 3]> {
    // +0 and −0 are one place.
    let mut all: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|x| x + 0.0)).collect();
    all.sort_unstable_by_key(|p| p.map(f32::to_bits));
    all.dedup();
    all.into_iter().map(|p| p.map(f64::from)).collect()
}

/// Compares a reconstruction with the vertices of a scan.
///
/// # Errors
/// Returns an error if the reconstruction has no area, if the scan has no vertex, or if `count` is 0.
pub fn compare(reconstruction: &Mesh, scan: &Mesh, count: usize, seed: u64) -> Result<Scan> {
    let vertices = places(scan);
    if vertices.is_empty() || count == 0 {
        return Err(Error::input("scan").expected("at least one vertex and one sample").got("none"));
    }
    let points = sample(reconstruction, count, seed, 0, "reconstruction")?.points;
    let mean = |from: &[[f64; 3]], to: &[[f64; 3]]| {
        let cloud = Cloud::new(to);
        let squares = par::map_batched(from.len(), BATCH, |i| cloud.nearest(from[i]).0);
        sum::sum16_f64(&squares) / from.len() as f64
    };
    Ok(Scan {
        samples_to_vertices: mean(&points, &vertices),
        vertices_to_samples: mean(&vertices, &points),
        vertices: vertices.len(),
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
    fn the_truth_is_the_vertices_and_not_the_surface() {
        let mut scan = square(0.0);
        // A seam doubles a vertex, which counts once.
        scan.positions.push([1.0, 1.0, -0.0]);
        let c = compare(&square(0.5), &scan, SAMPLES, 1).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(c.vertices, 4, "places, not entries");
        // E min d² over a unit square to its corners: each coordinate is uniform in 0..½ from the nearest: 2·(1/12).
        let expected = 0.25 + 1.0 / 6.0;
        assert!((c.samples_to_vertices - expected).abs() < 2e-3, "{} and {expected}", c.samples_to_vertices);
        // A corner has a sample nearby: E d² of the nearest of N in a quarter of the plane is 4/(π N).
        let nearest = 4.0 / (std::f64::consts::PI * SAMPLES as f64);
        assert!(
            c.vertices_to_samples >= 0.25 && c.vertices_to_samples < 0.25 + 8.0 * nearest,
            "{} and {nearest}",
            c.vertices_to_samples
        );
        assert_eq!(c.value(), 0.5 * (c.samples_to_vertices + c.vertices_to_samples));
        assert_eq!(c.table(), 2000.0 * c.value());
        assert!(compare(&Mesh::default(), &scan, 5, 0).is_err(), "nothing to sample");
        assert!(compare(&scan, &Mesh::default(), 5, 0).is_err(), "no vertex");
    }
}
