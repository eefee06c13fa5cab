//! The networks of a render, packed once, over the samples of a batch.
//!
//! The bits are those of [`crate::field::network`]: the same chains, in the same order. The gradient of a
//! weight continues the chain of the batches before, so that a block of rays is one left fold.

use crate::field::network::Network;
use crate::num::gemm::{CHUNK, Finish, Packed, View, gemm_here, gemm_packed_here};

/// One layer, packed for both directions.
#[derive(Debug)]
struct Layer {
    /// Wᵀ, (K, N).
    forward: Packed,
    /// W, (N, K).
    backward: Packed,
    n: usize,
    k: usize,
}

/// A network, packed.
#[derive(Debug)]
pub(super) struct Net {
    layers: Vec<Layer>,
}

/// Values of a network for the samples of a batch: the outputs of every layer, hidden ones after max(0, ·).
#[derive(Debug, Default)]
pub(super) struct Values {
    layers: Vec<Vec<f32>>,
    cotangents: [Vec<f32>; 2],
}

impl Values {
    /// Returns the outputs of the last layer, (rows, N).
    pub(super) fn outputs(&self) -> &[f32] {
        self.layers.last().map_or(&[], |y| y)
    }
}

impl Net {
    pub(super) fn new(network: &Network<'_>) -> Self {
        let widths = network.widths();
        let layer = |(weight, l): (&&[f32], usize)| {
            let (n, k) = (widths[l + 1], widths[l]);
            let w = View::new(weight, n, k);
            Layer { forward: Packed::new(w.t()), backward: Packed::new(w), n, k }
        };
        Self { layers: network.weights.iter().zip(0..).map(layer).collect() }
    }

    /// Number of outputs.
    pub(super) fn outputs(&self) -> usize {
        self.layers.last().map_or(0, |l| l.n)
    }

    /// Number of inputs.
    pub(super) fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |l| l.k)
    }

    /// Returns zeros for the gradients of the weights.
    pub(super) fn zeros(&self) -> Vec<Vec<f32>> {
        self.layers.iter().map(|l| vec![0.0; l.n * l.k]).collect()
    }

    /// Computes all layers for `rows` rows of features x (rows, K).
    pub(super) fn forward(&self, x: &[f32], rows: usize, values: &mut Values) {
        values.layers.resize_with(self.layers.len(), Vec::new);
        for (l, layer) in self.layers.iter().enumerate() {
            let (before, rest) = values.layers.split_at_mut(l);
            let (input, y) = (before.last().map_or(x, |y| y), &mut rest[0]);
            y.resize(rows * layer.n, 0.0);
            let how = if l + 1 < self.layers.len() { Finish::Relu } else { Finish::Store };
            gemm_packed_here(View::new(input, rows, layer.k), &layer.forward, how, y);
        }
    }

    /// Adds the gradients for the cotangents `y_bar` (rows, N) of the last layer to those of the weights, and
    /// of the features to `x_bar` (rows, K).
    pub(super) fn adjoint(
        &self,
        x: &[f32],
        values: &mut Values,
        y_bar: &[f32],
        weights_bar: &mut [Vec<f32>],
        x_bar: &mut [f32],
    ) {
        let rows = x.len() / self.inputs().max(1);
        let [mut here, mut next] = std::mem::take(&mut values.cotangents);
        here.clear();
        here.extend_from_slice(y_bar);
        for (l, layer) in self.layers.iter().enumerate().rev() {
            let input = if l > 0 { &values.layers[l - 1] } else { x };
            let bar = View::new(&here, rows, layer.n);
            // The chain of a weight continues over the rows of all batches, at most CHUNK of them per product.
            for (bar, input) in here.chunks(CHUNK * layer.n).zip(input.chunks(CHUNK * layer.k)) {
                let rows = bar.len() / layer.n;
                let (bar, input) = (View::new(bar, rows, layer.n), View::new(input, rows, layer.k));
                gemm_here(bar.t(), input, Finish::Resume, &mut weights_bar[l]);
            }
            if l == 0 {
                gemm_packed_here(bar, &layer.backward, Finish::Add, x_bar);
                break;
            }
            next.resize(rows * layer.k, 0.0);
            gemm_packed_here(bar, &layer.backward, Finish::Gated(input, layer.k), &mut next);
            std::mem::swap(&mut here, &mut next);
        }
        values.cotangents = [here, next];
    }
}
