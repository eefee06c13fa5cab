//! The network of the heads: linear maps without bias with ReLU, max(0, ·), between them. It is not an operator
//! of its own; [`super::sdf_head`] and its neighbours run it.
//!
//! y⁰ = x,   yˡ = max(0, Wˡ yˡ⁻¹) for l < L,   y = Wᴸ yᴸ⁻¹
//!
//! # Rounding
//! Each layer rounds as [`linear`] without bias; max(0, ·) is exact.
//!
//! # Kinks and domain
//! max(0, z) has gradient 0 at z = 0; a z that is NaN stays NaN.
//!
//! # Adjoint
//! The adjoints of [`linear`] from the last layer to the first; between two layers z̄ = ȳ where y > 0, else 0.
//! The outputs of the hidden layers are saved.

use crate::nn::linear;
use crate::num::par;

/// Values per task of an elementwise loop.
const CHUNK: usize = 1 << 14;

/// Weights of a network.
#[derive(Clone, Copy, Debug)]
pub struct Network<'a> {
    /// Shape (Nˡ, Nˡ⁻¹) of every layer; at least one.
    pub weights: &'a [&'a [f32]],
    /// Number of inputs N⁰.
    pub inputs: usize,
}

/// Outputs of the hidden layers.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    hidden: Vec<Vec<f32>>,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetworkBar {
    /// Shape (M, N⁰); empty if not requested.
    pub x: Vec<f32>,
    /// Gradient of the weights of every layer.
    pub weights: Vec<Vec<f32>>,
}

impl<'a> Network<'a> {
    /// Returns the widths N⁰, …, Nᴸ.
    ///
    /// # Panics
    /// Panics if there is no layer, or if a layer does not have the size of its shape.
    pub fn widths(&self) -> Vec<usize> {
        assert!(!self.weights.is_empty() && self.inputs > 0, "at least one layer and one input");
        let mut widths = vec![self.inputs];
        for weight in self.weights {
            let k = widths[widths.len() - 1];
            assert!(!weight.is_empty() && weight.len().is_multiple_of(k), "a layer is (N, K)");
            widths.push(weight.len() / k);
        }
        widths
    }

    fn layer<'b>(&self, l: usize, widths: &[usize], x: &'b [f32]) -> linear::In<'b>
    where
        'a: 'b,
    {
        let (n, k) = (widths[l + 1], widths[l]);
        linear::In { x, weight: self.weights[l], bias: &[], m: x.len() / k, n, k }
    }
}

/// Returns y (M, Nᴸ) of the rows `x` (M, N⁰), and the intermediate values that the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(network: &Network<'_>, x: &[f32]) -> (Vec<f32>, Saved) {
    let widths = network.widths();
    assert!(x.len().is_multiple_of(network.inputs), "complete rows");
    let m = x.len() / network.inputs;
    let mut saved = Saved::default();
    for l in 0..network.weights.len() {
        let input = saved.hidden.last().map_or(x, Vec::as_slice);
        let mut y = vec![0.0; m * widths[l + 1]];
        linear::forward(network.layer(l, &widths, input), &mut y);
        if l + 1 == network.weights.len() {
            return (y, saved);
        }
        par::chunks_mut(&mut y, CHUNK, |_, y| {
            for v in y {
                *v = if *v <= 0.0 { 0.0 } else { *v };
            }
        });
        saved.hidden.push(y);
    }
    unreachable!("the last layer returns")
}

/// Adds the gradients for the cotangent `y_bar` (M, Nᴸ) to `bar`.
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(network: &Network<'_>, x: &[f32], saved: &Saved, y_bar: &[f32], bar: &mut NetworkBar) {
    let widths = network.widths();
    let mut cotangent = y_bar.to_vec();
    for l in (0..network.weights.len()).rev() {
        let input = if l > 0 { &saved.hidden[l - 1] } else { x };
        let into = if l > 0 { vec![0.0; input.len()] } else { std::mem::take(&mut bar.x) };
        let weight = std::mem::take(&mut bar.weights[l]);
        let mut own = linear::InBar { x: into, weight, bias: Vec::new() };
        linear::adjoint(network.layer(l, &widths, input), &cotangent, &mut own);
        bar.weights[l] = own.weight;
        if l == 0 {
            bar.x = own.x;
            return;
        }
        cotangent = own.x;
        // The input of this layer is positive where the ReLU before it passed the value.
        par::chunks_mut(&mut cotangent, CHUNK, |c, cotangent| {
            for (g, v) in cotangent.iter_mut().zip(&input[c * CHUNK..]) {
                *g = if *v <= 0.0 { 0.0 } else { *g };
            }
        });
    }
}
