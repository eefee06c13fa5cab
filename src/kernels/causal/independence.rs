//! `causal.independence`: mutual information between the factors of an aggregated posterior, under a Gaussian
//! approximation.
//!
//! C = (1/B) Σ_b (m_b − m̄)(m_b − m̄)ᵀ + (I−Wᵀ) diag(ē) (I−W),   ē = (1/B) Σ_b e^ℓ_b
//! Σ = share·C + carried + δI
//! Iᵢⱼ = ½ (ln det Σᵢᵢ + ln det Σⱼⱼ − ln det Σ₍ᵢⱼ₎),   L = Σ_{i<j} aᵢⱼ Iᵢⱼ
//! form total:   L = ½ (Σᵢ ln det Σᵢᵢ − ln det Σ)
//!
//! Source: the law of total covariance; Cover & Thomas 2006, §8.4. It replaces LAST, eq. 5, which names no
//! estimator. No sampling is involved. L is exactly 0 if the blocks are uncorrelated; for aggregates that are
//! not Gaussian it measures second moments only. For independent factors the mean of Iᵢⱼ is k²/(2B).
//!
//! | symbol | argument | shape | range |
//! |--------|----------|-------|-------|
//! | m      | `mu`     | (B, n, k) | posterior means of the causes, or of the factors in the literal reading |
//! | ℓ      | `logvar` | (B, n, k) | ln of the posterior variance, at most 700 |
//! | W      | `mask`, `weight` | (n, n) | Ã∘Ω without its diagonal: ℓ is then that of the factors, and reaches the causes through edges; absent: W = 0 |
//! | a      | `among`  | (n, n) | weights of the pairs, read above the diagonal; absent: 1 |
//! |        | `carried` | (d, d) | weighted covariances of earlier batches, d = n·k; constant; absent: 0 |
//! |        | `share`  | () | weight of this batch, above 0; 1 if there are no earlier batches |
//! | δ      | `ridge`  | () | ≥ 0 |
//! | L      | `value`  | () | nats, ≥ 0 up to rounding |
//!
//! # Rounding
//! Means and C are left folds over b, followed by one division; with edges the noise is Σᵢ (M(j,i)·M(l,i))·ē,
//! M = I − Wᵀ, a left fold over i. Determinants are products of Cholesky pivots, row by row: the first k rows
//! of Σ₍ᵢⱼ₎ factor as Σᵢᵢ does, so Iᵢⱼ = Σ_c ln(pivot of Σⱼⱼ / pivot of Σ₍ᵢⱼ₎ in the same row), which is
//! exactly 0 if the block between i and j is 0. Pairs are added in order.
//!
//! # Kinks and domain
//! The function is smooth where Σ is positive definite; a pivot that is not positive is an `Error`.
//!
//! # Adjoint
//! G = ½ Σ aᵢⱼ (blkdiag(Σᵢᵢ⁻¹, Σⱼⱼ⁻¹) − Σ₍ᵢⱼ₎⁻¹) on the rows and columns of each pair;   v = share·L̄
//! m̄_b += (2v/B) G (m_b − m̄),   ℓ̄_b += (v/B) diag(MᵀGM)∘e^ℓ_b,   W̄ᵢⱼ −= 2v Σ_c Σ_l G(jc,lc) M(l,i) ē(i,c)
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::independence::{In, forward};
//! // two variables with correlation ρ: the value is −½ ln(1 − ρ²)
//! let mu = [1.0, 1.0, -1.0, -1.0, 1.0, 0.0, -1.0, 0.0];
//! let x = In { ridge: 0.0, ..In::new(&mu, &[-800.0; 8], 4, 2, 1) };
//! let rho = 1.0 / 2.0_f64.sqrt();
//! assert!((forward(&x)?.0 + 0.5 * libm::log(1.0 - rho * rho)).abs() < 1e-15);
//! # Ok::<(), lastlight::Error>(())
//! ```

use crate::Result;
use crate::math::dense::{self, NotPositive};
use crate::num::elem::f64::{exp, ln};

/// Default value of δ.
pub const RIDGE: f64 = 1e-4;

/// Edges of a linear mechanism.
#[derive(Clone, Copy, Debug)]
pub struct Edges<'a> {
    /// Shape (n, n).
    pub mask: &'a [f64],
    /// Shape (n, n).
    pub weight: &'a [f64],
}

