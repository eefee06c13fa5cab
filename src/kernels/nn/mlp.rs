//! `nn.mlp`: a fully connected network of affine maps with ReLU, max(0, ·), between them.
//!
//! y⁰ = x,   z = Wˡ yˡ⁻¹ + bˡ,   yˡ = max(0, z) for l < L,   y = z of the last layer L
//! (Glorot, Bordes and Bengio 2011)
//!
//! The layer with index `skip` also receives the input: its argument is (yˡ⁻¹, x), in this order (as in the
//! skinning field of GauHuman).
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `x` | (M, K) | finite |
//! | Wˡ | `weight` of a layer | (Nˡ, Kˡ) | finite; Kˡ is Nˡ⁻¹, plus K at `skip` |
//! | bˡ | `bias` of a layer | (Nˡ) | finite |
//! | | `skip` | () | index of a layer after the first, counted from 0; 0 in files and `None` here for none |
//! | y | `y` | (M, Nᴸ) | |
//!
//! In files the layers are concatenated: `weights` contains all Wˡ, `biases` all bˡ, and `widths` is (K, N⁰,
//! …, Nᴸ).
//!
//! # Rounding
//! Each layer rounds as [`mod@super::linear`]; max(0, ·) is exact.
//!
//! # Kinks and domain
//! max(0, z) has gradient 0 at z = 0; a z that is NaN stays NaN. There is at least one layer, and `skip` is a
//! layer after the first.
//!
//! # Adjoint
//! The adjoints of [`mod@super::linear`] are applied from the last layer to the first; between two layers
//! z̄ = ȳ where y > 0, else 0. The gradient of x is that of the skip connection, to which that of the first
//! layer is added. The inputs of all layers are saved.
//!
//! Twin: `reference::nn::mlp`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::mlp::{In, Layer, forward};
//! let layers = [Layer { weight: &[1.0, -1.0], bias: &[0.0, 0.5] }, Layer { weight: &[2.0, 4.0], bias: &[1.0] }];
//! let (y, _) = forward(&In { x: &[3.0], layers: &layers, m: 1, skip: None });
//! assert_eq!(y, [7.0]); // 2·max(0, 3) + 4·max(0, 0.5 − 3) + 1
//! ```

use super::linear;
use crate::num::par;

/// Values per task of an elementwise loop.
const CHUNK: usize = 1 << 14;
/// Rows per task of an elementwise loop over cotangents.
const ROWS: usize = 64;

/// One layer.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// Shape (N, K).
    pub weight: &'a [f32],
    /// Shape (N).
    pub bias: &'a [f32],
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (M, K).
    pub x: &'a [f32],
    /// The layers, first to last.
    pub layers: &'a [Layer<'a>],
    /// Number of rows M, at least 1.
    pub m: usize,
    /// Index of the layer that also receives the input; neither 0 nor beyond the last layer.
    pub skip: Option<usize>,
}

/// Inputs of every layer.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    inputs: Vec<Vec<f32>>,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (M, K); empty if not requested.
    pub x: Vec<f32>,
    /// Gradients of the weight and the bias of every layer.
    pub layers: Vec<[Vec<f32>; 2]>,
}

impl InBar {
    /// Returns zeros for the layers; the gradient of the input is not requested.
    pub fn of_layers(x: &In<'_>) -> Self {
        let zeros = |l: &Layer<'_>| [vec![0.0; l.weight.len()], vec![0.0; l.bias.len()]];
        Self { x: Vec::new(), layers: x.layers.iter().map(zeros).collect() }
    }
}

impl In<'_> {
    fn hold_to_domain(&self) {
        assert!(!self.layers.is_empty() && self.m > 0, "at least one layer and one row");
        assert!(self.skip.is_none_or(|l| 0 < l && l < self.layers.len()), "skip is a layer after the first");
    }
}

impl Layer<'_> {
    /// Returns N and K.
    fn sizes(&self) -> [usize; 2] {
        [self.bias.len(), self.weight.len() / self.bias.len()]
    }

    fn input<'a>(&'a self, x: &'a [f32], m: usize) -> linear::In<'a> {
        let [n, k] = self.sizes();
        linear::In { x, weight: self.weight, bias: self.bias, m, n, k }
    }
}

/// Returns the network's output y and the intermediate values that the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, if there is no layer or no row, or if `skip` is
/// not a layer after the first.
pub fn forward(x: &In<'_>) -> (Vec<f32>, Saved) {
    x.hold_to_domain();
    let mut saved = Saved::default();
    let mut value = x.x.to_vec();
    for (l, layer) in x.layers.iter().enumerate() {
        if x.skip == Some(l) {
            value = beside(&value, x.x, x.m);
        }
        let mut y = vec![0.0; x.m * layer.bias.len()];
        linear::forward(layer.input(&value, x.m), &mut y);
        if l + 1 < x.layers.len() {
            par::chunks_mut(&mut y, CHUNK, |_, y| {
                for v in y {
                    *v = if *v <= 0.0 { 0.0 } else { *v };
                }
            });
        }
        saved.inputs.push(std::mem::replace(&mut value, y));
    }
    (value, saved)
}

/// Adds the gradients for the cotangent `y_bar` (M, Nᴸ) to `x_bar`.
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(x: &In<'_>, saved: &Saved, y_bar: &[f32], x_bar: &mut InBar) {
    x.hold_to_domain();
    let width = x.x.len() / x.m;
    let mut bar = y_bar.to_vec();
    for (l, layer) in x.layers.iter().enumerate().rev() {
        let (input, [_, k]) = (&saved.inputs[l], layer.sizes());
        let [weight, bias] = std::mem::take(&mut x_bar.layers[l]);
        let into = if l > 0 { vec![0.0; input.len()] } else { std::mem::take(&mut x_bar.x) };
        let mut grad = linear::InBar { x: into, weight, bias };
        linear::adjoint(layer.input(input, x.m), &bar, &mut grad);
        x_bar.layers[l] = [grad.weight, grad.bias];
        if l == 0 {
            x_bar.x = grad.x;
            break;
        }
        let n = k - if x.skip == Some(l) { width } else { 0 };
        if n < k {
            let again = grad.x.chunks_exact(k).flat_map(|row| &row[n..]);
            x_bar.x.iter_mut().zip(again).for_each(|(bar, g)| *bar += *g);
            bar = grad.x.chunks_exact(k).flat_map(|row| &row[..n]).copied().collect();
        } else {
            bar = grad.x;
        }
        // The saved input of this layer is the output of the layer before; it is positive where the ReLU
        // passed the value.
        par::chunks_mut(&mut bar, n * ROWS, |c, bar| {
            for (r, row) in bar.chunks_exact_mut(n).enumerate() {
                let from = &input[(c * ROWS + r) * k..][..n];
                for (b, v) in row.iter_mut().zip(from) {
                    *b = if *v <= 0.0 { 0.0 } else { *b };
                }
            }
        });
    }
}

/// Concatenates each row of a with the same row of b.
fn beside(a: &[f32], b: &[f32], m: usize) -> Vec<f32> {
    let rows = a.chunks_exact(a.len() / m).zip(b.chunks_exact(b.len() / m));
    rows.flat_map(|(a, b)| a.iter().chain(b)).copied().collect()
}
