//! `causal.code`: the latent code of the value that an intervention set, computed from its label.
//!
//! c_g = v_g w_i,   i = target of group g,   w_i = (1, w_i2, …, w_ik)
//!
//! This form is used with supervision `labels` (chapter *Learned causes*, "How it is trained").
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | v | `labels` | (G) | finite, constants |
//! | i | `target` | (G) | 0 … n − 1 |
//! | w | `values` | (n, k) | finite; the first entry of a row is 1 and is not read |
//! | c | `codes` | (G, k) | |
//!
//! # Rounding
//! All values are f64; there is one product per entry.
//!
//! # Kinks and domain
//! There are no kinks.
//!
//! # Adjoint
//! w̄_i += Σ over groups of target i of v_g c̄_g, in index order; the first entry of a row gets no gradient.
//! Nothing is saved.
//!
//! Twin: `reference::causal::code`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::code::{In, forward};
//! let x = In { labels: &[3.0], target: &[1], values: &[1.0, 0.5, 1.0, -2.0], k: 2 };
//! assert_eq!(forward(&x), [3.0, -6.0]);
//! ```

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (G).
    pub labels: &'a [f64],
    /// Shape (G).
    pub target: &'a [usize],
    /// Shape (n, k).
    pub values: &'a [f64],
    /// Number of dimensions per factor, k.
    pub k: usize,
}

impl In<'_> {
    fn hold_to_shapes(&self) {
        assert_eq!(self.labels.len(), self.target.len(), "one label per group");
        assert!(self.k > 0 && self.values.len().is_multiple_of(self.k), "values are (n, k)");
    }
}

/// Returns c (G, k).
///
/// # Panics
/// Panics if a target is not a factor, or if an array does not have the size of its shape.
pub fn forward(x: &In<'_>) -> Vec<f64> {
    x.hold_to_shapes();
    let code = |i: usize, c: usize| if c == 0 { 1.0 } else { x.values[i * x.k + c] };
    let groups = x.target.iter().zip(x.labels);
    groups.flat_map(|(&i, v)| (0..x.k).map(move |c| v * code(i, c))).collect()
}

/// Adds the gradient for the cotangent `codes_bar` (G, k) to `values_bar` (n, k).
///
/// # Panics
/// Panics if a target is not a factor, or if an array does not have the size of its shape.
pub fn adjoint(x: &In<'_>, codes_bar: &[f64], values_bar: &mut [f64]) {
    x.hold_to_shapes();
    assert!(
        codes_bar.len() == x.target.len() * x.k && values_bar.len() == x.values.len(),
        "codes_bar is (G, k), values_bar is (n, k)"
    );
    for ((bar, i), v) in codes_bar.chunks_exact(x.k).zip(x.target).zip(x.labels) {
        for c in 1..x.k {
            values_bar[i * x.k + c] += v * bar[c];
        }
    }
}