/// The set of dependences that are added up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// Mutual information of every pair of factors.
    #[default]
    Pairs,
    /// Total correlation of all factors, which includes dependences of higher order.
    Total,
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (B, n, k).
    pub mu: &'a [f64],
    /// Shape (B, n, k).
    pub logvar: &'a [f64],
    /// Edges through which the noise of parents reaches the causes.
    pub edges: Option<Edges<'a>>,
    /// Weights of the pairs, shape (n, n); all 1 if absent.
    pub among: Option<&'a [f64]>,
    /// Weighted covariances of earlier batches, shape (n·k, n·k).
    pub carried: Option<&'a [f64]>,
    /// Weight of this batch.
    pub share: f64,
    /// Ridge δ that is added to the diagonal.
    pub ridge: f64,
    /// The set of dependences that are added up.
    pub form: Form,
    /// Number of samples B.
    pub batch: usize,
    /// Number of factors n.
    pub n: usize,
    /// Number of dimensions per factor, k.
    pub k: usize,
}

impl<'a> In<'a> {
    /// Inputs of a single batch with all pairs and the default [`RIDGE`].
    pub fn new(mu: &'a [f64], logvar: &'a [f64], batch: usize, n: usize, k: usize) -> Self {
        let form = Form::Pairs;
        Self {
            mu,
            logvar,
            edges: None,
            among: None,
            carried: None,
            share: 1.0,
            ridge: RIDGE,
            form,
            batch,
            n,
            k,
        }
    }
}

/// Gradients; the adjoint adds to them. Those of the edges are empty if there are no edges.
#[derive(Clone, Debug, PartialEq)]
pub struct InBar {
    /// Shape (B, n, k).
    pub mu: Vec<f64>,
    /// Shape (B, n, k).
    pub logvar: Vec<f64>,
    /// Shape (n, n).
    pub mask: Vec<f64>,
    /// Shape (n, n).
    pub weight: Vec<f64>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |len| vec![0.0; len];
        let edges = x.edges.map_or(0, |_| x.n * x.n);
        Self { mu: zeros(x.mu.len()), logvar: zeros(x.mu.len()), mask: zeros(edges), weight: zeros(edges) }
    }
}

/// Intermediate values that the adjoint needs, and values that reports print.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// Covariance C of this batch alone, shape (d, d).
    pub covariance: Vec<f64>,
    /// Mutual information Iᵢⱼ, shape (n, n), symmetric, without the weights of pairs.
    pub information: Vec<f64>,
    /// Mean m̄, shape (d).
    mean: Vec<f64>,
    /// Mean noise variance ē, shape (d).
    noise: Vec<f64>,
    /// Derivative G by the covariance, shape (d, d).
    slope: Vec<f64>,
}

/// The Cholesky factor of some rows and columns of Σ.
struct Triangle {
    size: usize,
    l: Vec<f64>,
}

impl Triangle {
    /// Factors the rows and columns `at` of a (d, d) matrix.
    fn new(matrix: &[f64], d: usize, at: &[usize]) -> Result<Self> {
        let part: Vec<f64> = at.iter().flat_map(|r| at.iter().map(move |c| matrix[r * d + c])).collect();
        let l = dense::cholesky(&part, at.len()).map_err(|e| {
            let e = NotPositive { row: at[e.row], ..e };
            e.of("causal.independence").hint("use a larger ridge, or more samples than dimensions")
        })?;
        Ok(Self { size: at.len(), l })
    }

    fn pivot(&self, r: usize) -> f64 {
        self.l[r * self.size + r]
    }

    /// Adds scale·A⁻¹ to the rows and columns `at` of a (d, d) matrix.
    fn add_inverse(&self, scale: f64, d: usize, at: &[usize], into: &mut [f64]) {
        let mut one = vec![0.0; self.size];
        for column in 0..self.size {
            one[column] = 1.0;
            for (r, x) in dense::solve(&self.l, self.size, &one).into_iter().enumerate() {
                into[at[r] * d + at[column]] += scale * x;
            }
            one[column] = 0.0;
        }
    }
}

/// Returns M = I − Wᵀ (n, n), where M(j,i) is the coefficient of factor i in cause j.
fn entering(x: &In<'_>) -> Vec<f64> {
    let n = x.n;
    let w = |i: usize, j: usize| x.edges.map_or(0.0, |e| e.mask[i * n + j] * e.weight[i * n + j]);
    (0..n * n).map(|at| (at / n, at % n)).map(|(j, i)| if i == j { 1.0 } else { -w(i, j) }).collect()
}

