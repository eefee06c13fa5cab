//! Measures of how closely the blocks of a trained model correspond one to one to true factors, and the
//! values that the true factors themselves attain.
//!
//! True factors depend on each other where the graph has edges. Scores that assume independence therefore
//! stay below 1 even for a model that recovers the factors exactly, and every score is reported together with
//! that of û := u.
//!
//! Disentanglement and completeness are computed from ridge weights of all standardised dimensions of the
//! code. A block of several dimensions represents its factor along one axis; the remaining variation across
//! this axis is small, but has the same weight after standardisation, and traces of other factors in it
//! receive large weights. Both scores are therefore low for models whose blocks are nearly pure (0.14 at a
//! mean correlation of 0.98), and increase only if these traces vanish. The information gap of continuous
//! factors may exceed 1, because the information of a continuous variable about itself is unbounded while the
//! entropy is that of 20 bins.

use crate::Result;
use crate::loss::metric::mutual;
use crate::loss::metric::structure::blocks::{dci, information_gap};
use crate::loss::metric::structure::{Blocks, Factors};
use serde_json::{Value, json};

/// Maximum number of samples for the information gap, whose cost grows with their square.
const SAMPLES: usize = 512;
/// Number of neighbours for its estimates.
const NEIGHBOURS: usize = 3;

/// Scores of a representation; `None` if a score is undefined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Degree to which a block represents a single factor (in the form of DCI).
    pub disentanglement: Option<f64>,
    /// Degree to which a factor is represented by a single block (the completeness of DCI).
    pub completeness: Option<f64>,
    /// Difference in mutual information between the two blocks that are most informative about a factor,
    /// divided by the entropy of the factor (in the form of MIG, estimated by `MI-KSG`).
    pub information_gap: Option<f64>,
}

impl Likeness {
    /// Scores of blocks with respect to factors.
    ///
    /// # Errors
    /// If shapes do not match, there are fewer than two samples, or values are not finite.
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

    /// Scores of the true factors with respect to themselves, that is, of a perfect model.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_truth(u: &Factors<'_>) -> Result<Self> {
        Self::of(&Blocks { values: u.values, n: u.m, k: 1 }, u)
    }

    /// Names and values of the scores.
    pub fn named(&self) -> [(&'static str, Option<f64>); 3] {
        [
            ("disentanglement", self.disentanglement),
            ("completeness", self.completeness),
            ("information_gap", self.information_gap),
        ]
    }

    /// The scores as JSON for records.
    pub fn json(&self) -> Value {
        json!({
            "disentanglement": self.disentanglement, "completeness": self.completeness, "information_gap": self.information_gap,
        })
    }
}
