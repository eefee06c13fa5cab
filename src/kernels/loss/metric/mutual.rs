//! Mutual information estimated from samples, for evaluating learned models. In nats, f64, without adjoints.
//!
//! | name | function | definition |
//! |---|---|---|
//! | `MI-KSG` | [`ksg`] | nearest neighbours, first estimator of Kraskov, Stögbauer & Grassberger 2004, eq. 8: any dependence, a few hundred points |
//! | `MI-mixture` | [`mixture`] | the aggregated posterior as a mixture, Monte Carlo with one sample of every image |
//!
//! Unlike `causal.independence`, both detect dependence beyond second moments. Both are unbiased only in the
//! limit and may be negative.

use crate::num::elem::f64::{exp, ln};
use crate::num::par;
use crate::{Error, Result};

/// Name of [`ksg`].
pub const NAME_KSG: &str = "MI-KSG";
/// Name of [`mixture`].
pub const NAME_MIXTURE: &str = "MI-mixture";
/// Default number of neighbours of [`ksg`].
pub const NEIGHBOURS: usize = 3;

/// Points per thread and task.
const BATCH: usize = 16;

/// Returns ψ(x) = d ln Γ(x)/dx for x > 0, accurate to a few units of 2⁻⁵² of max(1, |ψ|).
///
/// ψ(x) = ψ(x + 1) − 1/x up to x ≥ 10, then ln x − 1/(2x) − Σₙ B₂ₙ/(2n x²ⁿ), n = 1 … 7 (Abramowitz & Stegun
/// 1964, 6.3.18).
///
/// # Panics
/// Panics if x is not above 0.
pub fn digamma(x: f64) -> f64 {
    /// B₂ₙ/(2n)
    const TERMS: [f64; 7] =
        [1.0 / 12.0, -1.0 / 120.0, 1.0 / 252.0, -1.0 / 240.0, 1.0 / 132.0, -691.0 / 32_760.0, 1.0 / 12.0];
    assert!(x > 0.0, "the argument of the digamma function is above 0");
    let (mut x, mut below) = (x, 0.0);
    while x < 10.0 {
        below += 1.0 / x;
        x += 1.0;
    }
    let inverse = 1.0 / (x * x);
    let series = TERMS.iter().rev().fold(0.0, |sum, term| (sum + term) * inverse);
    ((ln(x) - 0.5 / x) - series) - below
}

/// Returns the largest coordinate difference of two points.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |most, (a, b)| {
        let d = (a - b).abs();
        if d > most { d } else { most }
    })
}

fn finite(what: &str, values: &[f64]) -> Result<()> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(at) => Err(Error::input("mutual information")
            .at(format!("{what}, entry {at}"))
            .expected("finite numbers")
            .got(values[at].to_string())),
    }
}

/// Returns the mutual information of two variables from N joint points, using the `neighbours` nearest ones
/// in the maximum norm; a marginal neighbour is strictly nearer than the last of them.
///
/// I = ψ(k) + ψ(N) − ⟨ψ(n_x + 1) + ψ(n_y + 1)⟩
///
/// `x` is (N, a), `y` is (N, b) for any a, b ≥ 1. Terms of the mean are added by a left fold over the points.
/// The run time grows with N².
///
/// # Errors
/// Returns an error unless there are more points than neighbours, sizes agree and all numbers are finite.
pub fn ksg(x: &[f64], y: &[f64], points: usize, neighbours: usize) -> Result<f64> {
    let whole = |v: &[f64]| points > 0 && !v.is_empty() && v.len().is_multiple_of(points);
    if neighbours == 0 || points <= neighbours || !whole(x) || !whole(y) {
        return Err(Error::input("mutual information")
            .expected("two variables with more points than neighbours, and at least one neighbour")
            .got(format!("{points} points, {neighbours} neighbours, {} and {} values", x.len(), y.len())));
    }
    finite("x", x)?;
    finite("y", y)?;
    let (a, b) = (x.len() / points, y.len() / points);
    let [x_at, y_at] = [(x, a), (y, b)].map(|(v, width)| move |i: usize| &v[i * width..(i + 1) * width]);
    let psi: Vec<f64> = (1..=points).map(|n| digamma(n as f64)).collect();
    let terms = par::map_batched(points, BATCH, |i| {
        let mut nearest = vec![f64::INFINITY; neighbours];
        for j in (0..points).filter(|j| *j != i) {
            let (dx, dy) = (distance(x_at(i), x_at(j)), distance(y_at(i), y_at(j)));
            let d = if dx > dy { dx } else { dy };
            if d < nearest[neighbours - 1] {
                let place = nearest.partition_point(|other| *other <= d);
                nearest.insert(place, d);
                nearest.truncate(neighbours);
            }
        }
        let radius = nearest[neighbours - 1];
        let nearer = |d: f64| usize::from(d < radius);
        let (mut n_x, mut n_y) = (0, 0);
        for j in (0..points).filter(|j| *j != i) {
            n_x += nearer(distance(x_at(i), x_at(j)));
            n_y += nearer(distance(y_at(i), y_at(j)));
        }
        psi[n_x] + psi[n_y]
    });
    let mean = terms.iter().fold(0.0, |sum, term| sum + term) / points as f64;
    Ok((psi[neighbours - 1] + psi[points - 1]) - mean)
}

