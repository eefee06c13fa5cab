//! What the latent part of the model takes, and the gradients it gives.

use super::super::settings::{Placement, Reading, Supervision, Weights};
use super::super::structure::{Structure, StructureBar};

/// What a batch is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// observed items
    pub observed: usize,
    /// factor set in each group
    pub targets: Vec<usize>,
    /// items of a group, before and after alike
    pub members: usize,
}

impl Layout {
    /// Pairs of all groups.
    pub fn pairs(&self) -> usize {
        self.targets.len() * self.members
    }

    /// Items in all.
    pub fn items(&self) -> usize {
        self.observed + 2 * self.pairs()
    }

    /// The base of pair `p`.
    pub fn base(&self, p: usize) -> usize {
        self.observed + p
    }

    /// The after-image of pair `p`.
    pub fn after(&self, p: usize) -> usize {
        self.observed + self.pairs() + p
    }

    /// The factor that was set in an after-image.
    pub fn set_in(&self, item: usize) -> Option<usize> {
        let pair = item.checked_sub(self.observed + self.pairs())?;
        Some(self.targets[pair / self.members])
    }
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// parameters
    pub structure: &'a Structure,
    /// Ã (n, n)
    pub mask: &'a [f64],
    /// what the batch is made of
    pub layout: &'a Layout,
    /// (B, d)
    pub mu: &'a [f64],
    /// (B, d)
    pub ell: &'a [f64],
    /// (B, d)
    pub eta: &'a [f64],
    /// (n) running variances of the factors
    pub spread: &'a [f64],
    /// (G) values that were set; with labels only
    pub labels: &'a [f64],
    /// which model
    pub reading: Reading,
    /// what groups say
    pub supervision: Supervision,
    /// factors of the terms
    pub weights: Weights,
    /// what L_MI looks at
    pub placement: Placement,
    /// (d, d) weighted covariances of earlier batches, and the weight of this one; none at the start
    pub carried: Option<(&'a [f64], f64)>,
}

/// Gradients.
#[derive(Clone, Debug)]
pub struct Bars {
    /// (B, d)
    pub mu: Vec<f64>,
    /// (B, d)
    pub ell: Vec<f64>,
    /// (n, n)
    pub mask: Vec<f64>,
    /// by the parameters of the structure
    pub structure: StructureBar,
}
