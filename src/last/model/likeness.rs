//! How far blocks of a trained model correspond to true factors one to one, and what the true factors themselves would score (`last.md` §13.2).
//!
//! True factors depend on each other where the graph has edges, so scores that rest on independence stay below 1 even for a model that gives the factors back:
//! every score stands beside that of û := u.
//!
//! Disentanglement and completeness rest on ridge weights of all standardised numbers of the code. A block of several numbers carries its factor along one axis; what is left
//! across it is small, but standardised it counts as much, and traces of other factors in it get large weights. So both are low for models whose blocks are nearly
//! clean (mean correlation 0.98: 0.14), and rise only where the traces go. The information gap of continuous factors may exceed 1: a number tells itself without
//! end, and the entropy is that of 20 bins.

use crate::Result;
use crate::loss::metric::mutual;
use crate::loss::metric::structure::blocks::{dci, information_gap};
use crate::loss::metric::structure::{Blocks, Factors};
use serde_json::{Value, json};

/// Samples that the information gap looks at, at most; its work grows with their square.
const SAMPLES: usize = 512;
/// Neighbours of its estimates.
const NEIGHBOURS: usize = 3;

/// Scores of a representation; none where a score is not defined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// whether a block tells of one factor only (the form of DCI)
    pub disentanglement: Option<f64>,
    /// whether a factor is told by one block only
    pub completeness: Option<f64>,
    /// of the two blocks that tell most of a factor, what the first tells more, over the factor's entropy (the form of MIG, by `MI-KSG`)
    pub information_gap: Option<f64>,
}

impl Likeness {
    /// Of blocks against factors.
    ///
    /// # Errors
    /// Shapes that do not fit, fewer than two samples, numbers that are not finite.
    pub fn of(z: &Blocks<'_>, u: &Factors<'_>) -> Result<Self> {
        let dci = dci(z, u)?;
        let count = Ord::min(SAMPLES, z.count());
        let first = Blocks { values: &z.values[..count * z.dims()], ..*z };
        let factors = Factors { values: &u.values[..count * u.m], ..*u };
        let information =
            |block: &[f64], _: usize, factor: &[f64]| mutual::ksg(block, factor, count, NEIGHBOURS);
        let gap = if count > NEIGHBOURS { information_gap(&first, &factors, information)? } else { None };
        Ok(Self {
            disentanglement: dci.disentanglement,
            completeness: dci.completeness,
            information_gap: gap,
        })
    }

    /// Of the true factors against themselves: what a perfect model scores.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_truth(u: &Factors<'_>) -> Result<Self> {
        Self::of(&Blocks { values: u.values, n: u.m, k: 1 }, u)
    }

    /// Names and values.
    pub fn named(&self) -> [(&'static str, Option<f64>); 3] {
        [
            ("disentanglement", self.disentanglement),
            ("completeness", self.completeness),
            ("information_gap", self.information_gap),
        ]
    }

    /// For records.
    pub fn json(&self) -> Value {
        json!({
            "disentanglement": self.disentanglement, "completeness": self.completeness, "information_gap": self.information_gap,
        })
    }
}
