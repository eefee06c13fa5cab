//! `loss.groups`: losses of groups of images that share one intervention.
//!
//! In group g, the factor i = i(g) was set to an unknown value; members m = 1 … M are image pairs before and
//! after the intervention. With v_g = (1/M) Σ_m û'(g,m,i), for G groups:
//!
//! If the codes of the values are given, v_g is the given code instead of the mean.
//!
//! L_eq  = 1/(G·M·k) · Σ over g, m of ‖û'(g,m,i) − v_g‖² / max(s_i², 10⁻⁴)        (equal values have equal
//! codes)
//!
//! L_inv = 1/(G·M·(n−1)·k) · Σ over g, m, j ≠ i of ‖ε(g,m,j) − ε'(g,m,j)‖²        (no other cause changes)
//!
//! L_spr = mean over factors of max(0, ¼ − V_i)        (codes do not collapse)
//!
//! V_i is the variance of v_g over the G_i groups of factor i: Σ ‖v_g − mean‖² / ((G_i − 1)·k). Factors with
//! fewer than two groups have no variance and are excluded from the mean; if all are excluded, L_spr = 0. The
//! LAST paper describes such a loss only in words (chapter *Learned causes*).
//!
//! | symbol | argument | shape | range |
//! |--------|----------|-------|-------|
//! | û' | `after` | (G, M, n, k) | posterior means of the factors after the intervention |
//! | ε, ε' | `eps`, `eps_after` | (G, M, n, k) | causes before and after |
//! | i | `target` | (G) | 0 … n−1 |
//! | s² | `variance` | (n) | ≥ 0, running variance of each factor; not differentiated |
//! | v | `given` | (G, k) | codes of the values, optional |
//! | L_eq | `equal` | () | ≥ 0 |
//! | L_inv | `invariant` | () | ≥ 0; 0 for n = 1 |
//! | L_spr | `spread` | () | 0 … ¼ |
//! | v | `shared` | (G, k) | the value of each group, an input of operators that intervene with it |
//!
//! # Rounding
//! All values are f64. v_g: a left fold over m, divided by M. L_eq: per group a left fold over (m, c) of
//! squares, divided by max(s², 10⁻⁴); a left fold over the groups; one division. L_inv: a left fold over (g,
//! m, j, c); one division. V_i: left folds over the groups of the factor, and over (g, c) of squares. All
//! folds start from +0.
//!
//! # Kinks and domain
//! L_spr has a kink where V_i = ¼: there and above, the gradient is 0. It is an error if there is no group or
//! no member, or if n·k = 0.
//!
//! # Adjoint
//! With weights a = 2·L̄_eq/(G·M·k·max(s², 10⁻⁴)), b = 2·L̄_inv/(G·M·(n−1)·k), and for V_i < ¼
//! c = −2·L̄_spr/(F·(G_i − 1)·k) with F factors in the mean
//!
//! ū'(g,m,i) += a·(û'(g,m,i) − v_g) + (c·(v_g − mean) + v̄_g)/M,   ε̄(g,m,j) += b·(ε − ε'),
//! ε̄'(g,m,j) −= the same, j ≠ i
//!
//! The path of L_eq through v_g vanishes, because the differences from a mean add up to 0. If v is given, no
//! gradient passes through it to û', and
//!
//! v̄(g) += c·(v_g − mean) + v̄_g − a·Σ_m (û'(g,m,i) − v_g)
//!
//! Twin: `reference::loss::groups`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::groups::{In, forward};
//! // one group of two members, two one-dimensional factors; factor 0 was set
//! let x = In {
//!     after: &[1.0, 7.0, 3.0, 7.0], eps: &[0.0, 1.0, 0.0, 2.0], eps_after: &[5.0, 1.5, 5.0, 2.0],
//!     target: &[0], variance: &[1.0, 1.0], given: None, members: 2, factors: 2, size: 1,
//! };
//! let out = forward(&x)?;
//! assert_eq!((out.shared[0], out.equal, out.invariant, out.spread), (2.0, 1.0, 0.125, 0.0));
//! # Ok::<(), lastlight::Error>(())
//! ```

use crate::{Error, Result};

