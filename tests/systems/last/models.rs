//! Random structural models to test with: an acyclic graph with randomly ordered nodes, weights, networks,
//! causes.

use lastlight::causal::structure::{In, Mechanism, Networks};
use lastlight::num::rng::Rng;

/// Purpose word of the draws made here (see `num::rng`).
const PURPOSE: u16 = 0x7e57;
/// Hidden units of the networks.
const HIDDEN: usize = 6;

/// Normal numbers of an array of a model.
pub(crate) fn normals(seed: u64, model: u32, array: u16, len: usize) -> Vec<f64> {
    (0..len).map(|i| f64::from(Rng::new(seed).normal_f32(i as u64, model, PURPOSE, array))).collect()
}

/// Numbers uniform in 0..1.
pub(crate) fn uniforms(seed: u64, model: u32, array: u16, len: usize) -> Vec<f64> {
    (0..len).map(|i| f64::from(Rng::new(seed).uniform_f32(i as u64, model, PURPOSE, array))).collect()
}

/// One model with the causes of one sample.
pub(crate) struct Model {
    pub(crate) n: usize,
    pub(crate) k: usize,
    /// parents before children
    pub(crate) order: Vec<usize>,
    /// (n, n) zeros and ones
    pub(crate) mask: Vec<f64>,
    /// (n, n)
    pub(crate) weight: Vec<f64>,
    /// (n, k)
    pub(crate) eps: Vec<f64>,
    layers: [Vec<f64>; 5],
}

impl Model {
    /// Model number `model`: 2 to 8 factors of 1 to 3 numbers, about half of all possible edges.
    pub(crate) fn new(model: u32) -> Self {
        let (n, k) = (2 + model as usize % 7, 1 + model as usize % 3);
        let draw = |array: u16, len: usize, scale: f64| -> Vec<f64> {
            normals(2, model, array, len).into_iter().map(|x| scale * x).collect()
        };
        let mut order: Vec<usize> = (0..n).collect();
        let keys = draw(0, n, 1.0);
        order.sort_by(|a, b| keys[*a].total_cmp(&keys[*b]));
        let edges = draw(1, n * n, 1.0);
        let mut mask = vec![0.0; n * n];
        for (place, i) in order.iter().enumerate() {
            for j in &order[place + 1..] {
                mask[i * n + j] = if edges[i * n + j] > 0.0 { 1.0 } else { 0.0 };
            }
        }
        let h = HIDDEN;
        let lengths = [n * h * n * k, n * h, n * h * h, n * h, n * k * h];
        let layers = std::array::from_fn(|i| draw(2 + i as u16, lengths[i], 0.5));
        Self { n, k, order, mask, weight: draw(7, n * n, 1.0), eps: draw(8, n * k, 1.0), layers }
    }

    /// The networks, or the weights.
    pub(crate) fn mechanism(&self, linear: bool) -> Mechanism<'_> {
        if linear {
            return Mechanism::Linear { weight: &self.weight };
        }
        let [w0, b0, w1, b1, w2] = &self.layers;
        Mechanism::Networks(Networks { w0, b0, w1, b1, w2, hidden: HIDDEN, slope: 0.05 })
    }

    /// The structure at its causes, with as many sweeps as a graph of n nodes needs.
    pub(crate) fn input(&self, linear: bool) -> In<'_> {
        let sweeps = if linear { self.n - 1 } else { self.n };
        let mechanism = self.mechanism(linear);
        In { eps: &self.eps, mask: &self.mask, mechanism, batch: 1, n: self.n, k: self.k, sweeps }
    }

    /// W = Ã∘Ω.
    pub(crate) fn edges(&self) -> Vec<f64> {
        self.mask.iter().zip(&self.weight).map(|(m, w)| m * w).collect()
    }
}

/// Bit patterns, for exact comparison.
pub(crate) fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}

/// Largest |a − b| over max(1, largest |b|).
pub(crate) fn worst(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many numbers");
    let (mut worst, mut scale) = (0.0, 1.0);
    for (a, b) in a.iter().zip(b) {
        worst = if (a - b).abs() > worst { (a - b).abs() } else { worst };
        scale = if b.abs() > scale { b.abs() } else { scale };
    }
    worst / scale
}
