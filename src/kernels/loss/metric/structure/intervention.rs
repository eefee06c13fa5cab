//! Evaluation of interventions in latent space on held-out pairs.

use super::Blocks;
use super::matching::Matching;
use crate::math::digraph::Digraph;
use crate::{Error, Result};

/// Returns the fraction of interventions whose target was recognised: `guessed` are blocks, `truth` factors.
///
/// # Errors
/// Returns an error if there are no interventions, or if the lengths differ.
pub fn target_accuracy(guessed: &[usize], truth: &[usize], matching: &Matching) -> Result<f64> {
    let m = matching.block.len();
    if guessed.is_empty() || guessed.len() != truth.len() || truth.iter().any(|&j| j >= m) {
        return Err(Error::input("target accuracy")
            .expected(format!("one guess per intervention on factors below {m}"))
            .got(format!("{} guesses, {} interventions", guessed.len(), truth.len())));
    }
    let right = guessed.iter().zip(truth).filter(|&(&i, &j)| matching.block[j] == Some(i)).count();
    Ok(right as f64 / truth.len() as f64)
}

/// Returns an error as a fraction of a reference error, such as that of no change or that of the true graph;
/// `None` if the reference is 0.
pub fn relative(error: f64, of: f64) -> Option<f64> {
    (of > 0.0).then(|| error / of)
}

/// Returns the mean displacement of blocks that an intervention must not change, divided by that of blocks it
/// changes.
///
/// A displacement is ‖ẑ'_j − ẑ_j‖ / √k with every dimension divided by its standard deviation in `before`.
/// `targets` (N) contains the block that was set; descendants are those of the true graph, given over blocks.
/// The target itself is excluded from both means. Returns `None` if no pair has both a non-descendant and a
/// descendant to compare, or if nothing moves.
///
/// # Errors
/// Returns an error if shapes differ.
pub fn locality(
    before: &Blocks<'_>,
    after: &Blocks<'_>,
    targets: &[usize],
    truth: &Digraph,
) -> Result<Option<f64>> {
    let (n, k, dims, count) = (before.n, before.k, before.dims(), before.count());
    let same = (after.n, after.k, after.values.len()) == (n, k, before.values.len());
    if !(same && targets.len() == count && truth.n() == n && targets.iter().all(|&t| t < n)) {
        return Err(Error::input("locality")
            .expected(format!("blocks ({count}, {n}, {k}) before and after, and one target for each"))
            .got(format!("{} values, {} targets", after.values.len(), targets.len())));
    }
    let deviation: Vec<f64> = (0..dims)
        .map(|d| {
            let column = || before.values.iter().skip(d).step_by(dims);
            let mean = column().fold(0.0, |s, x| s + x) / count as f64;
            (column().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / count as f64).sqrt()
        })
        .collect();
    let mut sums = [[0.0; 2]; 2]; // (not moved, moved) × (sum, count)
    for (s, &target) in targets.iter().enumerate() {
        let descendants = truth.descendants(target);
        for j in (0..n).filter(|&j| j != target) {
            let square = (j * k..(j + 1) * k).filter(|&d| deviation[d] > 0.0).fold(0.0, |sum, d| {
                let step = (after.values[s * dims + d] - before.values[s * dims + d]) / deviation[d];
                sum + step * step
            });
            let kind = &mut sums[(descendants >> j & 1) as usize];
            kind[0] += (square / k as f64).sqrt();
            kind[1] += 1.0;
        }
    }
    let [still, moved] = sums;
    if still[1] == 0.0 || moved[1] == 0.0 || moved[0] == 0.0 {
        return Ok(None);
    }
    Ok(Some((still[0] / still[1]) / (moved[0] / moved[1])))
}