/// Smallest variance that L_eq divides by.
pub const VARIANCE_FLOOR: f64 = 1e-4;
/// Variance of the values below which L_spr is positive.
pub const SPREAD: f64 = 0.25;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (G, M, n, k).
    pub after: &'a [f64],
    /// Shape (G, M, n, k).
    pub eps: &'a [f64],
    /// Shape (G, M, n, k).
    pub eps_after: &'a [f64],
    /// Shape (G).
    pub target: &'a [usize],
    /// Shape (n).
    pub variance: &'a [f64],
    /// Given codes of the values, shape (G, k); if absent, the means of the members are used.
    pub given: Option<&'a [f64]>,
    /// Number of members per group, M.
    pub members: usize,
    /// Number of factors, n.
    pub factors: usize,
    /// Number of dimensions per factor, k.
    pub size: usize,
}

/// Outputs or their cotangents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Loss L_eq, or its cotangent.
    pub equal: f64,
    /// Loss L_inv, or its cotangent.
    pub invariant: f64,
    /// Loss L_spr, or its cotangent.
    pub spread: f64,
    /// Values v of the groups, shape (G, k), or their cotangents.
    pub shared: Vec<f64>,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (G, M, n, k).
    pub after: Vec<f64>,
    /// Shape (G, M, n, k).
    pub eps: Vec<f64>,
    /// Shape (G, M, n, k).
    pub eps_after: Vec<f64>,
    /// Shape (G, k); empty if no codes are given.
    pub given: Vec<f64>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = vec![0.0; x.after.len()];
        let given = vec![0.0; x.given.map_or(0, <[f64]>::len)];
        Self { after: zeros.clone(), eps: zeros.clone(), eps_after: zeros, given }
    }
}

/// Statistics of the groups of one factor.
struct Factor {
    groups: Vec<usize>,
    /// Mean of the groups' values, shape (k).
    mean: Vec<f64>,
    /// Variance V_i.
    variance: f64,
}

impl In<'_> {
    /// Checks sizes and targets.
    ///
    /// # Errors
    /// Returns an error for wrong sizes, an empty batch, a target that is not a factor, or a variance that is
    /// not a number ≥ 0.
    pub fn check(&self) -> Result<()> {
        let what = |name: &str| Error::input("loss.groups").at(format!("array '{name}'"));
        let (g, m, n, k) = (self.target.len(), self.members, self.factors, self.size);
        if g * m * n * k == 0 {
            return Err(Error::input("loss.groups")
                .expected("at least one group, member, factor and dimension")
                .got(format!("({g}, {m}, {n}, {k})")));
        }
        for (name, values) in [("after", self.after), ("eps", self.eps), ("eps_after", self.eps_after)] {
            if values.len() != g * m * n * k {
                return Err(what(name)
                    .expected(format!("({g}, {m}, {n}, {k}) numbers"))
                    .got(values.len().to_string()));
            }
        }
        if let Some(at) = self.target.iter().position(|i| *i >= n) {
            return Err(Error::input("loss.groups")
                .at(format!("array 'target', entry {at}"))
                .expected(format!("a factor from 0 to {}", n - 1))
                .got(self.target[at].to_string()));
        }
        if self.variance.len() != n || !self.variance.iter().all(|s| *s >= 0.0 && s.is_finite()) {
            return Err(what("variance").expected(format!("{n} finite numbers of at least 0")));
        }
        if let Some(given) = self.given.filter(|given| given.len() != g * k) {
            return Err(what("given").expected(format!("({g}, {k}) numbers")).got(given.len().to_string()));
        }
        Ok(())
    }

    /// Returns the index of the first value of factor `j` of member `m` of group `g`.
    fn place(&self, g: usize, m: usize, j: usize) -> usize {
        ((g * self.members + m) * self.factors + j) * self.size
    }

    /// Returns û' of the factor that was set.
    fn set(&self, g: usize, m: usize) -> &[f64] {
        &self.after[self.place(g, m, self.target[g])..][..self.size]
    }

    /// Returns max(s², floor) of the factor that group `g` set.
    fn scale(&self, g: usize) -> f64 {
        let variance = self.variance[self.target[g]];
        if variance > VARIANCE_FLOOR { variance } else { VARIANCE_FLOOR }
    }

    /// Returns the number of values in the mean of L_eq.
    fn count(&self) -> f64 {
        (self.target.len() * self.members * self.size) as f64
    }

    /// Returns the number of values in the mean of L_inv.
    fn others(&self) -> f64 {
        self.count() * (self.factors - 1) as f64
    }

    /// Returns the factors with at least two groups.
    fn spreads(&self, shared: &[f64]) -> Vec<Factor> {
        let k = self.size;
        let mut all = Vec::new();
        for i in 0..self.factors {
            let groups: Vec<usize> = (0..self.target.len()).filter(|g| self.target[*g] == i).collect();
            if groups.len() < 2 {
                continue;
            }
            let mean: Vec<f64> = (0..k)
                .map(|c| groups.iter().fold(0.0, |sum, g| sum + shared[g * k + c]) / groups.len() as f64)
                .collect();
            let mut squares = 0.0;
            for g in &groups {
                for (v, mean) in shared[g * k..][..k].iter().zip(&mean) {
                    squares += (v - mean) * (v - mean);
                }
            }
            let variance = squares / ((groups.len() - 1) * k) as f64;
            all.push(Factor { groups, mean, variance });
        }
        all
    }
}

