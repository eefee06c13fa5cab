//! Which entries of the gradients of a network can be nonzero: those on a path of active units from an entry to an
//! output that has a cotangent.

use crate::ops::op::CheckedCall;

/// A network in f64, with the weights that no row has reached so far.
#[derive(Clone, Debug)]
pub(super) struct Layers {
    /// Weights of every layer with its number of outputs.
    weights: Vec<(usize, Vec<f64>)>,
    /// Per weight: no row reaches it.
    pub(super) zeros: Vec<Vec<bool>>,
}

impl Layers {
    pub(super) fn new(weights: Vec<(usize, Vec<f64>)>) -> Self {
        let zeros = weights.iter().map(|(_, w)| vec![true; w.len()]).collect();
        Self { weights, zeros }
    }

    /// The layers with these names.
    pub(super) fn of(x: &CheckedCall<'_>, names: &[&str]) -> Self {
        Self::new(names.iter().map(|name| (x.shape(name)[0], x.f64s(name))).collect())
    }

    /// Number of outputs.
    pub(super) fn outputs(&self) -> usize {
        self.weights[self.weights.len() - 1].0
    }

    /// Number of inputs.
    pub(super) fn inputs(&self) -> usize {
        self.weights[0].1.len() / Ord::max(self.weights[0].0, 1)
    }

    /// Sums of all units for one row, layer by layer; those of the last layer are the outputs.
    pub(super) fn units(&self, row: &[f64]) -> Vec<Vec<f64>> {
        let mut value = row.to_vec();
        let mut out = Vec::new();
        for (_, weight) in &self.weights {
            let dot = |w: &[f64]| w.iter().zip(&value).fold(0.0, |sum, (w, x)| sum + w * x);
            let z: Vec<f64> = weight.chunks_exact(value.len()).map(dot).collect();
            value = z.iter().map(|z| if *z > 0.0 { *z } else { 0.0 }).collect();
            out.push(z);
        }
        out
    }

    /// Marks the weights that a row with these units reaches, from all outputs; returns the inputs that it reaches.
    pub(super) fn reach(&mut self, units: &[Vec<f64>]) -> Vec<bool> {
        // Whether a unit of the layer reaches an output.
        let mut reaches = vec![true; self.outputs()];
        for l in (0..self.weights.len()).rev() {
            let inputs = self.weights[l].1.len() / self.weights[l].0;
            let is_active = |i: usize| l == 0 || units[l - 1][i] > 0.0;
            for (e, zero) in self.zeros[l].iter_mut().enumerate() {
                *zero &= !(reaches[e / inputs] && is_active(e % inputs));
            }
            let any = reaches.contains(&true);
            reaches = (0..inputs).map(|i| any && is_active(i)).collect();
        }
        reaches
    }
}

/// Sums of the hidden units.
pub(super) fn hidden(units: &[Vec<f64>]) -> impl Iterator<Item = f64> {
    units[..units.len() - 1].iter().flatten().copied()
}
