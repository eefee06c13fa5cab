//! Pictures of interventions: one factor set, everything else as it was; what changes and what does not.
//!
//! The values a factor is set to are codes that pictures of the training set have: at nine quantiles along the factor's axis of largest variance.

use super::evaluation::{intervened, linked};
use super::file::Trained;
pub use super::file::VALUES;
use crate::Result;
use crate::math::{knn, principal};
use crate::num::order;
use crate::scene::camera::Camera;
use crate::splat::discs;

/// Shares of the pictures below the first and the last value.
const ENDS: [f64; 2] = [0.02, 0.98];
/// Radius of a disc in units of the mean distance to the three nearest points.
const DISC: f64 = 0.9;

/// Codes (n, [`VALUES`], k) of rows of factors (N, n, k): those of the pictures at the quantiles along each factor's axis.
///
/// # Panics
/// When there are no rows.
pub fn codes(factors: &[f64], n: usize, k: usize) -> Vec<f64> {
    let mut all = Vec::new();
    for i in 0..n {
        let rows: Vec<&[f64]> = factors.chunks_exact(n * k).map(|row| &row[i * k..(i + 1) * k]).collect();
        assert!(!rows.is_empty(), "there are pictures");
        let axis = principal::axis(&rows, k);
        let along = |row: &[f64]| row.iter().zip(&axis).fold(0.0, |s, (x, a)| s + x * a);
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by(|&a, &b| along(rows[a]).total_cmp(&along(rows[b])).then(a.cmp(&b)));
        for q in 0..VALUES {
            let share = ENDS[0] + (ENDS[1] - ENDS[0]) * q as f64 / (VALUES - 1) as f64;
            let at = libm::round(share * (rows.len() - 1) as f64) as usize;
            all.extend_from_slice(rows[order[at]]);
        }
    }
    all
}

/// One cell of the grid.
#[derive(Clone, Debug)]
pub struct Cell {
    /// (P, 6) points and colours
    pub points: Vec<[f32; 6]>,
    /// (n) how far each factor moved, in its standard deviations
    pub moved: Vec<f64>,
}

/// Counterfactuals of one picture, whose encoder means are `mu` (n, k): factor `i` set to each of its codes, the noise of the others kept.
///
/// # Errors
/// A factor that does not exist.
pub fn row(trained: &Trained, mu: &[f64], i: usize) -> Result<Vec<Cell>> {
    let (n, k) = (trained.model.sizes.factors, trained.model.sizes.width);
    let [_, eps] = linked(trained, mu.to_vec());
    let codes: Vec<&[f64]> = trained.codes.chunks_exact(k).skip(i * VALUES).take(VALUES).collect();
    // What the graph makes of the noise when nothing is set.
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

/// A picture (S, S, 3) of points at the template's density.
///
/// # Errors
/// A camera that is not valid.
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
        // Factor 0 runs along (3, 4), factor 1 does not move in its first number.
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
        assert!(codes.chunks_exact(2).skip(VALUES).all(|c| c[0] == 0.5), "what stands still stays");
    }
}