fn check(x: &In<'_>) -> usize {
    let (n, d) = (x.n, x.n * x.k);
    assert!(x.batch > 0 && d > 0, "batch, n and k are at least 1");
    assert!(x.mu.len() == x.batch * d && x.logvar.len() == x.mu.len(), "mu and logvar are (B, n, k)");
    assert!(
        x.edges.is_none_or(|e| e.mask.len() == n * n && e.weight.len() == n * n),
        "mask and weight are (n, n)"
    );
    assert!(x.among.is_none_or(|a| a.len() == n * n), "among is (n, n)");
    assert!(x.carried.is_none_or(|c| c.len() == d * d), "carried is (n·k, n·k)");
    d
}

/// Returns L and the intermediate values that the adjoint needs.
///
/// # Errors
/// Returns an error if the covariance is not positive definite.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> Result<(f64, Saved)> {
    let d = check(x);
    let (n, k, count) = (x.n, x.k, x.batch as f64);
    let over_batch = |term: &dyn Fn(usize) -> f64| (0..x.batch).fold(0.0, |sum, b| sum + term(b * d)) / count;
    let mean: Vec<f64> = (0..d).map(|p| over_batch(&|b| x.mu[b + p])).collect();
    let noise: Vec<f64> = (0..d).map(|p| over_batch(&|b| exp(x.logvar[b + p]))).collect();
    let m = entering(x);
    let mut covariance = vec![0.0; d * d];
    for (p, q) in (0..d * d).map(|at| (at / d, at % d)).filter(|(p, q)| p >= q) {
        let spread = over_batch(&|b| (x.mu[b + p] - mean[p]) * (x.mu[b + q] - mean[q]));
        let (j, l, c) = (p / k, q / k, p % k);
        let through = |i: usize| m[j * n + i] * m[l * n + i] * noise[i * k + c];
        let within = if c == q % k { (0..n).fold(0.0, |sum, i| sum + through(i)) } else { 0.0 };
        covariance[p * d + q] = spread + within;
        covariance[q * d + p] = spread + within;
    }
    let carried = |at: usize| x.carried.map_or(0.0, |carried| carried[at]);
    let ridge = |at: usize| if at / d == at % d { x.ridge } else { 0.0 };
    let sum: Vec<f64> = (0..d * d).map(|at| (x.share * covariance[at] + carried(at)) + ridge(at)).collect();
    let rows = |i: usize| (i * k..(i + 1) * k).collect::<Vec<_>>();
    let blocks = (0..n).map(|i| Triangle::new(&sum, d, &rows(i))).collect::<Result<Vec<_>>>()?;
    let (mut information, mut slope, mut value) = (vec![0.0; n * n], vec![0.0; d * d], 0.0);
    // Σ_c ln(pivot alone / pivot after others) over the rows of a block that begin at `from` in the larger
    // matrix
    let gained = |alone: &Triangle, after: &Triangle, from: usize| {
        (0..k).fold(0.0, |sum, c| sum + ln(alone.pivot(c) / after.pivot(from + c)))
    };
    for (i, j) in (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))) {
        let at = [rows(i), rows(j)].concat();
        let pair = Triangle::new(&sum, d, &at)?;
        let nats = gained(&blocks[j], &pair, k);
        information[i * n + j] = nats;
        information[j * n + i] = nats;
        let weight = x.among.map_or(1.0, |among| among[i * n + j]);
        if x.form == Form::Pairs && weight != 0.0 {
            value += weight * nats;
            blocks[i].add_inverse(0.5 * weight, d, &at[..k], &mut slope);
            blocks[j].add_inverse(0.5 * weight, d, &at[k..], &mut slope);
            pair.add_inverse(-0.5 * weight, d, &at, &mut slope);
        }
    }
    if x.form == Form::Total {
        let at: Vec<usize> = (0..d).collect();
        let all = Triangle::new(&sum, d, &at)?;
        for (j, block) in blocks.iter().enumerate() {
            value += gained(block, &all, j * k);
            block.add_inverse(0.5, d, &rows(j), &mut slope);
        }
        all.add_inverse(-0.5, d, &at, &mut slope);
    }
    Ok((value, Saved { covariance, information, mean, noise, slope }))
}

