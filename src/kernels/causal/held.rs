//! `causal.held`: the values at which the factors of counterfactuals are held, one for every pair.
//!
//! h_p = v_g  (a value that the group shares)   or   h_p = u_p,i  (the pair's own),   g = group of pair p, i = its target      (chapter *Learned causes*, "How it is trained")
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | v | `shared` | (G, k), or `factors` | finite |
//! | u | `factors` | (G·M, n, k), or `shared` | finite; of the after-images |
//! | i | `target` | (G) | 0 … n − 1; read with `factors` |
//! | M | `members` | () | ≥ 1: pairs in each group |
//! | h | `held` | (G·M, k) | |
//!
//! # Rounding
//! Copies.
//!
//! # Kinks and domain
//! None. From files at most 2²⁶ numbers are held.
//!
//! # Adjoint
//! v̄_g += Σ over the pairs of g of h̄_p in index order, or ū_p,i += h̄_p. Nothing is saved.
//!
//! Twin: `reference::causal::held`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::held::{From, In, forward};
//! let x = In { from: From::Shared(&[0.5, 2.0]), target: &[0, 1], members: 2, n: 2, k: 1 };
//! assert_eq!(forward(&x), [0.5, 0.5, 2.0, 2.0]);
//! ```

/// Where the values come from.
#[derive(Clone, Copy, Debug)]
pub enum From<'a> {
    /// (G, k) one for each group
    Shared(&'a [f64]),
    /// (G·M, n, k) factors of each pair
    Own(&'a [f64]),
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// v or u
    pub from: From<'a>,
    /// (G)
    pub target: &'a [usize],
    /// M
    pub members: usize,
    /// n
    pub n: usize,
    /// k
    pub k: usize,
}

impl In<'_> {
    /// Where the value of pair `p` begins.
    fn start(&self, p: usize) -> usize {
        let g = p / self.members;
        match self.from {
            From::Shared(_) => g * self.k,
            From::Own(_) => (p * self.n + self.target[g]) * self.k,
        }
    }
}

/// h (G·M, k).
///
/// # Panics
/// When an array does not have the size of its shape.
pub fn forward(x: &In<'_>) -> Vec<f64> {
    let (From::Shared(values) | From::Own(values)) = x.from;
    (0..x.target.len() * x.members).flat_map(|p| &values[x.start(p)..][..x.k]).copied().collect()
}

/// Adds the gradient for the cotangent `held_bar` (G·M, k) to `from_bar`, which has the shape of `shared` or of `factors`.
///
/// # Panics
/// When an array does not have the size of its shape.
pub fn adjoint(x: &In<'_>, held_bar: &[f64], from_bar: &mut [f64]) {
    for (p, bar) in held_bar.chunks_exact(x.k).enumerate() {
        from_bar[x.start(p)..][..x.k].iter_mut().zip(bar).for_each(|(into, g)| *into += g);
    }
}
