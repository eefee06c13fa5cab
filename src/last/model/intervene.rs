//! Images of interventions: one factor is set, and all other noise is kept.
//!
//! A factor is set to codes that images of the training set have, at nine quantiles along the factor's axis
//! of largest variance.

use super::evaluation::{intervened, linked};
use super::file::Trained;
pub use super::file::VALUES;
use crate::Result;
use crate::math::{knn, principal};
use crate::num::order;
use crate::scene::camera::Camera;
use crate::splat::discs;

/// Fractions of the images below the first and the last value.
const ENDS: [f64; 2] = [0.02, 0.98];
/// Radius of a disc in units of the mean distance to the three nearest points.
const DISC: f64 = 0.9;

/// The quantile of value `q` of [`VALUES`].
pub fn quantile(q: usize) -> f64 {
    ENDS[0] + (ENDS[1] - ENDS[0]) * q as f64 / (VALUES - 1) as f64
}

/// Codes (n, [`VALUES`], k) selected from rows of factors (N, n, k), at the quantiles along each factor's
/// axis.
///
/// # Panics
/// If there are no rows.
pub fn codes(factors: &[f64], n: usize, k: usize) -> Vec<f64> {
    let mut all = Vec::new();
    for i in 0..n {
        let rows: Vec<&[f64]> = factors.chunks_exact(n * k).map(|row| &row[i * k..(i + 1) * k]).collect();
        assert!(!rows.is_empty(), "there must be at least one row of factors");
        let axis = principal::axis(&rows, k);
        let along = |row: &[f64]| row.iter().zip(&axis).fold(0.0, |s, (x, a)| s + x * a);
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by(|&a, &b| along(rows[a]).total_cmp(&along(rows[b])).then(a.cmp(&b)));
        for q in 0..VALUES {
            let at = libm::round(quantile(q) * (rows.len() - 1) as f64) as usize;
            all.extend_from_slice(rows[order[at]]);
        }
    }
    all
}

/// One cell of the grid.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Points and colours, shape (P, 6).
    pub points: Vec<[f32; 6]>,
    /// Displacement of each factor in units of its standard deviation, shape (n).
    pub moved: Vec<f64>,
}

/// Counterfactuals of one image, whose encoder means are `mu` (n, k): factor `i` is set to each of its codes,
/// the noise of the others is kept.
///
/// # Errors
/// If the factor does not exist.
pub fn row(trained: &Trained, mu: &[f64], i: usize) -> Result<Vec<Cell>> {
    let (n, k) = (trained.model.sizes.factors, trained.model.sizes.width);
    let [_, eps] = linked(trained, mu.to_vec());
    let codes: Vec<&[f64]> = trained.codes.chunks_exact(k).skip(i * VALUES).take(VALUES).collect();
    // The prediction without an intervention.
    let nothing = super::evaluation::predicted(trained, &eps);
    codes
        .into_iter()
        .map(|value| {
            let z = intervened(trained, &eps, &[i], value)?;
            let moved = (0..n)
                .map(|j| {
                    let sum = (j * k..(j + 1) * k).fold(0.0, |s, at| {
                        let off = (z[at] - nothing[at]) / trained.factor_spread[at];
                        s + off * off
                    });
                    (sum / k as f64).sqrt()
                })
                .collect();
            Ok(Cell { points: trained.decoded(&z, &trained.template), moved })
        })
        .collect()
}

/// An image (S, S, 3) of points at the density of the template.
///
/// # Errors
/// If the camera is invalid.
pub fn picture(trained: &Trained, points: &[[f32; 6]], camera: &Camera) -> Result<Vec<f32>> {
    let near = knn::neighbours::<3>(&trained.template)?;
    let radii: Vec<f32> = near
        .iter()
        .map(|three| (DISC * three.iter().fold(0.0, |s, (square, _)| s + square.sqrt()) / 3.0) as f32)
        .collect();
    let means: Vec<[f32; 3]> = points.iter().map(|p| [p[0], p[1], p[2]]).collect();
    let colours: Vec<[f32; 3]> =
        points.iter().map(|p| [p[3], p[4], p[5]].map(|c| order::clamp(c, 0.0, 1.0))).collect();
    Ok(discs::render(&means, &radii, &colours, camera, [0.0; 3])?.image.into_flattened())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_follow_the_factor() {
        // Factor 0 varies along (3, 4); the first dimension of factor 1 is constant.
        let rows: Vec<f64> = (0..101)
            .flat_map(|i| {
                let t = f64::from((i * 37) % 101) / 50.0 - 1.0;
                [3.0 * t, 4.0 * t, 0.5, -t]
            })
            .collect();
        let codes = codes(&rows, 2, 2);
        let first: Vec<f64> = codes.chunks_exact(2).take(VALUES).map(|c| c[1]).collect();
        assert!(first.is_sorted() || first.iter().rev().is_sorted(), "codes run along the axis: {first:?}");
        assert!((first[0] - first[VALUES - 1]).abs() > 7.0, "nearly the whole range: {first:?}");
        assert!(codes.chunks_exact(2).skip(VALUES).all(|c| c[0] == 0.5), "a constant dimension is unchanged");
    }
}
