//! `nn.decoder`: a network evaluated at every coordinate of a template, conditioned on factors.
//!
//! h₁ = λ(W_t γ + W_z z + b₀),  h₂ = λ(W₁h₁ + b₁),  h₃ = λ(W₂h₂ + b₂),  R = base + scale∘(W₃h₃ + b₃)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | γ | `codes` | (B, Q, F) |
//! | z | `z` | (B, D) |
//! | W_t, W_z | `point`, `latent` | (H0, F), (H0, D) |
//! | W₁, W₂, W₃ | `weight1`, `weight2`, `weight3` | (H1, H0), (H2, H1), (O, H2) |
//! | b₀ … b₃ | `bias0` … `bias3` | (H0), (H1), (H2), (O) |
//! | | `base`, `scale` | (B, Q, O), (O) |
//! | R | `points` | (B, Q, O) |
//!
//! # Kinks and domain
//! λ is the leaky ReLU of slope 0.2; at 0 its slope is 0.2.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.decoder`.
    pub struct In<'a, S> {
        codes: &'a Arr<S> = Port::fixed("B,Q,F", "code of every coordinate"),
        z: &'a Arr<S> = Port::var("B,D", "factors of every item"),
        point: &'a Arr<S> = Port::var("H0,F", "weights of the codes"),
        latent: &'a Arr<S> = Port::var("H0,D", "weights of the factors"),
        bias0: &'a Arr<S> = Port::var("H0", ""),
        weight1: &'a Arr<S> = Port::var("H1,H0", ""),
        bias1: &'a Arr<S> = Port::var("H1", ""),
        weight2: &'a Arr<S> = Port::var("H2,H1", ""),
        bias2: &'a Arr<S> = Port::var("H2", ""),
        weight3: &'a Arr<S> = Port::var("O,H2", ""),
        bias3: &'a Arr<S> = Port::var("O", ""),
        base: &'a Arr<S> = Port::fixed("B,Q,O", "added to the scaled output of the network"),
        scale: &'a Arr<S> = Port::fixed("O", "scale of the network's output"),
    }
}

/// `nn.decoder`
pub static SIGNATURE: Signature = Signature {
    name: "nn.decoder",
    summary: "points of a template from factors, by a network evaluated at every coordinate",
    inputs: In::<f64>::PORTS,
    outputs: ports![points: Port::var("B,Q,O", "")],
    ..Signature::EMPTY
};

/// W x + b.
fn affine<S: Scalar>(weight: &Arr<S>, x: &[S], bias: &Arr<S>) -> Vec<S> {
    let row = |n: usize| {
        let products = weight.data[n * x.len()..(n + 1) * x.len()].iter().zip(x);
        products.fold(S::zero(), |sum, (w, x)| sum + *w * *x) + bias.data[n]
    };
    (0..bias.data.len()).map(row).collect()
}

fn leaky<S: Scalar>(x: Vec<S>) -> Vec<S> {
    x.into_iter().map(|x| if x.value() > 0.0 { x } else { x * 0.2 }).collect()
}

/// The twin of `nn.decoder`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let [batch, count, features] = [0, 1, 2].map(|axis| input.codes.shape[axis]);
    let (d, outputs) = (input.z.shape[1], input.scale.data.len());
    let points = out.array("points", &[batch, count, outputs]);
    for at in 0..batch * count {
        let item = at / count;
        let shift = affine(input.latent, &input.z.data[item * d..(item + 1) * d], input.bias0);
        let code = &input.codes.data[at * features..(at + 1) * features];
        let zeros = Arr::filled(&[shift.len()], S::zero());
        let sums = affine(input.point, code, &zeros).into_iter().zip(shift).map(|(a, b)| a + b).collect();
        let mut h = leaky(sums);
        h = leaky(affine(input.weight1, &h, input.bias1));
        h = leaky(affine(input.weight2, &h, input.bias2));
        for (c, y) in affine(input.weight3, &h, input.bias3).into_iter().enumerate() {
            let index = at * outputs + c;
            out.put(points, index, input.base.data[index] + input.scale.data[c] * y);
        }
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out);
    Ok(())
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let x = In::of(call.arrays)?;
    let weights = [x.point, x.latent, x.weight1, x.weight2, x.weight3];
    Ok((x.codes.shape[0] * x.codes.shape[1]) as u64 * weights.iter().fold(0, |n, w| n + w.data.len() as u64))
}
