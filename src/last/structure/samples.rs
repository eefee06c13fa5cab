//! Samples of factors, some of which were set by an intervention.

use crate::math::principal;
use crate::{Error, Result};

/// Values of n factors of k dimensions, and the intervention on each sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// Values, shape (N, n, k).
    values: Vec<f64>,
    /// The factor that was set, shape (N).
    targets: Vec<Option<usize>>,
    /// The draw of noise of each sample, shape (N); a sample and its counterfactual share one.
    draws: Vec<usize>,
    n: usize,
    k: usize,
}

impl Samples {
    /// No samples.
    pub fn new(n: usize, k: usize) -> Self {
        Self { values: Vec::new(), targets: Vec::new(), draws: Vec::new(), n, k }
    }

    /// Adds a sample (n, k) without an intervention.
    pub fn observe(&mut self, values: &[f64]) {
        let draw = self.draws.last().map_or(0, |d| d + 1);
        self.push(values, None, draw);
    }

    /// Adds a sample before and after factor `target` was set; the noise of the others is the same.
    pub fn intervene(&mut self, before: &[f64], after: &[f64], target: usize) {
        assert!(target < self.n, "factor {target} of {}", self.n);
        self.observe(before);
        let draw = self.draws.last().copied().unwrap_or(0);
        self.push(after, Some(target), draw);
    }

    fn push(&mut self, values: &[f64], target: Option<usize>, draw: usize) {
        assert_eq!(values.len(), self.n * self.k, "{} factors of {} dimensions", self.n, self.k);
        self.values.extend_from_slice(values);
        self.targets.push(target);
        self.draws.push(draw);
    }

    /// Number of factors.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of dimensions per factor.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Number of samples.
    pub fn count(&self) -> usize {
        self.targets.len()
    }

    /// The values (n, k) of sample `s`.
    pub fn row(&self, s: usize) -> &[f64] {
        &self.values[s * self.n * self.k..][..self.n * self.k]
    }

    /// The factor that was set in sample `s`.
    pub fn target(&self, s: usize) -> Option<usize> {
        self.targets[s]
    }

    /// Weight of each sample for the mechanism of `j`, shape (N): 0 where j was set, otherwise the reciprocal
    /// of the number of samples with the same draw of its noise. The sum of the weights is therefore the
    /// number of draws, and a pair does not count twice.
    pub fn weights(&self, j: usize) -> Vec<f64> {
        let shows = |s: usize| self.targets[s] != Some(j);
        let mut weights = vec![0.0; self.count()];
        let mut start = 0;
        while start < self.count() {
            let end =
                (start..self.count()).find(|&s| self.draws[s] != self.draws[start]).unwrap_or(self.count());
            let shown = (start..end).filter(|&s| shows(s)).count();
            for s in (start..end).filter(|&s| shows(s)) {
                weights[s] = 1.0 / shown as f64;
            }
            start = end;
        }
        weights
    }

    /// One number per factor: the projection of its block on the axis of largest variance over all samples.
    ///
    /// A learned block represents its factor along one axis; the variation across it, thousandths of the
    /// variance, consists of traces of other factors and of the noise of the encoder. A regression on k
    /// standardised dimensions interprets their differences as signal, and finds spurious parents.
    pub fn along_axes(&self) -> Self {
        let (n, k) = (self.n, self.k);
        let block = |s: usize, i: usize| &self.row(s)[i * k..(i + 1) * k];
        let axes: Vec<Vec<f64>> = (0..if self.count() > 0 { n } else { 0 })
            .map(|i| principal::axis(&(0..self.count()).map(|s| block(s, i)).collect::<Vec<_>>(), k))
            .collect();
        let along =
            |s: usize, i: usize| block(s, i).iter().zip(&axes[i]).fold(0.0, |sum, (x, a)| sum + x * a);
        let values = (0..self.count()).flat_map(|s| (0..n).map(move |i| (s, i))).map(|(s, i)| along(s, i));
        Self { values: values.collect(), targets: self.targets.clone(), draws: self.draws.clone(), n, k: 1 }
    }

    /// Every dimension scaled to mean 0 and variance 1 over all samples.
    ///
    /// # Errors
    /// If there are fewer than two samples, a number is not finite, or a dimension does not vary.
    pub fn standardised(&self) -> Result<Self> {
        let (dims, count) = (self.n * self.k, self.count());
        let what = || Error::input("samples of factors");
        if count < 2 || dims == 0 {
            return Err(what()
                .expected("at least two samples of a factor")
                .got(format!("{count} of {dims}")));
        }
        if let Some(at) = self.values.iter().position(|x| !x.is_finite()) {
            let place = format!("sample {}, dimension {}", at / dims, at % dims);
            return Err(what().at(place).expected("a finite number").got(self.values[at].to_string()));
        }
        let mut out = self.clone();
        for d in 0..dims {
            let column = || self.values.iter().skip(d).step_by(dims);
            let mean = column().fold(0.0, |s, x| s + x) / count as f64;
            let variance = column().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / count as f64;
            if !(variance > 1e-24 * (1.0 + mean * mean)) {
                return Err(what()
                    .at(format!("dimension {d}"))
                    .expected("values that vary")
                    .got("a constant"));
            }
            let scale = 1.0 / variance.sqrt();
            for x in out.values.iter_mut().skip(d).step_by(dims) {
                *x = (*x - mean) * scale;
            }
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::last::structure::score::{Features, Table};
    use crate::last::structure::search::climb;
    use crate::math::digraph::Digraph;
    use crate::num::rng::Rng;

    /// Two independent factors; the second block has a trace of the first across its axis.
    #[test]
    fn a_trace_across_the_axis_is_no_parent() {
        let rng = Rng::new(5);
        let mut samples = Samples::new(2, 2);
        for s in 0..600 {
            let [a, b] = [0, 1].map(|c| rng.normal_f64(s, 0, 0x7e59, c));
            samples.observe(&[a, 2.0 * a, b + 1e-3 * a, b]);
        }
        let edges = |samples: &Samples| {
            let table = Table::new(samples, Features::Linear).expect("samples that vary");
            climb(&table, &Digraph::from_fn(2, |_, _| false))
                .0
                .graph
                .adjacency()
                .iter()
                .filter(|e| **e > 0.0)
                .count()
        };
        assert_eq!(edges(&samples), 1, "the difference of its dimensions shows the first factor");
        let along = samples.along_axes();
        assert_eq!((along.n(), along.k(), along.count()), (2, 1, 600));
        assert_eq!(edges(&along), 0);
    }
}