/// Adds the gradients for the cotangent `value_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &Saved, value_bar: f64, bar: &mut InBar) {
    let d = check(x);
    let (n, k) = (x.n, x.k);
    assert!(bar.mu.len() == x.mu.len() && bar.logvar.len() == x.mu.len(), "gradients are (B, n, k)");
    let g = |p: usize, q: usize| saved.slope[p * d + q];
    let m = entering(x);
    let v = x.share * value_bar;
    let each = v / x.batch as f64;
    // diag(MᵀGM): the derivative of L by the noise variance of each dimension
    let by_noise: Vec<f64> = (0..d)
        .map(|p| (p / k, p % k))
        .map(|(i, c)| {
            let term = |j: usize, l: usize| g(j * k + c, l * k + c) * m[j * n + i] * m[l * n + i];
            (0..n * n).fold(0.0, |sum, at| sum + term(at / n, at % n))
        })
        .collect();
    for b in 0..x.batch {
        let mu = &x.mu[b * d..(b + 1) * d];
        for p in 0..d {
            let pull = (0..d).fold(0.0, |sum, q| sum + g(p, q) * (mu[q] - saved.mean[q]));
            bar.mu[b * d + p] += 2.0 * each * pull;
            bar.logvar[b * d + p] += each * by_noise[p] * exp(x.logvar[b * d + p]);
        }
    }
    let Some(edges) = x.edges else { return };
    assert!(bar.mask.len() == n * n && bar.weight.len() == n * n, "mask and weight are (n, n)");
    for (i, j) in (0..n * n).map(|at| (at / n, at % n)).filter(|(i, j)| i != j) {
        let over_l = |c: usize| (0..n).fold(0.0, |sum, l| sum + g(j * k + c, l * k + c) * m[l * n + i]);
        let pull = (0..k).fold(0.0, |sum, c| sum + over_l(c) * saved.noise[i * k + c]);
        let w_bar = -2.0 * v * pull;
        bar.mask[i * n + j] += edges.weight[i * n + j] * w_bar;
        bar.weight[i * n + j] += edges.mask[i * n + j] * w_bar;
    }
}

/// Covariances of earlier batches, latest first, which compensate for a small batch size.
///
/// The latest batch has the weight 1, those before it ½, ¼, ⅛, …, normalised over the available batches. The
/// history is part of the state of a training run and is stored as arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Covariances, each (d, d), latest first.
    pub past: Vec<Vec<f64>>,
}

impl History {
    /// Number of batches that are combined, including the current one.
    pub const BATCHES: usize = 4;

    /// Returns `share` of the current batch and `carried` of the earlier ones; `carried` is `None` for the
    /// first batch.
    pub fn carried(&self) -> (f64, Option<Vec<f64>>) {
        let raw = |age: usize| (0..age).fold(1.0, |weight, _| 0.5 * weight);
        let total = (0..=self.past.len()).fold(0.0, |sum, age| sum + raw(age));
        let sum = |at: usize| {
            let ages = self.past.iter().enumerate();
            ages.fold(0.0, |sum, (age, c)| sum + raw(age + 1) / total * c[at])
        };
        let carried = self.past.first().map(|c| (0..c.len()).map(sum).collect());
        (raw(0) / total, carried)
    }

    /// Adds the covariance of a completed batch; the oldest is removed.
    pub fn push(&mut self, covariance: Vec<f64>) {
        self.past.insert(0, covariance);
        self.past.truncate(Self::BATCHES - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_batches_halve_and_add_up() {
        let mut history = History::default();
        assert_eq!(history.carried(), (1.0, None), "the first batch has no history");
        for batch in 1..=5 {
            history.push(vec![f64::from(batch)]);
        }
        let (share, carried) = history.carried();
        assert_eq!(history.past, [[5.0], [4.0], [3.0]], "three are kept");
        assert_eq!(share, 8.0 / 15.0, "the current one");
        let expected = (4.0 * 5.0 + 2.0 * 4.0 + 3.0) / 15.0;
        assert!((carried.expect("there are some")[0] - expected).abs() < 1e-15, "½, ¼, ⅛");
    }

    #[test]
    fn blocks_without_covariance_have_no_information_in_bits() {
        // means of two two-dimensional factors that never differ from 0 in the same sample
        let mu = [1.0, 2.0, 0.0, 0.0, -1.0, -2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.5, 0.0, 0.0, -3.0, -0.5];
        let (value, saved) = forward(&In::new(&mu, &[-1.0; 16], 4, 2, 2)).expect("positive definite");
        assert_eq!((value, saved.information[1]), (0.0, 0.0), "exactly");
        let flat = In { ridge: 0.0, ..In::new(&[0.0; 16], &[-800.0; 16], 4, 2, 2) };
        let refused = forward(&flat).expect_err("no spread, no noise, no ridge").to_string();
        assert!(refused.contains("positive definite") && refused.contains("pivot"), "{refused}");
    }
}