/// Returns the three losses and the value of each group.
///
/// # Errors
/// Returns an error under the conditions of [`In::check`], or if a result is not finite.
pub fn forward(x: &In<'_>) -> Result<Out> {
    x.check()?;
    let (k, members) = (x.size, x.members);
    let mut out = Out { shared: vec![0.0; x.target.len() * k], ..Out::default() };
    for g in 0..x.target.len() {
        let v = &mut out.shared[g * k..][..k];
        if let Some(given) = x.given {
            v.copy_from_slice(&given[g * k..][..k]);
        } else {
            for m in 0..members {
                v.iter_mut().zip(x.set(g, m)).for_each(|(v, u)| *v += u);
            }
            v.iter_mut().for_each(|v| *v /= members as f64);
        }
        let (mut squares, mut changes) = (0.0, out.invariant);
        for m in 0..members {
            for (u, v) in x.set(g, m).iter().zip(&*v) {
                squares += (u - v) * (u - v);
            }
            for j in (0..x.factors).filter(|j| *j != x.target[g]) {
                let at = x.place(g, m, j);
                for (e, after) in x.eps[at..][..k].iter().zip(&x.eps_after[at..][..k]) {
                    changes += (e - after) * (e - after);
                }
            }
        }
        out.equal += squares / x.scale(g);
        out.invariant = changes;
    }
    out.equal /= x.count();
    if x.factors > 1 {
        out.invariant /= x.others();
    }
    let spreads = x.spreads(&out.shared);
    let missing = |factor: &Factor| if factor.variance < SPREAD { SPREAD - factor.variance } else { 0.0 };
    if !spreads.is_empty() {
        out.spread = spreads.iter().fold(0.0, |sum, factor| sum + missing(factor)) / spreads.len() as f64;
    }
    for value in [out.equal, out.invariant, out.spread] {
        super::finite("loss.groups", value)?;
    }
    Ok(out)
}

/// Adds the gradients for the cotangents `out_bar` of `out`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, out: &Out, out_bar: &Out, x_bar: &mut InBar) {
    let (k, members) = (x.size, x.members);
    assert_eq!(out_bar.shared.len(), out.shared.len(), "the cotangent of `shared` is (G, k)");
    // The cotangent of v_g (G, k), distributed to the members if v_g is their mean.
    let mut value_bar = out_bar.shared.clone();
    let spreads = x.spreads(&out.shared);
    for factor in spreads.iter().filter(|factor| factor.variance < SPREAD) {
        let count = (spreads.len() * (factor.groups.len() - 1) * k) as f64;
        let weight = -2.0 * out_bar.spread / count;
        for g in &factor.groups {
            for (c, mean) in factor.mean.iter().enumerate() {
                value_bar[g * k + c] += weight * (out.shared[g * k + c] - mean);
            }
        }
    }
    for g in 0..x.target.len() {
        let same = 2.0 * out_bar.equal / (x.count() * x.scale(g));
        for m in 0..members {
            let at = x.place(g, m, x.target[g]);
            for (c, u) in x.set(g, m).iter().enumerate() {
                let apart = same * (u - out.shared[g * k + c]);
                if x.given.is_some() {
                    x_bar.after[at + c] += apart;
                    value_bar[g * k + c] -= apart;
                } else {
                    x_bar.after[at + c] += apart + value_bar[g * k + c] / members as f64;
                }
            }
            for j in (0..x.factors).filter(|j| *j != x.target[g]) {
                let at = x.place(g, m, j);
                for i in at..at + k {
                    let change = 2.0 * out_bar.invariant / x.others() * (x.eps[i] - x.eps_after[i]);
                    x_bar.eps[i] += change;
                    x_bar.eps_after[i] -= change;
                }
            }
        }
    }
    x_bar.given.iter_mut().zip(value_bar).for_each(|(bar, v)| *bar += v);
}
