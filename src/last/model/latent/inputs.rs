//! Inputs and gradients of the latent part of the model.

use super::super::settings::{Placement, Reading, Supervision, Weights};
use super::super::structure::{Structure, StructureBar};

/// Composition of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Number of observed items.
    pub observed: usize,
    /// The factor set in each group.
    pub targets: Vec<usize>,
    /// Number of items of a group before the intervention, and the same number after it.
    pub members: usize,
}

impl Layout {
    /// Number of pairs of all groups.
    pub fn pairs(&self) -> usize {
        self.targets.len() * self.members
    }

    /// Total number of items.
    pub fn items(&self) -> usize {
        self.observed + 2 * self.pairs()
    }

    /// Index of the base of pair `p`.
    pub fn base(&self, p: usize) -> usize {
        self.observed + p
    }

    /// Index of the after-image of pair `p`.
    pub fn after(&self, p: usize) -> usize {
        self.observed + self.pairs() + p
    }

    /// The factor that was set in an item; `None` if the item is not an after-image.
    pub fn set_in(&self, item: usize) -> Option<usize> {
        let pair = item.checked_sub(self.observed + self.pairs())?;
        Some(self.targets[pair / self.members])
    }
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Parameters of the structure.
    pub structure: &'a Structure,
    /// The mask Ã, shape (n, n).
    pub mask: &'a [f64],
    /// Composition of the batch.
    pub layout: &'a Layout,
    /// Posterior means μ, shape (B, d).
    pub mu: &'a [f64],
    /// Logarithms ℓ of the posterior variances, shape (B, d).
    pub ell: &'a [f64],
    /// Standard normal draws η, shape (B, d).
    pub eta: &'a [f64],
    /// Running variances of the factors, shape (n).
    pub spread: &'a [f64],
    /// Values that were set, shape (G); only with supervision by labels.
    pub labels: &'a [f64],
    /// The reading of the paper.
    pub reading: Reading,
    /// The kind of supervision.
    pub supervision: Supervision,
    /// Weights of the loss terms.
    pub weights: Weights,
    /// The variables to which L_MI applies.
    pub placement: Placement,
    /// Weighted covariances of earlier batches, shape (d, d), and the weight of this batch; `None` at the
    /// start.
    pub carried: Option<(&'a [f64], f64)>,
}

/// Gradients.
#[derive(Clone, Debug)]
pub struct Bars {
    /// Gradient with respect to μ, shape (B, d).
    pub mu: Vec<f64>,
    /// Gradient with respect to ℓ, shape (B, d).
    pub ell: Vec<f64>,
    /// Gradient with respect to the mask, shape (n, n).
    pub mask: Vec<f64>,
    /// Gradient with respect to the parameters of the structure.
    pub structure: StructureBar,
}