/// Posteriors of N images with one sample of each.
#[derive(Clone, Copy, Debug)]
pub struct Posteriors<'a> {
    /// Means, shape (N, n, k).
    pub mu: &'a [f64],
    /// Logarithms of the variances, shape (N, n, k).
    pub logvar: &'a [f64],
    /// Samples, shape (N, n, k).
    pub sample: &'a [f64],
    /// Number of images, N.
    pub images: usize,
    /// Number of factors, n.
    pub n: usize,
    /// Number of dimensions per factor, k.
    pub k: usize,
}

/// Returns ln Σ eˣ.
fn log_sum_exp(x: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = x.clone().fold(f64::NEG_INFINITY, |most, x| if x > most { x } else { most });
    most + ln(x.fold(0.0, |sum, x| sum + exp(x - most)))
}

/// Returns the mutual information of every pair of factors (n, n), symmetric with a zero diagonal, under the
/// mixture q(ε) = (1/N) Σₘ N(μₘ, σₘ²): the mean over the samples of ln q(εᵢ, εⱼ) − ln q(εᵢ) − ln q(εⱼ).
///
/// Means are left folds over the images. The run time grows with N².
///
/// # Errors
/// Returns an error if there is no image, if sizes disagree, or if a number is not finite.
pub fn mixture(x: &Posteriors<'_>) -> Result<Vec<f64>> {
    let Posteriors { mu, logvar, sample, images, n, k } = *x;
    let d = n * k;
    if images * d == 0 || [mu, logvar, sample].iter().any(|v| v.len() != images * d) {
        return Err(Error::input("mutual information")
            .expected(format!("three arrays of {images} x {n} x {k} numbers, at least one of each"))
            .got(format!("{}, {} and {} numbers", mu.len(), logvar.len(), sample.len())));
    }
    for (what, values) in [("mu", mu), ("logvar", logvar), ("sample", sample)] {
        finite(what, values)?;
    }
    let precision: Vec<f64> = logvar.iter().map(|l| exp(-l)).collect();
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    let terms = par::map_batched(images, BATCH, |s| {
        let at = &sample[s * d..(s + 1) * d];
        // Logarithm of a component's density of one factor, without the constant that cancels.
        let component = |m: usize, i: usize| {
            let numbers = (i * k..(i + 1) * k).map(|p| {
                let r = at[p] - mu[m * d + p];
                r * r * precision[m * d + p] + logvar[m * d + p]
            });
            -0.5 * numbers.fold(0.0, |sum, term| sum + term)
        };
        let factors: Vec<Vec<f64>> = (0..n).map(|i| (0..images).map(|m| component(m, i)).collect()).collect();
        let alone: Vec<f64> = factors.iter().map(|l| log_sum_exp(l.iter().copied())).collect();
        let gain = |&(i, j): &(usize, usize)| {
            let both = factors[i].iter().zip(&factors[j]).map(|(a, b)| a + b);
            (log_sum_exp(both) - alone[i]) - alone[j]
        };
        pairs.iter().map(gain).collect::<Vec<f64>>()
    });
    let mut information = vec![0.0; n * n];
    for (pair, (i, j)) in pairs.iter().enumerate() {
        let sum = terms.iter().fold(0.0, |sum, term| sum + term[pair]);
        let nats = sum / images as f64 + ln(images as f64);
        information[i * n + j] = nats;
        information[j * n + i] = nats;
    }
    Ok(information)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digamma_has_its_known_values() {
        const GAMMA: f64 = 0.577_215_664_901_532_9;
        let harmonic = |n: u32| (1..n).fold(0.0, |sum, i| sum + 1.0 / f64::from(i));
        for n in [1, 2, 3, 9, 10, 11, 50, 2048] {
            let error = digamma(f64::from(n)) - (harmonic(n) - GAMMA);
            assert!(error.abs() < 2e-14, "ψ({n}): off by {error:e}");
        }
        let half = -GAMMA - 2.0 * ln(2.0);
        assert!((digamma(0.5) - half).abs() < 1e-14, "ψ(½)");
        for x in [0.1, 0.7, 3.3, 9.99, 10.0, 123.4] {
            let step = digamma(x + 1.0) - digamma(x);
            assert!((step * x - 1.0).abs() < 1e-12, "ψ(x + 1) − ψ(x) = 1/x at {x}");
        }
    }

    #[test]
    fn bad_samples_are_refused() {
        let said = |r: Result<f64>| r.expect_err("bad").to_string();
        assert!(said(ksg(&[1.0, 2.0, 3.0], &[1.0, 2.0, 3.0], 3, 3)).contains("3 points"), "too few");
        assert!(said(ksg(&[1.0, f64::NAN], &[1.0, 2.0], 2, 1)).contains("x, entry 1"), "a NaN");
        let wrong = Posteriors { mu: &[0.0], logvar: &[0.0], sample: &[], images: 1, n: 1, k: 1 };
        assert!(mixture(&wrong).is_err(), "sizes");
    }
}
